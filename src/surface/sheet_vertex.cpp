#include "sheet_vertex.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Normals of a sheet that differ by less than this (cosine to their mean) are those of a smooth
/// surface, bent; and so are gradients of about this length.
constexpr float kSmooth = 0.985f;
constexpr float kSteepness = 0.05f;

/// Two planes of equal weight and angle t between their normals have eigenvalues in the ratio
/// tan^2(t/2): folds of less than about 20 degrees are smoothed over.
constexpr double kLeastEigenvalue = 0.03;

/// Folds of flat faces are kept down to this: less turns the normals of a sheet by half a degree
/// (cosine to their mean) at most.
constexpr double kLeastOfFaces = 1e-4; // eigenvalue
constexpr float kUnturned = 0.99996f;

/// Faces are flat where their values bend by no more than this share of the normals' turn.
constexpr float kStraight = 0.125f;

/// Steeper than this along an axis, values say nothing of bends: those of a surface lie across.
constexpr float kAcross = 0.9f;

/// Where an edge crosses a plane that it misses.
constexpr float kNowhere = 1e6f;

/// How far beyond its cell a vertex on a crease may lie, voxels: a crease that passes a cell
/// closely is followed, where a vertex held at the wall would fold its triangles over.
constexpr double kBeyond = 0.5;

/// Vertices keep this distance from the walls of their cell where the surface lets them move along
/// it, voxels: no two coincide where the surface passes through a voxel.
constexpr float kInset = 0.05f;

/// From which error of prediction on (voxels) the plane at a voxel says nothing.
constexpr float kWorstPlane = 0.4f;

Vec3f cornerOf(int c)
{
    return Vec3f(float(c >> 2 & 1), float(c >> 1 & 1), float(c & 1));
}

Vec3f inset(const Vec3f& p)
{
    return p.cwiseMax(kInset).cwiseMin(1 - kInset);
}

int stepTo(int c)
{
    return (c >> 2 & 1) * BlockHalo::kStride[0] + (c >> 1 & 1) * BlockHalo::kStride[1] +
           (c & 1) * BlockHalo::kStride[2];
}

/// The place of least weighted squared distance from planes, in or near the unit cube, as near to
/// the mean as the planes leave it free.
class Quadric
{
public:
    struct Minimum {
        Vec3d place;
        Eigen::Matrix3d free; ///< projects onto the directions that the planes leave open
        int rank;             ///< of those that they decide
    };

    explicit Quadric(const Vec3d& mean) : mMean(mean) {}

    void add(const Vec3d& normal, const Vec3d& point, double weight)
    {
        mSquares += weight * normal * normal.transpose();
        mRight += weight * normal * normal.dot(point - mMean);
    }

    /// @param beyond  how far outside the cube it may lie. @param least  eigenvalue, by the
    /// largest, of a direction that the planes decide.
    Minimum minimum(double beyond, double least) const
    {
        const auto nearest = [&](const Vec3d& place) -> Vec3d {
            return place.cwiseMax(-beyond).cwiseMin(1 + beyond);
        };
        Eigen::Array3i open = Eigen::Array3i::Ones();
        Minimum found = solve(open, mMean, least);
        // A minimum outside is held at the wall it passes farthest, and sought along it.
        for (int round = 0; round < 2; ++round) {
            const Vec3d held = nearest(found.place);
            Eigen::Index axis = 0;
            if ((held - found.place).cwiseAbs().maxCoeff(&axis) <= 0) break;
            open[axis] = 0;
            found.place = solve(open, held, least).place;
        }
        found.place = nearest(found.place);
        return found;
    }

private:
    /// The minimum over the open coordinates, the others held where @a at has them.
    Minimum solve(const Eigen::Array3i& open, const Vec3d& at, double least) const
    {
        const Vec3d mask = open.cast<double>().matrix();
        const Vec3d held = (Vec3d::Ones() - mask).cwiseProduct(at - mMean);
        const Eigen::Matrix3d squares = mask.asDiagonal() * mSquares * mask.asDiagonal();
        const Vec3d right = mask.asDiagonal() * (mRight - mSquares * held);
        Minimum found{mMean + held, Eigen::Matrix3d::Zero(), 0};
        if (Vec3d only; decidesOne(squares, least, only)) {
            const double value = only.dot(squares * only);
            found.place += mask.asDiagonal() * only * (only.dot(right) / value);
            found.free = Eigen::Matrix3d::Identity() - only * only.transpose();
            found.rank = 1;
            return found;
        }
        Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
        solver.computeDirect(squares);
        for (int n = 0; n < 3; ++n) {
            const double value = solver.eigenvalues()[n];
            const Vec3d direction = solver.eigenvectors().col(n);
            if (value > least * solver.eigenvalues()[2]) {
                found.place += mask.asDiagonal() * direction * (direction.dot(right) / value);
                ++found.rank;
            } else {
                found.free += direction * direction.transpose();
            }
        }
        return found;
    }

