#!/bin/sh
# A scan becomes a level set in tasks, two at a time, as a farm would do them: the same bytes as at once.
#
# Instead of Houdini's TOPs: ROP Fetch, Partition, Wait for All, VDB Merge. Needs mpuvdb on the PATH.
# On a farm: mpuvdb plan --engine slurm, parallel, snakemake or openjd (docs/farm.md).
set -eu
output=${OUTPUT:-.}
voxels=${VOXELS:-160}
mkdir -p "$output"

mpuvdb sample "difference(torus(1,0.4),sphere(0.5))" -o "$output/farm_scan.ply" --points 40000 --quiet
rm -rf "$output/job"
mpuvdb plan "$output/farm_scan.ply" --job "$output/job/" --voxels "$voxels" --tile-voxels 128 --part-points 10000 \
    --engine list -o "$output/farm.vdb" --quiet
# Two workers share the tasks; all wait where the parts of the fit are gathered.
both() {
    mpuvdb tile "$output/job/" 0 --every 2 --quiet &
    mpuvdb tile "$output/job/" 1 --every 2 --quiet
    wait $!
}
both
mpuvdb gather "$output/job/" --quiet
both
mpuvdb status "$output/job/"
mpuvdb merge "$output/job/" -o "$output/farm.vdb" --quiet

mpuvdb reconstruct "$output/farm_scan.ply" -o "$output/farm_whole.vdb" --voxels "$voxels" --quiet
cmp "$output/farm.vdb" "$output/farm_whole.vdb" && echo "the same bytes as at once"
