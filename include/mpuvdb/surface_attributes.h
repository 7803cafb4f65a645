// Attributes of places on a surface: colors, confidences, intensities.
#pragma once
#include <mpuvdb/field.h>

#include <string>
#include <vector>

namespace mpuvdb
{

/// Name of colors among attributes, and of their grid.
constexpr const char* kColorName = "Cd";

/// Attributes as functions on a surface. All members are safe to call from many threads.
class SurfaceAttributes
{
public:
    virtual ~SurfaceAttributes() = default;
    virtual bool hasColors() const = 0;
    /// Names of the scalars, in the order of their channels.
    virtual const std::vector<std::string>& scalarNames() const = 0;
    /// Count of numbers per place: linear red, green and blue where there are colors, then the
    /// scalars.
    std::size_t channels() const { return (hasColors() ? 3 : 0) + scalarNames().size(); }
    /// Set @a values to channels() numbers per place. Fastest where each place is near the one
    /// before it; no value depends on the other places.
    virtual void evaluate(const std::vector<SurfacePlace>& places,
                          std::vector<float>& values) const = 0;
};

} // namespace mpuvdb
