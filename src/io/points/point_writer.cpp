// Points to binary PLY or XYZ text.
#include "files/output_stream.h"
#include "files/text_scan.h"
#include "io/for_each_item.h"

#include <mpuvdb/error.h>
#include <mpuvdb/interrupter.h>
#include <mpuvdb/io.h>

#include <fmt/format.h>

namespace mpuvdb
{
namespace
{

void writePly(const PointCloud& cloud, OutputBuffer& out, Interrupter& progress)
{
    out.text(fmt::format("ply\nformat binary_little_endian 1.0\nelement vertex {}\n"
                         "property double x\nproperty double y\nproperty double z\n",
                         cloud.size()));
    if (!cloud.normals.empty())
        out.text("property float nx\nproperty float ny\nproperty float nz\n");
    if (!cloud.confidence.empty()) out.text("property float confidence\n");
    if (!cloud.colors.empty())
        out.text("property uchar red\nproperty uchar green\nproperty uchar blue\n");
    for (const NamedScalars& scalars : cloud.scalars)
        out.text(fmt::format("property float {}\n", identifier(scalars.name)));
    out.text("end_header\n");
    forEachItem(cloud.size(), out, progress, [&](std::size_t i) {
        const Vec3d p = cloud.world(i);
        out.append(p.data(), sizeof(double) * 3);
        if (!cloud.normals.empty()) out.append(cloud.normals[i].data(), sizeof(float) * 3);
        if (!cloud.confidence.empty()) out.value(cloud.confidence[i]);
        if (!cloud.colors.empty()) out.append(cloud.colors[i].data(), 3);
        for (const NamedScalars& scalars : cloud.scalars) out.value(scalars.values[i]);
    });
}

// Shortest decimals that give the same numbers back.
void writeText(const PointCloud& cloud, OutputBuffer& out, Interrupter& progress)
{
    forEachItem(cloud.size(), out, progress, [&](std::size_t i) {
        const Vec3d p = cloud.world(i);
        fmt::format_to(std::back_inserter(out.bytes()), "{} {} {}", p[0], p[1], p[2]);
        if (!cloud.normals.empty()) {
            const Vec3f& n = cloud.normals[i];
            fmt::format_to(std::back_inserter(out.bytes()), " {} {} {}", n[0], n[1], n[2]);
        }
        out.text("\n");
    });
}

} // namespace

void writePoints(const std::filesystem::path& file, const PointCloud& cloud,
                 Interrupter* interrupter)
{
    Interrupter& progress = orSilent(interrupter);
    const std::string extension = lowerCase(file.extension().string());
    const bool text = extension == ".xyz" || extension == ".txt" || extension == ".pwn";
    if (!text && extension != ".ply" && file != "-")
        throw UsageError(fmt::format("{}: points are written as .ply or .xyz, not '{}'",
                                     file.string(), extension));
    progress.beginStage("write points", double(cloud.size()));
    writeStream(file, [&](OutputBuffer& out) {
        if (text)
            writeText(cloud, out, progress);
        else
            writePly(cloud, out, progress);
    });
    progress.endStage();
}

} // namespace mpuvdb
