// Points as they come through the door: doubles, with what attributes their file has.
#pragma once
#include <mpuvdb/point_input.h>

#include <array>
#include <optional>
#include <string_view>

namespace mpuvdb
{

/// What a column of a file may mean to us.
enum class Attribute : std::uint8_t {
    X,
    Y,
    Z,
    NormalX,
    NormalY,
    NormalZ,
    Confidence,
    Red,
    Green,
    Blue,
    PackedRgb,   ///< 0xAARRGGBB
    FirstScalar, ///< that was asked for; the others follow
    LastScalar = FirstScalar + 7,
    None
};
constexpr std::size_t kAttributes = std::size_t(Attribute::None);
constexpr std::size_t kMostScalars =
    std::size_t(Attribute::None) - std::size_t(Attribute::FirstScalar);

inline bool isColor(Attribute attribute)
{
    return attribute >= Attribute::Red && attribute <= Attribute::Blue;
}

/// Whether a column that has a name holds numbers that may be asked for by it.
inline bool isNamedScalar(Attribute attribute)
{
    return attribute >= Attribute::FirstScalar;
}

/// Names of the scalars that are asked for, at most kMostScalars: place n is FirstScalar + n.
using ScalarNames = std::vector<std::string>;

/// The attribute that a column called @a name holds ("nx", "normal_x", "quality", "diffuse_red"),
/// or the scalar among @a wanted.
Attribute attributeOf(std::string_view name, const ScalarNames& wanted);

/// The values of one row by attribute.
using RowValues = std::array<double, kAttributes>;

/// Which attributes a file has.
struct AttributeSet {
    bool position = false, normals = false, confidence = false, colors = false, packedRgb = false;
    bool byteColors = false; ///< colors are bytes; else their scale is not known yet
    std::array<bool, kMostScalars> scalars{};

    AttributeSet() = default;
    /// All three components count, or none.
    explicit AttributeSet(const std::vector<Attribute>& columns);
};

/// Ask for large pages for the @a bytes at @a data, where the system has them: touching the first
/// time is what large arrays cost most.
void adviseLargePages(void* data, std::size_t bytes);

/// Make room for @a count values in an empty vector, on large pages.
template <class T>
void resizeLarge(std::vector<T>& values, std::size_t count)
{
    values.reserve(count);
    adviseLargePages(values.data(), count * sizeof(T));
    values.resize(count);
}

/// Keep the values i with keep[i] != 0, in order; an empty vector stays empty.
template <class T>
void compactVector(std::vector<T>& values, const std::vector<std::uint8_t>& keep)
{
    if (values.empty()) return;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < keep.size(); ++i)
        if (keep[i]) values[kept++] = values[i];
    values.resize(kept);
}

/// Some points of a file. Attributes are empty, or one per point.
struct PointBlock {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> normals;
    std::vector<float> confidence;
    std::vector<PointCloud::Rgb> colors;
    std::vector<Vec3f> rawColors;                         ///< as stored, until scaleColors()
    std::array<std::vector<float>, kMostScalars> scalars; ///< in the order of their names
    std::optional<Viewpoint> seenFrom;                    ///< all of them

    std::size_t size() const { return positions.size(); }
    void reserve(std::size_t points, const AttributeSet& has);
    void append(const RowValues& row, const AttributeSet& has);
    void append(PointBlock&& other);
    /// Keep the points i with keep[i] != 0, in order.
    void compact(const std::vector<std::uint8_t>& keep);
};

/// Move all points of @a block, and where they were seen from, by world = rotation * p +
/// translation.
void movePoints(PointBlock& block, const Eigen::Matrix3d& rotation, const Vec3d& translation);

/// A mesh's triangles while its vertices are still blocks.
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// What one reader hands over.
struct FilePoints {
    std::string name;           ///< of the file, for messages
    const char* unit = "point"; ///< what the file calls a point, for messages
    std::vector<PointBlock> blocks;
    Triangles triangles;                    ///< of all blocks' points, in order; corners are valid
    std::uint64_t meshTriangles = 0;        ///< that there were when vertices became points
    std::shared_ptr<const VertexMesh> mesh; ///< that they made; or null
    std::map<std::string, std::uint64_t> dropped;
    std::vector<std::string> scalarNames;     ///< that could be asked for
    std::vector<std::string> notes, warnings; ///< without the file's name

    std::uint64_t size() const;
    /// The attributes of the blocks, which all have the same.
    bool hasNormals() const;
    bool hasConfidence() const;
    bool hasColors() const;
    bool hasScalar(std::size_t place) const;
    bool hasViewpoints() const; ///< some blocks have one
    /// All blocks as one.
    PointBlock& joined();
};

/// Points per task where all points of a block are gone through.
constexpr std::size_t kPointsPerSlice = 1 << 14;

/// A color component in [0,255], rounded and clamped.
std::uint8_t colorByte(double value);
/// Make the raw colors of a file bytes. Files have components in [0, 1], [0, 255] or [0, 65535],
/// whatever type they store: the largest one of all points tells which.
void scaleColors(FilePoints& points, Interrupter& progress);

/// Leave out what cannot be used (not finite, too far, zero normal, no confidence), counted by
/// reason, and scale confidences to a largest one of 1. Normals or confidences that say nothing
/// at all are ignored, with a note.
/// @throws InputError for BadPoints::Fail, naming the first bad point.
void cleanPoints(FilePoints& points, BadPoints badPoints, Interrupter& progress);

/// Join all inputs about one frame, the middle of their bounding box, leaving out points that lie
/// absurdly far from all the others, and exact copies. Consumes @a inputs.
/// @throws InputError without points, or where an input has not all the @a scalars; LimitError for
/// more than 2^32-1.
PointInput joinPoints(std::vector<FilePoints>&& inputs, BadPoints badPoints,
                      const ScalarNames& scalars, Interrupter& progress);

/// The notes of @a points as part of an error that nothing is in them: they may tell why.
std::string butNotes(const FilePoints& points);

/// Leave out all but one of points that are the same in every attribute.
/// @return number left out. The rest keep their order.
std::uint64_t dropDuplicates(PointCloud& cloud, Interrupter& progress);

} // namespace mpuvdb
