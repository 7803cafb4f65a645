// mpuvdb fog, isosurface, components, voxelize: densities, parts, and meshes as level sets.
#include "level_set_verb.h"
#include "standard_output.h"

#include <mpuvdb/attribute_grids.h>
#include <mpuvdb/block_under.h>
#include <mpuvdb/carried_attributes.h>
#include <mpuvdb/io.h>

#include <algorithm>
#include <fmt/format.h>
#include <limits>

namespace mpuvdb::command
{
namespace
{

class FogVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"fog", "A level set to a density, as renderers use for clouds",
                "  mpuvdb fog scan.vdb -o cloud.vdb\n"
                "  mpuvdb fog scan.vdb -o both.vdb --keep-surface\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput,
                       "A .vdb file with a level set, or FILE.vdb:NAME; - is standard input")
            ->required();
        app.add_option("-o,--output", mOutput, "The density; - is standard output")
            ->required()
            ->type_name("OUT.vdb");
        addGridName(app, mGrid);
        app.add_flag("--keep-surface", mKeepSurface, "Write the level set too");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".vdb"}, true}}, {gridPlace(mInput, mGrid).file});
        const GridInput input = readGridInput(mInput, mGrid, session);
        session.progress().beginStage("fog");
        openvdb::GridCPtrVec grids{toFog(input.levelSet, &session.progress())};
        if (mKeepSurface) grids.push_back(input.levelSet.gridPtr());
        const auto others = besides(input.others, grids.front()->getName(), session);
        grids.insert(grids.end(), others.begin(), others.end());
        const auto write = [&](const std::filesystem::path& file) {
            writeGrids(file, grids, input.metadata, &session.progress());
        };
        if (mOutput == "-")
            printFile(".vdb", write);
        else
            write(mOutput);
        const auto count = grids.front()->activeVoxelCount();
        session.report()["grid"] = {{"name", grids.front()->getName()},
                                    {"voxel_size", input.levelSet.voxelSize()},
                                    {"active_voxels", count},
                                    {"bytes", grids.front()->memUsage()}};
        session.note(fmt::format("density     {} active voxels: {}", count, mOutput));
        if (count == 0)
            session.warn(fmt::format("{}: nothing is there: the density is empty", mOutput));
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return ExitCode::Ok;
    }

private:
    std::string mInput, mOutput, mGrid;
    bool mKeepSurface = false;
};

class IsosurfaceVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"isosurface", "The surface where a density, or any float grid, has a value",
                "  mpuvdb isosurface smoke.vdb -o smoke_surface.vdb --value 0.5\n"
                "  mpuvdb isosurface fire.vdb -o hot.vdb --grid temperature --value 900\n"
                "  mpuvdb isosurface sdf.vdb -o surface.vdb --value 0 --inside below\n"
                "      Distances in a grid without the class level set.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput,
                       "A .vdb file with a float grid, or FILE.vdb:NAME; - is standard input")
            ->required();
        app.add_option("-o,--output", mOutput, "The level set; - is standard output")
            ->required()
            ->type_name("OUT.vdb");
        app.add_option("--grid", mGrid, "Name of the float grid; default: the first")
            ->type_name("NAME");
        app.add_option("--value", mValue, "Value at the surface")
            ->type_name("NUMBER")
            ->capture_default_str();
        app.add_option("--inside", mInside,
                       "Values above, as of densities, or below, as of distances, are inside")
            ->type_name("above|below")
            ->check(oneOf({"above", "below"}))
            ->capture_default_str();
        app.add_option("--half-width", mHalfWidth,
                       "Voxels of the narrow band on either side of the surface")
            ->type_name("VOXELS")
            ->capture_default_str();
    }

    ExitCode run(Session& session) override
    {
        const GridPlace place = gridPlace(mInput, mGrid);
        session.checkFiles({{"-o", mOutput, {".vdb"}, true}}, {place.file});
        session.progress().beginStage("read");
        FloatGridFile input;
        readFile(place.file, ".vdb", [&](const std::filesystem::path& path) {
            input = readFloatGridFile(path, place.grid, session.bytesLeft());
        });
        const std::string name = input.grid->getName();
        session.note(fmt::format("grid        '{}', {} {:g} is inside", name, mInside, mValue));
        const LevelSet made =
            isosurface(*input.grid, mValue, mInside == "above" ? Inside::Above : Inside::Below,
                       mHalfWidth, session.bytesLeft(), &session.progress());
        session.report()["settings"] = {
            {"grid", name}, {"value", mValue}, {"inside", mInside}, {"half_width", mHalfWidth}};
        const ExitCode code = writeGridOutput(made, mOutput,
                                              {{"mpuvdb:version", MPUVDB_VERSION},
                                               {"mpuvdb:operation", "isosurface"},
                                               {"mpuvdb:value", fmt::format("{}", mValue)},
                                               {"mpuvdb:inside", mInside}},
                                              besides(input.others, made.grid().getName(), session),
                                              session, input.metadata);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code;
    }

