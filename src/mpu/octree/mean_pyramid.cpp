#include "mean_pyramid.h"

#include "files/array_file.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

/// Least cosine between the normals of points with one mean. [derived: turns of 0.64 radians: more
/// than noise of normals, less than between the faces of an edge]
constexpr double kSameSheetCosine = 0.8;

/// Points below which no coarser means are made. [free: time]
constexpr std::size_t kFewestPoints = 64;

/// Points of a task. [free: grain]
constexpr std::size_t kChunk = 1 << 14;

/// What the names of a level's arrays begin with in a file.
std::string prefixOf(std::uint64_t level)
{
    return "means " + std::to_string(level) + ' ';
}

/// Sums over the points of a cell that are of one sheet.
struct SheetSums {
    Vec3d position = Vec3d::Zero(), normal = Vec3d::Zero();
    double weight = 0;
};

/// A mean: position, normal, confidence, and the key of its cell.
struct Mean {
    Vec3f position, normal;
    float confidence;
    std::uint64_t key;
};

/// Means of the points of one cell.
class CellMeans
{
public:
    void append(const SortedPoints& points, std::size_t begin, std::size_t end,
                std::vector<Mean>& out)
    {
        const PointArrays& p = points.points();
        mCount = 0;
        for (std::size_t n = begin; n < end; ++n) {
            const Vec3d normal(p.nx[n], p.ny[n], p.nz[n]);
            SheetSums& sheet = sheetOf(normal);
            const auto weight = double(p.confidence[n]);
            sheet.position += weight * Vec3d(p.x[n], p.y[n], p.z[n]);
            sheet.normal += weight * normal;
            sheet.weight += weight;
        }
        for (std::size_t s = 0; s < mCount; ++s) {
            const SheetSums& sheet = mSheets[s];
            out.push_back({(sheet.position / sheet.weight).cast<float>(),
                           sheet.normal.normalized().cast<float>(), float(sheet.weight),
                           points.keyOf(begin)});
        }
    }

private:
    /// The sheet whose mean normal is nearest, if near enough or if there are as many as may be;
    /// else a new one.
    SheetSums& sheetOf(const Vec3d& normal)
    {
        std::size_t best = 0;
        double cosine = -2;
        for (std::size_t s = 0; s < mCount; ++s) {
            const double along = normal.dot(mSheets[s].normal) / mSheets[s].normal.norm();
            if (along > cosine) best = s, cosine = along;
        }
        if (cosine > kSameSheetCosine || mCount == mSheets.size()) return mSheets[best];
        mSheets[mCount] = {};
        return mSheets[mCount++];
    }

    std::array<SheetSums, 6> mSheets; // [derived: one for each side of a cube]
    std::size_t mCount = 0;
};

/// Means of the points of @a from over the cells of @a level.
SortedPoints meansOver(const SortedPoints& from, const RootCube& root, int level,
                       Interrupter& progress)
{
    std::vector<std::vector<Mean>> chunks((from.size() + kChunk - 1) / kChunk);
    tbb::parallel_for(std::size_t(0), chunks.size(), [&](std::size_t c) {
        progress.check();
        CellMeans means;
        from.forEachCell(
            level, {c * kChunk, std::min((c + 1) * kChunk, from.size())},
            [&](std::size_t begin, std::size_t end) { means.append(from, begin, end, chunks[c]); });
    });
    std::size_t count = 0;
    for (const auto& chunk : chunks) count += chunk.size();
    PointBatch all;
    all.resize(count);
    std::vector<std::uint64_t> keys(count);
    std::size_t n = 0;
    for (auto& chunk : chunks) {
        for (const Mean& mean : chunk) {
            all.x[n] = mean.position[0], all.y[n] = mean.position[1], all.z[n] = mean.position[2];
            all.nx[n] = mean.normal[0], all.ny[n] = mean.normal[1], all.nz[n] = mean.normal[2];
            all.confidence[n] = mean.confidence;
            keys[n++] = mean.key;
        }
        chunk = {};
    }
    return {std::move(all), std::move(keys), root};
}

} // namespace

MeanPyramid::MeanPyramid(const SortedPoints& points, const RootCube& root, double finest,
                         Interrupter& progress)
    : mPoints(points), mRoot(root)
{
    while (mFinest < SortedPoints::kMaxLevel && root.size(mFinest) > finest) ++mFinest;
    const SortedPoints* from = &points;
    for (int level = mFinest; level > 0 && from->size() > kFewestPoints; --level) {
        mMeans.push_back(meansOver(*from, root, level, progress));
        from = &mMeans.back();
    }
}

MeanPyramid::MeanPyramid(const SortedPoints& points, const ArrayFile& file, const RootCube& root)
    : mPoints(points), mRoot(root), mFinest(file.value<std::int32_t>("finest level of means"))
{
    const auto levels = file.value<std::uint64_t>("levels of means");
    for (std::uint64_t n = 0; n < levels; ++n) mMeans.emplace_back(file, prefixOf(n), root);
}

void MeanPyramid::save(ArrayFileWriter& file) const
{
    file.addValue("finest level of means", std::int32_t(mFinest));
    file.addValue("levels of means", std::uint64_t(mMeans.size()));
    for (std::size_t n = 0; n < mMeans.size(); ++n) mMeans[n].save(file, prefixOf(n));
}

const SortedPoints& MeanPyramid::of(double size) const
{
    std::size_t coarser = 0;
    while (coarser < mMeans.size() && mRoot.size(mFinest - int(coarser)) <= size) ++coarser;
    return coarser == 0 ? mPoints : mMeans[coarser - 1];
}

} // namespace mpuvdb
