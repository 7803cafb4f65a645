// Edge collapse in the order of quadric errors [Garland97], within a two-sided distance: every
// vertex of the original stays assigned to a triangle within the tolerance, and new vertices and
// edges stay within it of the original. Large meshes are simplified in parts, in parallel, and then
// along the borders of these.
#include "slab.h"

#include "spatial/triangle_tree.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/mesh.h>

#include <Eigen/Eigenvalues>
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <queue>
#include <tbb/parallel_for.h>
#include <utility>

namespace mpuvdb
{
namespace
{

using Index = std::uint32_t;
constexpr Index kNone = std::numeric_limits<Index>::max(); ///< no index [derived: the largest]

/// The part of the tolerance for the vertices: triangles may deviate by the rest between them.
/// [tuned: simplify_mesh_test]
constexpr double kVertexShare = 0.7;
/// The eigenvalue, in parts of the largest, below which the planes leave a direction free.
/// [tuned: simplify_mesh_test]
constexpr double kMinEigenvalue = 1e-3;
/// The least shape of a triangle (see shapeOf) that a collapse may make, unless it replaces a worse
/// one. [tuned: simplify_mesh_test]
constexpr double kMinShape = 0.02;
/// The triangles of the original in a part, which fits into the caches. [tuned: time]
constexpr std::size_t kPartTriangles = 1 << 16;
/// The least cosine between a triangle's normals before and after a collapse.
/// [tuned: simplify_mesh_test]
constexpr double kMinTurnCosine = 0.3;

/// Sum of squared distances from weighted planes.
struct Quadric {
    Eigen::Matrix3d squares = Eigen::Matrix3d::Zero();
    Vec3d linear = Vec3d::Zero();
    double constant = 0, weight = 0;

    void addPlane(const Vec3d& normal, const Vec3d& point, double w)
    {
        const double d = normal.dot(point);
        squares += w * normal * normal.transpose();
        linear += w * d * normal;
        constant += w * d * d;
        weight += w;
    }
    Quadric& operator+=(const Quadric& other)
    {
        squares += other.squares;
        linear += other.linear;
        constant += other.constant;
        weight += other.weight;
        return *this;
    }
    double at(const Vec3d& p) const
    {
        return std::max(0.0, p.dot(squares * p) - 2 * linear.dot(p) + constant);
    }
    /// The place of the minimum; along free directions that of @a start.
    Vec3d minimum(const Vec3d& start) const
    {
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
        solver.computeDirect(squares);
        const Vec3d right = linear - squares * start;
        Vec3d place = start;
        for (int n = 0; n < 3; ++n) {
            const double value = solver.eigenvalues()[n];
            if (!(value > kMinEigenvalue * solver.eigenvalues()[2])) continue;
            const Vec3d direction = solver.eigenvectors().col(n);
            place += direction * (direction.dot(right) / value);
        }
        return place;
    }
};

/// The quotient of twice the area and the square of the longest side: 0 for a needle.
double shapeOf(const Vec3d& a, const Vec3d& b, const Vec3d& c)
{
    const double longest =
        std::max({(b - a).squaredNorm(), (c - b).squaredNorm(), (a - c).squaredNorm()});
    return longest > 0 ? (b - a).cross(c - a).norm() / longest : 0;
}

struct Collapse {
    double cost;
    Index kept, gone; ///< kept < gone
    Index age;        ///< sum of both vertices' when the cost was computed
    Vec3d place;

