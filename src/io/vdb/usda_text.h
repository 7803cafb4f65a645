// The head of USDA layers.
#pragma once
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <string>

namespace mpuvdb
{

/// The head of a layer whose one prim is @a prim. @param time  lines of its time codes, or none.
inline std::string usdaHead(const char* prim, const SceneSettings& scene,
                            const std::string& time = {})
{
    return fmt::format("#usda 1.0\n(\n    defaultPrim = \"{}\"\n{}    metersPerUnit = {}\n"
                       "    upAxis = \"{}\"\n)\n\n",
                       prim, time, scene.metersPerUnit, scene.up == UpAxis::Z ? "Z" : "Y");
}

} // namespace mpuvdb
