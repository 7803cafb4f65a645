#include "output_check.h"

#include "frames.h"
#include <mpuvdb/error.h>

#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <fmt/format.h>
#include <fmt/ranges.h>
#include <unistd.h>

namespace mpuvdb::command
{
namespace
{

namespace fs = std::filesystem;

void checkExtension(const Output& output)
{
    const std::string extension = extensionOf(output.path);
    const auto& known = output.extensions;
    if (output.isFolder || known.empty() ||
        std::find(known.begin(), known.end(), extension) != known.end())
        return;
    throw UsageError(fmt::format("{} {}: no format has the extension '{}' here; use {}",
                                 output.option, output.path, extension, fmt::join(known, ", ")));
}

/// Whether a file can be created: by one without a name, which also detects read-only mounts; on
/// file systems without such files, by permissions.
bool writable(const fs::path& folder)
{
    const int file = open(folder.c_str(), O_TMPFILE | O_WRONLY | O_CLOEXEC, 0600);
    if (file >= 0) {
        close(file);
        return true;
    }
    if (errno != EOPNOTSUPP && errno != EISDIR) return false;
    return access(folder.c_str(), W_OK | X_OK) == 0;
}

void checkPlace(const Output& output)
{
    if (isFramePattern(output.path)) // of a sequence, it would be the name of a frame by now
        throw UsageError(fmt::format("{} {}: has a place for a frame's number, and there is no "
                                     "--frames. Give --frames 1-24, or another name",
                                     output.option, output.path));
    fs::path path(output.path);
    if (path.filename().empty()) path = path.parent_path(); // of a folder's name that ends in /
    std::error_code ignored;
    if (output.isFolder && fs::exists(path, ignored) && !fs::is_directory(path, ignored))
        throw IoError(fmt::format("{} {}: is a file; choose another name for the folder",
                                  output.option, output.path));
    if (!output.isFolder && fs::exists(path, ignored) && !fs::is_regular_file(path, ignored)) {
        throw IoError(fmt::format("{} {}: is not a regular file and would be replaced by one; name "
                                  "a file{}",
                                  output.option, output.path,
                                  output.printable ? ", or - for standard output" : ""));
    }
    const fs::path folder = path.has_parent_path() ? path.parent_path() : fs::path(".");
    if (!fs::is_directory(folder, ignored)) {
        throw IoError(fmt::format("{} {}: there is no folder {}; make it first", output.option,
                                  output.path, folder.string()));
    }
    if (!writable(folder)) {
        throw IoError(fmt::format("{} {}: cannot write in folder {}: {}", output.option,
                                  output.path, folder.string(), std::strerror(errno)));
    }
}

bool samePlace(const std::string& a, const std::string& b)
{
    if (a == "-" || b == "-") return a == b;
    std::error_code ignored;
    return fs::weakly_canonical(a, ignored) == fs::weakly_canonical(b, ignored);
}

} // namespace

std::string extensionOf(const std::string& path)
{
    std::string extension = fs::path(path).extension().string();
    for (char& c : extension) c = char(std::tolower(static_cast<unsigned char>(c)));
    return extension;
}

void checkDistinct(const std::vector<Output>& outputs, const std::vector<std::string>& inputs)
{
    if (std::count(inputs.begin(), inputs.end(), "-") > 1)
        throw UsageError("- -: standard input can be read once; name files for the others");
    std::vector<std::string> taken;
    for (const Output& output : outputs) {
        if (output.path.empty()) continue;
        const auto same = [&](const std::string& other) { return samePlace(output.path, other); };
        if (output.path != "-" && std::any_of(inputs.begin(), inputs.end(), same)) {
            throw UsageError(fmt::format("{} {}: is also an input; name another file",
                                         output.option, output.path));
        }
        if (std::any_of(taken.begin(), taken.end(), same)) {
            throw UsageError(fmt::format("{} {}: is named for two outputs; name two files",
                                         output.option, output.path));
        }
        taken.push_back(output.path);
    }
}

void checkForm(const Output& output)
{
    if (output.path.empty()) return;
    if (output.path != "-") {
        checkExtension(output);
    } else if (!output.printable) {
        throw UsageError(fmt::format("{} -: this format is not written to standard output; name a "
                                     "file ({})",
                                     output.option, fmt::join(output.extensions, ", ")));
    }
}

void checkOutput(const Output& output)
{
    checkForm(output);
    if (!output.path.empty() && output.path != "-") checkPlace(output);
}

} // namespace mpuvdb::command