    /// The cheapest comes first; of equals that of lower vertices.
    bool operator<(const Collapse& other) const
    {
        if (cost != other.cost) return cost > other.cost;
        return kept != other.kept ? kept > other.kept : gone > other.gone;
    }
};

class Simplifier
{
public:
    /// @param original  tree of the mesh; has to outlive this.
    /// @param held  flags of vertices that do not move.
    Simplifier(Mesh mesh, const TriangleTree& original, double tolerance, std::vector<char> held,
               const Interrupter& progress)
        : mMesh(std::move(mesh)), mOriginal(original), mTolerance(tolerance),
          mReach(kVertexShare * tolerance), mPositions(mMesh.positions.size()),
          mQuadrics(mMesh.positions.size()), mFaces(mMesh.positions.size()),
          mAge(mMesh.positions.size(), 0), mHeld(std::move(held)), mAtBorder(mHeld.size(), 0),
          mFirstPoint(mMesh.triangles.size(), kNone), mNextPoint(mMesh.positions.size(), kNone)
    {
        for (std::size_t v = 0; v < mPositions.size(); ++v)
            mPositions[v] = mMesh.positions[v].cast<double>();
        for (std::size_t t = 0; t < mMesh.triangles.size(); ++t) {
            progress.check();
            const Mesh::Triangle& corners = mMesh.triangles[t];
            const Vec3d &a = mPositions[corners[0]], &b = mPositions[corners[1]],
                        &c = mPositions[corners[2]];
            const Vec3d normal = (b - a).cross(c - a);
            const double length = normal.norm();
            for (const Index v : corners) {
                mFaces[v].push_back(Index(t));
                if (length > 0) mQuadrics[v].addPlane(normal / length, a, length);
            }
        }
        for (Index v = 0; v < mPositions.size(); ++v)
            if (!mFaces[v].empty()) addPoint(mFaces[v].front(), v);
        mPoints = mPositions;
        mPointColors = mMesh.colors;
        holdBoundaries(progress);
    }

    void run(Interrupter& progress)
    {
        progress.beginStage("simplify", double(mPositions.size()));
        const std::vector<Part> parts = divide(progress);
        tbb::parallel_for(std::size_t(0), parts.size(), [&](std::size_t n) {
            simplifyAmong(
                parts[n], [](Index v, Index w) { return v < w; }, progress);
        });
        Part borders;
        for (Index v = 0; v < mAtBorder.size(); ++v)
            if (mAtBorder[v]) borders.push_back(v);
        const std::vector<char> wasAtBorder =
            std::exchange(mAtBorder, std::vector<char>(mAtBorder.size(), 0));
        simplifyAmong(
            borders, [&](Index v, Index w) { return v < w || !wasAtBorder[w]; }, progress);
        progress.endStage();
    }

    /// The simplified mesh.
    Mesh result() const
    {
        Mesh mesh = mMesh;
        std::vector<Index> number(mPositions.size(), kNone);
        Index count = 0;
        for (std::size_t v = 0; v < mPositions.size(); ++v) {
            if (mFaces[v].empty()) continue;
            mesh.positions[count] = mPositions[v].cast<float>();
            mesh.forEachAttribute([&](auto& values) { values[count] = values[v]; });
            number[v] = count++;
        }
        mesh.positions.resize(count);
        mesh.forEachAttribute([&](auto& values) { values.resize(count); });
        mesh.triangles.clear();
        for (const Index t : left()) {
            const Mesh::Triangle& v = mMesh.triangles[t];
            mesh.triangles.push_back({number[v[0]], number[v[1]], number[v[2]]});
        }
        return mesh;
    }

    /// Sets flags for the vertices of the original that went into triangles of the result.
    /// @return whether any had none: a triangle between three held vertices does not change.
    bool hold(const std::vector<TrianglePair>& pairs, std::vector<char>& held) const
    {
        const std::vector<Index> triangles = left();
        bool isNew = false;
        const auto add = [&](Index v) {
            isNew |= !held[v];
            held[v] = 1;
        };
        for (const TrianglePair& pair : pairs)
            for (const Index n : pair) {
                const Index t = triangles[n];
                for (const Index v : mMesh.triangles[t]) add(v);
                for (Index p = mFirstPoint[t]; p != kNone; p = mNextPoint[p]) add(p);
            }
        return isNew;
    }

private:
    /// The vertices of a part.
    using Part = std::vector<Index>;
    using Queue = std::priority_queue<Collapse>;

