#include "inside_boxes.h"

#include "io/vdb/leaf_files.h"
#include <mpuvdb/interrupter.h>

#include <algorithm>

namespace mpuvdb
{
namespace
{

using openvdb::Coord;
using openvdb::CoordBBox;

/// Edge of the nodes below the root, voxels. [derived: OpenVDB's tree]
constexpr int kNodeDim = 4096;

/// The box between a part and the next one above it; empty unless it is inside.
CoordBBox insideAbove(const PartedGrid& grid, const std::string& prefix, const Coord& cube,
                      const Interrupter& progress)
{
    const std::optional<Coord> next = grid.above(cube);
    if (!next || (*next)[2] == cube[2] + 1) return {};
    CoordBBox box = grid.boxOf(cube), part = box;
    box.min()[2] += grid.edge();
    box.max()[2] = grid.boxOf(*next).min()[2] - 1;
    // The part, and the blocks above it.
    part.max()[2] += kBlockDim;
    const bool isInside = isSpaceInside({grid.parts().at(cube)}, prefix, part, box.min(), progress);
    return isInside ? box : CoordBBox();
}

/// Calls visit(node, part) with the nodes that @a box meets, and what of it is in them.
template <typename Visit>
void splitByNodes(const CoordBBox& box, const Visit& visit)
{
    const Coord first = box.min() & ~(kNodeDim - 1);
    for (int x = first[0]; x <= box.max()[0]; x += kNodeDim)
        for (int y = first[1]; y <= box.max()[1]; y += kNodeDim)
            for (int z = first[2]; z <= box.max()[2]; z += kNodeDim) {
                CoordBBox part = CoordBBox::createCube({x, y, z}, kNodeDim);
                part.intersect(box);
                visit(Coord(x, y, z), part);
            }
}

} // namespace

std::map<Coord, std::vector<CoordBBox>>
insideBoxes(const PartedGrid& grid, const std::string& prefix, Interrupter& progress)
{
    std::map<Coord, Coord> owners; // parts by the nodes in which they have leaves
    for (const auto& [cube, file] : grid.parts()) {
        progress.check();
        for (const Coord& node : nodesWithLeaves(file, prefix, kNodeDim))
            owners.emplace(node, cube);
    }
    std::map<Coord, std::vector<CoordBBox>> boxes;
    for (const auto& [cube, file] : grid.parts()) {
        progress.check();
        const CoordBBox box = insideAbove(grid, prefix, cube, progress);
        if (box.empty()) continue;
        splitByNodes(box, [&, at = cube](const Coord& node, const CoordBBox& part) {
            boxes[owners.emplace(node, at).first->second].push_back(part);
        });
    }
    return boxes;
}

} // namespace mpuvdb
