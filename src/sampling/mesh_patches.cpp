#include "mesh_patches.h"

#include "core/union_find.h"
#include "spatial/point_triangle.h"
#include "spatial/triangle_tree.h"
#include "winding_number.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <tbb/parallel_for.h>
#include <tuple>

namespace mpuvdb
{
namespace
{

/// Mean winding number that counts as 0. [derived: error of the two terms of Barill18 at kOpenness]
constexpr double kFlat = 0.01;
/// Least cosine of the angle of rims that run along each other. [derived: 60 degrees, halfway]
constexpr double kAlong = 0.5;
/// Distance from a whole number that is nearer to it than to a half. [derived: half of that]
constexpr double kNearWhole = 0.25;
/// Places of a patch whose sides are measured, on its largest triangles. [derived: means within
/// 1/4, the limit of sheets, from values within 1/2 of each other]
constexpr std::size_t kMeasured = 16;

/// Finds the patches and turns them.
class PatchTurner
{
public:
    PatchTurner(OrientedTriangles& of, double gap, Interrupter& progress)
        : mOf(of), mGap(gap), mProgress(progress)
    {
    }

    MeshPatches run()
    {
        findPatches();
        if (!mOf.isClosed() && mAreas.size() > 1) linkRims();
        const TriangleTree tree(mOf.mesh, mProgress);
        const WindingNumber winding(tree, mOf);
        measure(winding);
        turnInward();
        return std::move(mPatches);
    }

private:
    Vec3d corner(std::uint32_t n, std::size_t k) const
    {
        return mOf.mesh.positions[mOf.mesh.triangles[n][k]].cast<double>();
    }
    Vec3d areaVector(std::uint32_t n) const
    {
        return (corner(n, 1) - corner(n, 0)).cross(corner(n, 2) - corner(n, 0)) / 2;
    }

    /// Number the patches.
    void findPatches()
    {
        const std::size_t count = mOf.mesh.triangles.size();
        UnionFind parts(count);
        for (std::uint32_t n = 0; n < count; ++n)
            for (const std::uint32_t m : mOf.neighbors[n])
                if (m != kNoTriangle) parts.join(n, m);
        std::vector<std::uint32_t>& patchOf = mPatches.patchOf;
        patchOf.resize(count);
        for (std::uint32_t n = 0; n < count; ++n) { // a root is the first of its part
            const std::uint32_t root = parts.find(n);
            if (root == n) {
                mAreas.push_back(0);
                mPatches.isWall.push_back(0);
            }
            patchOf[n] = root == n ? std::uint32_t(mAreas.size() - 1) : patchOf[root];
            mAreas[patchOf[n]] += areaVector(n).norm();
            for (const std::uint32_t m : mOf.neighbors[n])
                if (m == kNoTriangle) mPatches.isWall[patchOf[n]] = 1; // if it is open;
        }
        mGroup.resize(mAreas.size());
        std::iota(mGroup.begin(), mGroup.end(), 0u);
    }

    /// An edge without a neighbor.
    struct Rim {
        std::uint32_t patch;
        Vec3d a, b;

        Vec3d along() const { return (b - a).normalized(); }
    };

    std::vector<Rim> rims() const
    {
        std::vector<Rim> rims;
        for (std::uint32_t n = 0; n < mOf.neighbors.size(); ++n)
            for (std::size_t k = 0; k < 3; ++k)
                if (mOf.neighbors[n][k] == kNoTriangle)
                    rims.push_back({mPatches.patchOf[n], corner(n, k), corner(n, (k + 1) % 3)});
        return rims;
    }

    /// The rim of another patch that is nearest to the middle of rim @a n, runs along it and is
    /// within the gap and no farther than rim @a n is long, of those equally near that of the
    /// largest patch; kNoTriangle if there is none.
    std::uint32_t beside(const std::vector<Rim>& rims, const TriangleTree& tree,
                         std::uint32_t n) const
    {
        const Vec3d middle = (rims[n].a + rims[n].b) / 2;
        std::uint32_t best = kNoTriangle;
        const double gap = std::min(mGap, (rims[n].b - rims[n].a).norm());
        double least = gap * gap;
        tree.forEachNear(middle, gap, [&](std::size_t slot) {
            const std::uint32_t m = tree.triangle(slot);
            if (rims[m].patch == rims[n].patch) return;
            if (std::abs(rims[m].along().dot(rims[n].along())) < kAlong) return;
            const double distance2 = squaredDistance(middle, rims[m].a, rims[m].b);
            if (distance2 > least) return;
            if (distance2 == least && best != kNoTriangle) {
                const double area = mAreas[rims[m].patch], other = mAreas[rims[best].patch];
                if (area < other || (area == other && m > best)) return;
            }
            least = distance2;
            best = m;
        });
        return best;
    }