    /// The vertices in parts, in the order of the original's tree. Vertices beside those of other
    /// parts are held: so collapses in a part neither read nor change another.
    std::vector<Part> divide(const Interrupter& progress)
    {
        std::vector<Part> parts(1 + (mOriginal.size() - 1) / kPartTriangles);
        if (parts.size() == 1) {
            parts[0].resize(mPositions.size());
            std::iota(parts[0].begin(), parts[0].end(), Index(0));
            return parts;
        }
        std::vector<Index> partOf(mPositions.size(), kNone);
        for (std::size_t slot = 0; slot < mOriginal.size(); ++slot)
            for (const Index v : mMesh.triangles[mOriginal.triangle(slot)])
                if (partOf[v] == kNone) {
                    partOf[v] = Index(slot / kPartTriangles);
                    parts[partOf[v]].push_back(v);
                }
        progress.check();
        for (const Mesh::Triangle& t : mMesh.triangles)
            if (partOf[t[0]] != partOf[t[1]] || partOf[t[1]] != partOf[t[2]])
                for (const Index v : t) mAtBorder[v] = 1;
        return parts;
    }

    /// Makes all collapses of edges of @a part that are allowed, and of the edges that result.
    /// @param isTaken  whether an edge counts, by its vertices, the first of which is of the part.
    template <typename IsTaken>
    void simplifyAmong(const Part& part, const IsTaken& isTaken, Interrupter& progress)
    {
        Queue queue;
        std::size_t nearest = 0; // a triangle of the original near the last query
        for (const Index v : part) {
            progress.check();
            for (const Index w : ring(v))
                if (isTaken(v, w)) propose(std::min(v, w), std::max(v, w), queue);
        }
        while (!queue.empty()) {
            const Collapse next = queue.top();
            queue.pop();
            progress.check();
            if (next.age != mAge[next.kept] + mAge[next.gone] || mFaces[next.kept].empty() ||
                mFaces[next.gone].empty())
                continue;
            if (!tryCollapse(next, nearest)) continue;
            progress.advance();
            for (const Index w : ring(next.kept))
                propose(std::min(next.kept, w), std::max(next.kept, w), queue);
        }
    }

    void addPoint(Index face, Index point)
    {
        mNextPoint[point] = mFirstPoint[face];
        mFirstPoint[face] = point;
    }

    /// The vertices that @a v shares an edge with, sorted.
    std::vector<Index> ring(Index v) const
    {
        std::vector<Index> found;
        found.reserve(2 * mFaces[v].size());
        for (const Index t : mFaces[v])
            for (const Index w : mMesh.triangles[t])
                if (w != v) found.push_back(w);
        std::sort(found.begin(), found.end());
        found.erase(std::unique(found.begin(), found.end()), found.end());
        return found;
    }

    /// Holds vertices with an edge that has not two triangles.
    void holdBoundaries(const Interrupter& progress)
    {
        for (Index v = 0; v < mPositions.size(); ++v) {
            progress.check();
            if (ring(v).size() != mFaces[v].size()) mHeld[v] = 1;
        }
    }

    bool isHeld(Index v) const { return mHeld[v] || mAtBorder[v]; }

    void propose(Index kept, Index gone, Queue& queue) const
    {
        if (isHeld(kept) || isHeld(gone)) return;
        Quadric sum = mQuadrics[kept];
        sum += mQuadrics[gone];
        const Vec3d middle = 0.5 * (mPositions[kept] + mPositions[gone]);
        const Vec3d place = sum.minimum(middle);
        const double cost = sum.at(place);
        if (!(cost <= mReach * mReach * sum.weight)) return;
        queue.push({cost, kept, gone, mAge[kept] + mAge[gone], place});
    }

    /// The triangle with @a v moved to @a place.
    std::array<Vec3d, 3> moved(Index t, Index v, Index w, const Vec3d& place) const
    {
        std::array<Vec3d, 3> corners;
        for (std::size_t c = 0; c < 3; ++c) {
            const Index i = mMesh.triangles[t][c];
            corners[c] = i == v || i == w ? place : mPositions[i];
        }
        return corners;
    }

