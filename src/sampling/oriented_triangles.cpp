#include "oriented_triangles.h"

#include "core/union_find.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <numeric>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

namespace mpuvdb
{
namespace
{

/// An edge of a triangle, by the corner that it starts at.
struct HalfEdge {
    std::uint32_t high; ///< end with the higher number
    std::uint32_t triangle;
    std::uint8_t corner;
    bool upward; ///< runs from the lower to the higher end
};

/// The edges of all triangles, by their ends with the lower number.
class EdgeTable
{
public:
    EdgeTable(const std::vector<Mesh::Triangle>& triangles, std::size_t vertices)
        : mFirst(vertices + 1, 0), mEdges(3 * triangles.size())
    {
        for (const Mesh::Triangle& t : triangles)
            for (std::size_t k = 0; k < 3; ++k) ++mFirst[std::min(t[k], t[(k + 1) % 3]) + 1];
        std::partial_sum(mFirst.begin(), mFirst.end(), mFirst.begin());
        std::vector<std::uint32_t> next(mFirst.begin(), mFirst.end() - 1);
        for (std::uint32_t n = 0; n < triangles.size(); ++n)
            for (std::size_t k = 0; k < 3; ++k) {
                const std::uint32_t from = triangles[n][k], to = triangles[n][(k + 1) % 3];
                mEdges[next[std::min(from, to)]++] = {std::max(from, to), n, std::uint8_t(k),
                                                      from < to};
            }
    }

    /// Call f(first, last) for the half-edges between each two vertices, from many threads.
    template <typename F>
    void forEachEdge(const F& f)
    {
        tbb::parallel_for(
            tbb::blocked_range<std::size_t>(0, mFirst.size() - 1, 4096), [&](const auto& range) {
                for (std::size_t low = range.begin(); low < range.end(); ++low) {
                    HalfEdge* const end = mEdges.data() + mFirst[low + 1];
                    HalfEdge* first = mEdges.data() + mFirst[low];
                    std::sort(first, end, [](const HalfEdge& a, const HalfEdge& b) {
                        return a.high != b.high ? a.high < b.high : a.triangle < b.triangle;
                    });
                    while (first != end) {
                        HalfEdge* last = first + 1;
                        while (last != end && last->high == first->high) ++last;
                        f(first, last);
                        first = last;
                    }
                }
            });
    }

private:
    std::vector<std::uint32_t> mFirst;
    std::vector<HalfEdge> mEdges;
};

/// For each vertex the first one at its position.
std::vector<std::uint32_t> firstAtPosition(const std::vector<Vec3f>& positions)
{
    const auto bitsOf = [&](std::size_t i) {
        const Vec3f p = positions[i] + Vec3f::Zero(); // -0 becomes 0
        std::array<std::uint32_t, 3> bits;
        std::memcpy(bits.data(), p.data(), sizeof bits);
        return bits;
    };
    std::size_t buckets = 16;
    while (buckets < 2 * positions.size()) buckets *= 2;
    std::vector<std::uint32_t> table(buckets, kNoTriangle), first(positions.size());
    for (std::uint32_t i = 0; i < positions.size(); ++i) {
        const auto bits = bitsOf(i);
        std::uint64_t hash = 0;
        for (const std::uint32_t b : bits) hash = (hash ^ b) * 0x9e3779b97f4a7c15u;
        std::size_t at = (hash >> 20) & (buckets - 1);
        while (table[at] != kNoTriangle && bitsOf(table[at]) != bits) at = (at + 1) & (buckets - 1);
        if (table[at] == kNoTriangle) table[at] = i;
        first[i] = table[at];
    }
    return first;
}

/// Whether triangle @a u runs along edge @a k of triangle @a t in the same direction.
bool runAlike(const Mesh::Triangle& t, std::size_t k, const Mesh::Triangle& u)
{
    for (std::size_t j = 0; j < 3; ++j)
        if (u[j] == t[k] && u[(j + 1) % 3] == t[(k + 1) % 3]) return true;
    return false;
}

/// Merges copies of triangles.
class CopyMerger
{
public:
    CopyMerger(OrientedTriangles& of, Copies copies) : mOf(of), mCopies(copies) {}

    void run()
    {
        const std::vector<Mesh::Triangle>& triangles = mOf.mesh.triangles;
        // By their corners in ascending order, then by number.
        std::vector<std::pair<Mesh::Triangle, std::uint32_t>> sorted(triangles.size());
        tbb::parallel_for(std::size_t(0), triangles.size(), [&](std::size_t n) {
            Mesh::Triangle t = triangles[n];
            std::sort(t.begin(), t.end());
            sorted[n] = {t, std::uint32_t(n)};
        });
        tbb::parallel_sort(sorted.begin(), sorted.end());
        std::vector<Kept> kept, cancelled;
        for (std::size_t n = 0; n < sorted.size();) {
            std::int32_t times = 0;
            const std::size_t first = n;
            for (; n < sorted.size() && sorted[n].first == sorted[first].first; ++n)
                times += runsUpward(triangles[sorted[n].second]) ? 1 : -1;
            (times != 0 ? kept : cancelled).push_back({sorted[first].second, times});
        }
        if (mCopies == Copies::Merge) mergeCopies(kept, cancelled);
        if (mCopies == Copies::Add) mOf.cancelled = cancelled.size();
        std::sort(kept.begin(), kept.end());
        mOf.copies = triangles.size() - kept.size();
        keep(kept);
    }

private:
    using Kept = std::pair<std::uint32_t, std::int32_t>; ///< the first copy; how often it counts

