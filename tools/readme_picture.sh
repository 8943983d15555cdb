#!/bin/sh
# Makes the picture of the README, testdata/readme/layouts.png: one panorama in eight layouts.  Needs ffmpeg and the font
# of the package fonts-dejavu-core.  tools/readme_picture.sh [BINARY]
set -eu
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
envconv=${1:-$root/build/envconv}
font=/usr/share/fonts/truetype/dejavu/DejaVuSans.ttf
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# Layout and packing of each cell, row by row.
cells="latlong:row cube:cross octahedral:row angular-map:row
       paraboloid:row tennis-ball:column polar-capped:grid diamond-12:grid"

inputs= filters= places= stack= n=0
for cell in $cells; do
  layout=${cell%%:*}
  # Larger than shown: a picture that is made smaller is sharper than one made larger.
  "$envconv" convert "$root/testdata/panoramas/venice.hdr" -q -o "$work/$layout.png" --to "$layout" \
    --packing "${cell##*:}" --texels 600k --exposure -1 --type uint8
  inputs="$inputs -i $work/$layout.png"
  filters="$filters[$n]scale=360:240:force_original_aspect_ratio=decrease:flags=area,pad=376:280:(ow-iw)/2:(248-ih)/2+4:white"
  filters="$filters,drawtext=fontfile=$font:text=$layout:fontsize=18:fontcolor=black:x=(w-text_w)/2:y=254[c$n];"
  stack="${stack}[c$n]"
  places="$places${places:+|}$((n % 4 * 376))_$((n / 4 * 280))"
  n=$((n + 1))
done
mkdir -p "$root/testdata/readme"
# shellcheck disable=SC2086
ffmpeg -nostdin -v error -y $inputs -filter_complex "$filters${stack}xstack=inputs=$n:layout=$places" \
  -frames:v 1 -update 1 "$root/testdata/readme/layouts.png"