    /// The colors of the triangle's corners after a collapse.
    std::array<Vec3f, 3> colorsOf(Index t, const Collapse& c) const
    {
        std::array<Vec3f, 3> colors{Vec3f::Zero(), Vec3f::Zero(), Vec3f::Zero()};
        if (mMesh.colors.empty()) return colors;
        for (std::size_t n = 0; n < 3; ++n) {
            const Index v = mMesh.triangles[t][n];
            colors[n] = v == c.kept || v == c.gone ? blended(mMesh.colors, c) : mMesh.colors[v];
        }
        return colors;
    }

    /// The value of a collapse's new vertex, interpolated.
    template <typename Value>
    Value blended(const std::vector<Value>& values, const Collapse& c) const
    {
        const Vec3d along = mPositions[c.gone] - mPositions[c.kept];
        const double square = along.squaredNorm();
        const auto t = float(
            square > 0 ? std::clamp((c.place - mPositions[c.kept]).dot(along) / square, 0., 1.)
                       : 0);
        return (1 - t) * values[c.kept] + t * values[c.gone];
    }

    bool holds(Index t, Index v) const
    {
        const Mesh::Triangle& c = mMesh.triangles[t];
        return c[0] == v || c[1] == v || c[2] == v;
    }

    /// Whether the two have no common neighbors but those of their own two triangles: else the
    /// surface would be pinched.
    bool keepsManifold(Index v, Index w) const
    {
        const std::vector<Index> a = ring(v), b = ring(w);
        std::vector<Index> common;
        std::set_intersection(a.begin(), a.end(), b.begin(), b.end(), std::back_inserter(common));
        return common.size() == 2 && a.size() + b.size() > 8;
    }

    /// Whether no triangle turns over or becomes a needle.
    bool keepsShape(const std::vector<Index>& faces, const Collapse& c) const
    {
        for (const Index t : faces) {
            const Mesh::Triangle& was = mMesh.triangles[t];
            const Vec3d &a = mPositions[was[0]], &b = mPositions[was[1]], &d = mPositions[was[2]];
            const auto now = moved(t, c.kept, c.gone, c.place);
            const Vec3d before = (b - a).cross(d - a),
                        after = (now[1] - now[0]).cross(now[2] - now[0]);
            if (!(before.dot(after) > kMinTurnCosine * before.norm() * after.norm())) return false;
            const double shape = shapeOf(now[0], now[1], now[2]);
            if (!(shape > kMinShape) && shape <= shapeOf(a, b, d)) return false;
        }
        return true;
    }

    /// Assigns to each of @a points one of @a faces within reach; false if there is none for one.
    bool assign(const std::vector<Index>& points, const std::vector<Index>& faces,
                const Collapse& c, std::vector<Index>& homes) const
    {
        std::vector<Slab> slabs;
        slabs.reserve(faces.size());
        for (const Index t : faces)
            slabs.emplace_back(moved(t, c.kept, c.gone, c.place), colorsOf(t, c));
        std::size_t last = 0; // points of one triangle are consecutive
        for (const Index point : points) {
            const Vec3d& p = mPoints[point];
            const auto found = [&](const auto& test) {
                for (std::size_t n = 0; n < slabs.size(); ++n) {
                    const std::size_t at = (last + n) % slabs.size();
                    if (!test(slabs[at])) continue;
                    last = at;
                    return true;
                }
                return false;
            };
            if (!found([&](const Slab& slab) { return slab.holds(p, mReach); }) &&
                !found([&](const Slab& slab) { return slab.isNear(p, mReach); }))
                return false;
            if (!mPointColors.empty() && !slabs[last].isColored(p, mPointColors[point]))
                return false;
            homes.push_back(faces[last]);
        }
        return true;
    }

    /// Whether the new vertex of a collapse, and the middles of its edges, are near the original.
    /// assign() does not find fins, nor corners where planes meet beyond the surface: no vertex of
    /// the original is near them.
    bool staysNear(const std::vector<Index>& faces, const Collapse& c, std::size_t& nearest) const
    {
        const auto isNear = [&](const Vec3d& p) {
            return mOriginal.isWithin(p, mTolerance, nearest);
        };
        if (!isNear(c.place)) return false;
        for (const Index t : faces) {
            const Mesh::Triangle& v = mMesh.triangles[t];
            std::size_t at = 0;
            while (v[at] != c.kept && v[at] != c.gone) ++at;
            // Each edge belongs to two triangles; this is the first.
            if (!isNear((c.place + mPositions[v[(at + 1) % 3]]) / 2)) return false;
        }
        return true;
    }

