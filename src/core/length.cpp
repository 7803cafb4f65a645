#include <mpuvdb/length.h>

#include <mpuvdb/error.h>

#include <charconv>
#include <cmath>
#include <fmt/format.h>

namespace mpuvdb
{

Length Length::parse(std::string_view text)
{
    Length length;
    std::string_view number = text;
    if (!number.empty() && number.front() == '+') number.remove_prefix(1);
    const char* const end = number.data() + number.size();
    const auto [rest, error] = std::from_chars(number.data(), end, length.value);
    const std::string_view unit(rest, std::size_t(end - rest));
    if (unit == "vx")
        length.unit = Unit::Voxels;
    else if (unit == "%")
        length.unit = Unit::Percent;
    if (error != std::errc() || !std::isfinite(length.value) ||
        (!unit.empty() && length.unit == Unit::World)) {
        throw UsageError(fmt::format("'{}' is not a length: write world units (0.002), voxels "
                                     "(1.5vx) or a part of the diagonal (0.1%)",
                                     text));
    }
    return length;
}

double Length::resolve(double voxelSize, double diagonal) const
{
    switch (unit) {
    case Unit::Voxels:
        return value * voxelSize;
    case Unit::Percent:
        return value * 0.01 * diagonal;
    case Unit::World:
        break;
    }
    return value;
}

std::string Length::text() const
{
    const char* const suffix = unit == Unit::Voxels ? "vx" : unit == Unit::Percent ? "%" : "";
    return fmt::format("{}{}", value, suffix);
}

} // namespace mpuvdb
