#include "voxel_topology.h"

#include <array>
#include <cstdlib>

namespace mpuvdb
{
namespace
{

constexpr int kCells = 27; ///< voxels of a neighborhood [derived: 3^3]
constexpr Neighborhood kAll = (1u << kCells) - 1;

constexpr Neighborhood bit(int x, int y, int z)
{
    return 1u << unsigned(9 * (x + 1) + 3 * (y + 1) + (z + 1));
}

/// For each voxel of a neighborhood the voxels in it that touch it.
struct Adjacency {
    std::array<Neighborhood, kCells> byFace{}, byCorner{};

    constexpr Adjacency()
    {
        for (int a = 0; a < kCells; ++a) {
            for (int b = 0; b < kCells; ++b) {
                int steps = 0, farthest = 0;
                for (int place = 1; place < kCells; place *= 3) {
                    const int d = a / place % 3 - b / place % 3, step = d < 0 ? -d : d;
                    steps += step;
                    farthest = step > farthest ? step : farthest;
                }
                if (steps == 1) byFace[std::size_t(a)] |= 1u << b;
                if (farthest == 1) byCorner[std::size_t(a)] |= 1u << b;
            }
        }
    }
};

constexpr Adjacency kAdjacent;

/// Mask of the voxels that share a face or an edge with the center.
constexpr Neighborhood facesAndEdges()
{
    Neighborhood all = kFaceNeighbors;
    for (int n = 0; n < kCells; ++n)
        if (kFaceNeighbors >> n & 1u) all |= kAdjacent.byFace[std::size_t(n)];
    return all & ~kCenter;
}

/// Whether exactly one component of @a voxels meets @a seeds.
bool oneComponent(Neighborhood voxels, Neighborhood seeds,
                  const std::array<Neighborhood, kCells>& adjacent)
{
    seeds &= voxels;
    if (!seeds) return false;
    Neighborhood reached = 0;
    for (Neighborhood front = seeds & (~seeds + 1); front;) {
        reached |= front;
        Neighborhood next = 0;
        for (; front; front &= front - 1) next |= adjacent[std::size_t(__builtin_ctz(front))];
        front = next & voxels & ~reached;
    }
    return (seeds & ~reached) == 0;
}

} // namespace

bool isSimple(Neighborhood around)
{
    const Neighborhood set = around & facesAndEdges(), rest = ~around & kAll & ~kCenter;
    return oneComponent(set, kFaceNeighbors, kAdjacent.byFace) &&
           oneComponent(rest, rest, kAdjacent.byCorner);
}

int eulerChange(Neighborhood around)
{
    // The complement is a union of closed cubes; without the center it loses the center's corners,
    // edges and faces that no other cube has. By duality the set gains what the complement loses.
    const Neighborhood rest = ~around & kAll & ~kCenter;
    int change = -1; // its body
    for (int n = 0; n < kCells; ++n) {
        const int at[3] = {n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1};
        const int codimension = std::abs(at[0]) + std::abs(at[1]) + std::abs(at[2]);
        if (codimension == 0) continue;
        Neighborhood sharing = 0;
        for (int x = 0; x <= std::abs(at[0]); ++x)
            for (int y = 0; y <= std::abs(at[1]); ++y)
                for (int z = 0; z <= std::abs(at[2]); ++z)
                    sharing |= bit(x * at[0], y * at[1], z * at[2]);
        if (rest & sharing) continue;
        change += codimension == 2 ? -1 : 1;
    }
    return -change;
}

} // namespace mpuvdb