    /// Two patches, and the length of rims along which they agree less that along which they do
    /// not.
    struct Link {
        std::uint32_t a, b;
        double agreed;
    };

    std::vector<Link> links() const
    {
        const std::vector<Rim> rims = this->rims();
        if (rims.empty()) return {};
        Mesh edges; // triangles without an area
        for (const Rim& rim : rims) {
            const auto first = std::uint32_t(edges.positions.size());
            edges.positions.push_back(rim.a.cast<float>());
            edges.positions.push_back(rim.b.cast<float>());
            edges.triangles.push_back({first, first + 1, first + 1});
        }
        const TriangleTree tree(edges, mProgress);
        std::vector<std::uint32_t> others(rims.size());
        tbb::parallel_for(tbb::blocked_range<std::size_t>(0, rims.size(), 64),
                          [&](const auto& range) {
                              mProgress.check();
                              for (std::size_t n = range.begin(); n < range.end(); ++n)
                                  others[n] = beside(rims, tree, std::uint32_t(n));
                          });
        std::map<std::pair<std::uint32_t, std::uint32_t>, double> agreed;
        for (std::size_t n = 0; n < rims.size(); ++n) {
            if (others[n] == kNoTriangle) continue;
            const Rim &rim = rims[n], &other = rims[others[n]];
            agreed[std::minmax(rim.patch, other.patch)] -=
                (rim.b - rim.a).norm() * rim.along().dot(other.along());
        }
        std::vector<Link> links;
        for (const auto& [parts, length] : agreed)
            if (length != 0) links.push_back({parts.first, parts.second, length});
        return links;
    }

    /// Turn patches to agree with those along whose rims theirs run, the longest rims first; most
    /// of the area stays.
    void linkRims()
    {
        std::vector<Link> links = this->links();
        std::sort(links.begin(), links.end(), [](const Link& x, const Link& y) {
            return std::make_tuple(-std::abs(x.agreed), x.a, x.b) <
                   std::make_tuple(-std::abs(y.agreed), y.a, y.b);
        });
        UnionFind groups(mAreas.size());
        std::vector<std::vector<std::uint32_t>> members(mAreas.size()); // by root
        for (std::uint32_t p = 0; p < members.size(); ++p) members[p] = {p};
        std::vector<std::uint8_t> isTurned(mAreas.size(), 0);
        for (const Link& link : links) {
            std::uint32_t keeps = groups.find(link.a), joins = groups.find(link.b);
            if (keeps == joins) continue;
            const bool turns = (isTurned[link.a] != isTurned[link.b]) == (link.agreed > 0);
            if (members[keeps].size() < members[joins].size()) std::swap(keeps, joins);
            for (const std::uint32_t p : members[joins]) isTurned[p] ^= std::uint8_t(turns);
            groups.join(keeps, joins);
            std::vector<std::uint32_t> all = std::move(members[keeps]);
            all.insert(all.end(), members[joins].begin(), members[joins].end());
            members[joins] = {};
            members[groups.find(keeps)] = std::move(all);
        }
        for (const auto& group : members) {
            double balance = 0; // area that stays less area that is turned
            for (const std::uint32_t p : group) balance += isTurned[p] ? -mAreas[p] : mAreas[p];
            if (balance < 0)
                for (const std::uint32_t p : group) isTurned[p] ^= 1;
        }
        for (std::uint32_t p = 0; p < mGroup.size(); ++p) mGroup[p] = groups.find(p);
        turnAll(isTurned);
    }

    /// Turn the patches that @a isTurned tells.
    void turnAll(const std::vector<std::uint8_t>& isTurned)
    {
        for (const std::uint8_t turned : isTurned) mPatches.turned += turned;
        for (std::uint32_t n = 0; n < mPatches.patchOf.size(); ++n)
            if (isTurned[mPatches.patchOf[n]]) turn(n);
    }

