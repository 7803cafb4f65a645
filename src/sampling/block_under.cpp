#include <mpuvdb/block_under.h>

#include "core/union_find.h"
#include "core/whole_triangle.h"
#include "oriented_triangles.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <fmt/format.h>
#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

namespace mpuvdb
{
namespace
{

/// Makes the block: under each triangle there is its projection on the base, turned down; walls
/// join the rims of the two.
class BlockMaker
{
public:
    BlockMaker(const OrientedTriangles& surface, const Vec3d& up, double depth)
        : mSurface(surface), mUp(up), mFirst(std::uint32_t(surface.mesh.positions.size()))
    {
        double lowest = HUGE_VAL;
        for (const Mesh::Triangle& t : surface.mesh.triangles)
            for (const std::uint32_t corner : t) lowest = std::min(lowest, mUp.dot(at(corner)));
        mBase = lowest - depth;
    }

    /// Twice the area of the surface as seen from above, less that seen from below.
    double areaFromAbove() const
    {
        double area = 0;
        for (const Mesh::Triangle& t : mSurface.mesh.triangles)
            area += mUp.dot((at(t[1]) - at(t[0])).cross(at(t[2]) - at(t[0])));
        return area;
    }

    Mesh make(bool isTurned)
    {
        mMesh.frame = mSurface.mesh.frame;
        mMesh.positions = mSurface.mesh.positions;
        for (std::uint32_t n = 0; n < mFirst; ++n)
            mMesh.positions.push_back(onBase(at(n)).cast<float>());
        for (Mesh::Triangle t : mSurface.mesh.triangles) {
            if (isTurned) std::swap(t[1], t[2]);
            mMesh.triangles.push_back(t);
            mMesh.triangles.push_back({below(t[0]), below(t[2]), below(t[1])});
        }
        findRims(isTurned);
        closeRims();
        return std::move(mMesh);
    }

private:
    Vec3d at(std::uint32_t vertex) const { return mSurface.mesh.positions[vertex].cast<double>(); }
    Vec3d onBase(const Vec3d& p) const { return p + (mBase - mUp.dot(p)) * mUp; }
    std::uint32_t below(std::uint32_t vertex) const { return mFirst + vertex; }

    void findRims(bool isTurned)
    {
        for (std::uint32_t n = 0; n < mSurface.neighbors.size(); ++n)
            for (std::size_t k = 0; k < 3; ++k) {
                if (mSurface.neighbors[n][k] != kNoTriangle) continue;
                const Mesh::Triangle& t = mSurface.mesh.triangles[n];
                mRims.push_back({t[k], t[(k + 1) % 3]});
                if (isTurned) std::swap(mRims.back().first, mRims.back().second);
            }
    }

    /// Walls below the rims that go around the surface counter-clockwise, as seen from above; under
    /// the others, which bound its holes, the base goes on, by a fan about their middle.
    void closeRims()
    {
        UnionFind loops(mFirst);
        for (const auto& [a, b] : mRims) loops.join(a, b);
        struct Loop {
            Vec3d middle = Vec3d::Zero(); ///< sum of its vertices
            double area = 0;              ///< twice that inside, from above
            std::uint32_t edges = 0, apex = 0;
        };
        std::unordered_map<std::uint32_t, Loop> byRoot;
        const Vec3d origin = at(mRims.front().first);
        for (const auto& [a, b] : mRims) {
            Loop& loop = byRoot[loops.find(a)];
            loop.middle += at(a);
            loop.area += mUp.dot((at(a) - origin).cross(at(b) - origin));
            ++loop.edges;
        }
        for (const auto& [a, b] : mRims) {
            Loop& loop = byRoot[loops.find(a)];
            if (loop.area > 0) {
                mMesh.triangles.push_back({b, a, below(a)});
                mMesh.triangles.push_back({b, below(a), below(b)});
                continue;
            }
            if (loop.apex == 0) {
                loop.apex = std::uint32_t(mMesh.positions.size());
                mMesh.positions.push_back(onBase(loop.middle / loop.edges).cast<float>());
            }
            mMesh.triangles.push_back({below(a), below(b), loop.apex});
        }
    }

    const OrientedTriangles& mSurface;
    Vec3d mUp;
    double mBase = 0;     ///< height of the base, relative to the frame
    std::uint32_t mFirst; ///< vertex of the base
    std::vector<std::pair<std::uint32_t, std::uint32_t>> mRims;
    Mesh mMesh;
};

} // namespace

Mesh blockUnder(const Mesh& surface, const Vec3d& up, double depth, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (!(depth > 0) || !std::isfinite(depth))
        throw UsageError(fmt::format("base {:.6g}: must be above 0", depth));
    if (!up.allFinite() || !(up.norm() > 0))
        throw UsageError("up: must be a direction, not zero and finite");
    const Mesh whole = wholeTriangles(surface);
    if (whole.triangles.empty())
        throw InputError("mesh: has no triangles with finite vertices, so that no block can be "
                         "made under them. Export its faces too");
    if (whole.positions.size() > std::numeric_limits<std::uint32_t>::max() / 4)
        throw LimitError(fmt::format("mesh: {} vertices are too many for a block under them. "
                                     "Simplify it",
                                     whole.positions.size()));
    const OrientedTriangles triangles = orientTriangles(whole, Copies::Merge, progress);
    progress.check();
    if (triangles.isClosed())
        throw InputError("mesh: is closed, so that there is no rim for the walls of a block. Leave "
                         "out the base (--base)");
    BlockMaker maker(triangles, up.normalized(), depth);
    const double area = maker.areaFromAbove();
    if (area == 0)
        throw InputError("mesh: is seen from its side, so that nothing is below it. Choose another "
                         "axis (--up)");
    return maker.make(area < 0);
}

} // namespace mpuvdb