private:
    std::string mInput, mOutput, mGrid, mInside = "above";
    double mValue = 0.5, mHalfWidth = 3;
};

class ComponentsVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"components", "The connected parts of a solid: listed, and the large ones kept",
                "  mpuvdb components scan.vdb\n"
                "  mpuvdb components scan.vdb -o clean.vdb --keep 1\n"
                "  mpuvdb components scan.vdb -o clean.vdb --min-volume 0.001\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput,
                       "A .vdb file with a level set, or FILE.vdb:NAME; - is standard input")
            ->required();
        app.add_option("-o,--output", mOutput, "The parts that are kept; - is standard output")
            ->type_name("OUT.vdb");
        addGridName(app, mGrid);
        app.add_option("--keep", mKeep, "Keep at most this many parts, the largest; at least 1")
            ->type_name("N");
        app.add_option("--min-volume", mMinVolume, "Keep parts of at least this volume")
            ->type_name("CUBIC UNITS");
        app.add_flag("--json", mJson, "Print the list as JSON");
    }

    ExitCode run(Session& session) override
    {
        if (mOutput.empty() && (mKeep || mMinVolume > 0))
            throw UsageError("--keep and --min-volume need an output. Name it with -o");
        if (mKeep && *mKeep < 1)
            throw UsageError(fmt::format("--keep {}: must be at least 1", *mKeep));
        session.checkFiles({{"-o", mOutput, {".vdb"}, true}}, {gridPlace(mInput, mGrid).file});
        const GridInput input = readGridInput(mInput, mGrid, session);
        session.progress().beginStage("components");
        const SolidComponents found(input.levelSet, &session.progress());
        list(found.measures(), session);
        if (mOutput.empty()) return ExitCode::Ok;
        const LevelSet kept =
            found.keep(mMinVolume, std::size_t(mKeep.value_or(std::numeric_limits<int>::max())),
                       &session.progress());
        return writeGridOutput(kept, mOutput,
                               {{"mpuvdb:version", MPUVDB_VERSION},
                                {"mpuvdb:operation", "components"},
                                {"mpuvdb:min_volume", fmt::format("{}", mMinVolume)}},
                               input.others, session, input.metadata);
    }

private:
    void list(const std::vector<ComponentMeasures>& measures, Session& session) const
    {
        Json parts = Json::array();
        std::string text;
        for (const ComponentMeasures& part : measures) {
            // A single voxel at distance 0 has no surface.
            const bool isNothing = part.bounds.isEmpty();
            const Vec3d size = isNothing ? Vec3d(Vec3d::Zero()) : Vec3d(part.bounds.sizes());
            parts.push_back({{"volume", part.volume},
                             {"area", part.area},
                             {"genus", part.genus},
                             {"min", isNothing ? Json() : toJson(Vec3d(part.bounds.min()))},
                             {"max", isNothing ? Json() : toJson(Vec3d(part.bounds.max()))}});
            text += fmt::format("{}: volume {:.6g}, area {:.6g}, genus {}, size {:.4g} x {:.4g} x "
                                "{:.4g}\n",
                                parts.size(), part.volume, part.area, part.genus, size.x(),
                                size.y(), size.z());
        }
        session.report()["components"] = parts;
        if (mOutput == "-") return; // standard output is the grid's
        if (mJson)
            session.printJson({{"components", parts}});
        else
            printText(text.empty() ? "no parts: the level set is empty\n" : text);
    }

    std::string mInput, mOutput, mGrid;
    std::optional<int> mKeep;
    double mMinVolume = 0;
    bool mJson = false;
};

class VoxelizeVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"voxelize",
                "A triangle mesh to a level set, with its colors; a broken one by --repair",
                "  mpuvdb voxelize part.obj -o part.vdb --voxels 256\n"
                "  mpuvdb voxelize part.stl -o part.vdb --voxel-size 0.5 --half-width 4\n"
                "  mpuvdb voxelize scan.ply -o solid.vdb --repair --repair-holes 20\n"
                "  mpuvdb voxelize leaf.obj -o leaf.vdb --thicken 4vx\n"
                "  mpuvdb voxelize terrain.ply -o block.vdb --base 10\n"
                "  mpuvdb voxelize load.ply -o load.vdb --attributes Cd,stress\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInput, "A mesh: .ply .obj .stl .off")->required();
        app.add_option("-o,--output", mOutput, "The level set; - is standard output")
            ->required()
            ->type_name("OUT.vdb");
        CLI::Option* const size =
            addLength(app, "--voxel-size", mVoxelSize, "Edge of a voxel: world units or %");
        app.add_option("--voxels", mVoxels,
                       "Instead: voxels along the longest side of the mesh; default: 256")
            ->type_name("N")
            ->excludes(size);
        app.add_option("--half-width", mHalfWidth,
                       "Voxels of the narrow band on either side of the surface")
            ->type_name("VOXELS")
            ->capture_default_str();
        app.add_flag("--repair", mRepairs,
                     "Make a solid of a broken mesh: close holes, turn patches that face the wrong "
                     "way, leave out copies and inner walls");
        addLength(app, "--repair-holes", mHoles,
                  "Repair, but refuse a mesh with a wider hole: world units, % or vx; default: "
                  "all are closed");
        addLength(app, "--thicken", mThickness,
                  "Repair, and make walls of this thickness of open surfaces that enclose "
                  "nothing: world units, % or vx");
        CLI::Option* const base = addLength(
            app, "--base", mBase,
            "Repair, and make a block of an open surface seen from above, such as a terrain:\n"
            "walls down to a flat base this far below its lowest vertex; world units, % or vx,\n"
            "at least 2vx");
        addUpAxis(app, mUp, "The axis that points up, for --base; default: z")->needs(base);
        addAttributes(
            app, mAttributes,
            "What of the vertices goes to grids beside the level set: Cd (colors) and up\n"
            "to four numbers by name (PLY). auto: Cd, where the mesh has colors; the\n"
            "default");
    }

    ExitCode run(Session& session) override
    {
        session.checkFiles({{"-o", mOutput, {".vdb"}, true}}, {mInput});
        const bool repairs = mRepairs || mHoles || mThickness || mBase;
        session.progress().beginStage("read");
        Mesh mesh = readMesh(mInput, &session.progress(),
                             repairs ? BadVertices::Keep : BadVertices::Refuse, scalarNames());
        if (!mAttributes.automatic) mAttributes.choose(!mesh.colors.empty());
        if (!mAttributes.automatic && !mAttributes.has(kColorName)) mesh.colors.clear();
        Box3d box = boxOf(mesh);
        SampleSettings settings;
        settings.halfWidth = mHalfWidth;
        settings.maxBytes = session.options().maxBytes;
        settings.lattice = latticeFor(box, voxelSize(box));
        Mesh block;
        if (mBase) {
            block = blockUnder(mesh, mUp == UpAxis::Z ? Vec3d::UnitZ() : Vec3d::UnitY(),
                               baseDepth(box, settings.lattice.voxelSize), &session.progress());
            box = boxOf(block);
            settings.lattice = latticeFor(box, settings.lattice.voxelSize);
        }
        const LevelSet made =
            repairs ? voxelize(mBase ? block : mesh, settings,
                               repairSettings(box, settings.lattice.voxelSize), &session.progress())
                    : voxelize(mesh, settings, &session.progress());
        const MeshExplained& explained = std::get<MeshExplained>(made.explained()->by);
        for (const std::string& note : session.progress().notes()) session.warn(note);
        const double h = settings.lattice.voxelSize;
        session.report()["settings"] = {{"voxel_size", h}, {"half_width", mHalfWidth}};
        session.report()["input"] = {{"vertices", mesh.positions.size()},
                                     {"triangles", mesh.triangles.size()}};
        session.note(fmt::format("mesh        {} vertices, {} triangles", mesh.positions.size(),
                                 mesh.triangles.size()));
        openvdb::GridCPtrVec beside;
        if (!mesh.colors.empty() || !mesh.scalars.empty())
            for (const auto& grid : sampleAttributes(
                     made, *attributesOfMesh(mesh, &session.progress()), &session.progress()))
                beside.push_back(grid);
        const ExitCode code = writeGridOutput(made, mOutput,
                                              {{"mpuvdb:version", MPUVDB_VERSION},
                                               {"mpuvdb:operation", "voxelize"},
                                               {"mpuvdb:voxel_size", fmt::format("{}", h)}},
                                              beside, session);
        session.report()["explained"] = toJson(explained);
        session.note("explained   " + explainedText(explained));
        if (explained.insideOut) session.note("mesh        all parts face inward, and were turned");
        if (explained.turned > 0)
            session.note(fmt::format("mesh        {} triangles faced another way than their "
                                     "neighbors, and were turned",
                                     explained.turned));
        if (explained.repair)
            for (const std::string& line : repairText(explained))
                session.note("repair      " + line);
        for (const std::string& finding : explained.findings)
            session.warn(fmt::format("{}: {}", mInput, finding));
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code == ExitCode::Ok && !explained.findings.empty() ? ExitCode::CheckFailed : code;
    }

