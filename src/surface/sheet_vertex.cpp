#include "sheet_vertex.h"

#include "quadratic_error.h"

#include <algorithm>
#include <cmath>

namespace mpuvdb
{
namespace
{

/// Smallest cosine between a smooth sheet's normals and their mean. [tuned: sharp_mesh_test]
constexpr float kSmoothCosine = 0.985f;
/// Largest | |grad| - 1 | of a smooth sheet's crossings. [tuned: sharp_mesh_test]
constexpr float kSteepnessTolerance = 0.05f;

/// Smallest relative eigenvalue for folds of flat faces, which are kept from one degree on.
/// [tuned: sharp_mesh_test]
constexpr double kMinFaceEigenvalue = 1e-4;
/// Cosine to their mean of normals without such a fold. [derived: half a degree]
constexpr float kUnfoldedCosine = 0.99996f;

/// Largest bend of a flat face's values, relative to the normals' angle to their mean.
/// [tuned: sharp_mesh_test]
constexpr float kMaxBendShare = 0.125f;

/// Largest slope along an axis on which bends are tested: a surface bends across its normal.
/// [tuned: sharp_mesh_test]
constexpr float kMaxAxisSlope = 0.9f;

/// Largest distance of a crease vertex outside its cell, voxels: held at the wall, a vertex beside
/// a crease that just misses its cell would fold its triangles over. [tuned: sharp_mesh_test]
constexpr double kOutsideCell = 0.5;

/// Distance of vertices from the walls of their cell where the surface leaves them free, voxels: no
/// two coincide where the surface passes through a voxel. [tuned: mesh_test]
constexpr float kInset = 0.05f;

/// Length of the last Newton step, voxels, that leaves an error below a thousandth of a voxel
/// beside a crease. [tuned: sharp_mesh_test]
constexpr double kLastStep = 0.02;

Vec3f cornerPlace(int c)
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

} // namespace

/// Crossings of a sheet with the edges of its cell, in the cell's coordinates.
struct SheetPlacer::Crossings {
    int count = 0;
    std::array<int, 12> edge;
    std::array<Vec3f, 12> point;
    Vec3f mean = Vec3f::Zero();
    Vec3f normal = Vec3f::Zero(); ///< mean of their normals, unit
    bool areSteep = true;         ///< all slopes are those of a distance
    float cosine = 1;             ///< smallest, between their normals and the mean of these

    bool areSmooth() const { return areSteep && cosine > kSmoothCosine; }
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
    found.isSteep = std::abs(length - 1) < kSteepnessTolerance;
    return found;
}

SheetPlacer::Crossings SheetPlacer::crossingsOf(const Vec3i& at, const DualCell& cell, int sheet)
{
    Crossings found;
    std::array<const ValueCrossing*, 12> crossing;
    for (unsigned edges = cell.sheets().edges[std::size_t(sheet)]; edges; edges &= edges - 1) {
        const int e = __builtin_ctz(edges);
        const Vec3f low = cornerPlace(cellEdge(e).low);
        const auto n = std::size_t(found.count++);
        crossing[n] = &valueCrossing(at + low.cast<int>(), e / 4);
        found.edge[n] = e;
        found.point[n] = low;
        found.point[n][e / 4] = crossing[n]->at;
        found.mean += found.point[n];
        found.areSteep &= crossing[n]->isSteep;
        found.normal += crossing[n]->normal;
    }
    found.mean *= 1 / float(found.count);
    found.normal *= 1 / std::max(found.normal.norm(), 1e-6f);
    for (std::size_t n = 0; n < std::size_t(found.count); ++n)
        found.cosine = std::min(found.cosine, crossing[n]->normal.dot(found.normal));
    return found;
}

/// The plane at a voxel of the block or the layers above, cached for the eight cells about it.
const OctantPlane& SheetPlacer::planeAt(const Vec3i& voxel)
{
    if (mPlanes.empty()) mPlanes.resize(kVoxels);
    Plane& plane = mPlanes[voxelIndex(voxel)];
    if (plane.block != mBlock) {
        const int index = BlockHalo::index(voxel.x(), voxel.y(), voxel.z());
        const auto scale = float(1 / mLattice.voxelSize);
        plane = {octantPlane(&mValues.value[std::size_t(index)], BlockHalo::kStride, scale),
                 mBlock};
    }
    return plane.plane;
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
    const QuadraticError& quadric() const { return mQuadric; }

private:
    QuadraticError mQuadric;
    int mCount = 0;
};

/// Add for each edge the plane of one of its ends.
void SheetPlacer::addGridPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes)
{
    const int home = BlockHalo::index(at.x(), at.y(), at.z());
    for (int n = 0; n < crossings.count; ++n) {
        CellEdge ends = cellEdge(crossings.edge[std::size_t(n)]);
        if (mValues[home + stepTo(ends.low)] >= 0) std::swap(ends.low, ends.high);
        const Vec3f from = cornerPlace(ends.low), along = cornerPlace(ends.high) - from;
        const OctantPlane& inner = planeAt(at + from.cast<int>());
        const OctantPlane& outer = planeAt(at + cornerPlace(ends.high).cast<int>());
        const PlaneCrossing crossing = crossingByPlanes(inner, outer, along);
        if (crossing.plane)
            planes.add(crossing.plane->normal, from + crossing.at * along,
                       crossing.plane->weight());
    }
}