    /// Whether planes decide one @a direction alone, as most do: the eigenvector that powers of
    /// their squares lead to, if what else they hold is too little to count.
    static bool decidesOne(const Eigen::Matrix3d& squares, double least, Vec3d& direction)
    {
        // Each step leaves of what is off no more than the other eigenvalues' share.
        constexpr int kSteps = 4;
        Eigen::Index most = 0;
        if (!(squares.diagonal().maxCoeff(&most) > 0)) return false;
        Vec3d at = squares.col(most);
        for (int step = 0; step < kSteps; ++step) at = squares * at;
        direction = at.normalized();
        const double value = direction.dot(squares * direction);
        // The squares of all eigenvalues but this.
        return squares.squaredNorm() - value * value <= least * least * value * value;
    }

    Vec3d mMean;
    Eigen::Matrix3d mSquares = Eigen::Matrix3d::Zero();
    Vec3d mRight = Vec3d::Zero();
};

} // namespace

/// Where a sheet crosses the edges of its cell; in the cell's coordinates.
struct SheetPlacer::Crossings {
    int count = 0;
    std::array<int, 12> edge;
    std::array<Vec3f, 12> point;
    Vec3f mean = Vec3f::Zero();
    bool areSteep = true; ///< as distances
    float cosine = 1;     ///< least, of their normals to the mean of these

    bool areSmooth() const { return areSteep && cosine > kSmooth; }
};

Vec3f SheetPlacer::centralGradient(int index) const
{
    const float scale = float(0.5 / mLattice.voxelSize);
    Vec3f gradient;
    for (int axis = 0; axis < 3; ++axis) {
        const int step = BlockHalo::kStride[std::size_t(axis)];
        gradient[axis] = scale * (mValues[index + step] - mValues[index - step]);
    }
    return gradient;
}

const SheetPlacer::ValueCrossing& SheetPlacer::valueCrossing(const Vec3i& low, int axis)
{
    ValueCrossing& found = mValueCrossings[edgeIndex(low, axis)];
    if (found.block == mBlock) return found;
    found.block = mBlock;
    const int from = BlockHalo::index(low.x(), low.y(), low.z());
    const int to = from + BlockHalo::kStride[std::size_t(axis)];
    const float t = mValues[from] / (mValues[from] - mValues[to]);
    const Vec3f gradient = (1 - t) * centralGradient(from) + t * centralGradient(to);
    const float length = gradient.norm();
    found.at = t;
    found.normal = gradient * (1 / std::max(length, 1e-6f));
    found.isSteep = std::abs(length - 1) < kSteepness;
    return found;
}

SheetPlacer::Crossings SheetPlacer::crossingsOf(const Vec3i& at, const DualCell& cell, int sheet)
{
    Crossings found;
    std::array<const ValueCrossing*, 12> crossing;
    Vec3f mean = Vec3f::Zero();
    for (unsigned edges = cell.sheets().edges[std::size_t(sheet)]; edges; edges &= edges - 1) {
        const int e = __builtin_ctz(edges);
        const Vec3f low = cornerOf(cellEdge(e).low);
        const auto n = std::size_t(found.count++);
        crossing[n] = &valueCrossing(at + low.cast<int>(), e / 4);
        found.edge[n] = e;
        found.point[n] = low;
        found.point[n][e / 4] = crossing[n]->at;
        found.mean += found.point[n];
        found.areSteep &= crossing[n]->isSteep;
        mean += crossing[n]->normal;
    }
    found.mean *= 1 / float(found.count);
    mean *= 1 / std::max(mean.norm(), 1e-6f);
    for (std::size_t n = 0; n < std::size_t(found.count); ++n)
        found.cosine = std::min(found.cosine, crossing[n]->normal.dot(mean));
    return found;
}

