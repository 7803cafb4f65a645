// The parts of a grid, each a cube of voxels in a file of its own.
#pragma once
#include "files/array_file.h"
#include <mpuvdb/field.h>

#include <openvdb/openvdb.h>

#include <map>
#include <optional>
#include <vector>

namespace mpuvdb
{

/// Cubes of a lattice that have leaves of a level set, in mapped files.
class PartedGrid
{
public:
    /// @param edge  of a cube, voxels: whole leaves.
    PartedGrid(const Lattice& lattice, int edge) : mLattice(lattice), mEdge(edge) {}

    const Lattice& lattice() const { return mLattice; }
    int edge() const { return mEdge; }
    /// The cubes with leaves, by their place in units of the edge.
    const std::map<openvdb::Coord, ArrayFile>& parts() const { return mParts; }
    openvdb::CoordBBox boxOf(const openvdb::Coord& cube) const
    {
        return openvdb::CoordBBox::createCube({cube[0] * mEdge, cube[1] * mEdge, cube[2] * mEdge},
                                              mEdge);
    }
    /// The cube with @a voxel.
    openvdb::Coord cubeOf(const openvdb::Coord& voxel) const;
    void add(const openvdb::Coord& cube, const ArrayFile& file) { mParts.emplace(cube, file); }
    /// The files of all parts that meet @a box.
    std::vector<ArrayFile> filesIn(const openvdb::CoordBBox& box) const;
    /// All files.
    std::vector<ArrayFile> files() const;
    /// The next part above @a cube, on the same line along z.
    std::optional<openvdb::Coord> above(const openvdb::Coord& cube) const;

private:
    Lattice mLattice;
    int mEdge;
    std::map<openvdb::Coord, ArrayFile> mParts;
};

} // namespace mpuvdb
