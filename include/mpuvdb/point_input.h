// Points in the memory of a program, and what becomes of them at the door.
#pragma once
#include <mpuvdb/point_cloud.h>

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// Rows of numbers in the caller's memory, which has to outlive the view. Nothing is copied.
struct NumberView {
    enum class Type { Float, Double, Byte };

    const void* first = nullptr; ///< the first row's first number
    Type type = Type::Float;
    std::size_t rows = 0;
    std::size_t columns = 0; ///< numbers of a row
    std::size_t stride = 0;  ///< bytes from a row to the next one

    NumberView() = default;
    /// @param numbers  the first row's first one. @param count  of rows.
    /// @param width  numbers of a row, which lie side by side.
    /// @param bytes  from a row to the next one; 0: the rows follow each other.
    template <class Number>
    NumberView(const Number* numbers, std::size_t count, std::size_t width, std::size_t bytes = 0)
        : first(numbers), type(typeOf<Number>()), rows(count), columns(width),
          stride(bytes ? bytes : width * sizeof(Number))
    {
    }
    /// A vector of numbers, or of vectors of numbers: openvdb::Vec3f, Eigen::Vector3d,
    /// std::array<float, 3>.
    template <class Row>
    NumberView(const std::vector<Row>& all)
        : first(all.data()), type(typeOf<NumberOf<Row>>()), rows(all.size()),
          columns(sizeof(Row) / sizeof(NumberOf<Row>)), stride(sizeof(Row))
    {
    }

    bool empty() const { return rows == 0; }
    /// The numbers of row @a i, as Number if that is their type.
    template <class Number>
    const Number* row(std::size_t i) const
    {
        return reinterpret_cast<const Number*>(static_cast<const std::byte*>(first) + i * stride);
    }

private:
    template <class Row, bool = std::is_arithmetic_v<Row>>
    struct Numbers {
        using Type = Row;
    };
    template <class Row>
    struct Numbers<Row, false> {
        using Type = std::decay_t<decltype(std::declval<const Row&>()[0])>;
    };
    template <class Row>
    using NumberOf = typename Numbers<Row>::Type;
    template <class Number>
    static constexpr Type typeOf()
    {
        static_assert(std::is_same_v<Number, float> || std::is_same_v<Number, double> ||
                          std::is_same_v<Number, std::uint8_t>,
                      "numbers of points are float, double or std::uint8_t");
        return std::is_same_v<Number, float>    ? Type::Float
               : std::is_same_v<Number, double> ? Type::Double
                                                : Type::Byte;
    }
};

/// Points in the caller's memory. What is optional is empty, or has a row for each point.
struct PointView {
    NumberView positions;   ///< 3 numbers, world units
    NumberView normals;     ///< 3 numbers, outward, of any length
    NumberView confidences; ///< 1 number from 0 on, of any scale; a point of 0 is left out
    /// 3 numbers in sRGB: bytes, or floats in [0, 1], [0, 255] or [0, 65535]: of what most
    /// components are, as in files.
    NumberView colors;
    std::vector<std::pair<std::string, NumberView>> scalars; ///< at most 8, 1 number, by name
    std::vector<Vec3d> viewpoints; ///< where points were seen from, world units
    /// Of each point the index into viewpoints; null: all were seen from the first one, if any.
    const std::uint32_t* seenFrom = nullptr;

    PointView() = default;
    PointView(const NumberView& places) : positions(places) {}
    template <class Row>
    PointView(const std::vector<Row>& places) : positions(places)
    {
        static_assert(!std::is_arithmetic_v<Row>,
                      "a vector of numbers has no rows: give NumberView(numbers, count, 3)");
    }
};

/// The treatment of unusable points: not finite, absurdly far, zero normal.
enum class BadPoints {
    Drop, ///< leave them out and count them
    Fail  ///< InputError at the first
};

/// Points read from one or more files, joined, or taken from memory.
struct PointInput {
    PointCloud cloud;
    /// Number of points left out, by reason ("not finite", "zero normal", "duplicate" ...).
    std::map<std::string, std::uint64_t> dropped;
    std::uint64_t triangles = 0; ///< of the files that are meshes; their vertices are the points
    std::vector<std::string> scalarNames; ///< that all files have, requested or not
    /// Scalars that only some files have, with the first of the other files.
    std::map<std::string, std::string> partialScalars;
    /// Information for the user ("bunny.ply: normals computed from its 69451 faces").
    std::vector<std::string> notes;
    /// Warnings for the user: positions were rounded far above the points' spacing.
    std::vector<std::string> warnings;

    PointInput() = default;
    PointInput(PointCloud&& points) : cloud(std::move(points)) {} // of a cloud that is there
};

/// Take points from memory: what readPoints() does to those of a file is done to these. A copy is
/// made about a frame of its own, in floats. @param name  for messages.
/// @throws UsageError (attributes or rows of another number than the points, names of scalars that
/// are empty or too many, an index beyond the viewpoints), InputError (nothing to use, or
/// BadPoints::Fail), Interrupted.
PointInput importPoints(const PointView& points, const std::string& name = "points",
                        BadPoints badPoints = BadPoints::Drop, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
