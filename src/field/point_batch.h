// Some points near a cell, copied together so that loops over them run straight through memory.
#pragma once
#include <mpuvdb/vec.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// Some points near a cell, one contiguous array per coordinate, local coordinates.
struct PointBatch {
    std::vector<float> x, y, z, nx, ny, nz, confidence;

    std::size_t size() const { return x.size(); }
    void clear()
    {
        forEach([](std::vector<float>& a) { a.clear(); });
    }
    void resize(std::size_t n)
    {
        forEach([n](std::vector<float>& a) { a.resize(n); });
    }
    /// Add point @a i of @a from.
    void append(const PointBatch& from, std::size_t i)
    {
        x.push_back(from.x[i]);
        y.push_back(from.y[i]);
        z.push_back(from.z[i]);
        nx.push_back(from.nx[i]);
        ny.push_back(from.ny[i]);
        nz.push_back(from.nz[i]);
        confidence.push_back(from.confidence[i]);
    }
    std::size_t bytes() const { return 7 * sizeof(float) * x.capacity(); }

    template <typename F>
    void forEach(F f)
    {
        f(x), f(y), f(z), f(nx), f(ny), f(nz), f(confidence);
    }
};

/// Points of @a parent within @a radius of @a centre. @param indices  scratch.
void filterBall(const PointBatch& parent, const Vec3d& centre, double radius,
                std::vector<std::uint32_t>& indices, PointBatch& out);

/// Every @a stride th point.
void takeStrided(const PointBatch& from, std::size_t stride, PointBatch& out);

/// Median over a few points of sqrt(pi/12) d12; 0 for too few points. Points near the middle of the
/// ball, where their neighbours are in it too.
double measureSpacing(const PointBatch& ball, const Vec3d& centre, double radius);

} // namespace mpuvdb