/// Of the eight octants about a voxel, the one in which the values are most nearly those of a
/// distance to a plane: creases lie elsewhere.
SheetPlacer::Plane SheetPlacer::planeThrough(int index) const
{
    const auto scale = float(1 / mLattice.voxelSize);
    const auto [sx, sy, sz] = BlockHalo::kStride;
    const float here = scale * mValues[index];
    // Octant o lies up the axes of its bits: 1 is x, 2 y, 4 z. Its corners but the voxel itself, by
    // the axes on which they are beside it.
    std::array<std::array<float, 8>, 8> corner;
    for (int o = 0; o < 8; ++o) {
        const int x = o & 1 ? sx : -sx, y = o & 2 ? sy : -sy, z = o & 4 ? sz : -sz;
        for (int at = 1; at < 8; ++at)
            corner[std::size_t(at)][std::size_t(o)] =
                mValues[index + (at & 1 ? x : 0) + (at & 2 ? y : 0) + (at & 4 ? z : 0)];
    }
    std::array<std::array<float, 8>, 3> rise;
    std::array<float, 8> error;
    for (std::size_t o = 0; o < 8; ++o) {
        const float a = scale * corner[1][o] - here, b = scale * corner[2][o] - here,
                    c = scale * corner[4][o] - here;
        // How far off the plane through these three the octant's other corners are.
        const float ab = scale * corner[3][o] - here - a - b,
                    ac = scale * corner[5][o] - here - a - c,
                    bc = scale * corner[6][o] - here - b - c,
                    abc = scale * corner[7][o] - here - a - b - c;
        error[o] =
            std::max(std::max(std::abs(ab), std::abs(ac)), std::max(std::abs(bc), std::abs(abc)));
        rise[0][o] = a;
        rise[1][o] = b;
        rise[2][o] = c;
    }
    for (std::size_t o = 0; o < 8; ++o) {
        const float slope =
            std::sqrt(rise[0][o] * rise[0][o] + rise[1][o] * rise[1][o] + rise[2][o] * rise[2][o]);
        // Values that rise faster are a multiple of distances, or of different sides of a crease:
        // then the other corners are far off the plane.
        error[o] = slope > 1 ? error[o] / slope : std::max(error[o], 1 - slope);
    }
    const auto best = std::size_t(std::min_element(error.begin(), error.end()) - error.begin());
    Plane plane;
    plane.error = error[best];
    for (std::size_t axis = 0; axis < 3; ++axis)
        plane.normal[Eigen::Index(axis)] = best >> axis & 1 ? rise[axis][best] : -rise[axis][best];
    const float slope = plane.normal.norm();
    plane.distance = here;
    plane.steepness = std::max(slope, 1.0f);
    plane.normal /= slope;
    return plane;
}

/// The same, found once for the eight cells about a voxel of the block or one beyond.
const SheetPlacer::Plane& SheetPlacer::planeAt(const Vec3i& voxel)
{
    if (mPlanes.empty()) mPlanes.resize(kVoxels);
    Plane& plane = mPlanes[voxelIndex(voxel)];
    if (plane.block != mBlock) {
        plane = planeThrough(BlockHalo::index(voxel.x(), voxel.y(), voxel.z()));
        plane.block = mBlock;
    }
    return plane;
}

/// Planes from the ends of the crossed edges.
class SheetPlacer::Planes
{
public:
    explicit Planes(const Vec3f& mean) : mQuadric(mean.cast<double>()) {}
    void add(const Vec3f& normal, const Vec3f& point, float weight)
    {
        mQuadric.add(normal.cast<double>(), point.cast<double>(), double(weight));
        ++mCount;
    }
    int count() const { return mCount; }
    const Quadric& quadric() const { return mQuadric; }

private:
    Quadric mQuadric;
    int mCount = 0;
};

/// The plane in which each edge crosses, from those at its ends: where these meet between the ends,
/// the first that is met from inside if the surface is convex there, and else the last.
void SheetPlacer::addGridPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes)
{
    const int home = BlockHalo::index(at.x(), at.y(), at.z());
    for (int n = 0; n < crossings.count; ++n) {
        CellEdge ends = cellEdge(crossings.edge[std::size_t(n)]);
        if (mValues[home + stepTo(ends.low)] >= 0) std::swap(ends.low, ends.high);
        const Vec3f from = cornerOf(ends.low), along = cornerOf(ends.high) - from;
        const Plane& inner = planeAt(at + from.cast<int>());
        const Plane& outer = planeAt(at + cornerOf(ends.high).cast<int>());
        // Beside a crease one of them may look steep, of values that are a multiple all.
        const float steepness = std::min(inner.steepness, outer.steepness);
        // Where along the edge the plane of one of its ends is crossed, from inside to outside.
        const auto crossing = [&](const Plane& plane, const Vec3f& end) {
            const float slope = plane.normal.dot(along);
            if (plane.error >= kWorstPlane || slope <= 0) return kNowhere;
            const float start = plane.distance / steepness + plane.normal.dot(from - end);
            return -start / slope;
        };
        const float t = crossing(inner, from), u = crossing(outer, from + along);
        bool takesOuter = false;
        if (t != kNowhere && u != kNowhere) {
            const float rise = (outer.distance - inner.distance) / steepness;
            const bool convex = rise > inner.normal.dot(along);
            takesOuter = (t < u) != convex;
        } else if (u != kNowhere) {
            takesOuter = true;
        } else if (t == kNowhere) {
            continue;
        }
        const Plane& plane = takesOuter ? outer : inner;
        const float weight = 1 - plane.error / kWorstPlane;
        planes.add(plane.normal, from + (takesOuter ? u : t) * along, weight * weight);
    }
}

