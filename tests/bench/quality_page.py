# SPDX-License-Identifier: Apache-2.0
"""Quality against time, for our filters and for other programs: writes QUALITY.md and QUALITY.svg beside this file.

    ninja -C build envconv resample_bench peers_bench pairs_bench
    python3 tests/bench/quality_page.py [--build build] [--runs N] [--folder FOLDER] [SOURCE_HEIGHT,FACE_SIZE]...

peers_bench measures what is called from a program, resample() and OpenCV, and pairs_bench every pair of layouts; here,
other programs are run on files that resample_bench paints and judges.  What is not installed is named on the page.  See
analytic.h for the signals.
"""
import argparse
import dataclasses
import math
import os
import pathlib
import re
import resource
import shutil
import statistics
import subprocess
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent


@dataclasses.dataclass
class Row:
    name: str
    wall: float  # seconds
    cpu: float
    psnr: tuple  # R, G, B

    @property
    def ours(self):
        return self.name.startswith("envconv")


def from_libraries(build, height, face, runs):
    """Rows of resample() and OpenCV."""
    command = [build / "peers_bench", "--all", "--quality", "--table", "--runs", str(runs), str(height), str(face)]
    rows = []
    for line in subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines():
        _, name, wall, cpu, *psnr = line.split("|")
        psnr = tuple(float(v) for v in psnr)
        if any(psnr):  # a resize alone has no quality
            rows.append(Row(name, float(wall), float(cpu), psnr))
    return rows


def timed(command, runs):
    """Medians of wall and processor seconds."""
    times = []
    for _ in range(runs):
        before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        wall = time.perf_counter() - start
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append((wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime))
    return tuple(statistics.median(t[i] for t in times) for i in (0, 1))


def from_programs(build, height, face, runs, folder):
    """Rows of whole programs, file to file, and the names of those that are missing."""
    exr, png = f"{folder}/source.exr", f"{folder}/source.png"
    bench = [build / "resample_bench"]
    for path in (exr, png):
        subprocess.run([*bench, "--paint", path, str(height), str(face)], check=True)
    convert = [build / "envconv", "convert", exr, "--size", str(face), "--type", "float", "--compression", "none", "-q"]
    # Name, program, command, output, judged as.
    cases = [(f"envconv convert, {name}", "envconv", [*convert, "--filter", name, "-o", f"{folder}/ours_{name}.exr"],
              f"{folder}/ours_{name}.exr", ["--to", "cube", "--packing", "row"]) for name in ("auto", "bilinear")]
    cases.append(("exrenvmap", "exrenvmap", ["exrenvmap", "-c", "-w", str(face), exr, f"{folder}/exrenvmap.exr"],
                  f"{folder}/exrenvmap.exr", ["--to", "openexr-cube"]))
    for name in ("linear", "cubic", "lanczos"):
        cases.append((f"ffmpeg v360, {name}", "ffmpeg",
                      ["ffmpeg", "-v", "error", "-y", "-i", png, "-vf",
                       f"v360=e:c6x1:interp={name}:w={6 * face}:h={face}", f"{folder}/ffmpeg_{name}.png"],
                      f"{folder}/ffmpeg_{name}.png", ["--to", "cube", "--packing", "row"]))
    rows, missing = [], []
    for name, program, command, output, how in cases:
        if program != "envconv" and not shutil.which(program):
            missing.append(program)
            continue
        pathlib.Path(output).unlink(missing_ok=True)
        wall, cpu = timed(command, 1 if program == "exrenvmap" else runs)
        text = subprocess.run([*bench, "--judge", output, *how, str(height), str(face)], check=True,
                              capture_output=True, text=True).stdout
        rows.append(Row(name, wall, cpu, tuple(float(v) for v in re.findall(r"[RGB] (-?[\d.]+)", text))))
    return rows, missing


def table(rows):
    lines = ["| | R | G | B | processor ms | wall ms |", "|---|---|---|---|---|---|"]
    for row in sorted(rows, key=lambda r: -r.psnr[0]):
        name = f"**{row.name}**" if row.ours else row.name
        lines.append(f"| {name} | " + " | ".join(f"{v:.1f}" for v in row.psnr) +
                     f" | {1e3 * row.cpu:.0f} | {1e3 * row.wall:.0f} |")
    return lines


