#include "vdb_layout.h"

#include "io/points/stand_ins.h"

#include <mpuvdb/error.h>

#include <fmt/format.h>
#include <openvdb/Metadata.h>
#include <openvdb/version.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <map>
#include <string>

namespace mpuvdb
{
namespace
{

/// The magic number, and the oldest (of OpenVDB 3, 2014) and newest file version, little-endian.
/// [derived: OpenVDB's format]
constexpr std::int64_t kMagic = 0x56444220;
constexpr std::uint32_t kOldestVersion = 222;
constexpr std::uint32_t kNewestVersion = std::max(225u, openvdb::OPENVDB_FILE_VERSION);
/// The longest name, bytes: longer ones are taken for damage. [tuned: io_broken_test]
constexpr std::size_t kMaxNameBytes = 1 << 16;
const char* const kHalfSuffix = "_HalfFloat";

class Walk
{
public:
    explicit Walk(const std::filesystem::path& file) : mFile(file), mStream(file, std::ios::binary)
    {
        std::error_code error;
        mSize = std::int64_t(std::filesystem::file_size(file, error));
        if (!mStream || error)
            throw IoError(fmt::format(
                "{}: cannot be read: {}. Check the name and its permissions", file.string(),
                error ? error.message() : std::generic_category().message(errno)));
    }

    void file()
    {
        std::string head(256, '\0');
        mStream.read(head.data(), std::streamsize(head.size()));
        head.resize(std::size_t(mStream.gcount()));
        mStream.clear();
        mStream.seekg(0);
        refuseStandIns(mFile.string(), head);
        if (mSize < std::int64_t(sizeof kMagic) || number<std::int64_t>() != kMagic)
            throw InputError(fmt::format(
                "{}: is not a .vdb file (no magic number). Name an OpenVDB file; points and meshes "
                "become one with mpuvdb reconstruct or voxelize (Python: mpuvdb.points, "
                "mpuvdb.mesh)",
                mFile.string()));
        version();
        const bool seekable = number<char>() != 0;
        skip(kVdbUuidSize);
        metadata();
        const auto grids = number<std::int32_t>();
        // A descriptor has at least 36 bytes.
        if (grids < 0 || grids > left() / 36) damaged("has an absurd number of grids");
        if (!seekable) return;
        for (std::int32_t grid = 0; grid < grids; ++grid) descriptor();
    }

private:
    std::int64_t at() { return std::int64_t(mStream.tellg()); }
    std::int64_t left() { return mSize - at(); }

    [[noreturn]] void truncated()
    {
        throw InputError(fmt::format("{}: is truncated ({} bytes). Copy or write it again",
                                     mFile.string(), mSize));
    }
    [[noreturn]] void damaged(const std::string& how)
    {
        throw InputError(fmt::format("{}: is damaged (near byte {}: {}). Copy or write it again",
                                     mFile.string(), at(), how));
    }

    template <typename Number>
    Number number()
    {
        Number value{};
        if (!mStream.read(reinterpret_cast<char*>(&value), sizeof value)) truncated();
        return value;
    }
    void skip(std::int64_t bytes)
    {
        if (bytes > left()) truncated();
        mStream.seekg(bytes, std::ios::cur);
    }
    std::string text()
    {
        const auto size = number<std::uint32_t>();
        if (size > kMaxNameBytes) damaged(fmt::format("has a name of {} bytes", size));
        if (size > left()) truncated();
        std::string value(size, '\0');
        mStream.read(value.data(), size);
        return value;
    }

    void version()
    {
        const auto format = number<std::uint32_t>();
        if (format < kOldestVersion || format > kNewestVersion)
            throw InputError(fmt::format(
                "{}: has file format {}, and {} to {} can be read. Convert it with vdb_tool",
                mFile.string(), format, kOldestVersion, kNewestVersion));
        skip(2 * sizeof(std::uint32_t)); // the writing library's version
    }

    void metadata()
    {
        const auto count = number<std::uint32_t>();
        // Two texts and a size each.
        if (count > left() / 12) damaged(fmt::format("has {} items of metadata", count));
        for (std::uint32_t item = 0; item < count; ++item) {
            text();
            const std::string type = text();
            const auto size = number<std::uint32_t>();
            if (openvdb::Metadata::isRegisteredType(type)) {
                // Types of variable size are empty when created.
                const auto expected = openvdb::Metadata::createMetadata(type)->size();
                if (expected != 0 && expected != size && !variable(type))
                    damaged(fmt::format("has {} bytes for a {}", size, type));
            }
            skip(size);
        }
    }
    static bool variable(const std::string& type)
    {
        return type == "string" || type == "__delayedload";
    }

    void descriptor()
    {
        text(); // name
        std::string type = text();
        const bool isShared = !text().empty(); // the grid whose tree this one shares
        const auto grid = number<std::int64_t>(), blocks = number<std::int64_t>(),
                   end = number<std::int64_t>();
        const bool isOrdered = isShared ? grid <= end : grid <= blocks && blocks <= end;
        if (grid < at() || !isOrdered) damaged("has grid offsets out of order");
        if (end > mSize) truncated();
        mStream.seekg(grid);
        skip(sizeof(std::uint32_t)); // compression
        metadata();
        // A shared tree is stored with its owner: nothing but the transform follows.
        if (transform() && !isShared && blocks > at()) root(type, blocks);
        if (at() > end) damaged("has a grid beyond its end");
        mStream.seekg(end);
    }

    /// @return whether the map's type is known.
    bool transform()
    {
        static const std::map<std::string, std::int64_t> kMapBytes = {
            {"UniformScaleMap", 120}, {"UniformScaleTranslateMap", 144},
            {"ScaleMap", 120},        {"ScaleTranslateMap", 144},
            {"TranslationMap", 24},   {"AffineMap", 128},
            {"UnitaryMap", 128}};
        const auto bytes = kMapBytes.find(text());
        if (bytes == kMapBytes.end()) return false;
        skip(bytes->second);
        return true;
    }

    /// The root of a tree of floats: the counts of its tiles and children.
    void root(std::string type, std::int64_t blocks)
    {
        const auto suffix = type.find(kHalfSuffix);
        if (suffix != std::string::npos) type.resize(suffix);
        if (type != "Tree_float_5_4_3") return;
        if (number<std::int32_t>() != 1) damaged("has more than one buffer per tree");
        skip(sizeof(float)); // background
        const auto tiles = number<std::uint32_t>(), children = number<std::uint32_t>();
        // A tile is a coordinate, a value and a state; a child at least a coordinate and two masks.
        // [derived: OpenVDB's format]
        constexpr std::int64_t kTile = 12 + 4 + 1, kChild = 12 + 2 * 4096;
        if (tiles * kTile + children * kChild > blocks - at())
            damaged(fmt::format("has {} tiles and {} nodes in a root", tiles, children));
    }

    std::filesystem::path mFile;
    std::ifstream mStream;
    std::int64_t mSize = 0;
};

} // namespace

void checkVdbLayout(const std::filesystem::path& file)
{
    Walk(file).file();
}

} // namespace mpuvdb
