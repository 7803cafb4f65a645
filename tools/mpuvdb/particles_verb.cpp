// mpuvdb particles: particles in, a level set (and mesh) out.
#include "level_set_verb.h"
#include "memory_limit.h"
#include "standard_output.h"

#include <mpuvdb/particles.h>
#include <mpuvdb/surface_attributes.h>

#include <fmt/format.h>

#include <algorithm>

namespace mpuvdb::command
{
namespace
{

class ParticlesVerb final : public Verb
{
public:
    VerbText text() const override
    {
        return {"particles", "Particles of a liquid, or points that fill a solid, to a level set",
                "  mpuvdb particles splash.ply -o splash.vdb\n"
                "      Radii and velocities by their names (pscale; vx vy vz); a radius for all\n"
                "      follows from the spacing where there are none.\n"
                "  mpuvdb particles points.vdb -o splash.vdb --radius 0.05 --voxel-size 0.02\n"
                "      Points of an OpenVDB point grid, with one radius.\n"
                "  mpuvdb particles sand.ply -o sand.vdb --surface spheres --mesh sand.obj\n"
                "      The balls themselves, and a mesh beside.\n"};
    }

    void addOptions(CLI::App& app) override
    {
        app.add_option("input", mInputs,
                       "Particles: .ply .xyz .pts .txt .csv .pcd .las and other points, or a .vdb\n"
                       "with point grids; - is standard input. Several are joined")
            ->required();
        app.add_option("-o,--output", mOutput, "The level set; - is standard output")
            ->required()
            ->type_name("OUT.vdb");
        app.add_option("--mesh", mMesh.path, "Write a mesh too: .ply .obj .off .stl .glb .usda")
            ->type_name("OUT.ply");
        app.add_option(
               "--surface", mSurface,
               "smooth: sheets, threads and water are whole, and keep their volume; a lone\n"
               "particle is its ball. spheres: the union of the balls")
            ->type_name("smooth|spheres")
            ->check(oneOf({"smooth", "spheres"}))
            ->capture_default_str();
        addLength(app, "--radius", mOptions.radius,
                  "Radius of all particles, instead of their own: pscale, radius, or half of\n"
                  "width, widths or diameter. Default without those: the ball has the volume that "
                  "the measured\n"
                  "spacing leaves each particle (0.62 spacings)");
        app.add_option("--radius-scale", mOptions.radiusScale, "Factor of all radii")
            ->type_name("X")
            ->capture_default_str();
        addLength(app, "--voxel-size", mOptions.voxelSize,
                  "Edge of a voxel; default: half the median radius");
        app.add_option("--half-width", mOptions.halfWidth,
                       "Voxels of the narrow band on either side of the surface")
            ->type_name("VOXELS")
            ->capture_default_str();
        app.add_flag_callback(
            "--no-velocity", [this] { mOptions.velocity = false; },
            "Write no grid 'v', which is for motion blur (world units per second)");
        addAttributes(app, mAttributes,
                      "What of the particles goes to grids beside the level set and to the mesh:\n"
                      "Cd (colors) and up to four properties by name. auto: Cd, where the\n"
                      "particles have colors; the default");
        addScene(app, mMesh.scene);
    }

