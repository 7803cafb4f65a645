#include "crease.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using Leaf = openvdb::FloatTree::LeafNodeType;

/// The length of the sum of two unit gradients below which surfaces are opposed and meet nowhere
/// near, and that of their difference below which they are parallel and a crease changes no value.
/// [tuned: combine_test; 0.8 degrees]
constexpr float kOpposed = 0.014f, kParallel = 0.014f;
/// The length of a gradient below which its direction is unknown. [tuned: csg_bench]
constexpr float kMinGradient = 0.3f;
/// The length of a gradient below which a value is no distance. [tuned: csg_bench]
constexpr float kMinDistanceSlope = 0.95f;
/// How far the first guess may lie beyond where the surfaces are buried: voxels, and parts of the
/// distance to them, over which they may curve. [tuned: combine_test]
constexpr float kGuessMargin = 0.3f, kGuessCurvature = 0.15f;
/// The excess of a crease's distance over the surfaces', in voxels, up to which it is accepted
/// without a check that both are buried. [tuned: combine_test]
constexpr float kMaxUncheckedExcess = 0.3f;
/// The distance to both surfaces, in voxels, and the last step, in parts of the distance, below
/// which the search has converged: interpolated gradients jump from voxel to voxel.
/// [tuned: csg_bench]
constexpr float kConvergedOffset = 0.05f, kConvergedStep = 0.1f;
/// The largest distance to both surfaces, in voxels, of a place that counts as on the crease:
/// corners where an input's own creases end do not converge. [tuned: combine_boxes_test]
constexpr float kMaxOffset = 0.4f;
/// Steps along the crease; later ones are halved, as they would oscillate about corners.
/// [tuned: csg_bench]
constexpr int kFullSteps = 4, kMaxSteps = 24;
/// The farthest guess, in reaches. [tuned: combine_test]
constexpr float kMaxGuessReaches = 2;
/// The factor by which a step that leaves a band is shortened. [tuned: csg_bench]
constexpr float kBacktrack = 0.75f;
/// The distance, in voxels, to the other solid from which on a place does not touch it; and where
/// interpolation may have rounded off that solid's edges. [tuned: combine_boxes_test]
constexpr float kExposed = 0.1f, kExposedBesideEdge = 0.5f;
/// The largest errors, in voxels, of the distance a voxel off a smooth surface, and of the length
/// of its gradient. [tuned: combine_boxes_test]
constexpr float kMaxCurvatureError = 0.1f, kMaxSlopeError = 0.05f;
/// The cosine between gradients below which two faces may touch. [tuned: combine_boxes_test]
constexpr float kTouchingCosine = -0.96f;
/// The depth below a surface, in voxels, from which on a place is buried. [tuned: csg_bench]
constexpr float kBuriedDepth = 0.05f;
/// The least determinant of two gradients that are independent. [tuned: combine_test]
constexpr float kMinDeterminant = 1e-3f;

