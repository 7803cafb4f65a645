#include "spread_fit.h"

#include "core/morton.h"
#include "field_parts.h"
#include "files/array_file.h"
#include "files/atomic_file.h"
#include "mpu/fill/veto_leaves.h"
#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <tbb/parallel_for.h>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

constexpr const char *kPointsFile = SpreadFit::kFiles[0], *kScanFile = SpreadFit::kFiles[1],
                     *kUpperFile = SpreadFit::kFiles[2];

/// Points that take as long as a subtree takes without any. [free: balance]
constexpr std::size_t kSubtreePoints = 64;

template <typename Write>
void writeArrays(const fs::path& file, const Write& write)
{
    writeAtomically(file, [&](const fs::path& temporary) {
        ArrayFileWriter arrays(temporary);
        write(arrays);
        arrays.finish();
    });
}

/// Numbers by themselves: the gaps between the members of an object hold anything.
void save(ArrayFileWriter& file, const MpuSettings& s)
{
    const PointStatistics& p = s.points;
    file.addValue("settings",
                  std::array<double, 13>{s.tolerance, s.noise, s.normalNoise, s.voxelSize, s.alpha,
                                         double(s.minPoints), double(s.sharp),
                                         double(s.interpolate), p.spacing, p.evenSpacing, p.noise,
                                         p.normalNoise, double(p.fillSolid)});
}

MpuSettings loadSettings(const ArrayFile& file)
{
    const auto n = file.value<std::array<double, 13>>("settings");
    MpuSettings s;
    s.tolerance = n[0], s.noise = n[1], s.normalNoise = n[2], s.voxelSize = n[3], s.alpha = n[4];
    s.minPoints = int(n[5]), s.sharp = n[6] != 0, s.interpolate = n[7] != 0;
    PointStatistics& p = s.points;
    p.spacing = n[8], p.evenSpacing = n[9], p.noise = n[10], p.normalNoise = n[11];
    p.fillSolid = n[12] != 0;
    return s;
}

void saveStatistics(ArrayFileWriter& file, const MpuStatistics& s)
{
    file.addValue("statistics",
                  std::array<double, 7>{double(s.cells), double(s.leaves), double(s.fits),
                                        double(s.sharpFits), double(s.levels), s.maxError,
                                        double(s.overTolerance)});
}

MpuStatistics loadStatistics(const ArrayFile& file)
{
    const auto numbers = file.value<std::array<double, 7>>("statistics");
    MpuStatistics s;
    s.cells = std::uint64_t(numbers[0]);
    s.leaves = std::uint64_t(numbers[1]);
    s.fits = std::uint64_t(numbers[2]);
    s.sharpFits = std::uint64_t(numbers[3]);
    s.levels = int(numbers[4]);
    s.maxError = numbers[5];
    s.overTolerance = std::uint64_t(numbers[6]);
    return s;
}

void save(ArrayFileWriter& file, const OctreeDraft& tree)
{
    file.add("nodes", tree.nodes);
    file.add("fits", tree.fits);
    file.add("quadrics", tree.quadrics);
    file.addValue("complete", std::uint8_t(tree.complete));
    saveStatistics(file, tree.statistics);
}

template <typename T>
std::vector<T> copied(const StoredArray<T>& array)
{
    return {array.begin(), array.end()};
}

OctreeDraft loadDraft(const ArrayFile& file, const OctreeShape& shape)
{
    OctreeDraft tree(shape);
    tree.nodes = copied(file.get<OctreeNode>("nodes"));
    tree.fits = copied(file.get<StoredFit>("fits"));
    tree.quadrics = copied(file.get<QuadricCoefficients>("quadrics"));
    tree.complete = file.value<std::uint8_t>("complete") != 0;
    tree.statistics = loadStatistics(file);
    return tree;
}

/// Sort @a subtrees along the Morton curve, so that those of a part are near each other.
void sortAlongCurve(std::vector<SubtreeRoot>& subtrees)
{
    const auto keyOf = [](const SubtreeRoot& root) {
        const OctreeCell& c = root.cell;
        return mortonKey(c.i, c.j, c.k) << 3 * (SortedPoints::kMaxLevel - c.level);
    };
    std::sort(subtrees.begin(), subtrees.end(),
              [&](const SubtreeRoot& a, const SubtreeRoot& b) { return keyOf(a) < keyOf(b); });
}

