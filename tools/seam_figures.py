#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Measures what envconv-seams(7) tables, and puts it into man/envconv-seams.7.in: tools/seam_figures.py [BINARY]

It takes minutes, so tools/generate.sh does not do it.
"""
import json
import pathlib
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parent.parent
BINARY = sys.argv[1] if len(sys.argv) > 1 else str(ROOT / "build" / "envconv")
METHODS = ("none", "average", "stretch", "gutter:2")
SIZE = 64
BEGIN, END = '.\\" figures: made by tools/seam_figures.py\n', '.\\" figures: end\n'


def run(*words):
    return subprocess.run([BINARY, *map(str, words)], check=True, capture_output=True, text=True).stdout


def figures(layout, folder):
    """For each method its seam error over that inside faces; at last the largest change of the mean."""
    errors, drift = [], 0
    for method in METHODS:
        run("convert", ROOT / "testdata/panoramas/venice.hdr", "--to", layout, "--size", SIZE, "--packing", "files",
            "--type", "float", "--seam", method, "-o", f"{folder}/{{face}}_{{mip}}.exr")
        ratios, first, level = [], None, 0
        while list(folder.glob(f"*_{level}.exr")):
            info = json.loads(run("info", "--seams", "--json", "--from", layout, f"{folder}/{{face}}_{level}.exr"))
            means = [c["mean"] for c in info["channels"]]
            first = first or means
            drift = max([drift] + [abs(a / b - 1) for a, b in zip(means, first)])
            if SIZE >> level >= 8:
                ratios.append(info["seams"]["rms"] / info["seams"]["inside_rms"])
            level += 1
        errors.append(sum(ratios) / len(ratios))
        for file in folder.glob("*.exr"):
            file.unlink()
    return errors, drift


def main():
    layouts = [entry["name"] for entry in json.loads(run("layouts", "--json"))["layouts"]]
    lines = [f"{'layout':24}" + "".join(f"{m:>10}" for m in METHODS) + f"{'mean':>9}"]
    for layout in layouts:
        with tempfile.TemporaryDirectory() as folder:
            errors, drift = figures(layout, pathlib.Path(folder))
        cells = ["0" if e < 1e-4 else f"{e:.2g}" for e in errors]
        lines.append(f"{layout:24}" + "".join(f"{c:>10}" for c in cells) + f"{drift:9.0e}")
        print(lines[-1], flush=True)
    page = ROOT / "man/envconv-seams.7.in"
    before, rest = page.read_text().split(BEGIN)
    text = "\n".join(lines).replace("-", "\\-")
    page.write_text(before + BEGIN + ".nf\n" + text + "\n.fi\n" + END + rest.split(END)[1])


if __name__ == "__main__":
    main()
