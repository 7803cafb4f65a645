// Level sets as densities.
#include <mpuvdb/operations.h>
#include <mpuvdb/progress.h>

#include <openvdb/tools/ChangeBackground.h>
#include <openvdb/tools/LevelSetUtil.h>

namespace mpuvdb
{

openvdb::FloatGrid::Ptr toFog(const LevelSet& levelSet, Progress& progress)
{
    progress.beginStage("fog");
    const openvdb::FloatGrid::Ptr fog = levelSet.grid().deepCopy();
    progress.check();
    // Without voxels OpenVDB has no least value to scale by, and would keep the background.
    if (fog->tree().empty())
        openvdb::tools::changeBackground(fog->tree(), 0.0f);
    else
        openvdb::tools::sdfToFogVolume(*fog, levelSet.grid().background());
    fog->setGridClass(openvdb::GRID_FOG_VOLUME);
    fog->setName("density");
    progress.endStage();
    return fog;
}

} // namespace mpuvdb
