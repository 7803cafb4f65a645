#include "dual_mesh.h"

#include <mpuvdb/interrupter.h>

namespace mpuvdb
{

Mesh extractMesh(const LevelSet& levelSet, const ExtractSettings& settings,
                 Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    progress.beginStage("mesh", 3);
    const openvdb::FloatTree& tree = levelSet.grid().tree();
    openvdb::CoordBBox box;
    tree.evalLeafBoundingBox(box);
    DualMesh mesh(tree, levelSet.lattice(), meshFrame(box), settings, {}, progress);
    progress.advance();
    mesh.placeAll({});
    progress.advance();
    for (DualMesh::Vertices folded =
             mesh.split(DualMesh::Selection(mesh.cells().blocks().size(), 1));
         mesh.retract(folded);) {
    }
    progress.advance();
    progress.endStage();
    if (settings.strict)
        for (DualMesh::Vertices found = crossingVertices(mesh.mesh(), progress);
             mesh.retract(found); found = crossingVertices(mesh.mesh(), progress)) {
        }
    return mesh.take();
}

} // namespace mpuvdb