    /// Count each once. Those that cancel stay, too, unless they only part what is closed without
    /// them, as faces between the cells of a volume mesh do.
    void mergeCopies(std::vector<Kept>& kept, const std::vector<Kept>& cancelled) const
    {
        for (auto& [n, times] : kept) times = times > 0 ? 1 : -1;
        const std::vector<std::uint8_t> isNeeded = neededOf(cancelled, kept);
        for (std::size_t n = 0; n < cancelled.size(); ++n)
            if (isNeeded[n])
                kept.push_back({cancelled[n].first,
                                runsUpward(mOf.mesh.triangles[cancelled[n].first]) ? 1 : -1});
    }

    /// What an edge of triangles that cancel tells of their part.
    struct Border {
        std::uint32_t part = kNoTriangle; ///< another triangle of it
        double closes = 0; ///< length that it closes or ends at, negative if closed without it
    };

    /// Whether each of @a cancelled triangles is in a part that closes more than it parts.
    std::vector<std::uint8_t> neededOf(const std::vector<Kept>& cancelled,
                                       const std::vector<Kept>& kept) const
    {
        const auto count = std::uint32_t(cancelled.size());
        if (count == 0) return {};
        std::vector<Mesh::Triangle> all;
        all.reserve(cancelled.size() + kept.size());
        for (const std::vector<Kept>* some : {&cancelled, &kept})
            for (const auto& [n, times] : *some) all.push_back(mOf.mesh.triangles[n]);
        std::vector<Border> borders(3 * cancelled.size());
        EdgeTable(all, mOf.mesh.positions.size())
            .forEachEdge([&](const HalfEdge* first, const HalfEdge* last) {
                const HalfEdge* mid = first; // copies that cancel come first
                for (; mid != last && mid->triangle < count; ++mid)
                    borders[3 * mid->triangle + mid->corner].part = first->triangle;
                if ((mid - first) % 2 == 0) return;
                const bool isFree = mid == last, isOpen = isFree || (last - mid) % 2 == 1;
                if (isFree && mid - first > 1) return;
                const double length = lengthOf(all[first->triangle], first->corner);
                borders[3 * first->triangle + first->corner].closes = isOpen ? length : -length;
            });
        UnionFind parts(count);
        for (std::uint32_t n = 0; n < borders.size(); ++n) parts.join(n / 3, borders[n].part);
        std::vector<double> closed(count, 0);
        for (std::uint32_t n = 0; n < borders.size(); ++n)
            closed[parts.find(n / 3)] += borders[n].closes;
        std::vector<std::uint8_t> isNeeded(count);
        for (std::uint32_t n = 0; n < count; ++n) isNeeded[n] = closed[parts.find(n)] >= 0;
        return isNeeded;
    }

    double lengthOf(const Mesh::Triangle& t, std::size_t k) const
    {
        return double((mOf.mesh.positions[t[(k + 1) % 3]] - mOf.mesh.positions[t[k]]).norm());
    }

    /// Whether its corners are a cyclic shift of ascending ones.
    static bool runsUpward(const Mesh::Triangle& t)
    {
        return (t[0] < t[1]) + (t[1] < t[2]) + (t[2] < t[0]) == 2;
    }

    void keep(const std::vector<Kept>& kept)
    {
        std::vector<Mesh::Triangle> triangles;
        std::vector<std::int32_t> multiplicity;
        for (const auto& [n, times] : kept) {
            Mesh::Triangle t = mOf.mesh.triangles[n];
            if (runsUpward(t) != (times > 0)) std::swap(t[1], t[2]);
            triangles.push_back(t);
            multiplicity.push_back(std::abs(times));
        }
        mOf.mesh.triangles = std::move(triangles);
        if (std::any_of(multiplicity.begin(), multiplicity.end(),
                        [](std::int32_t times) { return times != 1; }))
            mOf.multiplicity = std::move(multiplicity);
    }

