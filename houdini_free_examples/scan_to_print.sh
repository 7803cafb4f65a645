#!/bin/sh
# A scan becomes a part to print: hollow, with a drain hole, flat below, as STL and as slices.
#
# Needs mpuvdb on the PATH. Units are millimeters.
set -eu
output=${OUTPUT:-.}
mkdir -p "$output"
voxels=${VOXELS:-120}

mpuvdb sample "sphere(20)" -o "$output/raw.ply" --noise 0.05 --points 40000 --quiet
mpuvdb reconstruct "$output/raw.ply" -o "$output/whole.vdb" --voxels "$voxels" --quiet
mpuvdb shell "$output/whole.vdb" -o "$output/hollow.vdb" --thickness 2 --quiet
# Flat below: what lies under -17 mm goes; the opening there is the drain.
mpuvdb clip "$output/hollow.vdb" -o "$output/print.vdb" --box -30 -30 -17 30 30 30 --quiet
mpuvdb check "$output/print.vdb" --quiet
mpuvdb analyze "$output/print.vdb" -o "$output/print_thickness.vdb" --quantities thickness --quiet
mpuvdb mesh "$output/print.vdb" -o "$output/print.stl" --tolerance 0.1vx --strict --quiet
mpuvdb slice "$output/print.vdb" -o "$output/print.svg" --every 1 --units mm --quiet
mpuvdb info "$output/print.stl" | grep -E "boundary_edges|self_intersections|genus|volume"
