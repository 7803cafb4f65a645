// Booleans and motions of solids.
#include "solids.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// An operand and its sign; the solid is the maximum or minimum of all.
struct Operand {
    double sign;
    SolidPtr solid;
};

class Boolean final : public Solid
{
public:
    /// @param outer  +1: maximum of the signed children (intersection), -1: minimum (union).
    /// @param parts  as parts().
    Boolean(double outer, std::vector<Operand> operands, const Box3d& box, std::vector<Box3d> parts)
        : mOuter(outer), mOperands(std::move(operands)), mBox(box), mParts(std::move(parts))
    {
        for (Operand& o : mOperands) o.sign *= outer;
    }
    double distance(const Vec3d& p) const override { return combine(p, &Solid::distance); }
    double bound(const Vec3d& p) const override { return combine(p, &Solid::bound); }
    bool isExact() const override { return mOperands.size() == 1 && mOperands[0].solid->isExact(); }
    Vec3d normal(const Vec3d& p) const override
    {
        const Operand* ruler = nullptr;
        double largest = -HUGE_VAL;
        for (const Operand& o : mOperands) {
            const double d = o.sign * o.solid->distance(p);
            if (d > largest || !ruler) {
                largest = d;
                ruler = &o;
            }
        }
        return mOuter * ruler->sign * ruler->solid->normal(p);
    }
    Box3d bounds() const override { return mBox; }
    std::vector<Box3d> parts() const override { return mParts; }

private:
    double combine(const Vec3d& p, double (Solid::*value)(const Vec3d&) const) const
    {
        double largest = -HUGE_VAL;
        for (const Operand& o : mOperands)
            largest = std::max(largest, o.sign * ((*o.solid).*value)(p));
        return mOuter * largest;
    }

    double mOuter;
    std::vector<Operand> mOperands;
    Box3d mBox;
    std::vector<Box3d> mParts;
};

std::vector<Operand> operands(std::vector<SolidPtr> solids)
{
    std::vector<Operand> result;
    for (SolidPtr& s : solids) result.push_back({1, std::move(s)});
    return result;
}

class Moved final : public Solid
{
public:
    Moved(SolidPtr solid, const Eigen::Matrix3d& rotation, double scale, const Vec3d& translation)
        : mSolid(std::move(solid)), mRotation(rotation), mScale(scale), mTranslation(translation)
    {
    }
    double distance(const Vec3d& p) const override { return mScale * mSolid->distance(local(p)); }
    double bound(const Vec3d& p) const override { return mScale * mSolid->bound(local(p)); }
    bool isExact() const override { return mSolid->isExact(); }
    Vec3d normal(const Vec3d& p) const override { return mRotation * mSolid->normal(local(p)); }
    Box3d bounds() const override { return moved(mSolid->bounds()); }
    std::vector<Box3d> parts() const override
    {
        std::vector<Box3d> parts = mSolid->parts();
        for (Box3d& part : parts) part = moved(part);
        return parts;
    }

private:
    Box3d moved(const Box3d& box) const
    {
        const Vec3d middle = mTranslation + mScale * (mRotation * box.center());
        const Vec3d half = mScale * (mRotation.cwiseAbs() * (box.sizes() / 2));
        return Box3d(middle - half, middle + half);
    }
    Vec3d local(const Vec3d& p) const
    {
        return mRotation.transpose() * (p - mTranslation) / mScale;
    }
    SolidPtr mSolid;
    Eigen::Matrix3d mRotation;
    double mScale;
    Vec3d mTranslation;
};

/// Copies of a solid about the z axis. A point's nearest copy is that of its own sector, as
/// neighboring copies mirror each other at the plane between them.
class Ring final : public Solid
{
public:
    Ring(SolidPtr solid, int count) : mSolid(std::move(solid)), mSector(2 * M_PI / count) {}
    double distance(const Vec3d& p) const override
    {
        return mSolid->distance(sectorOf(p).transpose() * p);
    }
    double bound(const Vec3d& p) const override
    {
        return mSolid->bound(sectorOf(p).transpose() * p);
    }
    bool isExact() const override { return mSolid->isExact(); }
    Vec3d normal(const Vec3d& p) const override
    {
        const Eigen::Matrix3d r = sectorOf(p);
        return r * mSolid->normal(r.transpose() * p);
    }
    Box3d bounds() const override
    {
        const Box3d box = mSolid->bounds();
        const double r = std::hypot(std::max(std::abs(box.min().x()), std::abs(box.max().x())),
                                    std::max(std::abs(box.min().y()), std::abs(box.max().y())));
        return Box3d(Vec3d(-r, -r, box.min().z()), Vec3d(r, r, box.max().z()));
    }

private:
    Eigen::Matrix3d sectorOf(const Vec3d& p) const
    {
        const double angle = mSector * std::round(std::atan2(p.y(), p.x()) / mSector);
        const double c = std::cos(angle), s = std::sin(angle);
        Eigen::Matrix3d r;
        r << c, -s, 0, s, c, 0, 0, 0, 1;
        return r;
    }
    SolidPtr mSolid;
    double mSector;
};

} // namespace

SolidPtr makeUnion(std::vector<SolidPtr> solids)
{
    Box3d box;
    std::vector<Box3d> parts;
    for (const SolidPtr& s : solids) {
        box.extend(s->bounds());
        const std::vector<Box3d> more = s->parts();
        parts.insert(parts.end(), more.begin(), more.end());
    }
    return std::make_shared<Boolean>(-1, operands(std::move(solids)), box, std::move(parts));
}

SolidPtr makeIntersection(std::vector<SolidPtr> solids)
{
    Box3d box = solids.front()->bounds();
    for (const SolidPtr& s : solids) box = box.intersection(s->bounds());
    return std::make_shared<Boolean>(1, operands(std::move(solids)), box, std::vector<Box3d>{box});
}

SolidPtr makeDifference(std::vector<SolidPtr> solids)
{
    const Box3d box = solids.front()->bounds();
    std::vector<Box3d> parts = solids.front()->parts();
    std::vector<Operand> signedSolids = operands(std::move(solids));
    for (std::size_t i = 1; i < signedSolids.size(); ++i) signedSolids[i].sign = -1;
    return std::make_shared<Boolean>(1, std::move(signedSolids), box, std::move(parts));
}

SolidPtr makeMoved(SolidPtr solid, const Eigen::Matrix3d& rotation, double scale,
                   const Vec3d& translation)
{
    return std::make_shared<Moved>(std::move(solid), rotation, scale, translation);
}

SolidPtr makeRing(SolidPtr solid, int count)
{
    return std::make_shared<Ring>(std::move(solid), count);
}

} // namespace mpuvdb
