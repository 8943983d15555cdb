#!/bin/sh
# Installs the build folder $1 to a place of its own, builds the consumer in $2 against it through CMake and through
# pkg-config, and runs both and the installed tool.
set -eu
build=$1
here=$2
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

cmake --install "$build" --prefix "$work/prefix" >"$work/install.log"
cmake -S "$here" -B "$work/consumer" -G Ninja -DCMAKE_PREFIX_PATH="$work/prefix" -DCMAKE_BUILD_TYPE=Release >"$work/cmake.log"
cmake --build "$work/consumer"

PKG_CONFIG_PATH=$(dirname "$(find "$work/prefix" -name envconv.pc)")
export PKG_CONFIG_PATH
# shellcheck disable=SC2046,SC2086
c++ -std=c++20 ${CXXFLAGS-} "$here/consumer.cpp" -o "$work/consumer_pc" $(pkg-config --cflags --libs envconv)

input=$here/../../testdata/panoramas/venice.hdr
"$work/consumer/consumer" "$input" "$work/a.exr"
"$work/consumer_pc" "$input" "$work/b.exr"
cmp "$work/a.exr" "$work/b.exr"

# The installed tool, which must find its image module there: the build folder's is out of reach.
cd "$work"
"$work/prefix/bin/envconv" convert b.exr -o c.png --to latlong --size 32 -q
"$work/prefix/bin/envconv" info c.png >"$work/info"
grep -q 64x32 "$work/info"
for file in share/man/man1/envconv.1 share/man/man7/envconv-layouts.7 share/man/man7/envconv-metrics.7 \
  share/bash-completion/completions/envconv share/zsh/site-functions/_envconv share/fish/vendor_completions.d/envconv.fish share/doc/envconv/LICENSE; do
  test -s "$work/prefix/$file" || { echo "not installed: $file" >&2; exit 1; }
done
