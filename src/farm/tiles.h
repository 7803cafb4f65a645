// Where a field has to be sampled: boxes of voxels that its surface may meet.
#pragma once
#include <mpuvdb/mpu_field.h>
#include <mpuvdb/sampling.h>

#include <openvdb/openvdb.h>

#include <cstdint>
#include <vector>

namespace mpuvdb
{

/// A box of voxels that is sampled apart from the others.
struct Tile {
    openvdb::CoordBBox box;
    std::uint64_t points = 0; ///< data points in it
};

/// The tiles of edge @a edge (voxels) that the band of @a field may meet, those with most points
/// first: the longest tasks shall not begin last. @throws Interrupted; InputError for a solid that
/// has no end.
std::vector<Tile> tilesOf(const MpuField& field, const SampleSettings& settings, int edge,
                          Interrupter& progress);

} // namespace mpuvdb
