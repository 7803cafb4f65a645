#include "surface_places.h"

#include "core/clones.h"
#include "core/lanes.h"
#include "grid/leaf_halo.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::FloatGrid;
using openvdb::Index;
using Leaf = openvdb::FloatTree::LeafNodeType;
using Lanes = float __attribute__((vector_size(32)));
using Flags = std::int32_t __attribute__((vector_size(32)));

/// Smallest length of a gradient, which is 1 for distances. [tuned: coverage_test]
constexpr float kMinGradient = 0.5f;
/// Distance from the surface, voxels, at which projection ends. [tuned: coverage_test]
constexpr float kMaxResidual = 0.2f;

/// One number for each voxel of a leaf and each axis.
using Vectors = std::array<std::array<float, Leaf::SIZE>, 3>;

/// Slopes of the eight voxels in a row from @a at on along an axis, from neighbors in the band.
[[gnu::always_inline]] inline Lanes slopeAlong(const float* at, std::ptrdiff_t next,
                                               float background, Flags& known)
{
    const auto here = lanesAt<Lanes>(at), above = lanesAt<Lanes>(at + next),
               below = lanesAt<Lanes>(at - next);
    const Flags isAbove = magnitude(above) < background, isBelow = magnitude(below) < background;
    const Lanes rise = (isAbove ? above : here) - (isBelow ? below : here);
    known &= isAbove | isBelow;
    return (isAbove & isBelow) != 0 ? 0.5f * rise : rise;
}

/// Unit gradients of the distance in the rows of a leaf with @a voxels, zero where an axis has no
/// neighbor in the band, or the gradient is too short; and the places on the zero set along them,
/// in voxels from the leaf's first.
/// @param values  at the leaf's first voxel, in rows of @a row and slabs of @a slab values.
MPUVDB_CLONES
void findGradients(const Leaf::NodeMaskType& voxels, const float* values, std::ptrdiff_t slab,
                   std::ptrdiff_t row, float background, float shortest, Vectors& gradients,
                   Vectors& feet)
{
    for (int n = 0; n < 64; ++n) {
        if (!voxels.getWord<std::uint8_t>(Index(n))) continue;
        const float* const at = values + (n >> 3) * slab + (n & 7) * row;
        Flags known = Flags{} - 1;
        const Lanes x = slopeAlong(at, slab, background, known),
                    y = slopeAlong(at, row, background, known),
                    z = slopeAlong(at, 1, background, known);
        const Lanes squared = x * x + y * y + z * z;
        known &= squared >= shortest * shortest;
        Lanes length;
        for (int k = 0; k < 8; ++k) length[k] = std::sqrt(squared[k]);
        const Lanes scale = 1 / length;
        const auto put = [&](std::size_t axis, const Lanes& slope, const Lanes& from) {
            const Lanes kept = known ? scale * slope : Lanes{},
                        foot = from - lanesAt<Lanes>(at) * kept;
            std::memcpy(gradients[axis].data() + 8 * n, &kept, sizeof kept);
            std::memcpy(feet[axis].data() + 8 * n, &foot, sizeof foot);
        };
        put(0, x, Lanes{} + float(n >> 3));
        put(1, y, Lanes{} + float(n & 7));
        put(2, z, Lanes{0, 1, 2, 3, 4, 5, 6, 7});
    }
}

/// Set places from feet and gradients of voxels. Returns whether any gradient is zero.
MPUVDB_CLONES
bool setPlaces(const Leaf::NodeMaskType& voxels, const Vectors& gradients, const Vectors& feet,
               const Vec3d& origin, double voxelSize, SurfacePlace* place)
{
    using Quad = float __attribute__((vector_size(16)));
    using Four = double __attribute__((vector_size(32)));
    const Four low{origin[0], origin[1], origin[2], 0};
    const auto at = [](const Vectors& v, Index n) {
        return __builtin_convertvector((Quad{v[0][n], v[1][n], v[2][n], 0}), Four);
    };
    bool isAnyZero = false;
    for (Index word = 0; word < kBlockDim; ++word)
        for (auto left = voxels.getWord<std::uint64_t>(word); left; left &= left - 1, ++place) {
            const Index n = 64 * word + Index(__builtin_ctzll(left));
            const Four position = low + voxelSize * at(feet, n), normal = at(gradients, n);
            std::memcpy(place->position.data(), &position, 3 * sizeof(double));
            std::memcpy(place->normal.data(), &normal, 3 * sizeof(double));
            isAnyZero |= gradients[0][n] == 0 && gradients[1][n] == 0 && gradients[2][n] == 0;
        }
    return isAnyZero;
}

} // namespace

/// A leaf of the band with its surroundings.
class SurfacePlaces::Band
{
public:
    explicit Band(const FloatGrid& grid)
        : mAccess(grid.tree()), mVoxelSize(float(grid.voxelSize()[0])),
          mBackground(grid.background() / mVoxelSize)
    {
    }

