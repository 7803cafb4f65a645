#!/bin/sh
# A colored scan becomes one file for lookdev: surface, density and Cd, with a USD layer and a mesh.
#
# Instead of Houdini's Convert VDB, Attribute from Volume and USD Volume LOP. Needs mpuvdb on the
# PATH. The file opens in Blender (Add > Volume > Import OpenVDB) and Houdini (File).
set -eu
here=$(cd "$(dirname "$0")" && pwd)
output=${OUTPUT:-.}
mkdir -p "$output"

"${PYTHON:-/usr/bin/python3}" "$here/scan_to_surface.py" -o "$output" --voxels "${VOXELS:-120}" > "$output/scan.txt"
mpuvdb fog "$output/scan.vdb" -o "$output/lookdev.vdb" --keep-surface --quiet
mpuvdb mesh "$output/lookdev.vdb" -o "$output/lookdev.glb" --tolerance 0.2vx --quiet
mpuvdb mesh "$output/lookdev.vdb" -o "$output/lookdev.usda" --tolerance 0.2vx --quiet
mpuvdb info "$output/lookdev.vdb" | grep "name:"
