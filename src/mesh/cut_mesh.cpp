#include "cut_mesh.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <limits>
#include <tuple>

namespace mpuvdb
{
namespace
{

/// The largest distance of a cut from the end of an edge, in parts of the edge, at which that
/// vertex is moved instead. [tuned: coverage_test]
constexpr float kSnap = 0.25f;

/// The value at @a at, in parts of the way from @a a to @a b.
template <class T>
T between(const T& a, const T& b, float at)
{
    return a + at * (b - a);
}

std::uint64_t edgeKey(std::uint32_t a, std::uint32_t b)
{
    return std::uint64_t(std::min(a, b)) << 32 | std::max(a, b);
}

/// Cuts one mesh: moves vertices to the line, and adds others.
class Cut
{
public:
    Cut(Mesh mesh, const std::vector<float>& values, Interrupter& progress)
        : mMesh(std::move(mesh)), mValues(values), mProgress(progress), mSign(values.size())
    {
        for (std::size_t v = 0; v < values.size(); ++v) mSign[v] = isCovered(values[v]) ? 1 : -1;
    }

    Mesh run()
    {
        findCrossed();
        snap();
        addCrossings();
        replaceTriangles();
        separateFans();
        dropUnused();
        return std::move(mMesh);
    }

private:
    struct Move {
        float distance = std::numeric_limits<float>::max();
        std::uint32_t vertex = 0;
        Vec3f to, from;
        std::uint32_t towards = 0; ///< the edge's other end
        float at = 0;              ///< parts of the edge
    };

    template <typename F>
    void forEachTriangle(F f)
    {
        for (std::size_t t = 0; t < mMesh.triangles.size(); ++t) {
            if (t % kCheckStride == 0) mProgress.check();
            f(t, mMesh.triangles[t]);
        }
    }

    void findCrossed();
    void snap();
    template <class T>
    void moveAttribute(const std::vector<Move>& moves, std::vector<T>& values) const;
    void addCrossings();
    std::uint32_t crossingOf(std::uint32_t a, std::uint32_t b) const;
    void cutTriangle(const Mesh::Triangle& v, std::vector<Mesh::Triangle>& out) const;
    void replaceTriangles();
    void separateFans();
    void dropUnused();

