#!/bin/sh
# Builds envconv (installing what that needs) and runs it: tools/run.sh convert sky.hdr -o sky.exr
# Everything but the tool's own output goes to stderr.
set -eu
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
"$root/tools/setup.sh" build
mkdir -p "$root/build"
log=$root/build/run.log
{
  # BUILD_TESTING is left as it is, so that run.sh and test.sh can share a build folder.
  if [ ! -f "$root/build/build.ninja" ]; then
    cmake -S "$root" -B "$root/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=OFF
  fi
  cmake --build "$root/build" --target envconv
} >"$log" 2>&1 || {
  cat "$log" >&2
  exit 70
}
exec "$root/build/envconv" "$@"