def winners(rows):
    """Lines about others that none of ours matches in both time and quality."""
    lines = []
    for peer in (r for r in rows if not r.ours):
        faster = [r for r in rows if r.ours and r.cpu <= 1.02 * peer.cpu]
        if any(all(a >= b - 0.05 for a, b in zip(r.psnr, peer.psnr)) for r in faster):
            continue
        as_good = [r for r in rows if r.ours and all(a >= b - 0.05 for a, b in zip(r.psnr, peer.psnr))]
        best = min(as_good, key=lambda r: r.cpu, default=None)
        lines.append(f"- {peer.name}: " + (
            f"the fastest of ours that is as good in every column, {best.name}, takes {best.cpu / peer.cpu:.2f} times as long"
            if best else "none of ours is as good in every column"))
    return lines or ["- none: each is matched in every column by one of ours that takes no longer"]


def plot(panels):
    """SVG: the R column over processor time, one panel a pair of sizes; numbers are explained beside them."""
    width, height, margin, legend = 460, 360, 56, 250
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width + legend}" height="{len(panels) * (height + 40)}" '
           'font-family="sans-serif" font-size="12">', '<rect width="100%" height="100%" fill="white"/>']
    for k, (title, rows) in enumerate(panels):
        top = k * (height + 40) + 30
        rows = sorted(rows, key=lambda r: -r.psnr[0])
        logs, values = [math.log10(1e3 * r.cpu) for r in rows], [r.psnr[0] for r in rows]
        x0, x1 = math.floor(min(logs) * 2) / 2, math.ceil(max(logs) * 2) / 2
        y0, y1 = math.floor(min(values) / 10) * 10, math.ceil(max(values) / 10) * 10
        x = lambda v: margin + (v - x0) / (x1 - x0) * (width - margin - 20)
        y = lambda v: top + 10 + (y1 - v) / (y1 - y0) * (height - 60)
        out.append(f'<text x="{margin}" y="{top - 8}" font-size="14">{title}</text>')
        for v in range(y0, y1 + 1, 10):
            out.append(f'<path d="M{margin} {y(v):.1f}H{width - 20}" stroke="#ddd"/>'
                       f'<text x="{margin - 8}" y="{y(v) + 4:.1f}" text-anchor="end">{v}</text>')
        for exponent in range(math.floor(x0), math.ceil(x1) + 1):
            for digit in (1, 2, 5):
                v = exponent + math.log10(digit)
                if x0 <= v <= x1:
                    out.append(f'<path d="M{x(v):.1f} {y(y0):.1f}V{y(y1):.1f}" stroke="#ddd"/>'
                               f'<text x="{x(v):.1f}" y="{y(y0) + 16:.1f}" text-anchor="middle">'
                               f'{digit * 10 ** exponent:g}</text>')
        out.append(f'<text x="{(margin + width) / 2}" y="{y(y0) + 34:.1f}" text-anchor="middle">'
                   'processor time, ms</text>')
        out.append(f'<text x="14" y="{top + height / 2 - 20}" transform="rotate(-90 14 {top + height / 2 - 20})" '
                   'text-anchor="middle">PSNR of R, dB</text>')
        for i, (row, log, value) in enumerate(zip(rows, logs, values), 1):
            colour = "#0060c0" if row.ours else "#c04000"
            out.append(f'<circle cx="{x(log):.1f}" cy="{y(value):.1f}" r="3.5" fill="{colour}"/>'
                       f'<text x="{x(log) + 5:.1f}" y="{y(value) - 4:.1f}" font-size="10" fill="{colour}">{i}</text>'
                       f'<text x="{width}" y="{top + 4 + 15 * i}" fill="{colour}">{i}  {row.name}</text>')
    return "\n".join([*out, "</svg>", ""])


