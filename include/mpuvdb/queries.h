// Questions to a level set, anywhere in space: distances, nearest places, rays.
#pragma once
#include <mpuvdb/field.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/point_input.h>

#include <cstdint>
#include <memory>

namespace mpuvdb
{

class Interrupter;

/// A level set that answers questions at many places at once, in parallel. Immutable; all members
/// are safe to call from many threads, and give the same bits for any number of them.
///
/// In the band where values are smooth, cubic interpolation of them is the distance. About creases
/// where a few planes meet, it is that to those planes; beside other creases and ridges, that by
/// interpolation of the values on the place's side of them. Elsewhere, in cells that creases cross
/// and beyond the band, it is the distance to the surface with its creases as extractMesh() finds
/// it, and where that is curved, to the zero set of the interpolation. It is extracted by the first
/// question that needs it, and kept.
///
/// Of each function: @param places  3 numbers in a row, world units, at any strides. Results have
/// room for a row each. @throws UsageError for numbers that are bytes, LimitError (as
/// extractMesh()), Interrupted.
class Queries
{
public:
    /// @param field  with the exact zero set, see Shape::field(), or null: then creases come from
    /// the values beside them.
    explicit Queries(LevelSet levelSet, FieldPtr field = nullptr);
    ~Queries();

    const LevelSet& levelSet() const;

    /// Signed distances to the surface, world units, negative inside. NaN for a place that is not
    /// finite; infinite if the level set is empty.
    void distances(const NumberView& places, double* distances,
                   Interrupter* interrupter = nullptr) const;
    /// The same, and their gradients: unit vectors away from the nearest place of the surface
    /// outside, and towards it inside; on the surface its normals. NaN where the distance is not
    /// finite. @param gradients  3 numbers in a row.
    void distances(const NumberView& places, double* distances, Vec3d* gradients,
                   Interrupter* interrupter = nullptr) const;
    /// The nearest places of the surface, world units. NaN where there is none.
    void closestPoints(const NumberView& places, Vec3d* closest,
                       Interrupter* interrupter = nullptr) const;
    /// 1 for places inside, else 0.
    void contains(const NumberView& places, std::uint8_t* inside,
                  Interrupter* interrupter = nullptr) const;
    /// Where rays first meet the surface, from either side: origin + hit * direction; infinite
    /// where they do not. @param directions  of any length; one for each origin.
    /// @param hits  from 0 on. @param normals  unit, outward, of the surface there; NaN where rays
    /// miss. Null if they are not asked for.
    /// @throws UsageError where a direction is zero or not finite, or numbers of rows differ.
    void raycast(const NumberView& origins, const NumberView& directions, double* hits,
                 Vec3d* normals = nullptr, Interrupter* interrupter = nullptr) const;

private:
    class Answers;
    std::unique_ptr<Answers> mAnswers;
};

} // namespace mpuvdb
