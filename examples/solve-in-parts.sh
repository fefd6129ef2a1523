#!/bin/sh
# Solves a scene's light in N parts, each by a process of its own, and joins them.
#
#   examples/solve-in-parts.sh N ROOM.light SCENE [flags of isolux solve]
#
# ISOLUX is the program, if it is not found as isolux. Batch systems start the parts on many machines: see
# docs/batch.md.
set -eu
if [ $# -lt 3 ]; then
    echo "usage: $0 N ROOM.light SCENE [flags of isolux solve]" >&2
    exit 2
fi
parts=$1 light=$2
shift 2
isolux=${ISOLUX:-isolux}
folder=$(mktemp -d "$light.parts-XXXXXX")

# Each process beside the others.
pids=
for part in $(seq "$parts"); do
    "$isolux" solve "$@" --solver two-level --part "$part/$parts" -o "$folder/$part.part" &
    pids="$pids $!"
done
failed=0
for pid in $pids; do
    wait "$pid" || failed=1
done
if [ "$failed" = 1 ]; then
    echo "a part failed; the others are in $folder" >&2
    exit 1
fi
"$isolux" join "$folder"/*.part -o "$light"
rm -r "$folder"
