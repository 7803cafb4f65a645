#include "crease.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = openvdb::FloatTree::LeafNodeType;

/// Surfaces whose gradients add up to less run against each other: they meet nowhere near.
constexpr float kOpposed = 0.014f;
/// Surfaces whose gradients differ by less run along each other: the crease changes no value.
constexpr float kParallel = 0.014f;
/// A gradient shorter than this has no direction.
constexpr float kLeastGradient = 0.3f;
/// A gradient shorter than this is no distance's.
constexpr float kLeastSlope = 0.95f;
/// How far the first guess may lie beyond where the surfaces are buried: voxels, and parts of the
/// distance to them, over which they may curve.
constexpr float kGuessMargin = 0.3f, kCurving = 0.15f;
/// Farther than the surfaces by less, in voxels, a crease is taken without a look at those.
constexpr float kLittleFarther = 0.3f;
/// How near to both surfaces, in voxels, a place on the crease is to be, and how steady (parts of
/// its distance, for interpolated gradients jump from voxel to voxel); and how near if it is to be
/// taken at all, at corners where an input's own creases end.
constexpr float kOnCrease = 0.05f, kSteady = 0.1f, kNearCrease = 0.4f;
/// Steps along the crease; the later ones are halved, against swinging about a corner.
constexpr int kFullSteps = 4, kMostSteps = 24;
/// How many times the reach a guess may be off; for a ball's path, on the way to which surfaces may
/// curve.
constexpr float kFarGuess = 2;
/// What is left of a step that leaves a band.
constexpr float kShorter = 0.75f;
/// A place so far outside the other solid, in voxels, does not touch it; and where interpolation
/// may have rounded off an edge or corner of it, at most by so much.
constexpr float kExposed = 0.1f, kRounded = 0.5f;
/// Off a smooth surface by a voxel, distances differ from it by no more. A gradient's length is as
/// near to 1 there.
constexpr float kEdge = 0.1f, kOffLength = 0.05f;
/// The cosine of gradients below which two faces may be one, touched from both sides.
constexpr float kMayTouch = -0.96f;
/// Voxels that a place lies deeper than a surface to be buried under it.
constexpr float kDepth = 0.05f;
/// How far aside a place may be that a voxel's gradient tells, as part of its distance. A ball that
/// lacks as little room changes the value by the square of that.
constexpr float kAside = 0.01f;
/// The least determinant of two gradients that tell where to go.
constexpr float kLeastDeterminant = 1e-3f;

/// Whether two gradients are those of distances to smooth surfaces that do not touch.
bool arePlain(const Vec3f& a, const Vec3f& b)
{
    const float lengthA = a.norm(), lengthB = b.norm();
    return std::max(std::abs(lengthA - 1), std::abs(lengthB - 1)) < kOffLength &&
           a.dot(b) > kMayTouch * lengthA * lengthB;
}

bool before(const SolidReader::Sample& a, const SolidReader::Sample& b)
{
    if (a.value != b.value) return a.value < b.value;
    return std::lexicographical_compare(a.gradient.data(), a.gradient.data() + 3, b.gradient.data(),
                                        b.gradient.data() + 3);
}

} // namespace

Vec3f SolidReader::gradientAt(const Coord& at) const
{
    const float here = mAccess.getValue(at);
    Vec3f gradient;
    for (int axis = 0; axis < 3; ++axis) {
        Coord side = at;
        float below = here, above = here;
        side[axis] = at[axis] - 1;
        const bool hasBelow = mAccess.probeValue(side, below);
        side[axis] = at[axis] + 1;
        const bool hasAbove = mAccess.probeValue(side, above);
        gradient[axis] = hasBelow && hasAbove ? 0.5f * (above - below)
                         : hasAbove           ? above - here
                         : hasBelow           ? here - below
                                              : 0;
    }
    return mScale * gradient;
}

bool SolidReader::interpolate(const Coord& at, const Vec3f& offset, Sample& sample) const
{
    const Vec3f low = offset.array().floor();
    const Vec3f t = offset - low;
    const Coord base = at.offsetBy(int(low[0]), int(low[1]), int(low[2]));
    float v[8];
    const Leaf* const leaf = mAccess.probeConstLeaf(base);
    if (leaf && (base[0] & 7) < 7 && (base[1] & 7) < 7 && (base[2] & 7) < 7) {
        const openvdb::Index first = Leaf::coordToOffset(base);
        const float* const data = leaf->buffer().data();
        for (unsigned n = 0; n < 8; ++n) {
            const openvdb::Index i = first + (n >> 2) * 64 + (n >> 1 & 1) * 8 + (n & 1);
            if (!leaf->isValueOn(i)) return false;
            v[n] = data[i];
        }
    } else {
        for (int n = 0; n < 8; ++n)
            if (!mAccess.probeValue(base.offsetBy(n >> 2, n >> 1 & 1, n & 1), v[n])) return false;
    }
    const auto mix = [](float a, float b, float s) { return a + s * (b - a); };
    const float z00 = mix(v[0], v[1], t[2]), z01 = mix(v[2], v[3], t[2]),
                z10 = mix(v[4], v[5], t[2]), z11 = mix(v[6], v[7], t[2]);
    const float y0 = mix(z00, z01, t[1]), y1 = mix(z10, z11, t[1]);
    sample.value = mScale * mix(y0, y1, t[0]);
    const float dz0 = mix(v[1] - v[0], v[3] - v[2], t[1]),
                dz1 = mix(v[5] - v[4], v[7] - v[6], t[1]);
    sample.gradient = mScale * Vec3f(y1 - y0, mix(z01 - z00, z11 - z10, t[0]), mix(dz0, dz1, t[0]));
    return true;
}