    void turn(std::uint32_t n)
    {
        std::swap(mOf.mesh.triangles[n][1], mOf.mesh.triangles[n][2]);
        std::swap(mOf.neighbors[n][0], mOf.neighbors[n][2]);
        ++mOf.turned;
    }

    /// Measure what the patches enclose.
    void measure(const WindingNumber& winding)
    {
        mLargest.resize(mAreas.size());
        for (std::uint32_t n = 0; n < mPatches.patchOf.size(); ++n)
            mLargest[mPatches.patchOf[n]].push_back({-areaVector(n).norm(), n});
        mPatches.enclosed.assign(mLargest.size(), 0);
        tbb::parallel_for(std::size_t(0), mLargest.size(), [&](std::size_t patch) {
            mProgress.check();
            auto& largest = mLargest[patch];
            const std::size_t count = std::min(kMeasured, largest.size());
            std::partial_sort(largest.begin(), largest.begin() + std::ptrdiff_t(count),
                              largest.end());
            double sum = 0, area = 0, ofWalls = 0;
            for (std::size_t k = 0; k < count; ++k) {
                const Places places = placesOn(largest[k].second, mPatches.isWall[patch], count);
                for (const Vec3d& place : places) {
                    const double own = -largest[k].first / double(places.size()),
                                 mean = sidesMean(winding, largest[k].second, place);
                    sum += own * mean;
                    area += own;
                    if (std::abs(mean - std::round(mean)) < kNearWhole) ofWalls += own;
                }
            }
            if (area > 0) mPatches.enclosed[patch] = sum / area;
            if (ofWalls <= area / 2) mPatches.isWall[patch] = 0;
        });
        mLargest = {};
    }

    using Places = std::vector<Vec3d>;

    /// Where the sides of triangle @a n are measured: in its middle; if it is one of @a few of an
    /// open patch, also about that, as a surface may pass there.
    Places placesOn(std::uint32_t n, bool isOpen, std::size_t few) const
    {
        constexpr std::size_t kPlaces = 4; ///< on a triangle [derived: the middle, three about it]
        const Vec3d middle = (corner(n, 0) + corner(n, 1) + corner(n, 2)) / 3;
        Places places{middle};
        for (std::size_t k = 0; k < 3 && isOpen && kPlaces * few <= kMeasured; ++k)
            places.push_back((middle + corner(n, k)) / 2);
        return places;
    }

    /// The mean of the winding numbers on the sides of triangle @a n at @a place.
    double sidesMean(const WindingNumber& winding, std::uint32_t n, const Vec3d& place) const
    {
        /// Distance from the triangle, of its size. [derived: roundings of floats, thousandfold]
        constexpr double kStep = 1e-4;
        const Vec3d area = areaVector(n);
        if (!(area.norm() > 0)) return 0;
        const Vec3d step = kStep / std::sqrt(area.norm()) * area;
        return (winding.at(place + step) + winding.at(place - step)) / 2;
    }

    /// Turn groups of patches before which the winding number is higher than behind them.
    void turnInward()
    {
        std::vector<double> sums(mAreas.size(), 0), areas(mAreas.size(), 0); // by group
        for (std::uint32_t p = 0; p < mAreas.size(); ++p) {
            sums[mGroup[p]] += mAreas[p] * mPatches.enclosed[p];
            areas[mGroup[p]] += mAreas[p];
        }
        std::vector<std::uint8_t> isTurned(mAreas.size());
        for (std::uint32_t p = 0; p < mAreas.size(); ++p) {
            isTurned[p] = sums[mGroup[p]] < -kFlat * areas[mGroup[p]];
            if (isTurned[p]) mPatches.enclosed[p] = -mPatches.enclosed[p];
        }
        turnAll(isTurned);
    }

    OrientedTriangles& mOf;
    double mGap;
    Interrupter& mProgress;
    std::vector<double> mAreas;        ///< by patch
    std::vector<std::uint32_t> mGroup; ///< of patches whose rims run along each other, by patch
    MeshPatches mPatches;
    std::vector<std::vector<std::pair<double, std::uint32_t>>>
        mLargest; ///< triangles by patch, with their areas, negative
};

} // namespace

MeshPatches turnPatches(OrientedTriangles& triangles, double gap, Interrupter& progress)
{
    return PatchTurner(triangles, gap, progress).run();
}

} // namespace mpuvdb