def processor():
    names = [line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")]
    return f"{len(os.sched_getaffinity(0))} cores of {names[0]}" if names else f"{os.cpu_count()} cores"


def pairs(build, runs):
    """The section about all ordered pairs of layouts."""
    def said(*words):
        done = subprocess.run([build / "pairs_bench", *words], check=True, capture_output=True, text=True)
        return done.stdout.strip().splitlines()
    return ["## Every pair of layouts", "",
            "Quality (`pairs_bench quality`), beside the best that the source's texels allow: a sinc under a Kaiser "
            "window of 16 taps a side, integrated over each texel's footprint as exactly as by 32x32 samples, with true "
            "texels beyond every edge. Sources of 5.2e5 texels, outputs of 3.9e5, as at 1024x512 to a cube of 256. "
            "Negative: `auto` is nearer to the truth.", "", *said("quality"), "",
            "`auto` falls short by more than 4 dB only where the best is above 85 dB: there its kernel of 5x5 taps bounds "
            "R, and its grid of samples, about one to a source texel, bounds G. `--samples 2` takes 7x7 taps and four "
            "samples to an output texel, in about twice the time (near the sphere map's rim `auto` takes more):", "",
            *said("quality", "--samples", "2"), "",
            "Processor time of an output texel (`pairs_bench rates`), relative to lat-long to cube, for sources of 8.4e6 "
            "texels and outputs of 6.3e6:", "",
            *said("rates", "--texels", "8.4e6,6.3e6", "--runs", str(runs)), "",
            "The mapping is not what takes longer: it is evaluated at few points of a tile, with polynomials between. "
            "To the sphere map it is the number of samples: near its rim texels are slivers across the grid's axes, and "
            "a grid along both of them has to be as dense along each as the slivers are long. From layouts of many "
            "faces it is the seams: texels beyond them are interpolated (a fifth of the time for the twelve diamonds), "
            "and tiles that see several faces are located sample by sample.", ""]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sizes", nargs="*", default=["2048,1024", "4096,256"])
    parser.add_argument("--build", type=pathlib.Path, default=HERE.parents[1] / "build")
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--folder", default="/dev/shm" if os.path.isdir("/dev/shm") else None)
    options = parser.parse_args()
    build = options.build.resolve()
    page = ["<!-- Made by quality_page.py; not to be edited. -->", "# Quality against time", "",
            "A lat-long panorama of three analytic signals becomes a cube, and every texel is compared with the "
            "signal's true mean over the texel's footprint. R: plane waves up to the output's Nyquist limit; G: up to "
            "half of it; B: zone plates up to 0.98 of the source's Nyquist limit, most of which the output cannot hold "
            "and must average. PSNR in dB, weighted by solid angle: higher is better. "
            f"Medians of {options.runs} runs on {processor()}; the machine may have had other work, so the "
            "processor's time (of all threads) is the one to compare. Made by `tests/bench/quality_page.py`.", "",
            "![quality against time](QUALITY.svg)", ""]
    panels = []
    for pair in options.sizes:
        height, face = (int(v) for v in pair.split(","))
        title = f"{2 * height}x{height} to a cube of {face}"
        rows = from_libraries(build, height, face, options.runs)
        with tempfile.TemporaryDirectory(dir=options.folder) as folder:
            programs, missing = from_programs(build, height, face, options.runs, folder)
        panels.append((title, rows))
        page += [f"## {title}", "", "Within a program: `resample()` beside OpenCV, floats in memory. OpenCV's coordinate "
                 "maps are given unless its name says otherwise, and its source was padded before, so that it sees the "
                 "seam and the poles as it should. Ours are whole calls.", "", *table(rows), "",
                 "Where others win (processor time against all three columns):", "", *winners(rows), "",
                 "Whole programs, from an uncompressed file to a file (ffmpeg: PNG of 16 bits on both sides, most of its "
                 "time; exrenvmap, once, is judged in its own convention, texel centres on the faces' edges):", "",
                 *table(programs), "", "Where others win:", "", *winners(programs), ""]
        if missing:
            page += [f"Not installed: {', '.join(sorted(set(missing)))}.", ""]
    page += pairs(build, options.runs)
    page += ["Not measured: envutil, whose twining is the best of the released tools that we know, and "
             "OpenImageIO's `environment()`, which no program of its own calls.", ""]
    (HERE / "QUALITY.md").write_text("\n".join(page))
    (HERE / "QUALITY.svg").write_text(plot(panels))


main()
