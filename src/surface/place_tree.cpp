#include "place_tree.h"

#include <mpuvdb/interrupter.h>

#include <tbb/parallel_invoke.h>

#include <algorithm>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::uint32_t kLeafPlaces = 8;    ///< most places of a leaf [free: time]
constexpr std::uint32_t kTaskPlaces = 4096; ///< least places of two tasks [free: grain size]

/// The nodes of a tree of @a count places, whose halves differ by one at most.
std::size_t nodesOf(std::size_t count)
{
    if (count == 0) return 0;
    return count <= kLeafPlaces ? 1 : 1 + nodesOf(count / 2) + nodesOf(count - count / 2);
}

template <class T>
std::vector<T> inOrder(const std::vector<T>& values, const std::vector<std::uint32_t>& order)
{
    std::vector<T> result;
    result.reserve(order.size());
    for (const std::uint32_t n : order) result.push_back(values[n]);
    return result;
}

} // namespace

PlaceTree::PlaceTree(Places& places, const Interrupter& progress)
    : mOrder(places.size()), mNodes(nodesOf(places.size()))
{
    std::iota(mOrder.begin(), mOrder.end(), 0u);
    if (mOrder.empty()) return;
    build(places, 0, std::uint32_t(mOrder.size()), 0, progress);
    places.positions = inOrder(places.positions, mOrder);
    places.normals = inOrder(places.normals, mOrder);
}

std::uint32_t PlaceTree::nearest(const Places& places, const Vec3f& p, float& distance) const
{
    std::uint32_t found = kNone;
    search([&](const Node& node) { return node.squaredDistance(p, distance); },
           [&](std::uint32_t n) {
               const float apart = (places.positions[n] - p).norm();
               if (!(apart < distance)) return;
               distance = apart;
               found = n;
           });
    return found;
}

/// Makes node @a at of the places from @a begin to @a end in mOrder, and those below it.
void PlaceTree::build(const Places& places, std::uint32_t begin, std::uint32_t end,
                      std::uint32_t at, const Interrupter& progress)
{
    Node& node = mNodes[at];
    node.begin = begin;
    node.end = end;
    const std::uint32_t* const order = mOrder.data();
    Eigen::AlignedBox3f box;
    Vec3f sum = Vec3f::Zero();
    for (const std::uint32_t* n = order + begin; n != order + end; ++n) {
        box.extend(places.positions[*n]);
        sum += places.normals[*n];
    }
    node.middle = box.center();
    node.half = box.sizes() / 2;
    node.axis = sum.squaredNorm() > 0 ? Vec3f(sum.normalized()) : Vec3f::UnitX();
    node.low = kNever;
    node.high = -kNever;
    for (const std::uint32_t* n = order + begin; n != order + end; ++n) {
        const float along = node.axis.dot(places.positions[*n]);
        node.low = std::min(node.low, along);
        node.high = std::max(node.high, along);
    }
    const std::uint32_t count = end - begin;
    if (count <= kLeafPlaces) return;
    Eigen::Index longest = 0;
    node.half.maxCoeff(&longest);
    const std::uint32_t middle = begin + count / 2;
    std::nth_element(mOrder.begin() + begin, mOrder.begin() + middle, mOrder.begin() + end,
                     [&](std::uint32_t a, std::uint32_t b) {
                         const float x = places.positions[a][longest],
                                     y = places.positions[b][longest];
                         return x != y ? x < y : a < b;
                     });
    node.second = at + 1 + std::uint32_t(nodesOf(middle - begin));
    const auto first = [&] { build(places, begin, middle, at + 1, progress); };
    const auto second = [&] { build(places, middle, end, node.second, progress); };
    if (count < kTaskPlaces) {
        first();
        second();
        return;
    }
    progress.check();
    tbb::parallel_invoke(first, second);
}

} // namespace mpuvdb