/// The crossing of the field with an edge of a cell, and its gradient's direction there; cached for
/// the four cells that share the edge. @param start  crossing of the values, 0 to 1.
const SheetPlacer::FieldCrossing& SheetPlacer::fieldCrossing(const Vec3i& at, int edge, float start)
{
    constexpr int kNewtonSteps = 6; ///< largest number of steps [tuned: sharp_mesh_test]
    /// Length of the last Newton step, voxels, where the values have the same direction, as off
    /// creases; see kLastStep. [tuned: sharp_mesh_test]
    constexpr double kLastSmoothStep = 0.06;
    /// Distance from the zero set, voxels, above which there is no crossing. [tuned:
    /// sharp_mesh_test]
    constexpr double kMaxDisagreement = 0.06;
    const CellEdge ends = cellEdge(edge);
    const Vec3i low = at + cornerPlace(ends.low).cast<int>();
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
        const bool isSmooth = sample.gradient.dot(facing) > double(kSmoothCosine) * length;
        return std::abs(sample.value) <= (isSmooth ? kLastSmoothStep : kLastStep) * h * length;
    };
    for (int step = 0; step < kNewtonSteps && !isNear(); ++step) {
        ((sample.value < 0) == lowInside ? least : most) = t;
        const double slope = sample.gradient.dot(along);
        const double next = slope != 0 ? t - sample.value / slope : 0.5 * (least + most);
        t = next > least && next < most ? next : 0.5 * (least + most);
        sample = mField->evaluate(from + t * along);
    }
    const double length = sample.gradient.norm();
    found.isFound = std::abs(sample.value) <= kMaxDisagreement * h * length && length > 0;
    if (found.isFound) {
        const double slope = sample.gradient.dot(along);
        const double last = slope != 0 ? t - sample.value / slope : t;
        found.at = float(last > least && last < most ? last : t);
        found.normal = (sample.gradient / length).cast<float>();
    }
    return found;
}

/// Add planes where the field crosses the edges; none where field and grid disagree.
void SheetPlacer::addFieldPlanes(const Vec3i& at, const Crossings& crossings, Planes& planes)
{
    for (std::size_t n = 0; n < std::size_t(crossings.count); ++n) {
        const int edge = crossings.edge[n];
        const Vec3f from = cornerPlace(cellEdge(edge).low), axis = Vec3f::Unit(edge / 4);
        const FieldCrossing& found = fieldCrossing(at, edge, (crossings.point[n] - from).dot(axis));
        if (found.isFound) planes.add(found.normal, from + found.at * axis, 1);
    }
}

/// Whether the field is not zero at a place in a cell: planes that meet there are of a curved
/// surface, and not of a crease.
bool SheetPlacer::isOffField(const Vec3i& at, const Vec3f& inCell) const
{
    const double h = mLattice.voxelSize;
    const Vec3d place = mOrigin + at.cast<double>() + inCell.cast<double>();
    const FieldSample sample = mField->evaluate(mLattice.origin + h * place);
    return std::abs(sample.value) > kLastStep * h * sample.gradient.norm();
}

