#include "triangle_contacts.h"

#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>
#include <tuple>

namespace mpuvdb
{
namespace
{

using Segment = std::array<Vec3d, 2>;

/// Level below the root whose nodes are tasks. [free: time]
constexpr std::size_t kTaskLevels = 12;

/// A triangle with its plane.
struct Facet {
    std::uint32_t number;
    Mesh::Triangle vertices;
    std::array<Vec3d, 3> corners;
    Vec3d normal; ///< of length 1

    double height(const Vec3d& p) const { return normal.dot(p - corners[0]); }
};

using Heights = std::array<double, 3>;

bool isWithin(const Heights& heights, double distance)
{
    return std::all_of(heights.begin(), heights.end(),
                       [&](double h) { return std::abs(h) <= distance; });
}

/// Heights of the corners of a triangle above the plane of another.
struct Above {
    Heights heights; ///< 0 for corners that the two share
    int shared = 0;
    bool isBeside = false; ///< the other corners are on one side, beyond touch

    Above(const Facet& of, const Facet& plane, double touch)
    {
        double least = HUGE_VAL, most = -HUGE_VAL;
        for (std::size_t k = 0; k < 3; ++k) {
            heights[k] = 0;
            if (std::count(plane.vertices.begin(), plane.vertices.end(), of.vertices[k]) > 0) {
                ++shared;
                continue;
            }
            heights[k] = plane.height(of.corners[k]);
            least = std::min(least, heights[k]);
            most = std::max(most, heights[k]);
        }
        isBeside = least > touch || most < -touch;
    }
};

/// Whether a line along an edge of @a t separates the two in its plane, but for @a overlap.
bool isSeparatedBy(const Facet& t, const Facet& u, double overlap)
{
    for (std::size_t k = 0; k < 3; ++k) {
        const Vec3d& a = t.corners[k];
        const Vec3d outward = (t.corners[(k + 1) % 3] - a).cross(t.normal).normalized();
        double least = HUGE_VAL;
        for (const Vec3d& p : u.corners) least = std::min(least, outward.dot(p - a));
        if (least >= -overlap) return true;
    }
    return false;
}

/// The intersection of a triangle with another's plane, from the corners' heights above that plane;
/// heights up to @a zero are 0.
std::optional<Segment> crossing(const Facet& of, const Heights& heights, double zero)
{
    std::array<Vec3d, 6> places;
    std::size_t count = 0;
    for (std::size_t k = 0; k < 3; ++k) {
        const std::size_t m = (k + 1) % 3;
        if (std::abs(heights[k]) <= zero) {
            places[count++] = of.corners[k];
        } else if (std::abs(heights[m]) > zero && (heights[k] < 0) != (heights[m] < 0)) {
            const double t = heights[k] / (heights[k] - heights[m]);
            places[count++] = of.corners[k] + t * (of.corners[m] - of.corners[k]);
        }
    }
    if (count == 0) return std::nullopt;
    return Segment{places[0], places[count - 1]}; // at most two differ
}

/// Finds the contacts of two triangles.
class Meeting
{
public:
    Meeting(const ContactLengths& lengths, std::vector<Contact>& contacts)
        : mLengths(lengths), mContacts(contacts)
    {
    }

    void look(const Facet& t, const Facet& u)
    {
        const Above ofU(u, t, mLengths.touch);
        if (ofU.isBeside) return;
        const Above ofT(t, u, mLengths.touch);
        if (ofT.isBeside) return;
        if (isWithin(ofU.heights, mLengths.touch) || isWithin(ofT.heights, mLengths.touch))
            lookInPlane(t, u);
        else if (ofT.shared < 2)
            lookAcross(t, ofT.heights, u, ofU.heights, ofT.shared > 0);
    }

private:
    /// Contacts of two triangles in one plane.
    void lookInPlane(const Facet& t, const Facet& u)
    {
        if (isSeparatedBy(t, u, mLengths.point) || isSeparatedBy(u, t, mLengths.point)) return;
        addEdges(t, u);
        addEdges(u, t);
    }

    /// Add the contacts that cut @a of along the edges of @a by.
    void addEdges(const Facet& of, const Facet& by)
    {
        for (std::size_t k = 0; k < 3; ++k) {
            Segment edge = {by.corners[k], by.corners[(k + 1) % 3]};
            for (Vec3d& p : edge) p -= of.height(p) * of.normal;
            mContacts.push_back({of.number, by.number, true, edge});
        }
    }