float SolidReader::valueNear(const Coord& at, const Vec3f& offset) const
{
    Sample sample;
    if (interpolate(at, offset, sample)) return sample.value;
    return valueAt(at.offsetBy(int(std::lround(offset[0])), int(std::lround(offset[1])),
                               int(std::lround(offset[2]))));
}

/// How far along the two gradients the crease lies that they and their values tell.
struct CreaseFinder::Multipliers {
    float a = 0, b = 0, determinant = 0;

    /// Solves (ga, gb)^T (ga a + gb b) = (u, v).
    Multipliers(const Vec3f& ga, const Vec3f& gb, float u, float v)
    {
        const float aa = ga.squaredNorm(), bb = gb.squaredNorm(), ab = ga.dot(gb);
        determinant = aa * bb - ab * ab;
        if (determinant < kLeastDeterminant * kParallel) return;
        a = (u * bb - v * ab) / determinant;
        b = (v * aa - u * ab) / determinant;
    }
};

CreaseFinder::Answer CreaseFinder::find(const Coord& at) const
{
    const SolidReader *readerA = &mA, *readerB = &mB;
    SolidReader::Sample a{mA.valueAt(at), mA.gradientAt(at)}, b{mB.valueAt(at), mB.gradientAt(at)};
    if (before(b, a)) {
        std::swap(a, b);
        std::swap(readerA, readerB);
    }
    const Answer unknown{Place::Unknown, 0, false};
    const float u = mRadius - a.value, v = mRadius - b.value;
    if ((a.gradient + b.gradient).squaredNorm() < kOpposed * kOpposed)
        return {u + v > -kTouching ? Place::Buried : Place::Surface, 0, false};
    const float lengthA = a.gradient.norm(), lengthB = b.gradient.norm();
    if (!readerB->isInBand(at)) { // it may yet be in the way of a ball that touches the nearer one
        if (lengthA < kLeastGradient) return unknown;
        const Vec3f toCenter = u / lengthA * a.gradient;
        if (hasRoom(at, *readerA, *readerB, toCenter)) return {Place::Surface, 0, true};
        const Answer answer = follow(at, *readerA, *readerB, toCenter);
        return answer.place == Place::Crease ? answer : unknown;
    }
    if (mRadius == 0 && a.value == b.value && a.gradient == b.gradient)
        return {Place::Surface, 0, false};
    if (lengthA < kLeastGradient || lengthB < kLeastGradient) return unknown;
    const Vec3f ga = a.gradient / lengthA, gb = b.gradient / lengthB;
    const auto surface = [&](bool isSure) {
        if (mRadius == 0) {
            bool holds = a.value > 0;
            if (!holds && lengthA <= kLeastSlope) // the gradient does not tell where to look
                holds = b.value > u;
            else if (!holds)
                holds = isExposed(at, *readerA, *readerB, u * ga, arePlain(a.gradient, b.gradient));
            return holds ? Answer{Place::Surface, 0, isSure} : unknown;
        }
        return hasRoom(at, *readerA, *readerB, u * ga) ? Answer{Place::Surface, 0, isSure}
                                                       : unknown;
    };
    if ((ga - gb).squaredNorm() < kParallel * kParallel) return surface(false);
    const Multipliers guess(ga, gb, u, v);
    const float surfaces = std::max(u, v), margin = kGuessMargin + kCurving * surfaces;
    // Where a solid's own faces meet, its gradient is none of theirs, and shorter.
    if (guess.a < -margin || guess.b < -margin)
        return surface(std::min(lengthA, lengthB) > kLeastSlope);
    const Vec3f toCrease = guess.a * ga + guess.b * gb;
    const bool isFar = toCrease.norm() >= (mRadius > 0 ? kFarGuess : 1) * (mReach + 2);
    Answer answer = unknown;
    if (!isFar) answer = follow(at, *readerA, *readerB, toCrease);
    if (answer.place == Place::Surface) return surface(answer.isSure);
    // The crease is no nearer than the surfaces.
    answer.distance = std::max(answer.distance, surfaces);
    if (answer.place == Place::Crease && answer.distance < surfaces + kLittleFarther) return answer;
    if (!bothBuried(at, *readerA, *readerB, u * ga, v * gb)) return surface(false);
    if (answer.place == Place::Crease) return answer;
    // What a ball's fillet covers may yet be outside.
    return {mRadius == 0 || isFar ? Place::Buried : Place::Unknown, 0, false};
}

