#!/bin/sh
# A head becomes a rabbit in eight frames, each a file of its own, as a farm would make them.
#
# Instead of Houdini's VDB Morph SDF, Time Shift and ROP Geometry. Needs mpuvdb on the PATH.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
output=${OUTPUT:-.}
mkdir -p "$output"

"${PYTHON:-/usr/bin/python3}" - "$here" "$output" "${VOXELS:-120}" <<'MODELS'
import sys
sys.path.insert(0, sys.argv[1])
from models import head, rabbit, unit
for name, shape in (("head", head), ("rabbit", rabbit)):
    unit(shape()).write(f"{sys.argv[2]}/{name}.vdb", voxel_size=1 / int(sys.argv[3]))
MODELS

mpuvdb morph "$output/head.vdb" "$output/rabbit.vdb" -o "$output/change.####.vdb" \
    --frames 1-8 --method advection --jobs 2 --quiet
mpuvdb check "$output/change.####.vdb" --frames 1-8 --quiet
mpuvdb info "$output/change.0001.vdb" "$output/change.0008.vdb" | grep active_voxels
