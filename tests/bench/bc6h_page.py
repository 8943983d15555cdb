# SPDX-License-Identifier: Apache-2.0
"""Quality against time of the BC6H encoder: writes BC6H.md beside this file.

    ninja -C build bc6h_bench
    python3 tests/bench/bc6h_page.py [--build build] [--stride N] [PANORAMA]...

Every N-th block is compared with the exhaustive search, which takes a tenth of a second for one.
"""
import argparse
import pathlib
import re
import statistics
import subprocess

HERE = pathlib.Path(__file__).resolve().parent
PANORAMAS = HERE.parent.parent / "testdata" / "panoramas"
LINE = re.compile(r"  (\w+) +([\d.]+) dB  mean +([\d.]+) %  +[\d.]+ Mtexel/s  cube +([\d.]+) s  "
                  r"loss (-?[\d.]+) dB over (\d+) blocks")


def measure(build, stride, files):
    """SIMD target, and [file][effort] of (dB, % of the mean, seconds, loss in dB, blocks)."""
    command = [build / "bc6h_bench", "--exhaustive", str(stride), *files]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    target, found, file = text.split(maxsplit=2)[1], {}, None
    for line in text.splitlines()[1:]:
        match = LINE.fullmatch(line)
        if match:
            found[file][match[1]] = tuple(float(match[i]) for i in range(2, 7))
        else:
            file = pathlib.Path(line).stem
            found[file] = {}
    return target, found


def page(target, found):
    efforts = list(next(iter(found.values())))
    blocks = int(sum(rows[efforts[0]][4] for rows in found.values()))
    lines = [
        "<!-- Made by bc6h_page.py; not to be edited. -->", "# BC6H: quality against time", "",
        "Of the three efforts of `--compression`; `lib/bc6h.cpp` tells how blocks are searched.", "",
        "Loss: squared error of log2(x + 1/1024) against a search over all modes and partitions from many starts, each",
        f"followed by a descent (`tests/bc6h_exhaustive.h`), over {blocks} blocks spread over the panoramas; negative where",
        "ours is better, since that search has its own local minima. Time: processor time for a cube of 1024 with its",
        f"levels (8.39 Mtexel), halved, as two cores would take; SIMD target {target}. The exhaustive search would take",
        "about half a day.", "",
        "| effort | loss, dB | time, s |", "|---|---|---|",
    ]
    for effort in efforts:
        of_all = [rows[effort] for rows in found.values()]
        lines.append(f"| {effort} | {statistics.mean(r[3] for r in of_all):.2f} "
                     f"({min(r[3] for r in of_all):.2f} to {max(r[3] for r in of_all):.2f}) "
                     f"| {statistics.median(r[2] for r in of_all):.1f} |")
    lines += ["", "Each panorama: PSNR of the same logarithm (16 octaves are full scale), and by how much the mean of a",
              "channel is off at most.", "",
              "| panorama | " + " | ".join(f"{e}, dB | mean, %" for e in efforts) + " |",
              "|---" * (1 + 2 * len(efforts)) + "|"]
    for file, rows in found.items():
        lines.append(f"| {file} | " + " | ".join(f"{rows[e][0]:.2f} | {rows[e][1]:.2f}" for e in efforts) + " |")
    return "\n".join(lines) + "\n"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--build", type=pathlib.Path, default=pathlib.Path("build"))
    parser.add_argument("--stride", type=int, default=331)
    parser.add_argument("panoramas", nargs="*", type=pathlib.Path)
    o = parser.parse_args()
    files = o.panoramas or sorted(f for f in PANORAMAS.iterdir() if f.suffix in (".exr", ".hdr"))
    (HERE / "BC6H.md").write_text(page(*measure(o.build.resolve(), o.stride, files)))


if __name__ == "__main__":
    main()
