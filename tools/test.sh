#!/bin/sh
# Builds everything (installing what that and the tests need) and runs all tests.  Arguments go to ctest.
set -eu
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
"$root/tools/setup.sh" test
cmake -S "$root" -B "$root/build" -G Ninja -DCMAKE_BUILD_TYPE=Release -DBUILD_TESTING=ON
cmake --build "$root/build"
cd "$root/build"
exec ctest -j2 --output-on-failure "$@"
