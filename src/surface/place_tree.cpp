#include "place_tree.h"

#include <algorithm>
#include <numeric>

namespace mpuvdb
{
namespace
{

constexpr std::ptrdiff_t kLeafPlaces = 8; ///< most places of a leaf [free: time]

template <class T>
std::vector<T> inOrder(const std::vector<T>& values, const std::vector<std::uint32_t>& order)
{
    std::vector<T> result;
    result.reserve(order.size());
    for (const std::uint32_t n : order) result.push_back(values[n]);
    return result;
}

} // namespace

PlaceTree::PlaceTree(Places& places)
{
    std::vector<std::uint32_t> order(places.size());
    std::iota(order.begin(), order.end(), 0u);
    if (order.empty()) return;
    build(places, order.data(), order.data() + order.size(), order.data());
    places.positions = inOrder(places.positions, order);
    places.normals = inOrder(places.normals, order);
}

std::uint32_t PlaceTree::build(const Places& places, std::uint32_t* begin, std::uint32_t* end,
                               const std::uint32_t* first)
{
    const auto at = std::uint32_t(mNodes.size());
    mNodes.emplace_back();
    Node node;
    node.begin = std::uint32_t(begin - first);
    node.end = std::uint32_t(end - first);
    Eigen::AlignedBox3f box;
    Vec3f sum = Vec3f::Zero();
    for (const std::uint32_t* n = begin; n != end; ++n) {
        box.extend(places.positions[*n]);
        sum += places.normals[*n];
    }
    node.middle = box.center();
    node.half = box.sizes() / 2;
    node.axis = sum.squaredNorm() > 0 ? Vec3f(sum.normalized()) : Vec3f::UnitX();
    node.low = kNever;
    node.high = -kNever;
    for (const std::uint32_t* n = begin; n != end; ++n) {
        const float along = node.axis.dot(places.positions[*n]);
        node.low = std::min(node.low, along);
        node.high = std::max(node.high, along);
    }
    if (end - begin > kLeafPlaces) {
        Eigen::Index longest = 0;
        node.half.maxCoeff(&longest);
        std::uint32_t* const middle = begin + (end - begin) / 2;
        std::nth_element(begin, middle, end, [&](std::uint32_t a, std::uint32_t b) {
            const float x = places.positions[a][longest], y = places.positions[b][longest];
            return x != y ? x < y : a < b;
        });
        build(places, begin, middle, first);
        node.second = build(places, middle, end, first);
    }
    mNodes[at] = node;
    return at;
}

} // namespace mpuvdb
