#!/bin/sh
# Makes the committed documents again from the program: tools/generate.sh [BINARY]
set -eu
root=$(CDPATH='' cd -- "$(dirname -- "$0")/.." && pwd)
envconv=${1:-$root/build/envconv}
cd "$root"
# Through a variable, so that a failure leaves the old text.
for pair in man:man/envconv.1.in:man/envconv.1 layouts-man:man/envconv-layouts.7.in:man/envconv-layouts.7 \
  metrics-man:man/envconv-metrics.7.in:man/envconv-metrics.7 \
  readme:README.md:README.md; do
  kind=${pair%%:*} rest=${pair#*:}
  text=$("$envconv" --generate "$kind" "${rest%%:*}")
  printf '%s\n' "$text" >"${rest##*:}"
done
