#include "range_grid.h"

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include <cmath>

namespace mpuvdb
{
namespace
{

/// The cosine between a ray and a triangle's normal, 78 degrees, below which the triangle spans a
/// jump in depth. [tuned: io_read_test]
constexpr double kMinCosine = 0.2;
/// The rays over which confidence rises from a border to the inside. [tuned: io_read_test]
constexpr int kBorderRays = 4;

Vec3d towardsScanner(const RangeGrid& grid, const Vec3d& p)
{
    return grid.hasEye ? (grid.eye - p).normalized() : Vec3d(Vec3d::UnitZ());
}

// The triangles of one cell of the grid: bit q of `corners` says that corner q is in one.
struct Cell {
    Vec3d areaNormals[4]; // sum over the triangles at each corner
    unsigned corners = 0;
};

class GridTriangles
{
public:
    GridTriangles(const RangeGrid& grid, const std::vector<Vec3d>& positions)
        : mGrid(grid), mPositions(positions)
    {
    }

    // Corners: 0 (c,r), 1 (c+1,r), 2 (c+1,r+1), 3 (c,r+1).
    Cell cell(std::size_t column, std::size_t row) const
    {
        Cell cell;
        for (Vec3d& n : cell.areaNormals) n.setZero();
        const std::size_t at = row * mGrid.columns + column;
        const std::uint32_t ids[4] = {mGrid.points[at], mGrid.points[at + 1],
                                      mGrid.points[at + mGrid.columns + 1],
                                      mGrid.points[at + mGrid.columns]};
        unsigned hits = 0;
        for (unsigned q = 0; q < 4; ++q) hits |= unsigned(ids[q] != RangeGrid::kMissed) << q;
        const auto length = [&](int a, int b) {
            return (mPositions[ids[a]] - mPositions[ids[b]]).squaredNorm();
        };
        if (hits == 15) {
            const bool along02 = length(0, 2) <= length(1, 3);
            add(cell, ids, 0, 1, along02 ? 2 : 3);
            add(cell, ids, along02 ? 0 : 1, 2, 3);
        } else {
            for (int missing = 0; missing < 4; ++missing)
                if (hits == (15u & ~(1u << missing)))
                    add(cell, ids, (missing + 1) % 4, (missing + 2) % 4, (missing + 3) % 4);
        }
        return cell;
    }

    // The cells between rows of rays `row` and row + 1; none beyond the grid.
    void cellsOf(std::size_t row, std::vector<Cell>& cells) const
    {
        cells.clear();
        if (row + 1 >= mGrid.rows) return;
        for (std::size_t column = 0; column + 1 < mGrid.columns; ++column)
            cells.push_back(cell(column, row));
    }

private:
    void add(Cell& cell, const std::uint32_t* ids, int a, int b, int c) const
    {
        const Vec3d &p = mPositions[ids[a]], &q = mPositions[ids[b]], &r = mPositions[ids[c]];
        Vec3d normal = (q - p).cross(r - p);
        const double cosine = normal.dot(towardsScanner(mGrid, p));
        if (!(std::abs(cosine) > kMinCosine * normal.norm())) return;
        if (cosine < 0) normal = -normal;
        for (const int corner : {a, b, c}) {
            cell.areaNormals[corner] += normal;
            cell.corners |= 1u << corner;
        }
    }

