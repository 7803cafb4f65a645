#include "job_file.h"

#include "files/atomic_file.h"
#include "files/content_hash.h"
#include <mpuvdb/error.h>

#include <fmt/format.h>

#include <chrono>
#include <fstream>
#include <functional>
#include <sstream>

namespace mpuvdb
{
namespace
{

namespace fs = std::filesystem;

/// Version of the files' format. [derived: the first]
constexpr int kJobVersion = 1;

/// The JSON of @a file; null if there is no such file. @throws InputError (damaged).
JobJson readJson(const fs::path& file)
{
    std::ifstream in(file, std::ios::binary);
    if (!in) return {};
    std::ostringstream text;
    text << in.rdbuf();
    JobJson json = JobJson::parse(text.str(), nullptr, /*allow_exceptions=*/false);
    if (json.is_discarded())
        throw InputError(fmt::format("{}: damaged: plan the job again", file.string()));
    return json;
}

/// Run @a read, whose errors of JSON become ours.
template <typename Read>
auto withJson(const fs::path& file, const Read& read)
{
    try {
        return read();
    } catch (const nlohmann::json::exception& e) {
        throw InputError(
            fmt::format("{}: damaged ({}): plan the job again", file.string(), e.what()));
    }
}

/// What an input looks like from outside: bytes, and time of change.
JobJson lookOf(const std::string& path)
{
    std::error_code error;
    const auto bytes = fs::file_size(path, error);
    if (error) return {{"path", path}, {"bytes", nullptr}};
    const auto changed = fs::last_write_time(path, error).time_since_epoch();
    return {{"path", path},
            {"bytes", bytes},
            {"changed", std::chrono::duration_cast<std::chrono::nanoseconds>(changed).count()}};
}

std::string hashOf(const std::string& text)
{
    std::uint64_t hash = 0xcbf29ce484222325u; // FNV-1a
    for (const char c : text) hash = (hash ^ std::uint8_t(c)) * 0x100000001b3u;
    return fmt::format("{:016x}", hash);
}

} // namespace

FileHashes hashesOf(const fs::path& folder, const std::vector<std::string>& names,
                    const Interrupter& progress)
{
    FileHashes hashes;
    for (const std::string& name : names)
        if (fs::exists(folder / name)) hashes[name] = contentHash(folder / name, progress);
    return hashes;
}

void requireFiles(const fs::path& folder, const FileHashes& hashes, const Interrupter& progress)
{
    for (const auto& [name, hash] : hashes)
        if (!fs::exists(folder / name) || contentHash(folder / name, progress) != hash)
            throw InputError(fmt::format("{}: damaged, or not there any more, so that what was "
                                         "made from it may be wrong. Plan the job again",
                                         (folder / name).string()));
}

void writeJson(const fs::path& file, const JobJson& json)
{
    writeAtomically(file, [&](const fs::path& temporary) {
        std::ofstream out(temporary, std::ios::binary | std::ios::trunc);
        out << json.dump(1) << '\n';
        out.close();
        if (!out)
            throw IoError(fmt::format("{}: cannot be written. Free some space, or write to another "
                                      "disk",
                                      file.string()));
    });
}

void JobPlan::write(const fs::path& folder)
{
    mInputs = JobJson::array();
    // Other processes may be in other folders.
    for (const std::string& path : options.inputs)
        if (path != "-") mInputs.push_back(lookOf(fs::absolute(path).string()));
    const Vec3d& o = grid.lattice.origin;
    JobJson json = {{"mpuvdb_job", kJobVersion},
                    {"build", options.build},
                    {"inputs", mInputs},
                    {"points", points},
                    {"parts", parts},
                    {"tile_voxels", options.tileVoxels},
                    {"origin", {o[0], o[1], o[2]}},
                    {"voxel_size", grid.lattice.voxelSize},
                    {"half_width", grid.halfWidth},
                    {"name", grid.name},
                    {"max_bytes", grid.maxBytes},
                    {"coverage", coverage},
                    {"attributes", attributes},
                    {"metadata", options.metadata},
                    {"files", files}};
    json["id"] = id = hashOf(json.dump());
    writeJson(folder / "plan.json", json);
}

JobPlan JobPlan::read(const fs::path& folder)
{
    const fs::path file = folder / "plan.json";
    const JobJson json = readJson(file);
    if (json.is_null())
        throw InputError(
            fmt::format("{}: there is no job: plan one with mpuvdb plan", folder.string()));
    return withJson(file, [&] {
        if (json.at("mpuvdb_job") != kJobVersion)
            throw InputError(
                fmt::format("{}: of another version of mpuvdb: plan the job again", file.string()));
        JobPlan plan;
        plan.id = json.at("id");
        plan.options.build = json.at("build");
        plan.options.tileVoxels = json.at("tile_voxels");
        plan.options.metadata = json.at("metadata").get<std::map<std::string, std::string>>();
        plan.points = json.at("points");
        plan.parts = json.at("parts");
        for (int k = 0; k < 3; ++k) plan.grid.lattice.origin[k] = json.at("origin").at(k);
        plan.grid.lattice.voxelSize = json.at("voxel_size");
        plan.grid.halfWidth = json.at("half_width");
        plan.grid.name = json.at("name");
        plan.grid.maxBytes = json.at("max_bytes");
        plan.coverage = json.at("coverage");
        plan.attributes = json.at("attributes").get<std::vector<std::string>>();
        plan.files = json.at("files").get<FileHashes>();
        plan.mInputs = json.at("inputs");
        for (const JobJson& input : plan.mInputs) plan.options.inputs.push_back(input.at("path"));
        return plan;
    });
}

void JobPlan::requireInputs() const
{
    for (const JobJson& input : mInputs) {
        const std::string path = input.at("path");
        const JobJson now = lookOf(path);
        // What is gone is not needed any more; what is another file may be meant to count.
        if (now.at("bytes").is_null() || now == input) continue;
        throw InputError(fmt::format("{}: it has changed since the job was planned: plan it again, "
                                     "in another folder",
                                     path));
    }
}

std::optional<TaskRecord> TaskRecord::read(const fs::path& file)
try {
    const JobJson json = readJson(file);
    if (json.is_null()) return std::nullopt;
    return withJson(file, [&] {
        TaskRecord record;
        record.plan = json.at("plan");
        record.hash = json.at("hash");
        record.host = json.at("host");
        record.bytes = json.at("bytes");
        record.peakBytes = json.at("peak_bytes");
        record.seconds = json.at("seconds");
        record.voxels = json.at("voxels");
        record.faults = json.at("faults").get<std::vector<std::string>>();
        const JobJson& explained = json.at("explained");
        record.explained.points = explained.at("points");
        record.explained.limit = explained.at("limit");
        record.explained.within = explained.at("within");
        record.explained.largest = explained.at("largest");
        record.explained.beyondBand = explained.at("beyond_band");
        record.explained.against = explained.at("against");
        record.explained.unsupported = explained.at("unsupported");
        return std::optional(std::move(record));
    });
} catch (const InputError&) {
    return std::nullopt; // damaged
}

void TaskRecord::write(const fs::path& file) const
{
    writeJson(file, {{"plan", plan},
                     {"hash", hash},
                     {"host", host},
                     {"bytes", bytes},
                     {"peak_bytes", peakBytes},
                     {"seconds", seconds},
                     {"voxels", voxels},
                     {"faults", faults},
                     {"explained",
                      {{"points", explained.points},
                       {"limit", explained.limit},
                       {"within", explained.within},
                       {"largest", explained.largest},
                       {"beyond_band", explained.beyondBand},
                       {"against", explained.against},
                       {"unsupported", explained.unsupported}}}});
}

void writeTiles(const fs::path& file, const std::string& plan, const TileList& list)
{
    JobJson tiles = JobJson::array();
    for (const Tile& tile : list.tiles) {
        const openvdb::Coord &a = tile.box.min(), &b = tile.box.max();
        tiles.push_back({{"box", {a[0], a[1], a[2], b[0], b[1], b[2]}}, {"points", tile.points}});
    }
    writeJson(file, {{"plan", plan}, {"field", list.field}, {"tiles", std::move(tiles)}});
}

std::optional<TileList> readTiles(const fs::path& file, const std::string& plan)
{
    const JobJson json = readJson(file);
    if (json.is_null()) return std::nullopt;
    return withJson(file, [&] {
        if (json.at("plan") != plan)
            throw InputError(fmt::format("{}: of another plan: plan the job again", file.string()));
        TileList list;
        list.field = json.at("field").get<FileHashes>();
        for (const JobJson& item : json.at("tiles")) {
            const auto at = item.at("box").get<std::array<int, 6>>();
            list.tiles.push_back(
                {{{at[0], at[1], at[2]}, {at[3], at[4], at[5]}}, item.at("points")});
        }
        return std::optional(std::move(list));
    });
}

} // namespace mpuvdb
