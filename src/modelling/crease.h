// The distance to where two surfaces meet: to their crease.
//
// A union is looked at from one side only: with values a and b, negative inside, its creases are
// where a = b = 0. A point from which the nearest places of both surfaces are buried under the
// other has its nearest place there. Intersections and differences are unions of complements.
#pragma once
#include <mpuvdb/vec.h>

#include <openvdb/openvdb.h>

namespace mpuvdb
{

/// The widest gap, in voxels, between opposed surfaces that count as touching.
/// [tuned: combine_boxes_test]
constexpr float kTouchingGap = 0.01f;

/// A solid's level set, or its complement's, between voxels: values in voxels. For one thread.
class SolidReader
{
public:
    struct Sample {
        float value = 0;
        Vec3f gradient = Vec3f::Zero();
    };

    /// @param scale  1 / voxel size; negative for the complement.
    SolidReader(const openvdb::FloatTree& tree, float scale) : mAccess(tree), mScale(scale) {}

    float valueAt(const openvdb::Coord& at) const { return mScale * mAccess.getValue(at); }
    bool isInBand(const openvdb::Coord& at) const { return mAccess.isValueOn(at); }
    /// The gradient by differences between active voxels, central where both neighbors are; 0 along
    /// axes where neither is.
    Vec3f gradientAt(const openvdb::Coord& at) const;
    /// Trilinear value and gradient at @a offset voxels from @a at; false outside the band.
    bool interpolate(const openvdb::Coord& at, const Vec3f& offset, Sample& sample) const;
    /// The trilinear value; outside the band that of the nearest voxel, whose sign is right.
    float valueNear(const openvdb::Coord& at, const Vec3f& offset) const;

private:
    openvdb::tree::ValueAccessor<const openvdb::FloatTree> mAccess;
    float mScale;
};

/// Finds the nearest place of the crease of a union. Lengths in voxels. For one thread.
class CreaseFinder
{
public:
    enum class Place {
        Surface, ///< the nearest place lies on one of the surfaces: the sharp value holds
        Crease,  ///< the nearest place lies on the crease
        Buried,  ///< the nearest places of both surfaces are buried, and no crease is near
        Unknown  ///< only the sharp value is known
    };
    struct Answer {
        Place place = Place::Surface;
        float distance = 0;  ///< to the crease
        bool isSure = false; ///< both solids' values are distances, and the crease is located
    };

    /// @param reach  farthest distance asked.
    CreaseFinder(const SolidReader& a, const SolidReader& b, float reach)
        : mA(a), mB(b), mReach(reach)
    {
    }

    /// The nearest place for the voxel @a at, in both bands; the same to the bit if the
    /// solids change places.
    Answer find(const openvdb::Coord& at) const;

private:
    struct Multipliers;
    Answer follow(const openvdb::Coord& at, const SolidReader& a, const SolidReader& b,
                  Vec3f toCrease) const;
    bool isExposed(const openvdb::Coord& at, const SolidReader& a, const SolidReader& b,
                   const Vec3f& foot, bool plain) const;
    static bool isSmooth(const openvdb::Coord& at, const SolidReader& solid, const Vec3f& offset,
                         const SolidReader::Sample& there);
    bool bothBuried(const openvdb::Coord& at, const SolidReader& a, const SolidReader& b,
                    const Vec3f& toA, const Vec3f& toB) const;

    SolidReader mA, mB;
    float mReach;
};

} // namespace mpuvdb
