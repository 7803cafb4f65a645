#include "raw_points.h"

#include "core/compact.h"
#include "files/text_scan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <sys/mman.h>
#include <unordered_map>

namespace mpuvdb
{
namespace
{

template <class T>
void appendVector(std::vector<T>& to, std::vector<T>&& from)
{
    if (to.empty())
        to = std::move(from);
    else
        to.insert(to.end(), from.begin(), from.end());
}

template <class T>
bool anyBlockHas(const std::vector<PointBlock>& blocks, std::vector<T> PointBlock::*attribute)
{
    for (const PointBlock& block : blocks)
        if (!(block.*attribute).empty()) return true;
    return false;
}

Attribute scalarAt(std::size_t place)
{
    return Attribute(std::size_t(Attribute::FirstScalar) + place);
}

} // namespace

void adviseLargePages([[maybe_unused]] void* data, [[maybe_unused]] std::size_t bytes)
{
#ifdef MADV_HUGEPAGE
    constexpr std::uintptr_t kLargePage = std::uintptr_t(1) << 21; // bytes [derived: of x86-64]
    const auto from = (reinterpret_cast<std::uintptr_t>(data) + kLargePage - 1) & ~(kLargePage - 1);
    const auto to = (reinterpret_cast<std::uintptr_t>(data) + bytes) & ~(kLargePage - 1);
    if (from < to) madvise(reinterpret_cast<void*>(from), to - from, MADV_HUGEPAGE);
#endif
}

Attribute attributeOf(std::string_view name, const ScalarNames& wanted)
{
    using A = Attribute;
    static const std::unordered_map<std::string, Attribute> names = {
        {"x", A::X},
        {"y", A::Y},
        {"z", A::Z},
        {"nx", A::NormalX},
        {"ny", A::NormalY},
        {"nz", A::NormalZ},
        {"normal_x", A::NormalX},
        {"normal_y", A::NormalY},
        {"normal_z", A::NormalZ},
        {"normalx", A::NormalX},
        {"normaly", A::NormalY},
        {"normalz", A::NormalZ},
        {"confidence", A::Confidence},
        {"quality", A::Confidence},
        {"red", A::Red},
        {"green", A::Green},
        {"blue", A::Blue},
        {"rf", A::Red}, // of CloudCompare, fractions
        {"gf", A::Green},
        {"bf", A::Blue},
        {"r", A::Red},
        {"g", A::Green},
        {"b", A::Blue},
        {"diffuse_red", A::Red},
        {"diffuse_green", A::Green},
        {"diffuse_blue", A::Blue},
        {"rgb", A::PackedRgb},
        {"rgba", A::PackedRgb},
    };
    const auto found = names.find(lowerCase(name));
    if (found != names.end()) return found->second;
    const auto scalar = std::find(wanted.begin(), wanted.end(), name);
    return scalar == wanted.end() ? Attribute::None
                                  : scalarAt(std::size_t(scalar - wanted.begin()));
}

AttributeSet::AttributeSet(const std::vector<Attribute>& columns)
{
    std::array<bool, kAttributes + 1> has{};
    for (const Attribute a : columns) has[std::size_t(a)] = true;
    const auto all = [&](Attribute a, Attribute b, Attribute c) {
        return has[std::size_t(a)] && has[std::size_t(b)] && has[std::size_t(c)];
    };
    position = all(Attribute::X, Attribute::Y, Attribute::Z);
    normals = all(Attribute::NormalX, Attribute::NormalY, Attribute::NormalZ);
    confidence = has[std::size_t(Attribute::Confidence)];
    packedRgb = has[std::size_t(Attribute::PackedRgb)];
    colors = packedRgb || all(Attribute::Red, Attribute::Green, Attribute::Blue);
    byteColors = packedRgb;
    for (std::size_t n = 0; n < kMaxScalars; ++n) scalars[n] = has[std::size_t(scalarAt(n))];
}

std::uint8_t colorByte(double value)
{
    return value >= 254.5 ? std::uint8_t(255)
           : value > 0    ? std::uint8_t(value + 0.5)
                          : std::uint8_t(0);
}

void PointBlock::reserve(std::size_t points, const AttributeSet& has)
{
    positions.reserve(points);
    if (has.normals) normals.reserve(points);
    if (has.confidence) confidence.reserve(points);
    if (has.colors && has.byteColors) colors.reserve(points);
    if (has.colors && !has.byteColors) rawColors.reserve(points);
    for (std::size_t n = 0; n < kMaxScalars; ++n)
        if (has.scalars[n]) scalars[n].reserve(points);
}

void PointBlock::append(const RowValues& row, const AttributeSet& has)
{
    const auto value = [&](Attribute a) { return row[std::size_t(a)]; };
    positions.emplace_back(value(Attribute::X), value(Attribute::Y), value(Attribute::Z));
    if (has.normals)
        normals.emplace_back(float(value(Attribute::NormalX)), float(value(Attribute::NormalY)),
                             float(value(Attribute::NormalZ)));
    if (has.confidence) confidence.push_back(float(value(Attribute::Confidence)));
    if (has.packedRgb) {
        const double packed = value(Attribute::PackedRgb);
        const auto bits = packed >= 0 && packed < 4294967296.0 ? std::uint32_t(packed) : 0u;
        colors.push_back({std::uint8_t(bits >> 16), std::uint8_t(bits >> 8), std::uint8_t(bits)});
    } else if (has.colors && has.byteColors) {
        colors.push_back({colorByte(value(Attribute::Red)), colorByte(value(Attribute::Green)),
                          colorByte(value(Attribute::Blue))});
    } else if (has.colors) {
        rawColors.emplace_back(float(value(Attribute::Red)), float(value(Attribute::Green)),
                               float(value(Attribute::Blue)));
    }
    for (std::size_t n = 0; n < kMaxScalars; ++n)
        if (has.scalars[n]) scalars[n].push_back(float(value(scalarAt(n))));
}

void PointBlock::append(PointBlock&& other)
{
    appendVector(positions, std::move(other.positions));
    appendVector(normals, std::move(other.normals));
    appendVector(confidence, std::move(other.confidence));
    appendVector(colors, std::move(other.colors));
    appendVector(rawColors, std::move(other.rawColors));
    for (std::size_t n = 0; n < kMaxScalars; ++n)
        appendVector(scalars[n], std::move(other.scalars[n]));
}

void PointBlock::compact(const std::vector<std::uint8_t>& keep)
{
    compactVector(positions, keep);
    compactVector(normals, keep);
    compactVector(confidence, keep);
    compactVector(colors, keep);
    compactVector(rawColors, keep);
    for (std::vector<float>& values : scalars) compactVector(values, keep);
}

void movePoints(PointBlock& block, const Eigen::Matrix3d& rotation, const Vec3d& translation)
{
    const Eigen::Matrix3f turn = rotation.cast<float>();
    for (Vec3d& p : block.positions) p = rotation * p + translation;
    for (Vec3f& n : block.normals) n = turn * n;
    if (!block.seenFrom) return;
    Vec3d& place = block.seenFrom->place;
    place = rotation * place;
    if (!block.seenFrom->distant) place += translation;
}

std::uint64_t FilePoints::size() const
{
    std::uint64_t points = 0;
    for (const PointBlock& block : blocks) points += block.size();
    return points;
}

bool FilePoints::hasNormals() const
{
    return anyBlockHas(blocks, &PointBlock::normals);
}
bool FilePoints::hasConfidence() const
{
    return anyBlockHas(blocks, &PointBlock::confidence);
}
bool FilePoints::hasColors() const
{
    return anyBlockHas(blocks, &PointBlock::colors) || anyBlockHas(blocks, &PointBlock::rawColors);
}

bool FilePoints::hasScalar(std::size_t place) const
{
    return std::any_of(blocks.begin(), blocks.end(),
                       [=](const PointBlock& block) { return !block.scalars[place].empty(); });
}

bool FilePoints::hasViewpoints() const
{
    return std::any_of(blocks.begin(), blocks.end(),
                       [](const PointBlock& block) { return block.seenFrom.has_value(); });
}

PointBlock& FilePoints::joined()
{
    if (blocks.empty()) blocks.emplace_back();
    if (blocks.size() > 1) {
        const std::size_t points = size();
        AttributeSet has;
        has.normals = hasNormals();
        has.confidence = hasConfidence();
        has.colors = hasColors();
        has.byteColors = anyBlockHas(blocks, &PointBlock::colors);
        for (std::size_t n = 0; n < kMaxScalars; ++n) has.scalars[n] = hasScalar(n);
        PointBlock all;
        all.reserve(points, has);
        for (PointBlock& block : blocks) {
            all.positions.insert(all.positions.end(), block.positions.begin(),
                                 block.positions.end());
            all.normals.insert(all.normals.end(), block.normals.begin(), block.normals.end());
            all.confidence.insert(all.confidence.end(), block.confidence.begin(),
                                  block.confidence.end());
            all.colors.insert(all.colors.end(), block.colors.begin(), block.colors.end());
            all.rawColors.insert(all.rawColors.end(), block.rawColors.begin(),
                                 block.rawColors.end());
            for (std::size_t n = 0; n < kMaxScalars; ++n)
                all.scalars[n].insert(all.scalars[n].end(), block.scalars[n].begin(),
                                      block.scalars[n].end());
            block = PointBlock();
        }
        blocks.clear();
        blocks.push_back(std::move(all));
    }
    return blocks.front();
}

std::string butNotes(const FilePoints& points)
{
    return points.notes.empty() ? "" : fmt::format(" ({})", fmt::join(points.notes, "; "));
}

} // namespace mpuvdb
