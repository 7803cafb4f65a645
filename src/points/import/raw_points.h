// Points as files have them: doubles, with the file's attributes.
#pragma once
#include <mpuvdb/point_input.h>

#include <array>
#include <optional>
#include <string_view>

namespace mpuvdb
{

/// The meaning of a file's column.
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
    FirstScalar, ///< of the requested ones; the others follow
    LastScalar = FirstScalar + 7,
    None
};
/// The number of attributes, and of scalars among them. [derived: the enumeration's]
constexpr std::size_t kAttributes = std::size_t(Attribute::None);
constexpr std::size_t kMaxScalars =
    std::size_t(Attribute::None) - std::size_t(Attribute::FirstScalar);

inline bool isColor(Attribute attribute)
{
    return attribute >= Attribute::Red && attribute <= Attribute::Blue;
}

/// Whether a column's numbers can be requested by its name.
inline bool isNamedScalar(Attribute attribute)
{
    return attribute >= Attribute::FirstScalar;
}

/// Names of the requested scalars, at most kMaxScalars: the n-th is FirstScalar + n.
using ScalarNames = std::vector<std::string>;

/// The attribute that a column called @a name holds ("nx", "normal_x", "quality", "diffuse_red"),
/// or the scalar among @a wanted.
Attribute attributeOf(std::string_view name, const ScalarNames& wanted);

/// The values of one row by attribute.
using RowValues = std::array<double, kAttributes>;

/// The attributes that a file has.
struct AttributeSet {
    bool position = false, normals = false, confidence = false, colors = false, packedRgb = false;
    bool byteColors = false; ///< colors are bytes; else their scale is not known yet
    std::array<bool, kMaxScalars> scalars{};

    AttributeSet() = default;
    /// A vector counts if all three components are there.
    explicit AttributeSet(const std::vector<Attribute>& columns);
};

/// Asks for large pages for the @a bytes at @a data, where the system has them: the first touch of
/// pages is most of the cost of large arrays.
void adviseLargePages(void* data, std::size_t bytes);

/// Resizes an empty vector to @a count values, on large pages.
template <class T>
void resizeLarge(std::vector<T>& values, std::size_t count)
{
    values.reserve(count);
    adviseLargePages(values.data(), count * sizeof(T));
    values.resize(count);
}

/// Some points of a file. Attributes are empty, or one per point.
struct PointBlock {
    std::vector<Vec3d> positions;
    std::vector<Vec3f> normals;
    std::vector<float> confidence;
    std::vector<PointCloud::Rgb> colors;
    std::vector<Vec3f> rawColors;                        ///< as stored, until scaleColors()
    std::array<std::vector<float>, kMaxScalars> scalars; ///< in the order of their names
    std::optional<Viewpoint> seenFrom;                   ///< of all points

    std::size_t size() const { return positions.size(); }
    void reserve(std::size_t points, const AttributeSet& has);
    void append(const RowValues& row, const AttributeSet& has);
    void append(PointBlock&& other);
    /// Keeps the points i with keep[i] != 0, in order.
    void compact(const std::vector<std::uint8_t>& keep);
};

/// Moves all points of @a block, and their viewpoint, by world = rotation * p + translation.
void movePoints(PointBlock& block, const Eigen::Matrix3d& rotation, const Vec3d& translation);

/// A mesh's triangles while its vertices are still blocks.
using Triangles = std::vector<std::array<std::uint32_t, 3>>;

/// The result of one reader.
struct FilePoints {
    std::string name;           ///< of the file, for messages
    const char* unit = "point"; ///< what the file calls a point, for messages
    std::vector<PointBlock> blocks;
    Triangles triangles;                    ///< of all blocks' points, in order; corners are valid
    std::uint64_t meshTriangles = 0;        ///< number of triangles before vertices became points
    std::shared_ptr<const VertexMesh> mesh; ///< of these triangles; or null
    std::map<std::string, std::uint64_t> dropped;
    std::vector<std::string> scalarNames;     ///< that can be requested
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

/// The points in a task. [free: grain size]
constexpr std::size_t kPointsPerSlice = 1 << 14;

/// A color component in [0,255], rounded and clamped.
std::uint8_t colorByte(double value);
/// Converts the raw colors of a file to bytes. Components are in [0, 1], [0, 255] or [0, 65535]
/// whatever their type: the largest one of all points decides.
void scaleColors(FilePoints& points, Interrupter& progress);

/// Leaves out unusable points (not finite, too far, zero normal, no confidence), counted by reason,
/// and scales confidences to a largest one of 1. Normals that are all zero, and confidences without
/// a positive one, are ignored, with a note.
/// @throws InputError for BadPoints::Fail, naming the first bad point.
void cleanPoints(FilePoints& points, BadPoints badPoints, Interrupter& progress);

/// Joins all inputs about one frame, the middle of their bounding box, without points that lie
/// absurdly far from all the others, and without exact copies. Consumes @a inputs.
/// @throws InputError without points, or where an input has not all the @a scalars; LimitError for
/// more than 2^32-1.
PointInput joinPoints(std::vector<FilePoints>&& inputs, BadPoints badPoints,
                      const ScalarNames& scalars, Interrupter& progress);

/// @throws InputError where @a input, which has points, has not all the @a scalars that it was read
/// with.
void requireScalars(const FilePoints& input, const ScalarNames& scalars);

/// The notes of @a points, as part of the error that there are none: they may give the reason.
std::string butNotes(const FilePoints& points);

/// Leaves out all but the first of points that are equal in every attribute.
/// @return the number left out. The others keep their order.
std::uint64_t dropDuplicates(PointCloud& cloud, Interrupter& progress);

} // namespace mpuvdb