    ExitCode run(Session& session) override
    {
        std::vector<Output> outputs = filesOf(mMesh, "--mesh");
        outputs.push_back({"-o", mOutput, {".vdb"}, true});
        mMesh.scene.requireUse(outputs);
        session.checkFiles(outputs, mInputs);
        mOptions.surface =
            mSurface == "smooth" ? ParticleSurface::Smooth : ParticleSurface::Spheres;
        Particles particles = readInput(session);
        session.hold(residentBytes());
        if (const std::uint64_t left = session.bytesLeft(); left > 0) mOptions.maxBytes = left;
        const ParticleResult made =
            particlesToLevelSet(std::move(particles), mOptions, &session.progress());
        describe(made.report, session);
        ExitCode code = writeGridOutput(made.levelSet(), mOutput, metadata(made.report),
                                        {made.beside.begin(), made.beside.end()}, session, {},
                                        gradientTolerance());
        if (!mMesh.path.empty()) code = std::max(code, writeMesh(made, session));
        for (const std::string& finding : made.report.findings) session.warn(finding);
        if (!made.report.findings.empty()) code = std::max(code, ExitCode::CheckFailed);
        session.progress().endStage();
        session.note("time        " + session.timesText());
        return code;
    }

private:
    Particles readInput(Session& session)
    {
        std::vector<std::filesystem::path> files(mInputs.begin(), mInputs.end());
        Particles particles;
        const auto read = [&](const std::vector<std::filesystem::path>& paths) {
            particles = readParticles(paths, mAttributes.scalars(), session.bytesLeft(),
                                      &session.progress());
        };
        if (files.size() == 1)
            readFile(mInputs.front(), ".txt", [&](const auto& file) { read({file}); });
        else
            read(files);
        mAttributes.choose(!particles.colors.empty());
        if (!mAttributes.has(kColorName)) particles.colors.clear();
        return particles;
    }

    /// For check(): balls that lie close leave creases all over, at which no gradient is 1.
    double gradientTolerance() const
    {
        return mOptions.surface == ParticleSurface::Smooth ? kGradientTolerance : 1;
    }

    ExitCode writeMesh(const ParticleResult& made, Session& session)
    {
        mMesh.addAttributes = [&made](Mesh& mesh, Interrupter& progress) {
            for (const auto& grid : made.beside)
                if (grid->getName() != kVelocityName) addAttribute(mesh, *grid, &progress);
        };
        return writeMeshOf(made.levelSet(), mMesh, session);
    }

    std::map<std::string, std::string> metadata(const ParticleReport& made) const
    {
        return {{"mpuvdb:version", MPUVDB_VERSION},
                {"mpuvdb:operation", "particles"},
                {"mpuvdb:surface", mSurface},
                {"mpuvdb:particles", fmt::format("{}", made.particles)},
                {"mpuvdb:radius", fmt::format("{}", made.medianRadius)},
                {"mpuvdb:voxel_size", fmt::format("{}", made.voxelSize)}};
    }

    void describe(const ParticleReport& made, Session& session) const
    {
        Json& report = session.report();
        report["settings"] = {
            {"surface", mSurface},           {"voxel_size", made.voxelSize},
            {"half_width", made.halfWidth},  {"radius_scale", mOptions.radiusScale},
            {"velocity", mOptions.velocity}, {"attributes", mAttributes.names}};
        report["input"] = {{"particles", made.particles},
                           {"dropped", made.dropped},
                           {"lost", made.lost},
                           {"smallest_radius", made.smallestRadius},
                           {"median_radius", made.medianRadius},
                           {"largest_radius", made.largestRadius}};
        if (made.spacing) report["input"]["spacing"] = *made.spacing;
        report["estimate"] = {{"blocks", made.blocks}, {"peak_bytes", made.bytes}};
        for (const std::string& note : made.notes) session.note(note);
        for (const std::string& warning : made.warnings) session.warn(warning);
        for (const std::string& note : session.progress().notes()) session.warn(note);
        const std::string dropped = droppedText(made.dropped);
        session.note(fmt::format(
            "particles   {}, {}{}", made.particles,
            made.smallestRadius < made.largestRadius
                ? fmt::format("radius {:.4g} to {:.4g}, median {:.4g}", made.smallestRadius,
                              made.largestRadius, made.medianRadius)
                : fmt::format("radius {:.4g}", made.medianRadius) +
                      (made.spacing ? fmt::format(" of the measured spacing {:.4g}", *made.spacing)
                                    : ""),
            dropped.empty() ? "" : "; dropped: " + dropped));
    }

    std::vector<std::string> mInputs;
    std::string mOutput, mSurface = "smooth";
    MeshOutput mMesh;
    Attributes mAttributes;
    ParticleOptions mOptions;
};

} // namespace

std::unique_ptr<Verb> makeParticles()
{
    return std::make_unique<ParticlesVerb>();
}

} // namespace mpuvdb::command
