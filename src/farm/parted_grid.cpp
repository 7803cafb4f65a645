#include "parted_grid.h"

namespace mpuvdb
{

using openvdb::Coord;
using openvdb::CoordBBox;

Coord PartedGrid::cubeOf(const Coord& voxel) const
{
    const auto cube = [&](int index) { return (index >= 0 ? index : index - mEdge + 1) / mEdge; };
    return {cube(voxel[0]), cube(voxel[1]), cube(voxel[2])};
}

std::vector<ArrayFile> PartedGrid::filesIn(const CoordBBox& box) const
{
    std::vector<ArrayFile> files;
    const Coord first = cubeOf(box.min()), last = cubeOf(box.max());
    for (int x = first[0]; x <= last[0]; ++x)
        for (int y = first[1]; y <= last[1]; ++y)
            for (int z = first[2]; z <= last[2]; ++z)
                if (const auto found = mParts.find({x, y, z}); found != mParts.end())
                    files.push_back(found->second);
    return files;
}

std::vector<ArrayFile> PartedGrid::files() const
{
    std::vector<ArrayFile> files;
    for (const auto& [cube, file] : mParts) files.push_back(file);
    return files;
}

std::optional<Coord> PartedGrid::above(const Coord& cube) const
{
    const auto next = mParts.upper_bound(cube); // sorted by x, then y, then z
    if (next == mParts.end()) return std::nullopt;
    const Coord& at = next->first;
    return at[0] == cube[0] && at[1] == cube[1] ? std::optional(at) : std::nullopt;
}

} // namespace mpuvdb
