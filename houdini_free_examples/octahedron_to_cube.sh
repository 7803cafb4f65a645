#!/usr/bin/env bash
# An octahedron becomes a cube in seven frames, with nothing but the command.
# Ohtake et al., Multi-level partition of unity implicits, Figure 13.
#   octahedron_to_cube.sh [FROM [TO]]      meshes or level sets; made up where none is given
#   OUTPUT=folder VOXELS=100               where results go, and how fine they are
set -euo pipefail
output=${OUTPUT:-.} voxels=${VOXELS:-100}
from=${1:-$output/octahedron.obj} to=${2:-$output/cube.obj}
mkdir -p "$output"

# Six corners and eight faces; eight corners and six faces.
[[ $# -ge 1 ]] || cat > "$from" <<'OBJ'
v 1.2 0 0
v -1.2 0 0
v 0 1.2 0
v 0 -1.2 0
v 0 0 1.2
v 0 0 -1.2
f 1 3 5
f 3 2 5
f 2 4 5
f 4 1 5
f 3 1 6
f 2 3 6
f 4 2 6
f 1 4 6
OBJ
[[ $# -ge 2 ]] || cat > "$to" <<'OBJ'
v -0.7 -0.7 -0.7
v 0.7 -0.7 -0.7
v 0.7 0.7 -0.7
v -0.7 0.7 -0.7
v -0.7 -0.7 0.7
v 0.7 -0.7 0.7
v 0.7 0.7 0.7
v -0.7 0.7 0.7
f 4 3 2 1
f 5 6 7 8
f 1 2 6 5
f 2 3 7 6
f 3 4 8 7
f 4 1 5 8
OBJ

# Meshes become level sets; what is one already stays as it is.
level_set() {
    case $1 in
        *.vdb) cp "$1" "$2" ;;
        *) mpuvdb voxelize "$1" -o "$2" --voxels "$voxels" --quiet ;;
    esac
}
level_set "$from" "$output/from.vdb"
level_set "$to" "$output/to.vdb"
mpuvdb morph "$output/from.vdb" "$output/to.vdb" --frames 1-7 -o "$output/morph.####.vdb" --quiet

for frame in "$output"/morph.*.vdb; do
    mpuvdb check "$frame" --quiet
    mpuvdb render "$frame" -o "${frame%.vdb}.png" --size 300x300 --quiet
    echo "$frame and its picture"
done
