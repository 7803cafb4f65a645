// Attributes of the inputs of an operation, carried to its result.
#pragma once
#include <mpuvdb/field.h>
#include <mpuvdb/level_set.h>
#include <mpuvdb/surface_attributes.h>
#include <mpuvdb/triangle_mesh.h>

#include <memory>
#include <vector>

namespace mpuvdb
{

class Interrupter;

/// The colors and scalars of a mesh, at each place those of the nearest point of its triangles,
/// linear between their corners. @param mesh  has triangles and outlives what is returned.
/// @throws Interrupted.
std::unique_ptr<SurfaceAttributes> attributesOfMesh(const Mesh& mesh,
                                                    Interrupter* interrupter = nullptr);

/// An operand of a Boolean, and the grids of its file that hold attributes of its surface.
struct Operand {
    LevelSet levelSet;
    openvdb::GridCPtrVec grids; ///< all of them, see attributesOfOperands()
};

/// The attributes of a Boolean's result: at each place those of the operand whose surface is
/// nearest, of equals of the first. Colors are those of Vec3f grids called kColorName, scalars the
/// float grids on the voxels of the operand's band; where only other operands have them, colors are
/// white, scalars 0. Other grids (level sets, volumes) are left out, and so is the coverage.
std::unique_ptr<SurfaceAttributes> attributesOfOperands(const std::vector<Operand>& operands);

/// The coverage of a solid that was cut by another one, for the result of the cut: 1 on what is
/// left of the solid's surface (times the solid's own coverage there), 0 on the cut, and one half
/// at the edge between them, so that a mesh trimmed by it ends there. @param coverage  of @a solid;
/// null: 1.
/// @param tool  in a band of at least a voxel.
std::unique_ptr<Coverage> coverageOfCut(const LevelSet& solid, const LevelSet& tool,
                                        openvdb::FloatGrid::ConstPtr coverage = nullptr);

} // namespace mpuvdb
