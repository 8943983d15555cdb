# SPDX-License-Identifier: Apache-2.0
"""Quality against time of the BC6H encoder: writes BC6H.md beside this file.

    ninja -C build bc6h_bench
    python3 tests/bench/bc6h_page.py [--build build] [--crops N] [PANORAMA]...

N crops of each panorama are compared with the exhaustive search, which takes half a minute for one.
"""
import argparse
import pathlib
import re
import statistics
import subprocess

HERE = pathlib.Path(__file__).resolve().parent
PANORAMAS = HERE.parent.parent / "testdata" / "panoramas"
LOSS = r"  loss of \d+: mean (-?[\d.]+) dB, most (-?[\d.]+) dB, (\d+) of (\d+) over 0.5 dB"
LINE = re.compile(r"  (\w+) +([\d.]+) dB  mean +([\d.]+) %  +[\d.]+ Mtexel/s  cube +([\d.]+) s" + LOSS + LOSS)


def measure(build, crops, files):
    """SIMD target, and [file][effort] of (dB, % of the mean, seconds, and twice, of crops and of squares: mean and
    largest loss in dB, number of those over 0.5 dB, number of all)."""
    command = [build / "bc6h_bench", "--crops", str(crops), *files]
    text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    target, found, file = text.split(maxsplit=2)[1], {}, None
    for line in text.splitlines()[1:]:
        match = LINE.fullmatch(line)
        if match:
            found[file][match[1]] = tuple(float(match[i]) for i in range(2, 13))
        else:
            file = pathlib.Path(line).stem
            found[file] = {}
    return target, found


def page(target, found):
    efforts = list(next(iter(found.values())))
    crops, squares = (int(sum(rows[efforts[0]][i] for rows in found.values())) for i in (6, 10))
    lines = [
        "<!-- Made by bc6h_page.py; not to be edited. -->", "# BC6H: quality against time", "",
        "Of the three efforts of `--compression`; `lib/bc6h.cpp` tells how blocks are searched.", "",
        "Loss: squared error of log2(x + 1/1024) against a search over all modes and partitions from many starts, each",
        "followed by a descent (`tests/bc6h_exhaustive.h`); negative where ours is better, since that search has its own",
        f"local minima. What is compared: {crops} crops of 64x64 texels, from the panoramas' tops to their bottoms, of",
        f"which none is to lose more than 0.5 dB at the normal effort; and the {squares} squares of 16x16 texels that they",
        "consist of (those without any error left out), of which single ones lose more: a block or two decide there, or",
        "all is so smooth that what is lost is less than the rounding of halves. Time: processor time for a cube of 1024",
        f"with its levels (8.39 Mtexel), halved, as two cores would take; SIMD target {target}. The exhaustive search",
        "would take about half a day.", "",
        "| effort | crops: mean loss, dB | largest | squares: mean loss, dB | largest | over 0.5 dB | time, s |",
        "|---|---|---|---|---|---|---|",
    ]
    for effort in efforts:
        of_all = [rows[effort] for rows in found.values()]
        loss = [(sum(r[i] * r[i + 3] for r in of_all) / sum(r[i + 3] for r in of_all), max(r[i + 1] for r in of_all))
                for i in (3, 7)]
        over = sum(r[9] for r in of_all) / squares
        lines.append(f"| {effort} | {loss[0][0]:.2f} | {loss[0][1]:.2f} | {loss[1][0]:.2f} | {loss[1][1]:.2f} "
                     f"| {over:.1%} | {statistics.median(r[2] for r in of_all):.1f} |")
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
    parser.add_argument("--crops", type=int, default=4)
    parser.add_argument("panoramas", nargs="*", type=pathlib.Path)
    o = parser.parse_args()
    files = o.panoramas or sorted(f for f in PANORAMAS.iterdir() if f.suffix in (".exr", ".hdr"))
    (HERE / "BC6H.md").write_text(page(*measure(o.build.resolve(), o.crops, files)))


if __name__ == "__main__":
    main()
