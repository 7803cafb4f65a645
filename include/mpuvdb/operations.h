// Operations on level sets. Each leaves its inputs as they are and returns a level set: distances
// in a full band. Lengths are world units unless a comment says voxels.
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

/// The kinds of Booleans.
enum class Boolean {
    Union,
    Intersection,
    Difference ///< the first without all others
};

/// The Boolean of the solids of @a inputs (at least one). Inputs on other lattices than the finest
/// are resampled to it (see onOneLattice()). The half-width is the largest of the inputs'; inputs
/// too narrow for it, or for the blend, are widened. Two inputs may change places without a bit
/// changing (not for Difference).
/// @param blendRadius  >= 0, world units. Above 0 new creases are filleted as by a rolling ball of
/// that radius; only where both surfaces lie within the radius of the ball's path, the result
/// differs from the sharp one. Where the ball has no room it fills gaps of a union, and removes
/// thinner parts of an intersection or difference; where it has none beside one of the solids,
/// creases stay sharp. The interrupter gets a note of either.
/// @throws UsageError (no input, negative or infinite radius), LimitError (a radius for which bands
/// of 1000 voxels are too narrow, or larger than all solids together and than 100 voxels; as
/// onOneLattice()), Interrupted.
LevelSet combine(Boolean kind, const std::vector<LevelSet>& inputs, double blendRadius,
                 Interrupter* interrupter = nullptr);

/// Level sets that share a lattice.
struct OneLattice {
    std::vector<LevelSet> levelSets;
    std::optional<std::size_t> model;   ///< index of the input whose lattice it is
    std::vector<std::size_t> resampled; ///< indices of the inputs that were resampled
};

/// The inputs on one lattice; those on it already stay as they are.
/// @param voxelSize  world units; the lattice is that of the first input with such voxels, or else
/// aligned to the world. 0: the lattice of the first input with the smallest voxels.
/// @throws LimitError where @a voxelSize is 0 and the inputs would take more than 64 times the
/// voxels that they have: choose a voxel size; Interrupted.
OneLattice onOneLattice(const std::vector<LevelSet>& inputs, double voxelSize = 0,
                        Interrupter* interrupter = nullptr);

/// @a levelSet resampled on @a lattice in a band of @a halfWidth of its voxels, in [1.5, 1000]. The
/// interrupter gets a note where larger voxels change the volume by more than 3/16.
/// @throws UsageError for settings out of range, LimitError for voxels too large for any band,
/// Interrupted.
LevelSet resample(const LevelSet& levelSet, const Lattice& lattice, double halfWidth,
                  Interrupter* interrupter = nullptr);

/// The filters of smooth().
enum class Filter {
    Mean,         ///< mean over a cube of 2 width + 1 voxels
    Gaussian,     ///< four means in succession
    Median,       ///< median over that cube
    MeanCurvature ///< flow by the sum of the principal curvatures (a sphere: dr/dt = -2/r), one
                  ///< explicit step of h^2/6 per iteration
};

struct SmoothSettings {
    Filter filter = Filter::Gaussian;
    int iterations = 1; ///< in [1, 1000]
    int width = 1;      ///< voxels, in [1, 32]; not for MeanCurvature
    /// Blends from the input to the filtered surface by values in [0,1], inactive ones too; of any
    /// lattice, and no level set. Null: filtered everywhere.
    openvdb::FloatGrid::ConstPtr mask;
};

/// The smoothed surface. Bands are widened to what the filter reads, so that planes stay in place.
/// Away from the mask nothing changes, to the bit. The time of a median grows with the cube of its
/// width.
/// A note says if the mask is 0 wherever the filter changes the surface.
/// @throws UsageError for settings out of range, InputError for a mask that is not finite or a
/// level set, Interrupted.
LevelSet smooth(const LevelSet& levelSet, const SmoothSettings& settings,
                Interrupter* interrupter = nullptr);

/// The paths of morph() from one surface to the other.
enum class Morphing {
    Linear,   ///< the zero set of (1-t) a + t b [Ohtake03 §6]; needs bands that reach each other
    Advection ///< a front moves from a's surface along its normal at constant speed and stops at
              ///< b's; in closed form, so that parts of b that a does not touch appear too: for
              ///< shapes that differ much; apart, a vanishes before b appears
};

/// The surface between @a a (@a t = 0) and @a b (@a t = 1), on one lattice, with the larger
/// half-width. Each place changes sides at most once. An empty solid is infinitely far away. Memory
/// is that of bands as wide as the shapes differ (Linear: of both; Advection: of a).
/// @throws UsageError for t outside [0,1], LimitError where that is more than 1000 voxels,
/// Interrupted.
LevelSet morph(const LevelSet& a, const LevelSet& b, double t, Morphing how,
               Interrupter* interrupter = nullptr);

/// A fog volume called "density", on the same lattice: 1 inside, falling over the band's inner half
/// to 0 at the surface. A solid that is nowhere as deep as its band has 1 where it is deepest.
openvdb::FloatGrid::Ptr toFog(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

/// The measures of a connected part of a solid.
struct ComponentMeasures {
    double volume = 0, area = 0; ///< world units cubed, squared
    Box3d bounds;                ///< of the zero set, world units
    double genus = 0;            ///< as in SolidMeasures
};

class SolidParts;

/// The connected parts of a solid, with their cavities, found and measured once. Cheap to copy.
class SolidComponents
{
public:
    /// @throws Interrupted.
    explicit SolidComponents(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

    /// The measures of all parts, largest first; of equals by the first voxel.
    const std::vector<ComponentMeasures>& measures() const { return mMeasures; }
    /// The union of the largest parts, at most @a count, of at least @a minVolume (world units
    /// cubed). @throws UsageError for a volume below 0, Interrupted.
    LevelSet keep(double minVolume, std::size_t count, Interrupter* interrupter = nullptr) const;

private:
    LevelSet mLevelSet;
    std::shared_ptr<const SolidParts> mParts;
    std::vector<std::uint32_t> mOrder; ///< indices of the parts
    std::vector<ComponentMeasures> mMeasures;
};

/// A part as a level set of its own.
struct SolidComponent : ComponentMeasures {
    LevelSet levelSet;
};

/// The parts of a solid as level sets, largest first. @throws Interrupted.
std::vector<SolidComponent> components(const LevelSet& levelSet,
                                       Interrupter* interrupter = nullptr);

/// SolidComponents(levelSet).keep(minVolume, count).
LevelSet keepComponents(const LevelSet& levelSet, double minVolume, std::size_t count,
                        Interrupter* interrupter = nullptr);

/// The measures of a solid.
struct SolidMeasures {
    double volume = 0, area = 0;          ///< world units cubed, squared
    Box3d bounds;                         ///< of the zero set, world units
    std::int64_t eulerCharacteristic = 0; ///< of the surface
    std::uint64_t surfaces = 0;           ///< connected parts of the surface, cavities too
    double genus = 0;                     ///< handles of all surfaces: surfaces - Euler / 2
    /// @{ Diameters of the largest balls inside that touch the surface, to a few percent: the
    /// smallest between walls that face each other, and the mean over the surface.
    double minThickness = 0;
    double meanThickness = 0;
    /// @}
};

/// Measures a solid; second order in the voxel size but for thickness: along sharp edges the area
/// lacks up to 0.3 voxels times their length, where these leave cells. @throws Interrupted.
SolidMeasures measure(const LevelSet& levelSet, Interrupter* interrupter = nullptr);

} // namespace mpuvdb