/// Whether a surface has no edge of its own where it passes through a place.
bool CreaseFinder::isSmooth(const Coord& at, const SolidReader& solid, const Vec3f& offset,
                            const SolidReader::Sample& there)
{
    SolidReader::Sample in, out;
    return solid.interpolate(at, offset - there.gradient, in) &&
           solid.interpolate(at, offset + there.gradient, out) &&
           std::abs(out.value - there.value - 1) < kEdge &&
           std::abs(in.value - there.value + 1) < kEdge;
}

/// From a first guess to the place on the crease that is nearest to the voxel: linearize both
/// values there, and go to the nearest place of the line where they are as wanted.
CreaseFinder::Answer CreaseFinder::follow(const Coord& at, const SolidReader& readerA,
                                          const SolidReader& readerB, Vec3f toCrease) const
{
    SolidReader::Sample a, b;
    Answer nearest{Place::Unknown, 0, false};
    float least = kNearCrease; // off either surface
    for (int step = 0; step < kMostSteps; ++step) {
        if (!readerA.interpolate(at, toCrease, a) || !readerB.interpolate(at, toCrease, b)) {
            toCrease *= kShorter;
            continue;
        }
        const float u = mRadius - a.value, v = mRadius - b.value;
        const Multipliers along(a.gradient, b.gradient, u + a.gradient.dot(toCrease),
                                v + b.gradient.dot(toCrease));
        if (along.determinant < kLeastDeterminant) break;
        const Vec3f next = along.a * a.gradient + along.b * b.gradient;
        const float moved = (next - toCrease).norm(), off = std::max(std::abs(u), std::abs(v));
        const float distance = toCrease.norm();
        if (off < least) {
            least = off;
            nearest = {along.a > 0 && along.b > 0 ? Place::Crease : Place::Surface, distance,
                       false};
        }
        if (off < kOnCrease && moved < kOnCrease + kSteady * distance) {
            nearest.distance = next.norm();
            // Where interpolation has rounded off an input's own edge, the crease is elsewhere.
            nearest.isSure =
                mRadius > 0 || nearest.place != Place::Crease ||
                (arePlain(a.gradient, b.gradient) && isSmooth(at, readerA, toCrease, a) &&
                 isSmooth(at, readerB, toCrease, b));
            break;
        }
        toCrease = step < kFullSteps ? next : Vec3f(0.5f * (toCrease + next));
        if (!(toCrease.norm() < kFarGuess * (mReach + 2))) break;
    }
    return nearest;
}

/// Whether the nearest place of the surface @a a, the nearer, is on the union's: neither inside the
/// other solid nor where the two touch. @param plain  see arePlain(), at the voxel.
bool CreaseFinder::isExposed(const Coord& at, const SolidReader& a, const SolidReader& b,
                             const Vec3f& foot, bool plain) const
{
    const float near = b.valueAt(at.offsetBy(int(std::lround(foot[0])), int(std::lround(foot[1])),
                                             int(std::lround(foot[2]))));
    if (plain && near > 1) return true;
    SolidReader::Sample touched, other;
    if (!a.interpolate(at, foot, touched) || std::abs(touched.value) > kNearCrease) return false;
    if (!b.interpolate(at, foot, other)) return near > 0;
    // What faces the same way does not close the surface; beside edges, though, two faces that do
    // may have others between them that touch.
    if (other.value > -kNearCrease && touched.gradient.dot(other.gradient) > 0 &&
        b.valueNear(at, foot + foot.normalized()) > kExposed)
        return true;
    return other.value > kRounded ||
           (plain && other.value > -kExposed && arePlain(touched.gradient, other.gradient) &&
            isSmooth(at, a, foot, touched) && isSmooth(at, b, foot, other));
}

/// Whether a ball has room where it touches the surface @a a, the nearer; a point always has.
bool CreaseFinder::hasRoom(const Coord& at, const SolidReader& a, const SolidReader& b,
                           const Vec3f& toCenter) const
{
    if (a.valueAt(at) >= mRadius) return true;
    SolidReader::Sample touched;
    return a.interpolate(at, toCenter, touched) &&
           std::abs(touched.value - mRadius) < kNearCrease &&
           b.valueNear(at, toCenter) >= mRadius - kDepth - kAside * toCenter.norm();
}

/// Whether the nearest places of both surfaces (a ball's radius off) lie inside the other solid.
bool CreaseFinder::bothBuried(const Coord& at, const SolidReader& a, const SolidReader& b,
                              const Vec3f& toA, const Vec3f& toB) const
{
    const float buried = mRadius - kDepth;
    return b.valueNear(at, toA) < buried && a.valueNear(at, toB) < buried;
}

} // namespace mpuvdb
