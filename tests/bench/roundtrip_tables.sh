#!/bin/sh
# Makes the README's tables of round trips again: which layout loses least on real panoramas.
# tests/bench/roundtrip_tables.sh [BINARY]  (minutes: it takes a good hundred round trips)
set -eu
root=$(CDPATH='' cd -- "$(dirname -- "$0")/../.." && pwd)
ENVCONV=${1:-$root/build/envconv} exec python3 -B - "$root" <<'END'
import json
import os
import pathlib
import re
import statistics
import subprocess
import sys

root = pathlib.Path(sys.argv[1])
panoramas = sorted(p for p in (root / "testdata/panoramas").iterdir() if p.suffix in (".exr", ".hdr"))
sizes, texels = (16, 32, 64, 128, 256), "50k"


def envconv(*words):
    return json.loads(subprocess.run([os.environ["ENVCONV"], *map(str, words), "--json"], check=True,
                                     stdout=subprocess.PIPE, text=True).stdout)


def table(heading, rows):
    lines = [heading, ["---"] * len(heading), *rows]
    return "".join("| " + " | ".join(line) + " |\n" for line in lines)


def ranks(names, key):
    """Ranks from 1; equal keys share the mean of theirs."""
    order = sorted(names, key=key)
    places = {}
    for name in order:
        same = [i + 1 for i, other in enumerate(order) if key(other) == key(name)]
        places[name] = sum(same) / len(same)
    return places


def against_cube():
    """Figure 10 of the isocube paper: PSNR of the isocube less that of the cube, in dB."""
    rows, gains = [], []
    for panorama in panoramas:
        for figure in ("psnr", "psnr_hdr"):
            found = envconv("roundtrip", panorama, "--via", "isocube,cube", "--sizes", ",".join(map(str, sizes)),
                            "--filter", "bilinear")["results"]
            value = {(r["layout"], r["size"]): r[figure] for r in found}
            gain = [round(value["isocube", n] - value["cube", n], 2) for n in sizes]
            rows.append([panorama.name, f"`{figure}`", *(f"{g:+.2f}" for g in gain)])
            gains += gain
    text = table(["panorama", "figure", *(f"{n} x {n} x 6" for n in sizes)], rows)
    return text + (f"\nThe isocube is ahead in {sum(g > 0 for g in gains)} of {len(gains)}; the median is "
                   f"{statistics.median(gains):+.2f} dB.\n")


def ranking():
    requirement = {l["name"]: l["sampling_requirement"] or float("inf") for l in envconv("layouts")["layouts"]}
    names = list(requirement)
    sums = {name: {"psnr": 0.0, "psnr_hdr": 0.0} for name in names}
    for panorama in panoramas:
        for result in envconv("roundtrip", panorama, "--via", "all", "--texels", texels)["results"]:
            for figure in sums[result["layout"]]:
                sums[result["layout"]][figure] += result[figure] / len(panoramas)
    by_requirement = ranks(names, lambda n: round(requirement[n], 2))
    places = {figure: ranks(names, lambda n: -sums[n][figure]) for figure in ("psnr", "psnr_hdr")}
    rows = [[f"`{n}`", f"{sums[n]['psnr_hdr']:.2f}", f"{places['psnr_hdr'][n]:g}", f"{sums[n]['psnr']:.2f}",
             f"{places['psnr'][n]:g}", f"{requirement[n]:.2f}", f"{by_requirement[n]:g}"]
            for n in sorted(names, key=lambda n: places["psnr_hdr"][n])]

    def correlation(a, b):  # Spearman's: Pearson's of the ranks
        mean = (len(names) + 1) / 2
        moment = lambda p, q: sum((p[n] - mean) * (q[n] - mean) for n in names)
        return moment(a, b) / (moment(a, a) * moment(b, b)) ** 0.5

    text = table(["layout", "`psnr_hdr`", "rank", "`psnr`", "rank", "sampling", "rank"], rows)
    return text + (f"\nRank correlation (Spearman) of the sampling requirement with `psnr_hdr`: "
                   f"{correlation(by_requirement, places['psnr_hdr']):.2f}, with `psnr`: "
                   f"{correlation(by_requirement, places['psnr']):.2f}.\n")


readme = root / "README.md"
text = readme.read_text()
for name, made in (("isocube", against_cube()), ("ranking", ranking())):
    begin, end = f"<!-- {name}: made by tests/bench/roundtrip_tables.sh -->\n", f"<!-- {name}: end -->"
    text, count = re.subn(re.escape(begin) + ".*?" + re.escape(end), lambda _: begin + made + end, text, flags=re.S)
    assert count == 1, name
readme.write_text(text)
END