/// Ends of parts of about @a pointsPerPart points.
std::vector<std::uint64_t> partEnds(const std::vector<SubtreeRoot>& subtrees,
                                    const SortedPoints& points, std::size_t pointsPerPart)
{
    std::vector<std::uint64_t> ends;
    std::size_t inPart = 0;
    for (std::size_t n = 0; n < subtrees.size(); ++n) {
        const SortedPoints::Range range = points.cellRange(subtrees[n].cell);
        inPart += range.end - range.begin + kSubtreePoints;
        if (inPart < pointsPerPart && n + 1 < subtrees.size()) continue;
        ends.push_back(n + 1);
        inPart = 0;
    }
    return ends;
}

} // namespace

void SpreadFit::plan(const fs::path& folder, PointCloud&& cloud, const MpuSettings& given,
                     std::size_t pointsPerPart, Interrupter& progress)
{
    checkSettings(cloud, given);
    MpuSettings settings = given;
    settings.sharp &= !settings.interpolate;
    const Vec3d frame = cloud.frame;
    const Box3d bounds = cloud.localBounds();
    const RootCube root = rootCube(bounds, settings.voxelSize);
    progress.beginStage("sort");
    writeArrays(folder / kPointsFile, [&](ArrayFileWriter& file) {
        SortedPoints(std::move(cloud), root, progress, copiesFor(settings)).save(file, "");
        save(file, settings);
        file.addValue("frame", frame);
        file.addValue("bounds", std::array<Vec3d, 2>{bounds.min(), bounds.max()});
    });
    progress.beginStage("upper fit");
    const SortedPoints points(ArrayFile(folder / kPointsFile), "", root);
    const auto scan = NoisyScan::of(points, root, settings, progress);
    if (scan) writeArrays(folder / kScanFile, [&](ArrayFileWriter& file) { scan->save(file); });
    UpperOctree upper = buildUpper(points, root, settings, scan.get(), progress);
    sortAlongCurve(upper.subtrees);
    writeArrays(folder / kUpperFile, [&](ArrayFileWriter& file) {
        save(file, upper.tree);
        file.add("subtrees", upper.subtrees);
        file.add("part ends", partEnds(upper.subtrees, points, pointsPerPart));
    });
    progress.endStage();
}

SpreadFit::SpreadFit(const fs::path& folder)
{
    const ArrayFile points(folder / kPointsFile);
    mSettings = loadSettings(points);
    mFrame = points.value<Vec3d>("frame");
    const auto bounds = points.value<std::array<Vec3d, 2>>("bounds");
    mBounds = Box3d(bounds[0], bounds[1]);
    mRoot = rootCube(mBounds, mSettings.voxelSize);
    mPoints = std::make_unique<SortedPoints>(points, "", mRoot);
    if (NoisyScan::isFor(mSettings) && fs::exists(folder / kScanFile))
        mScan = NoisyScan::open(*mPoints, ArrayFile(folder / kScanFile), mRoot);
    const ArrayFile upper(folder / kUpperFile);
    mUpper = loadDraft(upper, OctreeShape(mRoot, mSettings));
    mSubtrees = upper.get<SubtreeRoot>("subtrees");
    mPartEnds = upper.get<std::uint64_t>("part ends");
}

void SpreadFit::fit(std::size_t n, const fs::path& file, Interrupter& progress) const
{
    progress.beginStage("fit");
    const SubtreeRoot *const begin = beginOf(n), *const end = mSubtrees.begin() + mPartEnds[n];
    std::vector<OctreeDraft> built =
        buildSubtrees(*mPoints, mRoot, mSettings, mScan.get(), begin, end, progress);
    // A forest: first the roots, in order, then what is below them.
    OctreeDraft forest;
    forest.nodes.resize(built.size());
    for (std::size_t tree = 0; tree < built.size(); ++tree) {
        forest.graft(std::uint32_t(tree), built[tree]);
        built[tree] = OctreeDraft{};
    }
    writeArrays(file, [&](ArrayFileWriter& arrays) { save(arrays, forest); });
    progress.endStage();
}

/// The cells of the leaves of all @a parts that their data do not support.
std::vector<OctreeCell> SpreadFit::unsupportedIn(const std::vector<fs::path>& parts) const
{
    // Roots of subtrees are leaves of the upper tree, until then.
    std::vector<OctreeCell> cells;
    OctreeDraft upper = mUpper;
    for (const SubtreeRoot& root : mSubtrees) upper.nodes[root.node].support = 1;
    addUnsupported(upper, 0, {}, cells);
    for (std::size_t n = 0; n < parts.size(); ++n) {
        OctreeDraft forest = loadDraft(ArrayFile(parts[n]), mUpper);
        const SubtreeRoot *const begin = beginOf(n), *const end = mSubtrees.begin() + mPartEnds[n];
        for (const SubtreeRoot* root = begin; root < end; ++root)
            addUnsupported(forest, std::uint32_t(root - begin), root->cell, cells);
    }
    return cells;
}

