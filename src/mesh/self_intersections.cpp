#include "spatial/triangle_tree.h"

#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{
namespace
{

__extension__ using Int128 = __int128;

/// A position as whole numbers up to 2^30, so that signs of volumes are exact.
using Place = std::array<std::int64_t, 3>;
using Corners = std::array<Place, 3>;

/// The tree's level whose pairs of nodes are tasks. [free: grain size]
constexpr std::size_t kTaskLevels = 12;

/// The mesh's size in steps of the rounded positions. [derived: differences and their products
/// stay below 2^31 and 2^95]
constexpr double kSteps = double(std::int64_t(1) << 30);

class Rounding
{
public:
    explicit Rounding(const Mesh& mesh)
    {
        Eigen::AlignedBox3f box;
        for (const Vec3f& p : mesh.positions) box.extend(p);
        mFrom = box.min().cast<double>();
        const double size = (box.max().cast<double>() - mFrom).maxCoeff();
        mScale = size > 0 ? kSteps / size : 0;
    }
    Corners operator()(const TriangleTree::Corners& corners) const
    {
        Corners rounded{};
        for (std::size_t n = 0; n < 3; ++n)
            for (int k = 0; k < 3; ++k)
                rounded[n][std::size_t(k)] = // not below 0
                    std::int64_t(mScale * (double(corners[n][k]) - mFrom[k]));
        return rounded;
    }

    /// The distance from a triangle's plane, a few steps, beyond which rounding changes no side.
    double margin() const { return mScale > 0 ? 16 / mScale : 0; }

private:
    Vec3d mFrom;
    double mScale = 0;
};

int signOf(double v)
{
    return (v > 0) - (v < 0);
}

/// The sign of the volume of the tetrahedron a, b, c, @a d: +1, 0 or -1, exactly.
int orientation(const Place& a, const Place& b, const Place& c, const Place& d)
{
    std::int64_t u[3], v[3], w[3]; // below 2^31
    double sizeU = 0, sizeV = 0, sizeW = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        u[k] = a[k] - d[k], v[k] = b[k] - d[k], w[k] = c[k] - d[k];
        sizeU = std::max(sizeU, std::abs(double(u[k])));
        sizeV = std::max(sizeV, std::abs(double(v[k])));
        sizeW = std::max(sizeW, std::abs(double(w[k])));
    }
    const auto volume = [&](auto number) {
        using T = decltype(number);
        return T(u[0]) * (T(v[1]) * T(w[2]) - T(v[2]) * T(w[1])) +
               T(u[1]) * (T(v[2]) * T(w[0]) - T(v[0]) * T(w[2])) +
               T(u[2]) * (T(v[0]) * T(w[1]) - T(v[1]) * T(w[0]));
    };
    // Six products of three factors, each with a few roundings.
    const double rough = volume(double()), error = 1e-14 * sizeU * sizeV * sizeW;
    if (std::abs(rough) > error) return signOf(rough);
    const Int128 exact = volume(Int128());
    return (exact > 0) - (exact < 0);
}

/// The sides of a triangle's plane that the corners of another lie on.
std::array<int, 3> sidesOf(const Corners& plane, const Corners& of)
{
    std::array<int, 3> sides{};
    for (std::size_t n = 0; n < 3; ++n) sides[n] = orientation(plane[0], plane[1], plane[2], of[n]);
    return sides;
}

bool onOneSide(const std::array<int, 3>& sides)
{
    const auto [least, most] = std::minmax_element(sides.begin(), sides.end());
    return *least >= 0 || *most <= 0;
}

/// Turn @a corners so that the first is alone on its side of a plane.
/// @param sides  that the corners lie on, not all of them on one. @return the first one's.
int bringFirst(Corners& corners, std::array<int, 3> sides)
{
    while (sides[0] == 0 || sides[0] == sides[1] || sides[0] == sides[2]) {
        std::rotate(corners.begin(), corners.begin() + 1, corners.end());
        std::rotate(sides.begin(), sides.begin() + 1, sides.end());
    }
    return sides[0];
}

