// What Python callers say in words: lengths with units, axes, choices.
#pragma once
#include "vectors.h"

#include <mpuvdb/fields.h>
#include <mpuvdb/length.h>

#include <pybind11/pybind11.h>

#include <filesystem>
#include <initializer_list>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

namespace mpuvdb::python
{

/// A number (world units), or text with a unit: "0.1%", "1.5vx".
using LengthArgument = std::variant<double, std::string>;

Length lengthOf(const LengthArgument& argument);

/// @{ @a value. @param what  whose it is, for the error: "sphere: radius".
/// @throws UsageError unless it is finite, or above 0 and finite.
double finite(const std::string& what, double value);
Vec3d finite(const std::string& what, const Vec3d& value);
double positive(const std::string& what, double value);
Vec3d positive(const std::string& what, const Vec3d& value);
/// @}

/// What a length is relative to.
struct Scale {
    Box3d box;            ///< whose diagonal "%" is a part of; world units
    double voxelSize = 0; ///< world units; 0: there are no voxels yet
};

/// World units. @throws UsageError for a unit that @a scale cannot resolve.
double worldLength(const LengthArgument& argument, const Scale& scale);

/// Where centers and origins are unless given.
inline const Vec3d kZero = Vec3d::Zero();

/// "x", "y", "z", or a vector.
using AxisArgument = std::variant<std::string, Vec3d>;

/// @throws UsageError for anything else, or a vector that is zero or not finite.
Vec3d directionOf(const AxisArgument& argument, const char* what);

/// The value that goes with @a word. @throws UsageError listing all words.
template <class T>
T choose(const std::string& word, const char* what,
         std::initializer_list<std::pair<const char*, T>> choices);

[[noreturn]] void throwChoice(const std::string& word, const char* what, const std::string& words);

template <class T>
T choose(const std::string& word, const char* what,
         std::initializer_list<std::pair<const char*, T>> choices)
{
    std::string words;
    for (const auto& [name, value] : choices) {
        if (word == name) return value;
        words += words.empty() ? "" : ", ";
        words += name;
    }
    throwChoice(word, what, words);
}

/// The files that a path, or a sequence of paths, names; nothing for anything else.
std::optional<std::vector<std::filesystem::path>> pathsOf(const pybind11::object& source);

using Corners = std::pair<Vec3d, Vec3d>;

/// The box from @a low to @a high. @throws UsageError unless low < high everywhere, and both are
/// finite.
Box3d boxBetween(const Vec3d& low, const Vec3d& high);

/// (low, high), or None if @a box is empty.
pybind11::object cornersOf(const Box3d& box);

} // namespace mpuvdb::python