void SpreadFit::join(const std::vector<fs::path>& parts, const fs::path& file,
                     Interrupter& progress) const
{
    progress.beginStage("join");
    OctreeDraft upper = mUpper;
    std::size_t nodes = upper.nodes.size(), fits = upper.fits.size(),
                quadrics = upper.quadrics.size();
    bool complete = upper.complete;
    for (std::size_t n = 0; n < parts.size(); ++n) {
        const ArrayFile part(parts[n]);
        const auto roots = std::size_t(mSubtrees.begin() + mPartEnds[n] - beginOf(n));
        const std::size_t there = part.get<OctreeNode>("nodes").size();
        if (there < roots)
            throw InputError(
                fmt::format("{}: it is of another plan: make it again", parts[n].string()));
        nodes += there - roots;
        fits += part.get<StoredFit>("fits").size();
        quadrics += part.get<QuadricCoefficients>("quadrics").size();
        complete &= part.value<std::uint8_t>("complete") != 0;
    }
    std::unique_ptr<const CoarseSign> coarse;
    if (!complete) {
        progress.beginStage("sign");
        coarse = std::make_unique<CoarseSign>(*mPoints, mBounds, mRoot, mSettings.noise,
                                              Unseen{unsupportedIn(parts), mSettings.voxelSize},
                                              progress);
        vetoLeaves(upper, *coarse);
        progress.beginStage("join");
    }
    writeArrays(file, [&](ArrayFileWriter& arrays) {
        const std::size_t allNodes = arrays.reserve<OctreeNode>("nodes", nodes),
                          allFits = arrays.reserve<StoredFit>("fits", fits),
                          allQuadrics = arrays.reserve<QuadricCoefficients>("quadrics", quadrics);
        std::size_t atNode = upper.nodes.size(), atFit = upper.fits.size(),
                    atQuadric = upper.quadrics.size();
        arrays.write(allFits, 0, upper.fits.data(), atFit);
        arrays.write(allQuadrics, 0, upper.quadrics.data(), atQuadric);
        for (std::size_t n = 0; n < parts.size(); ++n) {
            OctreeDraft forest = loadDraft(ArrayFile(parts[n]), mUpper);
            const SubtreeRoot* const begin = beginOf(n);
            const auto roots = std::size_t(mSubtrees.begin() + mPartEnds[n] - begin);
            if (coarse)
                tbb::parallel_for(std::size_t(0), roots, [&](std::size_t tree) {
                    vetoLeaves(forest, std::uint32_t(tree), begin[tree].cell, *coarse);
                });
            for (OctreeNode& node : forest.nodes)
                node.index += std::uint32_t(node.isLeaf() ? atFit : atNode - roots);
            for (StoredFit& fit : forest.fits) fit.firstQuadric += std::uint32_t(atQuadric);
            for (std::size_t tree = 0; tree < roots; ++tree)
                upper.nodes[begin[tree].node] = forest.nodes[tree];
            arrays.write(allNodes, atNode, forest.nodes.data() + roots,
                         forest.nodes.size() - roots);
            arrays.write(allFits, atFit, forest.fits.data(), forest.fits.size());
            arrays.write(allQuadrics, atQuadric, forest.quadrics.data(), forest.quadrics.size());
            atNode += forest.nodes.size() - roots;
            atFit += forest.fits.size();
            atQuadric += forest.quadrics.size();
            upper.add(forest.statistics);
            progress.advance(1.0 / double(parts.size()));
        }
        arrays.write(allNodes, 0, upper.nodes.data(), upper.nodes.size());
        saveStatistics(arrays, upper.statistics);
        if (coarse) coarse->save(arrays);
    });
    progress.endStage();
}

std::shared_ptr<const MpuField> SpreadFit::open(const fs::path& folder, const fs::path& file)
{
    SpreadFit plan(folder);
    const ArrayFile arrays(file);
    FieldParts parts;
    parts.settings = plan.mSettings;
    parts.frame = plan.mFrame;
    parts.localBounds = plan.mBounds;
    parts.points = std::move(plan.mPoints);
    parts.tree = Octree(static_cast<const OctreeShape&>(plan.mUpper));
    parts.tree.nodes = arrays.get<OctreeNode>("nodes");
    parts.tree.fits = arrays.get<StoredFit>("fits");
    parts.tree.quadrics = arrays.get<QuadricCoefficients>("quadrics");
    parts.tree.statistics = loadStatistics(arrays);
    if (arrays.has("coarse values")) parts.coarse = std::make_unique<CoarseSign>(arrays);
    return std::make_shared<const MpuField>(std::move(parts));
}

} // namespace mpuvdb