/// Whether the insides of two triangles meet that do not lie in a plane: each has a part of the
/// line that both planes share, and the parts overlap. [Guigue03]
bool cross(Corners a, Corners b)
{
    const std::array<int, 3> ofB = sidesOf(a, b);
    if (onOneSide(ofB)) return false;
    const std::array<int, 3> ofA = sidesOf(b, a);
    if (onOneSide(ofA)) return false;
    const int sideOfA = bringFirst(a, ofA), sideOfB = bringFirst(b, ofB);
    if (sideOfA > 0) std::swap(b[1], b[2]);
    if (sideOfB > 0) std::swap(a[1], a[2]);
    return orientation(a[0], a[1], b[0], b[1]) > 0 && orientation(a[0], a[2], b[2], b[0]) > 0;
}

/// Finds the crossing pairs among the triangles of two leaves.
class LeafPairs
{
public:
    LeafPairs(const Mesh& mesh, const TriangleTree& tree) : mMesh(mesh), mTree(tree), mRound(mesh)
    {
    }

    /// @param a, b  leaves, a <= b.
    void find(std::size_t a, std::size_t b, std::vector<TrianglePair>& pairs) const
    {
        const TriangleTree::Box& other = mTree.leafBox(b);
        for (std::size_t i = mTree.firstSlot(a); i < mTree.firstSlot(a + 1); ++i) {
            const TriangleTree::Box box = boxOf(i);
            if (!box.intersects(other)) continue;
            const Plane plane(mTree.corners(i));
            for (std::size_t j = std::max(i + 1, mTree.firstSlot(b)); j < mTree.firstSlot(b + 1);
                 ++j)
                if (box.intersects(boxOf(j)) && mayCross(i, plane, j) &&
                    cross(mRound(mTree.corners(i)), mRound(mTree.corners(j))))
                    pairs.push_back({std::min(mTree.triangle(i), mTree.triangle(j)),
                                     std::max(mTree.triangle(i), mTree.triangle(j))});
        }
    }

private:
    struct Plane {
        Vec3d origin, normal; ///< of length 1, or 0
        explicit Plane(const TriangleTree::Corners& c)
            : origin(c[0].cast<double>()),
              normal((c[1].cast<double>() - origin).cross(c[2].cast<double>() - origin))
        {
            normal.normalize();
        }
    };

    TriangleTree::Box boxOf(std::size_t slot) const
    {
        const TriangleTree::Corners& c = mTree.corners(slot);
        return {c[0].cwiseMin(c[1]).cwiseMin(c[2]), c[0].cwiseMax(c[1]).cwiseMax(c[2])};
    }

    /// False where the two share an edge, and where the second's corners that they do not share
    /// lie on one side of the first's @a plane, farther from it than rounding moves them.
    bool mayCross(std::size_t i, const Plane& plane, std::size_t j) const
    {
        const Mesh::Triangle &first = mMesh.triangles[mTree.triangle(i)],
                             &second = mMesh.triangles[mTree.triangle(j)];
        int common = 0;
        bool isAbove = true, isBelow = true;
        for (std::size_t n = 0; n < 3; ++n) {
            if (std::count(first.begin(), first.end(), second[n]) > 0) {
                ++common;
                continue;
            }
            const double height =
                plane.normal.dot(mTree.corners(j)[n].cast<double>() - plane.origin);
            isAbove &= height > mRound.margin();
            isBelow &= height < -mRound.margin();
        }
        return common < 2 && !isAbove && !isBelow;
    }

    const Mesh& mMesh;
    const TriangleTree& mTree;
    Rounding mRound;
};

} // namespace

std::vector<TrianglePair> findSelfIntersections(const Mesh& mesh, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (mesh.triangles.empty()) return {};
    progress.beginStage("intersections");
    const TriangleTree tree(mesh, progress);
    const LeafPairs leafPairs(mesh, tree);
    std::vector<std::array<std::size_t, 2>> tasks;
    tree.forEachPair(std::min(tree.levels(), kTaskLevels), [&](std::size_t a, std::size_t b) {
        tasks.push_back({a, b});
    });
    tbb::enumerable_thread_specific<std::vector<TrianglePair>> found;
    tbb::parallel_for(std::size_t(0), tasks.size(), [&](std::size_t n) {
        progress.check();
        std::vector<TrianglePair>& mine = found.local();
        tree.forEachLeafPair(tasks[n][0], tasks[n][1],
                             [&](std::size_t a, std::size_t b) { leafPairs.find(a, b, mine); });
    });
    std::vector<TrianglePair> pairs;
    for (const auto& some : found) pairs.insert(pairs.end(), some.begin(), some.end());
    tbb::parallel_sort(pairs.begin(), pairs.end());
    progress.endStage();
    return pairs;
}

} // namespace mpuvdb