/// The values, linear between voxels across an axis, at the faces of a cell across that axis and a
/// voxel beyond each: in the row through @a p along it.
template <int kAxis>
std::array<float, 4> SheetPlacer::rowThrough(int home, const Vec3f& p) const
{
    const std::size_t u = (kAxis + 1) % 3, v = (kAxis + 2) % 3;
    const int along = BlockHalo::kStride[kAxis], stepU = BlockHalo::kStride[u],
              stepV = BlockHalo::kStride[v];
    const auto between = [](float low, float high, float t) { return low + t * (high - low); };
    std::array<float, 4> row;
    for (int n = 0; n < 4; ++n) {
        const int index = home + (n - 1) * along;
        const float* const at = &mValues.value[std::size_t(index)];
        row[std::size_t(n)] = between(between(at[0], at[stepV], p[int(v)]),
                                      between(at[stepU], at[stepU + stepV], p[int(v)]), p[int(u)]);
    }
    return row;
}

/// One Newton step to where the mesh is on the surface in the mean, and away from the walls.
/// Between voxels the values are parabolas along each axis, with the harmonic mean of the second
/// differences at both ends, and none where these differ in sign: that of a crease beside the cell
/// does not count [vanLeer74].
Vec3f SheetPlacer::ontoSurface(const Vec3i& at, Vec3f p) const
{
    // Mean depth of a triangle below a surface through its vertices: a twelfth of the sum of the
    // curvatures times the area of a quad. [derived: a twelfth of the squares of its edges is the
    // variance of its places]
    constexpr float kDepth = 1.0f / 12;
    const int home = BlockHalo::index(at.x(), at.y(), at.z());
    float value = 0, bends = 0;
    Vec3f gradient;
    const std::array<std::array<float, 4>, 3> rows = {
        rowThrough<0>(home, p), rowThrough<1>(home, p), rowThrough<2>(home, p)};
    for (int axis = 0; axis < 3; ++axis) {
        const std::array<float, 4>& row = rows[std::size_t(axis)];
        const float t = p[axis];
        gradient[axis] = row[2] - row[1];
        if (axis == 0) value += row[1] + t * gradient[axis];
        const float low = row[2] - row[1] - (row[1] - row[0]),
                    high = row[3] - row[2] - (row[2] - row[1]);
        const float bend = low * high > 0 ? 2 * low * high / (low + high) : 0;
        value -= 0.5f * t * (1 - t) * bend;
        bends += bend;
    }
    const float square = gradient.squaredNorm();
    if (!(square > 0)) return p;
    // There are as many quads as edges that the surface crosses.
    const float area = std::sqrt(square) / gradient.lpNorm<1>();
    p -= (value - kDepth * area * bends) / square * gradient;
    const Vec3f inward = inset(p) - p;
    p += inward - inward.dot(gradient) / square * gradient;
    return p.cwiseMax(-kInset).cwiseMin(1 + kInset);
}

/// Curvature of the values about a voxel along the surface, per voxel: of the second differences up
/// and down an axis the lesser, as one side of a crease is flat, and the largest of the axes.
float SheetPlacer::curvatureAt(int index) const
{
    const auto h = float(mLattice.voxelSize);
    const float here = mValues[index];
    float most = 0;
    for (const int step : BlockHalo::kStride) {
        const float up = mValues[index + step], down = mValues[index - step];
        if (std::abs(up - down) > 2 * kMaxAxisSlope * h) continue;
        const float bendUp = mValues[index + 2 * step] - 2 * up + here;
        const float bendDown = mValues[index - 2 * step] - 2 * down + here;
        most = std::max(most, std::min(std::abs(bendUp), std::abs(bendDown)));
    }
    return most / h;
}