/// Where the field itself crosses an edge of a cell, and its direction there; found once for the
/// four cells that share the edge. @param start  where the values cross it, 0 to 1.
const SheetPlacer::FieldCrossing& SheetPlacer::fieldCrossing(const Vec3i& at, int edge, float start)
{
    constexpr int kSteps = 6;
    // A last step by the slope, from so near, leaves less than a thousandth of a voxel; where the
    // values face the same way, as they do off creases, it may be longer.
    constexpr double kNear = 0.02, kNearInSmooth = 0.06, kDisagrees = 0.06; // voxels
    const CellEdge ends = cellEdge(edge);
    const Vec3i low = at + cornerOf(ends.low).cast<int>();
    if (mFieldCrossings.empty()) mFieldCrossings.resize(3 * kVoxels);
    FieldCrossing& found = mFieldCrossings[edgeIndex(low, edge / 4)];
    if (found.block == mBlock) return found;
    found.block = mBlock;
    const double h = mLattice.voxelSize;
    const Vec3d from = mLattice.origin + h * (mOrigin + low.cast<double>());
    const Vec3d along = h * Vec3d::Unit(edge / 4);
    const bool lowInside = mValues[BlockHalo::index(low.x(), low.y(), low.z())] < 0;
    double least = 0, most = 1, t = double(start);
    FieldSample sample = mField->evaluate(from + t * along);
    const Vec3d facing = valueCrossing(low, edge / 4).normal.cast<double>();
    const auto isNear = [&] {
        const double length = sample.gradient.norm();
        const bool isSmooth = sample.gradient.dot(facing) > double(kSmooth) * length;
        return std::abs(sample.value) <= (isSmooth ? kNearInSmooth : kNear) * h * length;
    };
    for (int step = 0; step < kSteps && !isNear(); ++step) {
        ((sample.value < 0) == lowInside ? least : most) = t;
        const double slope = sample.gradient.dot(along);
        const double next = slope != 0 ? t - sample.value / slope : 0.5 * (least + most);
        t = next > least && next < most ? next : 0.5 * (least + most);
        sample = mField->evaluate(from + t * along);
    }
    const double length = sample.gradient.norm();
    found.isFound = std::abs(sample.value) <= kDisagrees * h * length && length > 0;
    if (found.isFound) {
        const double slope = sample.gradient.dot(along);
        const double last = slope != 0 ? t - sample.value / slope : t;
        found.at = float(last > least && last < most ? last : t);
        found.normal = (sample.gradient / length).cast<float>();
    }
    return found;
}

/// Planes where the field itself crosses the edges; nothing where field and grid disagree.
void SheetPlacer::addFieldPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes)
{
    for (std::size_t n = 0; n < std::size_t(crossings.count); ++n) {
        const int edge = crossings.edge[n];
        const Vec3f from = cornerOf(cellEdge(edge).low), axis = Vec3f::Unit(edge / 4);
        const FieldCrossing& found = fieldCrossing(at, edge, (crossings.point[n] - from).dot(axis));
        if (found.isFound) planes.add(found.normal, from + found.at * axis, 1);
    }
}