/// Whether two gradients are those of distances to smooth surfaces that do not touch.
bool arePlain(const Vec3f& a, const Vec3f& b)
{
    const float lengthA = a.norm(), lengthB = b.norm();
    return std::max(std::abs(lengthA - 1), std::abs(lengthB - 1)) < kMaxSlopeError &&
           a.dot(b) > kTouchingCosine * lengthA * lengthB;
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

/// The coefficients of the two gradients that lead to the crease of the linearized values.
struct CreaseFinder::Multipliers {
    float a = 0, b = 0, determinant = 0;

    /// Solves (ga, gb)^T (ga a + gb b) = (u, v).
    Multipliers(const Vec3f& ga, const Vec3f& gb, float u, float v)
    {
        const float aa = ga.squaredNorm(), bb = gb.squaredNorm(), ab = ga.dot(gb);
        determinant = aa * bb - ab * ab;
        if (determinant < kMinDeterminant * kParallel) return;
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
    const float u = -a.value, v = -b.value;
    if ((a.gradient + b.gradient).squaredNorm() < kOpposed * kOpposed)
        return {u + v > -kTouchingGap ? Place::Buried : Place::Surface, 0, false};
    const float lengthA = a.gradient.norm(), lengthB = b.gradient.norm();
    if (a.value == b.value && a.gradient == b.gradient) return {Place::Surface, 0, false};
    if (lengthA < kMinGradient || lengthB < kMinGradient) return unknown;
    const Vec3f ga = a.gradient / lengthA, gb = b.gradient / lengthB;
    const auto surface = [&](bool isSure) {
        bool holds = a.value > 0;
        if (!holds && lengthA <= kMinDistanceSlope) // the gradient does not lead to the surface
            holds = b.value > u;
        else if (!holds)
            holds = isExposed(at, *readerA, *readerB, u * ga, arePlain(a.gradient, b.gradient));
        return holds ? Answer{Place::Surface, 0, isSure} : unknown;
    };
    if ((ga - gb).squaredNorm() < kParallel * kParallel) return surface(false);
    const Multipliers guess(ga, gb, u, v);
    const float surfaces = std::max(u, v), margin = kGuessMargin + kGuessCurvature * surfaces;
    // Gradients between a solid's own faces are shorter than 1.
    if (guess.a < -margin || guess.b < -margin)
        return surface(std::min(lengthA, lengthB) > kMinDistanceSlope);
    const Vec3f toCrease = guess.a * ga + guess.b * gb;
    const bool isFar = toCrease.norm() >= mReach + 2;
    Answer answer = unknown;
    if (!isFar) answer = follow(at, *readerA, *readerB, toCrease);
    if (answer.place == Place::Surface) return surface(answer.isSure);
    // The crease is no nearer than the surfaces.
    answer.distance = std::max(answer.distance, surfaces);
    if (answer.place == Place::Crease && answer.distance < surfaces + kMaxUncheckedExcess)
        return answer;
    if (!bothBuried(at, *readerA, *readerB, u * ga, v * gb)) return surface(false);
    if (answer.place == Place::Crease) return answer;
    return {Place::Buried, 0, false};
}

/// Whether the level set is linear along its gradient about a place: the surface has no edge there.
bool CreaseFinder::isSmooth(const Coord& at, const SolidReader& solid, const Vec3f& offset,
                            const SolidReader::Sample& there)
{
    SolidReader::Sample in, out;
    return solid.interpolate(at, offset - there.gradient, in) &&
           solid.interpolate(at, offset + there.gradient, out) &&
           std::abs(out.value - there.value - 1) < kMaxCurvatureError &&
           std::abs(in.value - there.value + 1) < kMaxCurvatureError;
}

/// The place on the crease nearest to the voxel, by Newton steps from a first guess: both values
/// are linearized, and the nearest place of the line where they are as wanted is the next.
CreaseFinder::Answer CreaseFinder::follow(const Coord& at, const SolidReader& readerA,
                                          const SolidReader& readerB, Vec3f toCrease) const
{
    SolidReader::Sample a, b;
    Answer nearest{Place::Unknown, 0, false};
    float least = kMaxOffset; // off either surface
    for (int step = 0; step < kMaxSteps; ++step) {
        if (!readerA.interpolate(at, toCrease, a) || !readerB.interpolate(at, toCrease, b)) {
            toCrease *= kBacktrack;
            continue;
        }
        const float u = -a.value, v = -b.value;
        const Multipliers along(a.gradient, b.gradient, u + a.gradient.dot(toCrease),
                                v + b.gradient.dot(toCrease));
        if (along.determinant < kMinDeterminant) break;
        const Vec3f next = along.a * a.gradient + along.b * b.gradient;
        const float moved = (next - toCrease).norm(), off = std::max(std::abs(u), std::abs(v));
        const float distance = toCrease.norm();
        if (off < least) {
            least = off;
            nearest = {along.a > 0 && along.b > 0 ? Place::Crease : Place::Surface, distance,
                       false};
        }
        if (off < kConvergedOffset && moved < kConvergedOffset + kConvergedStep * distance) {
            nearest.distance = next.norm();
            // Where interpolation has rounded off an input's own edge, the crease is elsewhere.
            nearest.isSure =
                nearest.place != Place::Crease ||
                (arePlain(a.gradient, b.gradient) && isSmooth(at, readerA, toCrease, a) &&
                 isSmooth(at, readerB, toCrease, b));
            break;
        }
        toCrease = step < kFullSteps ? next : Vec3f(0.5f * (toCrease + next));
        if (!(toCrease.norm() < kMaxGuessReaches * (mReach + 2))) break;
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
    if (!a.interpolate(at, foot, touched) || std::abs(touched.value) > kMaxOffset) return false;
    if (!b.interpolate(at, foot, other)) return near > 0;
    // A face that faces the same way does not close the surface; beside edges, though, others
    // between the two may touch.
    if (other.value > -kMaxOffset && touched.gradient.dot(other.gradient) > 0 &&
        b.valueNear(at, foot + foot.normalized()) > kExposed)
        return true;
    return other.value > kExposedBesideEdge ||
           (plain && other.value > -kExposed && arePlain(touched.gradient, other.gradient) &&
            isSmooth(at, a, foot, touched) && isSmooth(at, b, foot, other));
}

/// Whether the nearest places of both surfaces lie inside the other solid.
bool CreaseFinder::bothBuried(const Coord& at, const SolidReader& a, const SolidReader& b,
                              const Vec3f& toA, const Vec3f& toB) const
{
    return b.valueNear(at, toA) < -kBuriedDepth && a.valueNear(at, toB) < -kBuriedDepth;
}

} // namespace mpuvdb