/// Whether a sheet whose normals differ is a strongly curved one: its values bend beyond the cell
/// as they do in it. On both sides of a crease they are straight.
bool SheetPlacer::isCurved(const Vec3i& at, const Crossings& crossings)
{
    // The share of the normals' turn that has to be the curvature's. [derived: about a ball of two
    // voxels' radius the lesser bend, a voxel farther off it, is a third to two thirds of the
    // ball's]
    constexpr float kCurved = 1.0f / 3;
    const int home = BlockHalo::index(at.x(), at.y(), at.z());
    float turn = 0, byCurvature = 0; // sums over the crossings, radians
    for (std::size_t n = 0; n < std::size_t(crossings.count); ++n) {
        const CellEdge ends = cellEdge(crossings.edge[n]);
        const float curvature =
            std::min(curvatureAt(home + stepTo(ends.low)), curvatureAt(home + stepTo(ends.high)));
        const Vec3i low = at + cornerPlace(ends.low).cast<int>();
        turn += (valueCrossing(low, crossings.edge[n] / 4).normal - crossings.normal).norm();
        byCurvature += curvature * (crossings.point[n] - crossings.mean).norm();
    }
    // The normals of flat faces turn by rounding.
    const float unfolded = float(crossings.count) * std::sqrt(2 * (1 - kUnfoldedCosine));
    return byCurvature > kCurved * std::max(turn, unfolded);
}

/// Whether an obtuse fold of flat faces passes through the cell of a smooth sheet: each crossed
/// edge has an end with linear values, and the planes of these meet in the cell.
bool SheetPlacer::liesOnFold(const Vec3i& at, const Crossings& crossings)
{
    if (crossings.cosine > kUnfoldedCosine) return false;
    // In proportion to the angle to the mean, radians.
    const float most = kMaxBendShare * std::sqrt(2 * (1 - crossings.cosine));
    const auto isFlat = [&](const Vec3f& corner) {
        const Vec3i voxel = at + corner.cast<int>();
        return curvatureAt(BlockHalo::index(voxel.x(), voxel.y(), voxel.z())) <= most &&
               planeAt(voxel).error <= most;
    };
    for (int n = 0; n < crossings.count; ++n) {
        const CellEdge ends = cellEdge(crossings.edge[std::size_t(n)]);
        if (!isFlat(cornerPlace(ends.low)) && !isFlat(cornerPlace(ends.high))) return false;
    }
    Planes planes(crossings.mean);
    addGridPlanes(at, crossings, planes);
    const QuadraticError::Minimum fold = planes.quadric().minimum(kOutsideCell, kMinFaceEigenvalue);
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
    const bool seemsCurved = !areSmooth && isCurved(at, crossings);
    const auto onSheet = [&] { // of several none is the values' zero alone
        return cell.sheets().count == 1 ? ontoSurface(at, crossings.mean) : crossings.mean;
    };
    if (freedom == Freedom::None) {
        inCell = inset(inCell);
    } else if (areSmooth ? !liesOnFold(at, crossings) : seemsCurved && !mField) {
        inCell = onSheet();
    } else {
        Planes planes(crossings.mean);
        if (mField) addFieldPlanes(at, crossings, planes);
        if (planes.count() < crossings.count) addGridPlanes(at, crossings, planes);
        if (planes.count() > 0) {
            // Obtuse folds move vertices of their own cells alone: triangles stay well shaped.
            const double beyond =
                areSmooth ? -double(kInset) : (freedom == Freedom::Near ? kOutsideCell : 0);
            const QuadraticError::Minimum minimum =
                planes.quadric().minimum(beyond, areSmooth ? kMinFaceEigenvalue : kMinEigenvalue);
            inCell = minimum.place.cast<float>();
            inCell += minimum.free.cast<float>() * (inset(inCell) - inCell);
            if (freedom == Freedom::Half) inCell = 0.5f * (inCell + crossings.mean);
            vertex.feature = !areSmooth && minimum.rank > 1;
            if (seemsCurved && isOffField(at, inCell)) {
                inCell = onSheet();
                vertex.feature = false;
            }
        }
    }
    vertex.position = at.cast<float>() + inCell;
    vertex.reach = (inCell - crossings.mean).norm();
    return vertex;
}

} // namespace mpuvdb