    bool tryCollapse(const Collapse& c, std::size_t& nearest)
    {
        if (!keepsManifold(c.kept, c.gone)) return false;
        std::vector<Index> staying, going;
        for (const Index t : mFaces[c.kept]) (holds(t, c.gone) ? going : staying).push_back(t);
        for (const Index t : mFaces[c.gone])
            if (!holds(t, c.kept)) staying.push_back(t);
        if (!keepsShape(staying, c)) return false;
        std::vector<Index> points, homes;
        for (const auto* faces : {&staying, &going})
            for (const Index t : *faces)
                for (Index p = mFirstPoint[t]; p != kNone; p = mNextPoint[p]) points.push_back(p);
        if (!assign(points, staying, c, homes) || !staysNear(staying, c, nearest)) return false;

        for (const auto* faces : {&staying, &going})
            for (const Index t : *faces) mFirstPoint[t] = kNone;
        for (std::size_t n = 0; n < points.size(); ++n) addPoint(homes[n], points[n]);
        for (const Index t : staying)
            for (Index& v : mMesh.triangles[t])
                if (v == c.gone) v = c.kept;
        for (const Index t : going) {
            for (const Index v : mMesh.triangles[t])
                mFaces[v].erase(std::remove(mFaces[v].begin(), mFaces[v].end(), t),
                                mFaces[v].end());
            mMesh.triangles[t] = {kNone, kNone, kNone};
        }
        mMesh.forEachAttribute([&](auto& values) { values[c.kept] = blended(values, c); });
        mFaces[c.kept] = staying;
        mFaces[c.gone].clear();
        mPositions[c.kept] = c.place;
        mQuadrics[c.kept] += mQuadrics[c.gone];
        mAge[c.kept] += mAge[c.gone] + 1;
        return true;
    }

    /// The triangles that no collapse took.
    std::vector<Index> left() const
    {
        std::vector<Index> triangles;
        for (std::size_t t = 0; t < mMesh.triangles.size(); ++t)
            if (mMesh.triangles[t][0] != kNone) triangles.push_back(Index(t));
        return triangles;
    }

    Mesh mMesh;
    const TriangleTree& mOriginal;
    double mTolerance, mReach;
    std::vector<Vec3d> mPositions, mPoints; ///< of the result; of the original
    std::vector<Vec3f> mPointColors;        ///< of the original; or empty
    std::vector<Quadric> mQuadrics;
    std::vector<std::vector<Index>> mFaces; ///< of each vertex
    std::vector<Index> mAge;                ///< of each vertex, grows when it changes
    std::vector<char> mHeld;
    std::vector<char> mAtBorder;                ///< of a part: held while parts are simplified
    std::vector<Index> mFirstPoint, mNextPoint; ///< a list of points for each triangle
};

} // namespace

Mesh simplify(const Mesh& mesh, const SimplifySettings& settings, Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    if (!(settings.tolerance > 0))
        throw UsageError(fmt::format("simplify: the tolerance is {}; give a length above 0, world "
                                     "units",
                                     settings.tolerance));
    if (mesh.triangles.empty()) return mesh;
    const TriangleTree original(mesh, progress);
    std::vector<char> held(mesh.positions.size(), 0);
    for (;;) {
        Simplifier simplifier(mesh, original, settings.tolerance, held, progress);
        simplifier.run(progress);
        Mesh result = simplifier.result();
        if (!settings.strict) return result;
        const std::vector<TrianglePair> pairs = findSelfIntersections(result, &progress);
        if (pairs.empty() || !simplifier.hold(pairs, held)) return result;
        const std::vector<char> core = held; // their neighbors are held too: fewer rounds
        for (const Mesh::Triangle& t : mesh.triangles)
            if (core[t[0]] || core[t[1]] || core[t[2]])
                for (const Index v : t) held[v] = 1;
    }
}

} // namespace mpuvdb