/// One step to the zero of the values' trilinear interpolation, and away from the walls.
Vec3f SheetPlacer::ontoSurface(const Vec3i& at, Vec3f p) const
{
    const int home = BlockHalo::index(at.x(), at.y(), at.z());
    const auto between = [](float low, float high, float t) { return low + t * (high - low); };
    // By corners of the face across x: bit 1 is y; the values there at p's height, and their rise.
    std::array<float, 4> column, rise;
    for (int c = 0; c < 4; ++c) {
        const float low = mValues[home + stepTo(2 * c)], high = mValues[home + stepTo(2 * c + 1)];
        rise[std::size_t(c)] = high - low;
        column[std::size_t(c)] = between(low, high, p.z());
    }
    const float low = between(column[0], column[1], p.y()),
                high = between(column[2], column[3], p.y());
    const float value = between(low, high, p.x());
    const Vec3f gradient(
        high - low, between(column[1] - column[0], column[3] - column[2], p.x()),
        between(between(rise[0], rise[1], p.y()), between(rise[2], rise[3], p.y()), p.x()));
    const float square = gradient.squaredNorm();
    if (!(square > 0)) return p;
    p -= value / square * gradient;
    const Vec3f inward = inset(p) - p;
    p += inward - inward.dot(gradient) / square * gradient;
    return p.cwiseMax(-kInset).cwiseMin(1 + kInset);
}

/// Whether the values go on straight from a voxel along each axis, one way or the other: along it
/// is at most one fold of flat faces. @param most  bend, as a part of the voxel size.
bool SheetPlacer::isStraight(int index, float most) const
{
    const auto h = float(mLattice.voxelSize);
    const float here = mValues[index];
    for (const int step : BlockHalo::kStride) {
        const float up = mValues[index + step], down = mValues[index - step];
        if (std::abs(up - down) > 2 * kAcross * h) continue;
        const float bendUp = mValues[index + 2 * step] - 2 * up + here;
        const float bendDown = mValues[index - 2 * step] - 2 * down + here;
        if (std::min(std::abs(bendUp), std::abs(bendDown)) > most * h) return false;
    }
    return true;
}

/// Whether a dull fold of flat faces passes through the cell of a smooth sheet: each crossed edge
/// has an end from which the values are flat, and the planes of these meet in the cell.
bool SheetPlacer::liesOnFold(const Vec3i& at, const Crossings& crossings)
{
    if (crossings.cosine > kUnturned) return false;
    // The angle to the mean, radians.
    const float most = kStraight * std::sqrt(2 * (1 - crossings.cosine));
    const auto isFlat = [&](const Vec3f& corner) {
        const Vec3i voxel = at + corner.cast<int>();
        return isStraight(BlockHalo::index(voxel.x(), voxel.y(), voxel.z()), most) &&
               planeAt(voxel).error <= most;
    };
    for (int n = 0; n < crossings.count; ++n) {
        const CellEdge ends = cellEdge(crossings.edge[std::size_t(n)]);
        if (!isFlat(cornerOf(ends.low)) && !isFlat(cornerOf(ends.high))) return false;
    }
    Planes planes(crossings.mean);
    addGridPlanes(at, crossings, planes);
    const Quadric::Minimum fold = planes.quadric().minimum(kBeyond, kLeastOfFaces);
    const Vec3d middle = Vec3d::Constant(0.5);
    const Vec3d nearest = fold.place + fold.free * (middle - fold.place);
    return fold.rank > 1 && (nearest - middle).cwiseAbs().maxCoeff() <= 0.5;
}

SheetVertex SheetPlacer::place(const Vec3i& at, const DualCell& cell, int sheet, Freedom freedom)
{
    const Crossings crossings = crossingsOf(at, cell, sheet);
    SheetVertex vertex;
    Vec3f inCell = crossings.mean;
    const bool areSmooth = crossings.areSmooth();
    if (freedom == Freedom::None) {
        // Whatever the planes say, this is inside.
        inCell = inset(inCell);
    } else if (areSmooth && !liesOnFold(at, crossings)) {
        if (cell.sheets().count == 1) inCell = ontoSurface(at, inCell);
    } else {
        Planes planes(crossings.mean);
        if (mField) addFieldPlanes(at, crossings, planes);
        if (planes.count() < crossings.count) addGridPlanes(at, crossings, planes);
        if (planes.count() > 0) {
            // Folds may wait for the cell that they pass through: triangles stay well shaped.
            const double beyond =
                areSmooth ? -double(kInset) : (freedom == Freedom::Near ? kBeyond : 0);
            const Quadric::Minimum minimum =
                planes.quadric().minimum(beyond, areSmooth ? kLeastOfFaces : kLeastEigenvalue);
            inCell = minimum.place.cast<float>();
            inCell += minimum.free.cast<float>() * (inset(inCell) - inCell);
            if (freedom == Freedom::Half) inCell = 0.5f * (inCell + crossings.mean);
            vertex.feature = !areSmooth && minimum.rank > 1;
        }
    }
    vertex.position = at.cast<float>() + inCell;
    vertex.reach = (inCell - crossings.mean).norm();
    return vertex;
}

} // namespace mpuvdb