    void lookAcross(const Facet& t, const Heights& overU, const Facet& u, const Heights& overT,
                    bool sharing)
    {
        const auto ofT = crossing(t, overU, mLengths.point),
                   ofU = crossing(u, overT, mLengths.point);
        if (!ofT || !ofU) return;
        // Along the line that both planes have in common.
        const Vec3d along = t.normal.cross(u.normal).normalized();
        const Vec3d& origin = (*ofT)[0];
        const auto range = [&](const Segment& s) {
            const double a = along.dot(s[0] - origin), b = along.dot(s[1] - origin);
            return std::minmax({a, b});
        };
        const auto [lowT, highT] = range(*ofT);
        const auto [lowU, highU] = range(*ofU);
        const double low = std::max(lowT, lowU), high = std::min(highT, highU);
        if (high - low < (sharing ? mLengths.point : -mLengths.touch)) return;
        const bool cuts = high - low > mLengths.point;
        const Segment segment = {origin + low * along, origin + high * along};
        mContacts.push_back({t.number, u.number, cuts, segment});
        mContacts.push_back({u.number, t.number, cuts, segment});
    }

    const ContactLengths& mLengths;
    std::vector<Contact>& mContacts;
};

/// Finds the contacts between the triangles of two leaves of the tree.
class LeafContacts
{
public:
    LeafContacts(const OrientedTriangles& triangles, const TriangleTree& tree,
                 const ContactLengths& lengths)
        : mMesh(triangles.mesh), mTree(tree), mLengths(lengths)
    {
    }

    void find(std::size_t a, std::size_t b, std::vector<Contact>& contacts) const
    {
        Meeting meeting(mLengths, contacts);
        const TriangleTree::Box other = widened(mTree.leafBox(b));
        for (std::size_t i = mTree.firstSlot(a); i < mTree.firstSlot(a + 1); ++i) {
            const TriangleTree::Box box = boxOf(i);
            if (!box.intersects(other)) continue;
            const TriangleTree::Box wide = widened(box);
            std::optional<Facet> first;
            for (std::size_t j = std::max(i + 1, mTree.firstSlot(b)); j < mTree.firstSlot(b + 1);
                 ++j) {
                if (!wide.intersects(boxOf(j))) continue;
                if (!first && !(first = facet(i))) break;
                if (const auto second = facet(j)) meeting.look(*first, *second);
            }
        }
    }

private:
    TriangleTree::Box widened(TriangleTree::Box box) const
    {
        const auto by = float(mLengths.touch);
        box.min().array() -= by;
        box.max().array() += by;
        return box;
    }

    TriangleTree::Box boxOf(std::size_t slot) const
    {
        const TriangleTree::Corners& c = mTree.corners(slot);
        return {c[0].cwiseMin(c[1]).cwiseMin(c[2]), c[0].cwiseMax(c[1]).cwiseMax(c[2])};
    }

    /// The facet of a triangle; none without an area.
    std::optional<Facet> facet(std::size_t slot) const
    {
        Facet f;
        f.number = mTree.triangle(slot);
        f.vertices = mMesh.triangles[f.number];
        for (std::size_t k = 0; k < 3; ++k) f.corners[k] = mTree.corners(slot)[k].cast<double>();
        const Vec3d area = (f.corners[1] - f.corners[0]).cross(f.corners[2] - f.corners[0]);
        const double size = area.norm();
        if (!(size > 0)) return std::nullopt;
        f.normal = area / size;
        return f;
    }

    const Mesh& mMesh;
    const TriangleTree& mTree;
    const ContactLengths& mLengths;
};

/// A total order of contacts: independent of threads.
bool isBefore(const Contact& a, const Contact& b)
{
    const auto key = [](const Contact& c) {
        return std::make_tuple(c.triangle, c.other, c.segment[0][0], c.segment[0][1],
                               c.segment[0][2], c.segment[1][0], c.segment[1][1], c.segment[1][2]);
    };
    return key(a) < key(b);
}

} // namespace

std::vector<Contact> findContacts(const OrientedTriangles& triangles, const TriangleTree& tree,
                                  const ContactLengths& lengths, Interrupter& progress)
{
    const LeafContacts leaves(triangles, tree, lengths);
    const auto apart = float(lengths.touch);
    std::vector<std::array<std::size_t, 2>> tasks;
    tree.forEachPair(
        std::min(tree.levels(), kTaskLevels),
        [&](std::size_t a, std::size_t b) {
            tasks.push_back({a, b});
        },
        apart);
    tbb::enumerable_thread_specific<std::vector<Contact>> found;
    tbb::parallel_for(std::size_t(0), tasks.size(), [&](std::size_t n) {
        progress.check();
        std::vector<Contact>& mine = found.local();
        tree.forEachLeafPair(
            tasks[n][0], tasks[n][1],
            [&](std::size_t a, std::size_t b) { leaves.find(a, b, mine); }, apart);
    });
    std::vector<Contact> contacts;
    for (const auto& some : found) contacts.insert(contacts.end(), some.begin(), some.end());
    tbb::parallel_sort(contacts.begin(), contacts.end(), isBefore);
    return contacts;
}

} // namespace mpuvdb