    const RangeGrid& mGrid;
    const std::vector<Vec3d>& mPositions;
};

struct GridNormals {
    std::vector<Vec3f> normals;        // by point; zero where no triangle
    std::vector<std::uint8_t> borders; // by point; 1 where not all four cells around have triangles
};

GridNormals gridNormals(const RangeGrid& grid, const std::vector<Vec3d>& positions)
{
    const GridTriangles triangles(grid, positions);
    GridNormals result;
    result.normals.assign(positions.size(), Vec3f::Zero());
    result.borders.assign(positions.size(), 1);
    tbb::parallel_for(tbb::blocked_range<std::size_t>(0, grid.rows, 16), [&](const auto& range) {
        std::vector<Cell> cells[2]; // of the row before, and of this
        if (range.begin() > 0) triangles.cellsOf(range.begin() - 1, cells[1]);
        for (std::size_t row = range.begin(); row < range.end(); ++row) {
            cells[0].swap(cells[1]);
            triangles.cellsOf(row, cells[1]);
            for (std::size_t column = 0; column < grid.columns; ++column) {
                const std::uint32_t id = grid.points[row * grid.columns + column];
                if (id == RangeGrid::kMissed) continue;
                Vec3d normal = Vec3d::Zero();
                int around = 0;
                // The cell at (column - dx, row - dy) has this point as its corner dx + 2 dy, in
                // the order 0 1 3 2.
                for (int q = 0; q < 4; ++q) {
                    const std::size_t dx = q == 1 || q == 2;
                    const std::vector<Cell>& ofRow = cells[q < 2];
                    if (column < dx || column - dx >= ofRow.size()) continue;
                    normal += ofRow[column - dx].areaNormals[q];
                    around += ofRow[column - dx].corners >> q & 1;
                }
                const double length = normal.norm();
                if (length > 0) result.normals[id] = (normal / length).cast<float>();
                result.borders[id] = around < 4;
            }
        }
    });
    return result;
}

// Steps along the grid to the nearest border, up to kBorderRays; by point.
std::vector<std::uint8_t> borderSteps(const RangeGrid& grid,
                                      const std::vector<std::uint8_t>& borders)
{
    std::vector<std::uint8_t> steps(borders.size());
    for (std::size_t i = 0; i < steps.size(); ++i) steps[i] = borders[i] ? 0 : kBorderRays;
    for (int step = 1; step < kBorderRays; ++step)
        for (std::size_t row = 0; row < grid.rows; ++row)
            for (std::size_t column = 0; column < grid.columns; ++column) {
                const std::size_t at = row * grid.columns + column;
                const std::uint32_t id = grid.points[at];
                if (id == RangeGrid::kMissed || steps[id] <= step) continue;
                const auto touches = [&](bool inside, std::size_t other) {
                    return !inside || grid.points[other] == RangeGrid::kMissed ||
                           steps[grid.points[other]] == step - 1;
                };
                if (touches(column > 0, at - 1) || touches(column + 1 < grid.columns, at + 1) ||
                    touches(row > 0, at - grid.columns) ||
                    touches(row + 1 < grid.rows, at + grid.columns))
                    steps[id] = std::uint8_t(step);
            }
    return steps;
}

} // namespace

void addRangeNormals(FilePoints& points, const RangeGrid& grid)
{
    PointBlock& block = points.joined();
    if (block.size() == 0 || grid.columns < 2 || grid.rows < 2) return;
    GridNormals found = gridNormals(grid, block.positions);
    std::vector<std::uint8_t> keep(block.size());
    std::uint64_t unjoined = 0;
    for (std::size_t i = 0; i < keep.size(); ++i) {
        keep[i] = found.normals[i] != Vec3f::Zero();
        unjoined += keep[i] == 0;
    }
    if (4 * unjoined > block.size()) {
        points.notes.push_back("its grid of rays does not follow a surface, and is ignored");
        return;
    }
    block.normals = std::move(found.normals);
    block.seenFrom = grid.hasEye ? Viewpoint{grid.eye, false} : Viewpoint{Vec3d::UnitZ(), true};
    if (block.confidence.empty()) {
        const std::vector<std::uint8_t> steps = borderSteps(grid, found.borders);
        block.confidence.resize(block.size());
        for (std::size_t i = 0; i < block.size(); ++i) {
            const double cosine =
                block.normals[i].cast<double>().dot(towardsScanner(grid, block.positions[i]));
            block.confidence[i] = float(std::max(cosine, 0.0) * (steps[i] + 1) / (kBorderRays + 1));
        }
    }
    if (unjoined > 0) {
        block.compact(keep);
        points.dropped["alone in a range image"] += unjoined;
    }
    points.notes.push_back("normals and confidences from its range image");
}

} // namespace mpuvdb
