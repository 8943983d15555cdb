#!/bin/sh
# usage: tests/instrumented_tbb.sh FOLDER
# Builds TBB with the thread sanitizer into FOLDER/libtbb.so.12, from the source of the Debian package that is installed.
set -eu
mkdir -p "$1"
folder=$(cd "$1" && pwd)
source=$(mktemp -d)
trap 'rm -rf "$source"' EXIT
cd "$source"
apt-get source --quiet=2 onetbb
cd onetbb-*/src/tbb
for file in *.cpp; do
  echo "$file"
done | xargs -P 2 -I{} g++ -std=c++17 -O1 -g -fPIC -fsanitize=thread -Wno-tsan -pthread -mrtm -mwaitpkg -D__TBB_BUILD \
  -I../../include -c {} -o {}.o
g++ -shared -fsanitize=thread -pthread -Wl,-soname,libtbb.so.12 ./*.o -o "$folder/libtbb.so.12" -ldl