    Mesh mMesh;
    const std::vector<float>& mValues;
    Interrupter& mProgress;
    std::vector<signed char> mSign;      ///< per vertex: 1 stays, -1 goes, 0 lies on the line
    std::vector<std::uint32_t> mCrossed; ///< triangles with both signs before snapping
    std::vector<std::uint64_t> mEdges;   ///< keys of the edges that are cut, sorted
    std::uint32_t mFirstCrossing = 0;    ///< vertex of mEdges[0]
};

void Cut::findCrossed()
{
    forEachTriangle([&](std::size_t t, const Mesh::Triangle& v) {
        if (mSign[v[0]] != mSign[v[1]] || mSign[v[1]] != mSign[v[2]])
            mCrossed.push_back(std::uint32_t(t));
    });
}

/// Moves vertices to the nearest crossing of their edges, where that is near.
void Cut::snap()
{
    std::vector<Move> moves; // the nearest of each vertex, once sorted
    for (const std::uint32_t t : mCrossed) {
        const Mesh::Triangle& v = mMesh.triangles[t];
        for (std::size_t a = 0; a < 3; ++a) {
            for (const std::size_t b : {(a + 1) % 3, (a + 2) % 3}) {
                if (mSign[v[a]] == mSign[v[b]]) continue;
                const float at = crossing(mValues[v[a]], mValues[v[b]]);
                if (at >= kSnap) continue;
                const Vec3f from = mMesh.positions[v[a]];
                const Vec3f step = at * (mMesh.positions[v[b]] - from);
                moves.push_back({step.norm(), v[a], from + step, from, v[b], at});
            }
        }
    }
    const auto key = [](const Move& m) {
        return std::make_tuple(m.vertex, m.distance, m.to[0], m.to[1], m.to[2], m.towards);
    };
    std::sort(moves.begin(), moves.end(),
              [&](const Move& a, const Move& b) { return key(a) < key(b); });
    moves.erase(std::unique(moves.begin(), moves.end(),
                            [](const Move& a, const Move& b) { return a.vertex == b.vertex; }),
                moves.end());
    for (const Move& move : moves) {
        mMesh.positions[move.vertex] = move.to;
        mSign[move.vertex] = 0;
    }
    // A triangle with all of its vertices on the line would be on neither side.
    const auto moveOf = [&](std::uint32_t vertex) {
        return std::lower_bound(moves.begin(), moves.end(), vertex,
                                [](const Move& m, std::uint32_t v) { return m.vertex < v; });
    };
    for (const std::uint32_t t : mCrossed) {
        const Mesh::Triangle& v = mMesh.triangles[t];
        if (mSign[v[0]] || mSign[v[1]] || mSign[v[2]]) continue;
        const std::uint32_t back =
            *std::max_element(v.begin(), v.end(), [&](std::uint32_t a, std::uint32_t b) {
                return std::make_pair(moveOf(a)->distance, a) <
                       std::make_pair(moveOf(b)->distance, b);
            });
        mMesh.positions[back] = moveOf(back)->from;
        mSign[back] = isCovered(mValues[back]) ? 1 : -1;
    }
    mMesh.forEachAttribute([&](auto& values) { moveAttribute(moves, values); });
}

/// Interpolates an attribute at the new places of vertices that were moved.
template <class T>
void Cut::moveAttribute(const std::vector<Move>& moves, std::vector<T>& values) const
{
    std::vector<T> moved; // all before any: their other ends may have moved too
    for (const Move& move : moves)
        moved.push_back(mSign[move.vertex] == 0
                            ? between(values[move.vertex], values[move.towards], move.at)
                            : values[move.vertex]);
    for (std::size_t n = 0; n < moves.size(); ++n) values[moves[n].vertex] = moved[n];
}

void Cut::addCrossings()
{
    for (const std::uint32_t t : mCrossed) {
        const Mesh::Triangle& v = mMesh.triangles[t];
        for (std::size_t a = 0; a < 3; ++a) {
            const std::uint32_t from = v[a], to = v[(a + 1) % 3];
            if (mSign[from] * mSign[to] < 0) mEdges.push_back(edgeKey(from, to));
        }
    }
    std::sort(mEdges.begin(), mEdges.end());
    mEdges.erase(std::unique(mEdges.begin(), mEdges.end()), mEdges.end());
    mFirstCrossing = std::uint32_t(mMesh.positions.size());
    for (const std::uint64_t edge : mEdges) {
        const auto a = std::uint32_t(edge >> 32), b = std::uint32_t(edge);
        // A vertex that was moved back has its crossing at the end of the edge.
        const float at = std::clamp(crossing(mValues[a], mValues[b]), kSnap, 1 - kSnap);
        mMesh.positions.push_back(between(mMesh.positions[a], mMesh.positions[b], at));
        mMesh.forEachAttribute(
            [&](auto& values) { values.push_back(between(values[a], values[b], at)); });
    }
}

std::uint32_t Cut::crossingOf(std::uint32_t a, std::uint32_t b) const
{
    const auto found = std::lower_bound(mEdges.begin(), mEdges.end(), edgeKey(a, b));
    return mFirstCrossing + std::uint32_t(found - mEdges.begin());
}

/// Appends the covered part of a triangle that has vertices of both signs.
void Cut::cutTriangle(const Mesh::Triangle& v, std::vector<Mesh::Triangle>& out) const
{
    std::array<std::uint32_t, 4> corners{};
    std::size_t count = 0;
    for (std::size_t a = 0; a < 3; ++a) {
        const std::uint32_t from = v[a], to = v[(a + 1) % 3];
        if (mSign[from] >= 0) corners[count++] = from;
        if (mSign[from] * mSign[to] < 0) corners[count++] = crossingOf(from, to);
    }
    const auto [a, b, c, d] = corners;
    if (count == 3) {
        out.push_back({a, b, c});
        return;
    }
    const auto& at = mMesh.positions;
    if ((at[a] - at[c]).squaredNorm() <= (at[b] - at[d]).squaredNorm())
        out.insert(out.end(), {{a, b, c}, {a, c, d}});
    else
        out.insert(out.end(), {{a, b, d}, {b, c, d}});
}

void Cut::replaceTriangles()
{
    std::vector<Mesh::Triangle> kept;
    kept.reserve(mMesh.triangles.size());
    forEachTriangle([&](std::size_t, const Mesh::Triangle& v) {
        const auto [least, most] = std::minmax({mSign[v[0]], mSign[v[1]], mSign[v[2]]});
        if (most <= 0) return;
        if (least >= 0)
            kept.push_back(v);
        else
            cutTriangle(v, kept);
    });
    mMesh.triangles = std::move(kept);
}

/// Gives each fan of triangles about a vertex of the line a vertex of its own.
void Cut::separateFans()
{
    struct Corner {
        std::uint32_t vertex, triangle, fan;
    };
    std::vector<Corner> corners;
    mSign.resize(mMesh.positions.size(), 0);
    forEachTriangle([&](std::size_t t, const Mesh::Triangle& v) {
        for (const std::uint32_t a : v)
            if (mSign[a] == 0) corners.push_back({a, std::uint32_t(t), 0});
    });
    std::sort(corners.begin(), corners.end(), [](const Corner& a, const Corner& b) {
        return std::make_pair(a.vertex, a.triangle) < std::make_pair(b.vertex, b.triangle);
    });
    const auto shareEdge = [&](const Corner& a, const Corner& b) {
        int shared = 0;
        for (const std::uint32_t v : mMesh.triangles[a.triangle])
            for (const std::uint32_t w : mMesh.triangles[b.triangle]) shared += v == w;
        return shared > 1;
    };
    for (std::size_t begin = 0, end = 0; begin < corners.size(); begin = end) {
        const std::uint32_t vertex = corners[begin].vertex;
        while (end < corners.size() && corners[end].vertex == vertex) ++end;
        std::uint32_t fans = 0;
        for (std::size_t n = begin; n < end; ++n) {
            if (corners[n].fan) continue;
            std::vector<std::size_t> open{n};
            corners[n].fan = ++fans;
            while (!open.empty()) {
                const std::size_t m = open.back();
                open.pop_back();
                for (std::size_t k = n; k < end; ++k) {
                    if (corners[k].fan || !shareEdge(corners[m], corners[k])) continue;
                    corners[k].fan = fans;
                    open.push_back(k);
                }
            }
        }
        const auto first = std::uint32_t(mMesh.positions.size());
        const auto repeat = [&](auto& values) {
            const auto value = values[vertex];
            values.insert(values.end(), std::max(fans, 1u) - 1, value);
        };
        repeat(mMesh.positions);
        mMesh.forEachAttribute(repeat);
        for (std::size_t n = begin; n < end; ++n) {
            if (corners[n].fan < 2) continue;
            Mesh::Triangle& v = mMesh.triangles[corners[n].triangle];
            std::replace(v.begin(), v.end(), vertex, first + corners[n].fan - 2);
        }
    }
}

void Cut::dropUnused()
{
    constexpr std::uint32_t kUnused = ~std::uint32_t(0); // no index [derived: the largest]
    std::vector<std::uint32_t> place(mMesh.positions.size(), kUnused);
    forEachTriangle([&](std::size_t, const Mesh::Triangle& v) {
        for (const std::uint32_t a : v) place[a] = 0;
    });
    std::uint32_t next = 0;
    for (std::size_t v = 0; v < place.size(); ++v) {
        if (place[v] == kUnused) continue;
        const auto keep = [&](auto& values) { values[next] = values[v]; };
        keep(mMesh.positions);
        mMesh.forEachAttribute(keep);
        place[v] = next++;
    }
    const auto shorten = [&](auto& values) { values.resize(next); };
    shorten(mMesh.positions);
    mMesh.forEachAttribute(shorten);
    for (Mesh::Triangle& v : mMesh.triangles)
        for (std::uint32_t& a : v) a = place[a];
}

} // namespace

Mesh cutMesh(Mesh mesh, const std::vector<float>& values, Interrupter& progress)
{
    return Cut(std::move(mesh), values, progress).run();
}

} // namespace mpuvdb
