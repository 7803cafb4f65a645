// Meshes of smooth solids, by marching tetrahedra: few lines, and closed whatever the function.
#include "validate_solids.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

namespace validate
{
namespace
{

using Corner = std::array<int, 3>; ///< of a cell of the grid

class Mesher
{
public:
    Mesher(const Implicit& solid, int resolution) : mSolid(solid)
    {
        const Box box = solid.bounds();
        mStep = box.sizes().maxCoeff() / resolution;
        // Half a step off, so that planes of symmetry do not fall on the grid.
        mOrigin = box.min() - Vec3::Constant(1.47 * mStep);
        for (int axis = 0; axis < 3; ++axis)
            mSize[axis] = int(std::ceil(box.sizes()[axis] / mStep)) + 4;
        mValues.resize(std::size_t(mSize[0]) * mSize[1] * mSize[2]);
    }

    Triangles run()
    {
        evaluate();
        for (int z = 0; z + 1 < mSize[2]; ++z)
            for (int y = 0; y + 1 < mSize[1]; ++y)
                for (int x = 0; x + 1 < mSize[0]; ++x) cell({x, y, z});
        return std::move(mMesh);
    }

private:
    std::size_t index(const Corner& c) const
    {
        return (std::size_t(c[2]) * mSize[1] + c[1]) * mSize[0] + c[0];
    }
    Vec3 place(const Corner& c) const { return mOrigin + mStep * Vec3(c[0], c[1], c[2]); }

    /// Blocks that a distance shows to be off the surface take its sign.
    void evaluate()
    {
        constexpr int kBlock = 8;
        const double reach = kBlock * mStep;
        for (int z = 0; z < mSize[2]; z += kBlock)
            for (int y = 0; y < mSize[1]; y += kBlock)
                for (int x = 0; x < mSize[0]; x += kBlock) {
                    const Vec3 middle = place({x, y, z}) + Vec3::Constant(reach / 2);
                    const double value = mSolid.isDistance() ? mSolid.value(middle) : 0;
                    fill({x, y, z}, kBlock, std::abs(value) > reach ? value : 0);
                }
    }

    /// @param value  of all corners of the block; 0: ask for each.
    void fill(const Corner& first, int block, double value)
    {
        const auto end = [&](int axis) { return std::min(first[axis] + block, mSize[axis]); };
        for (int z = first[2]; z < end(2); ++z)
            for (int y = first[1]; y < end(1); ++y)
                for (int x = first[0]; x < end(0); ++x)
                    mValues[index({x, y, z})] = value != 0 ? value : mSolid.value(place({x, y, z}));
    }

    /// Six tetrahedra about the diagonal: those of neighboring cells meet.
    void cell(const Corner& c)
    {
        if (!isPassed(c)) return;
        static constexpr int kOrders[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                              {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
        for (const auto& order : kOrders) {
            std::array<Corner, 4> corners{c, c, c, c};
            for (int n = 1; n < 4; ++n) {
                corners[n] = corners[n - 1];
                ++corners[n][order[n - 1]];
            }
            tetrahedron(corners);
        }
    }

    bool isPassed(const Corner& c) const
    {
        int inside = 0;
        for (int n = 0; n < 8; ++n)
            inside += mValues[index({c[0] + n % 2, c[1] + n / 2 % 2, c[2] + n / 4})] < 0;
        return inside > 0 && inside < 8;
    }

    void tetrahedron(const std::array<Corner, 4>& corners)
    {
        std::vector<Corner> in, out;
        for (const Corner& c : corners) (mValues[index(c)] < 0 ? in : out).push_back(c);
        if (in.size() == 1) triangle(in[0], out[0], in[0], out[1], in[0], out[2]);
        if (out.size() == 1) triangle(in[0], out[0], in[1], out[0], in[2], out[0]);
        if (in.size() == 2) {
            triangle(in[0], out[0], in[0], out[1], in[1], out[1]);
            triangle(in[0], out[0], in[1], out[1], in[1], out[0]);
        }
    }

    /// On three edges, each from inside to outside.
    void triangle(const Corner& a, const Corner& b, const Corner& c, const Corner& d,
                  const Corner& e, const Corner& f)
    {
        std::array<std::uint32_t, 3> t{vertex(a, b), vertex(c, d), vertex(e, f)};
        // Middles of edges turn the same way as the vertices do.
        const Vec3 u = place(a) + place(b), v = place(c) + place(d), w = place(e) + place(f);
        const Vec3 outward = place(b) + place(d) + place(f) - place(a) - place(c) - place(e);
        if ((v - u).cross(w - u).dot(outward) < 0) std::swap(t[1], t[2]);
        mMesh.triangles.push_back(t);
    }

    std::uint32_t vertex(const Corner& in, const Corner& out)
    {
        const std::uint64_t key = std::uint64_t(index(in)) * mValues.size() + index(out);
        const auto [found, isNew] = mVertices.emplace(key, std::uint32_t(mMesh.vertices.size()));
        if (isNew) {
            const double a = mValues[index(in)], b = mValues[index(out)];
            const Vec3 p = place(in) + a / (a - b) * (place(out) - place(in));
            mMesh.vertices.push_back(mSolid.project(p));
        }
        return found->second;
    }

    const Implicit& mSolid;
    double mStep;
    Vec3 mOrigin;
    std::array<int, 3> mSize{};
    std::vector<double> mValues;
    std::unordered_map<std::uint64_t, std::uint32_t> mVertices;
    Triangles mMesh;
};

} // namespace

Triangles marchTetrahedra(const Implicit& solid, int resolution)
{
    return Mesher(solid, resolution).run();
}

} // namespace validate