private:
    double voxelSize(const Box3d& box) const
    {
        if (mVoxelSize) {
            if (mVoxelSize->unit == Length::Unit::Voxels)
                throw UsageError("--voxel-size: there are no voxels yet. Give world units or %");
            return mVoxelSize->resolve(0, box.diagonal().norm());
        }
        if (!(mVoxels >= 4 && mVoxels <= 100000))
            throw UsageError(fmt::format("--voxels {}: must be in [4, 100000]", mVoxels));
        return box.sizes().maxCoeff() / mVoxels;
    }

    RepairSettings repairSettings(const Box3d& box, double voxelSize) const
    {
        RepairSettings settings;
        const double diagonal = box.diagonal().norm();
        if (mHoles) settings.holes = mHoles->resolve(voxelSize, diagonal);
        if (mThickness) settings.thickness = mThickness->resolve(voxelSize, diagonal);
        return settings;
    }

    static Box3d boxOf(const Mesh& mesh)
    {
        Box3d box;
        for (std::size_t n = 0; n < mesh.positions.size(); ++n)
            if (mesh.world(n).allFinite()) box.extend(mesh.world(n));
        return box;
    }

    /// Of the base below the lowest vertex, world units.
    double baseDepth(const Box3d& box, double voxelSize) const
    {
        constexpr double kThinnest = 2; // voxels, as of walls
        const double depth = mBase->resolve(voxelSize, box.diagonal().norm());
        if (!(depth >= kThinnest * voxelSize))
            throw UsageError(fmt::format("--base {:.6g}: must be at least two voxels, {:.6g}. Use "
                                         "smaller voxels, or a larger base",
                                         depth, kThinnest * voxelSize));
        return depth;
    }

    /// What is to be kept of the vertices beside colors.
    std::vector<std::string> scalarNames() const
    {
        std::vector<std::string> names = mAttributes.names;
        names.erase(std::remove(names.begin(), names.end(), kColorName), names.end());
        return names;
    }

    std::string mInput, mOutput;
    Attributes mAttributes;
    std::optional<Length> mVoxelSize, mHoles, mThickness, mBase;
    UpAxis mUp = UpAxis::Z;
    double mVoxels = 256, mHalfWidth = 3;
    bool mRepairs = false;
};

} // namespace

std::unique_ptr<Verb> makeFog()
{
    return std::make_unique<FogVerb>();
}

std::unique_ptr<Verb> makeIsosurface()
{
    return std::make_unique<IsosurfaceVerb>();
}

std::unique_ptr<Verb> makeComponents()
{
    return std::make_unique<ComponentsVerb>();
}

std::unique_ptr<Verb> makeVoxelize()
{
    return std::make_unique<VoxelizeVerb>();
}

} // namespace mpuvdb::command
