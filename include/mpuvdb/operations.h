// Operations on level sets. Each leaves its inputs as they are and gives back a level set: a true
// distance in a full band. Lengths are world units unless a comment says voxels.
#pragma once
#include <mpuvdb/distances.h>
#include <mpuvdb/fields.h>
#include <mpuvdb/sampling.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// How solids combine.
enum class Boolean {
    Union,
    Intersection,
    Difference ///< all others from the first
};

/// The solids of @a inputs (at least one, none changed) as one. With @a blendRadius > 0 the creases
/// that come about are filleted as by a rolling ball of that radius; away from where both surfaces
/// lie within the radius of the ball's path, nothing differs from the sharp result, to the bit.
/// Inputs on other lattices than the finest one are resampled to it (see onOneLattice()). The
/// half-width is the largest of the inputs'; inputs of narrower bands, or too narrow for the blend,
/// are widened. Two inputs may change places without a bit changing (not for Difference).
/// Where a ball has no room it fills gaps of a union, and takes away what is thinner than it of an
/// intersection or difference; where it has none beside one of the solids, creases stay sharp. The
/// progress gets a note of either.
/// @throws UsageError (no input, negative or infinite radius), LimitError (a radius for which bands
/// of 1000 voxels are too narrow, or larger than all solids together and than 100 voxels; voxels as
/// of onOneLattice()), Interrupted.
LevelSet combine(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                 Interrupter* interrupter = nullptr);

/// Level sets that share a lattice, and how they came to.
struct OneLattice {
    std::vector<LevelSet> levelSets;
    std::optional<std::size_t> model;   ///< the input whose lattice it is
    std::vector<std::size_t> resampled; ///< the inputs that were
};

/// The inputs on one lattice, with voxels of @a voxelSize: that of the first input with such
/// voxels, or, where none has, one aligned to the world. 0: on that of the input with the smallest
/// voxels (of equals the first). Those that lie on it already stay as they are, all others are
/// resampled.
/// @throws LimitError where @a voxelSize is 0 and the inputs together would take more than 64 times
/// the voxels that they have, which is to be asked for; Interrupted.
OneLattice onOneLattice(const std::vector<LevelSet>& inputs, double voxelSize = 0,
                        Interrupter* interrupter = nullptr);

/// @a levelSet sampled on @a lattice with @a halfWidth voxels of it.
LevelSet resample(const LevelSet& levelSet, const Lattice& lattice, double halfWidth,
                  Interrupter* interrupter = nullptr);

/// How smooth() filters the values.
enum class Filter {
    Mean,         ///< of a cube of 2 width + 1 voxels
    Gaussian,     ///< four means, one after the other
    Median,       ///< of that cube
    MeanCurvature ///< flow by the sum of the principal curvatures (a sphere: dr/dt = -2/r), one
                  ///< explicit step of h^2/6 per iteration
};

struct SmoothSettings {
    Filter filter = Filter::Gaussian;
    int iterations = 1; ///< in [1, 1000]
    int width = 1;      ///< voxels, in [1, 32]; not for MeanCurvature
    /// Where it acts: values in [0,1] blend from the input to the filtered surface; of any lattice;
    /// inactive voxels count with their value. Null: everywhere, in full.
    openvdb::FloatGrid::ConstPtr mask;
};

/// The surface smoothed; bands are widened to what the filter reads, so that planes stay where they
/// are. Away from the mask nothing changes, to the bit. A median costs as the cube of its width.
/// @throws UsageError for settings out of range, InputError for a mask that is not finite,
/// Interrupted.
LevelSet smooth(const LevelSet& levelSet, const SmoothSettings& settings,
                Interrupter* interrupter = nullptr);

/// How morph() goes from one surface to the other.
enum class Morphing {
    Linear,   ///< the zero set of (1-t) a + t b [Ohtake03 §6]; needs bands that reach each other
    Advection ///< a front moves from a's surface along its normal at constant speed and stops at
              ///< b's; in closed form, so that b appears where nothing of a touches it, too: for
              ///< shapes that differ much; apart, a goes before b comes
};

/// The surface on the way from @a a (@a t = 0) to @a b (@a t = 1), at the ends these themselves, on
/// one lattice, with the larger half-width. Each place changes sides at most once. What is empty is
/// infinitely far away. Takes memory for bands as wide as the shapes differ (Linear: of both;
/// Advection: of a). @throws UsageError for t outside [0,1], LimitError where that is more than
/// 1000 voxels, Interrupted.
LevelSet morph(const LevelSet& a, const LevelSet& b, double t, Morphing how,
               Interrupter* interrupter = nullptr);

/// Density 1 inside, falling over the band's inner half to 0 at the surface: class fog volume,
/// called "density", on the same lattice. A solid that is nowhere as deep as its band has 1 where
/// it is deepest.
openvdb::FloatGrid::Ptr toFog(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

/// What can be said of a connected part of a solid.
struct ComponentMeasures {
    double volume = 0, area = 0; ///< world units cubed, squared
    Box3d bounds;                ///< of the zero set, world units
    double genus = 0;            ///< as in SolidMeasures
};

class SolidParts;

/// The connected parts of a solid, found and measured once; a part that encloses a cavity keeps it.
/// Cheap to copy.
class SolidComponents
{
public:
    /// @throws Interrupted.
    explicit SolidComponents(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

    /// The largest first; of equals, by the first voxel.
    const std::vector<ComponentMeasures>& measures() const { return mMeasures; }
    /// The parts together again: those of at least @a minVolume, at most @a count of them, the
    /// largest first. @throws UsageError for a volume below 0, Interrupted.
    LevelSet keep(double minVolume, std::size_t count, Interrupter* interrupter = nullptr) const;

private:
    LevelSet mLevelSet;
    std::shared_ptr<const SolidParts> mParts;
    std::vector<std::uint32_t> mOrder; ///< of the parts
    std::vector<ComponentMeasures> mMeasures;
};

/// A part, and a level set of it alone.
struct SolidComponent : ComponentMeasures {
    LevelSet levelSet;
};

/// The parts of SolidComponents, each alone.
std::vector<SolidComponent> components(const LevelSet& levelSet,
                                       Interrupter* interrupter = nullptr);

/// SolidComponents::keep() at once.
LevelSet keepComponents(const LevelSet& levelSet, double minVolume, std::size_t count,
                        Interrupter* interrupter = nullptr);

/// What can be measured of a solid.
struct SolidMeasures {
    double volume = 0, area = 0;          ///< world units cubed, squared
    Box3d bounds;                         ///< of the zero set, world units
    std::int64_t eulerCharacteristic = 0; ///< of the surface
    std::uint64_t surfaces = 0;           ///< connected parts of the surface, cavities too
    double genus = 0;                     ///< handles of all surfaces: surfaces - Euler / 2
    double minThickness = 0;              ///< the smallest between walls that face each other, and
    double meanThickness = 0; ///< the mean diameter of the largest ball inside that touches the
                              ///< surface at a place; not second order, but to a few percent
};

/// Measure the solid; second order in the voxel size.
SolidMeasures measure(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