    /// @param projections, places  see SurfacePlaces::find().
    void find(const Coord& origin, const Leaf::NodeMaskType& voxels, const Lattice& lattice,
              int projections, SurfacePlace* places)
    {
        const Leaf* const leaf = mAccess.probeConstLeaf(origin);
        if (!leaf) return;
        mLow = origin;
        mVoxels = voxels;
        const float perVoxel = float(1 / lattice.voxelSize);
        mHalo.load(mAccess, leaf->origin(), perVoxel, 0, 1);
        findGradients(voxels, &mHalo.value[LeafHalo::index(0, 0, 0)], LeafHalo::kStride[0],
                      LeafHalo::kStride[1], mBackground, kMinGradient, mGradients, mFeet);
        const Vec3d low =
            lattice.origin + lattice.voxelSize * Vec3d(origin[0], origin[1], origin[2]);
        if (!setPlaces(voxels, mGradients, mFeet, low, lattice.voxelSize, places) &&
            projections == 1)
            return;
        mHalo.load(mAccess, leaf->origin(), perVoxel, 2, 3);
        for (auto voxel = voxels.beginOn(); voxel; ++voxel, ++places) {
            Vec3f gradient = at(mGradients, voxel.pos());
            if (projections == 1 && gradient != Vec3f::Zero()) continue;
            const Vec3f x = nearestTo(Leaf::offsetToLocalCoord(voxel.pos()), projections, gradient);
            places->position = low + lattice.voxelSize * x.cast<double>();
            places->normal = gradient.cast<double>();
        }
    }

private:
    static Vec3f at(const Vectors& vectors, std::size_t n)
    {
        return {vectors[0][n], vectors[1][n], vectors[2][n]};
    }
    /// The nearest place on the zero set, value times gradient away from a voxel; repeated from
    /// there, as outside an edge values may be less than the distance. Coordinates are local to the
    /// leaf.
    Vec3f nearestTo(Coord at, int projections, Vec3f& gradient) const
    {
        gradient = gradientAt(at);
        while (gradient == Vec3f::Zero()) {
            const Coord next = nearestToSurface(at);
            if (next == at) break;
            at = next;
            gradient = gradientAt(at);
        }
        Vec3f x = Vec3i(at[0], at[1], at[2]).cast<float>();
        float value = valueAt(at);
        for (int n = 1; std::abs(value) > kMaxResidual; ++n) {
            x -= value * gradient;
            if (n == projections) break;
            value = sample(x, gradient);
            gradient.normalize();
        }
        return x;
    }
    float valueAt(const Coord& at) const
    {
        const auto isNear = [&](int k) { return at[k] >= -1 && at[k] <= kBlockDim; };
        return isNear(0) && isNear(1) && isNear(2) ? mHalo[LeafHalo::index(at[0], at[1], at[2])]
                                                   : mAccess.getValue(mLow + at) / mVoxelSize;
    }
    bool isBand(float value) const { return std::abs(value) < mBackground; }

    Vec3f gradientAt(const Coord& at) const
    {
        const bool isKnown =
            ((at[0] | at[1] | at[2]) & ~7) == 0 && mVoxels.isOn(Leaf::coordToOffset(at));
        return isKnown ? Band::at(mGradients, Leaf::coordToOffset(at)) : gradientBeside(at);
    }
    /// The gradient at a voxel that is not among the leaf's.
    Vec3f gradientBeside(const Coord& at) const
    {
        Vec3f gradient;
        const float here = valueAt(at);
        for (int axis = 0; axis < 3; ++axis) {
            Coord above = at, below = at;
            ++above[axis];
            --below[axis];
            const float up = valueAt(above), down = valueAt(below);
            const int steps = int(isBand(up)) + int(isBand(down));
            if (!steps) return Vec3f::Zero();
            gradient[axis] =
                ((isBand(up) ? up : here) - (isBand(down) ? down : here)) / float(steps);
        }
        return gradient.norm() < kMinGradient ? Vec3f::Zero() : gradient.normalized();
    }
    /// The voxel of the band that is nearest to the surface, of @a at and its 26 neighbors.
    Coord nearestToSurface(const Coord& at) const
    {
        Coord best = at;
        float least = std::abs(valueAt(at));
        for (int n = 0; n < 27; ++n) {
            const Coord next = at.offsetBy(n / 9 - 1, n / 3 % 3 - 1, n % 3 - 1);
            const float v = valueAt(next);
            if (!isBand(v) || !(std::abs(v) < least)) continue;
            best = next;
            least = std::abs(v);
        }
        return best;
    }
    /// Value and gradient by trilinear interpolation.
    float sample(const Vec3f& x, Vec3f& gradient) const
    {
        const auto floorOf = [](float v) { return int(v) - int(float(int(v)) > v); };
        const Coord base(floorOf(x[0]), floorOf(x[1]), floorOf(x[2]));
        std::array<float, 8> v;
        for (int n = 0; n < 8; ++n)
            v[std::size_t(n)] = valueAt(base.offsetBy(n >> 2, n >> 1 & 1, n & 1));
        const float tx = x[0] - float(base[0]), ty = x[1] - float(base[1]),
                    tz = x[2] - float(base[2]);
        const auto between = [](float a, float b, float t) { return a + t * (b - a); };
        // Along z, then along y, then along x.
        const float z00 = between(v[0], v[1], tz), z01 = between(v[2], v[3], tz),
                    z10 = between(v[4], v[5], tz), z11 = between(v[6], v[7], tz);
        const float y0 = between(z00, z01, ty), y1 = between(z10, z11, ty);
        gradient = {y1 - y0, between(z01 - z00, z11 - z10, tx),
                    between(between(v[1] - v[0], v[3] - v[2], ty),
                            between(v[5] - v[4], v[7] - v[6], ty), tx)};
        return between(y0, y1, tx);
    }

    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    float mVoxelSize, mBackground; ///< world units; voxels
    Coord mLow;                    ///< the leaf's origin
    Leaf::NodeMaskType mVoxels;    ///< whose gradients and feet are known
    LeafHalo mHalo;                ///< voxels
    Vectors mGradients, mFeet;
};

SurfacePlaces::SurfacePlaces(const FloatGrid& surface, const Lattice& lattice)
    : mBand(std::make_unique<Band>(surface)), mLattice(lattice)
{
}

SurfacePlaces::~SurfacePlaces() = default;

void SurfacePlaces::find(const Leaf& leaf, int projections, SurfacePlace* places)
{
    mBand->find(leaf.origin(), leaf.valueMask(), mLattice, projections, places);
}

} // namespace mpuvdb
