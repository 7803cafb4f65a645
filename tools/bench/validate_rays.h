// Where rays meet a mesh: what the scanners of the validation set see.
#pragma once
#include "validate_solids.h"

#include <algorithm>
#include <limits>
#include <numeric>
#include <optional>
#include <vector>

namespace validate
{

/// Boxes about triangles, halved until few are left.
class RayTree
{
public:
    /// @param mesh  outlives this.
    explicit RayTree(const Triangles& mesh) : mMesh(mesh), mOrder(mesh.triangles.size())
    {
        std::iota(mOrder.begin(), mOrder.end(), std::size_t(0));
        build(0, mOrder.size());
    }

    struct Hit {
        double along = std::numeric_limits<double>::infinity(); ///< lengths of the ray's direction
        std::size_t triangle = 0;
    };
    /// The first triangle that the ray meets.
    std::optional<Hit> first(const Vec3& from, const Vec3& direction) const
    {
        Hit hit;
        visit(0, from, direction, direction.cwiseInverse(), hit);
        if (hit.along == std::numeric_limits<double>::infinity()) return std::nullopt;
        return hit;
    }

private:
    struct Node {
        Box box;
        std::size_t begin = 0, end = 0; ///< in mOrder
        std::size_t right = 0;          ///< the left child follows its parent; 0: a leaf
    };

    Vec3 middle(std::size_t t) const
    {
        return (mMesh.corner(t, 0) + mMesh.corner(t, 1) + mMesh.corner(t, 2)) / 3;
    }

    std::size_t build(std::size_t begin, std::size_t end)
    {
        constexpr std::size_t kLeaf = 4;
        const std::size_t node = mNodes.size();
        mNodes.emplace_back();
        Box box;
        for (std::size_t n = begin; n < end; ++n)
            for (std::size_t c = 0; c < 3; ++c) box.extend(mMesh.corner(mOrder[n], c));
        std::size_t right = 0;
        if (end - begin > kLeaf) {
            Eigen::Index axis = 0;
            box.sizes().maxCoeff(&axis);
            const auto first = mOrder.begin();
            const std::size_t half = (begin + end) / 2;
            std::nth_element(first + std::ptrdiff_t(begin), first + std::ptrdiff_t(half),
                             first + std::ptrdiff_t(end), [&](std::size_t a, std::size_t b) {
                                 return middle(a)[axis] < middle(b)[axis];
                             });
            build(begin, half);
            right = build(half, end);
        }
        mNodes[node] = {box, begin, end, right};
        return node;
    }

    void visit(std::size_t n, const Vec3& from, const Vec3& direction, const Vec3& inverse,
               Hit& hit) const
    {
        const Node& node = mNodes[n];
        const Vec3 a = (node.box.min() - from).cwiseProduct(inverse);
        const Vec3 b = (node.box.max() - from).cwiseProduct(inverse);
        const double enter = std::max(a.cwiseMin(b).maxCoeff(), 0.0);
        if (!(enter <= std::min(a.cwiseMax(b).minCoeff(), hit.along))) return;
        if (node.right) {
            visit(n + 1, from, direction, inverse, hit);
            visit(node.right, from, direction, inverse, hit);
            return;
        }
        for (std::size_t k = node.begin; k < node.end; ++k) meet(mOrder[k], from, direction, hit);
    }

    void meet(std::size_t t, const Vec3& from, const Vec3& direction, Hit& hit) const
    {
        const Vec3 a = mMesh.corner(t, 0), u = mMesh.corner(t, 1) - a, v = mMesh.corner(t, 2) - a;
        const Vec3 across = direction.cross(v);
        const double volume = u.dot(across);
        if (volume == 0) return;
        const Vec3 away = from - a, turned = away.cross(u);
        const double s = away.dot(across) / volume, r = direction.dot(turned) / volume;
        const double along = v.dot(turned) / volume;
        if (s >= 0 && r >= 0 && s + r <= 1 && along > 0 && along < hit.along) hit = {along, t};
    }

    const Triangles& mMesh;
    std::vector<std::size_t> mOrder;
    std::vector<Node> mNodes;
};

} // namespace validate
