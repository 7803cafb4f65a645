// The head of USDA layers.
#pragma once
#include <mpuvdb/io.h>

#include <fmt/format.h>

#include <string>

namespace mpuvdb
{

/// The head of a layer whose one prim is @a prim.
inline std::string usdaHead(const char* prim, const SceneSettings& scene)
{
    return fmt::format("#usda 1.0\n(\n    defaultPrim = \"{}\"\n    metersPerUnit = {}\n"
                       "    upAxis = \"{}\"\n)\n\n",
                       prim, scene.metersPerUnit, scene.up == UpAxis::Z ? "Z" : "Y");
}

} // namespace mpuvdb