    OrientedTriangles& mOf;
    Copies mCopies;
};

/// Numbers of edges by kind.
struct EdgeKinds {
    std::uint64_t open = 0;          ///< triangles do not cancel
    std::uint64_t contradicting = 0; ///< two triangles with the same direction
    std::uint64_t crowded = 0;       ///< more than two triangles
};

/// Find the neighbors, contradicting ones too, and count edges by kind.
EdgeKinds findNeighbors(OrientedTriangles& of)
{
    const auto timesOf = [&](const HalfEdge& e) {
        return of.multiplicity.empty() ? 1 : of.multiplicity[e.triangle];
    };
    of.neighbors.assign(of.mesh.triangles.size(), {kNoTriangle, kNoTriangle, kNoTriangle});
    std::atomic<std::uint64_t> open{0}, contradicting{0}, crowded{0};
    EdgeTable(of.mesh.triangles, of.mesh.positions.size())
        .forEachEdge([&](const HalfEdge* first, const HalfEdge* last) {
            std::int64_t balance = 0;
            for (const HalfEdge* e = first; e != last; ++e)
                balance += e->upward ? timesOf(*e) : -timesOf(*e);
            if (balance != 0) ++open;
            if (last - first > 2) ++crowded;
            if (last - first != 2 || timesOf(first[0]) != timesOf(first[1])) return;
            if (first[0].upward == first[1].upward) ++contradicting;
            of.neighbors[first[0].triangle][first[0].corner] = first[1].triangle;
            of.neighbors[first[1].triangle][first[1].corner] = first[0].triangle;
        });
    return {open, contradicting, crowded};
}

/// Turns triangles until neighbors agree.
class Reorientation
{
public:
    explicit Reorientation(OrientedTriangles& of)
        : mOf(of), mState(of.mesh.triangles.size(), kUnseen)
    {
    }

    void run()
    {
        for (std::uint32_t n = 0; n < mState.size(); ++n)
            if (mState[n] == kUnseen) turnPart(n);
    }

private:
    enum State : std::uint8_t { kUnseen, kKept, kTurned };

    void turnPart(std::uint32_t seed)
    {
        std::vector<std::uint32_t> part{seed};
        mState[seed] = kKept;
        double balance = 0; // area that stays less area that is turned
        for (std::size_t next = 0; next < part.size(); ++next) {
            const std::uint32_t n = part[next];
            balance += mState[n] == kKept ? areaOf(n) : -areaOf(n);
            for (std::size_t k = 0; k < 3; ++k) {
                const std::uint32_t m = mOf.neighbors[n][k];
                if (m == kNoTriangle || mState[m] != kUnseen) continue;
                const auto& triangles = mOf.mesh.triangles;
                const bool contradict = runAlike(triangles[n], k, triangles[m]);
                mState[m] = (mState[n] == kTurned) != contradict ? kTurned : kKept;
                part.push_back(m);
            }
        }
        const State turned = balance < 0 ? kKept : kTurned;
        for (const std::uint32_t n : part) {
            if (mState[n] != turned) continue;
            std::swap(mOf.mesh.triangles[n][1], mOf.mesh.triangles[n][2]);
            ++mOf.turned;
        }
    }

    double areaOf(std::uint32_t n) const
    {
        const Mesh::Triangle& t = mOf.mesh.triangles[n];
        const auto at = [&](std::size_t k) {
            return Vec3d(mOf.mesh.positions[t[k]].cast<double>());
        };
        return (at(1) - at(0)).cross(at(2) - at(0)).norm();
    }

    OrientedTriangles& mOf;
    std::vector<State> mState;
};

/// Disconnect neighbors that contradict each other, as some on a Moebius strip do.
void dropContradicting(OrientedTriangles& of)
{
    for (std::uint32_t n = 0; n < of.neighbors.size(); ++n)
        for (std::size_t k = 0; k < 3; ++k) {
            const std::uint32_t m = of.neighbors[n][k];
            if (m == kNoTriangle) continue;
            if (!runAlike(of.mesh.triangles[n], k, of.mesh.triangles[m])) continue;
            for (std::uint32_t& back : of.neighbors[m])
                if (back == n) back = kNoTriangle;
            of.neighbors[n][k] = kNoTriangle;
        }
}

} // namespace

OrientedTriangles orientTriangles(const Mesh& mesh, Copies copies, Interrupter& progress)
{
    OrientedTriangles of;
    of.mesh.frame = mesh.frame;
    of.mesh.positions = mesh.positions;
    const std::vector<std::uint32_t> first = firstAtPosition(mesh.positions);
    progress.check();
    of.mesh.triangles.reserve(mesh.triangles.size());
    for (const Mesh::Triangle& t : mesh.triangles) {
        const Mesh::Triangle u = {first[t[0]], first[t[1]], first[t[2]]};
        if (u[0] != u[1] && u[1] != u[2] && u[2] != u[0]) of.mesh.triangles.push_back(u);
    }
    EdgeKinds kinds = findNeighbors(of);
    if (kinds.crowded > 0) {
        CopyMerger(of, copies).run();
        kinds = findNeighbors(of);
    }
    progress.check();
    if (kinds.contradicting > 0) {
        Reorientation(of).run();
        kinds = findNeighbors(of);
        if (kinds.contradicting > 0) dropContradicting(of);
    }
    of.openEdges = kinds.open;
    return of;
}

} // namespace mpuvdb
