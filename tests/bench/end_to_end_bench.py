# SPDX-License-Identifier: Apache-2.0
"""A conversion from file to file beside oiiotool, which reads the same file and writes as many texels without resampling.

    ENVCONV=build/envconv python3 tests/bench/end_to_end_bench.py [FORMAT...] [OPTION...]

Prints a table: for each pair of sizes and format the medians of alternating runs.  `oiiotool IN --cut WxH -o OUT` cuts
what it writes out of what it reads; where the output has more texels, out of copies of the input side by side
(--mosaic).  Types, compressions and their levels are the same, but for PNG's filters and Radiance's run lengths, which
each program has of its own.  Processor time is that of all processes, the isolated reader too.  Outputs go to one folder,
by default in memory: a disk's own time would be added to ours alone, since oiiotool does not wait for it.
"""
import argparse
import ctypes
import os
import pathlib
import resource
import statistics
import subprocess
import tempfile
import time

BINARY = os.path.abspath(os.environ["ENVCONV"])
SOURCE = pathlib.Path(__file__).resolve().parents[2]
SIZES = ((1024, 512), (2048, 512), (4096, 1024), (8192, 512))  # a lat-long's width, a cube's face
# Name: extension, oiiotool's type, envconv's, compression of both.
FORMATS = {
    "exr-zip-half": ("exr", "half", "half", "zip"),
    "exr-zip-float": ("exr", "float", "float", "zip"),
    "exr-zips-half": ("exr", "half", "half", "zips"),
    "exr-zips-float": ("exr", "float", "float", "zips"),
    "exr-none-half": ("exr", "half", "half", "none"),
    "exr-none-float": ("exr", "float", "float", "none"),
    "exr-piz-half": ("exr", "half", "half", "piz"),
    "exr-piz-float": ("exr", "float", "float", "piz"),
    "exr-dwaa-half": ("exr", "half", "half", "dwaa"),
    "exr-dwaa-float": ("exr", "float", "float", "dwaa"),
    "hdr": ("hdr", "float", "float", None),
    "png-8": ("png", "uint8", "uint8", None),
    "png-16": ("png", "uint16", "uint16", None),
    "tif-none-float": ("tif", "float", "float", "none"),
    "tif-zip-float": ("tif", "float", "float", "zip"),
    "tif-lzw-float": ("tif", "float", "float", "lzw"),
    "tif-zip-16": ("tif", "uint16", "uint16", "zip"),
    "tif-none-8": ("tif", "uint8", "uint8", "none"),
    "tif-zip-8": ("tif", "uint8", "uint8", "zip"),
    "tif-lzw-8": ("tif", "uint8", "uint8", "lzw"),
    "jpg": ("jpg", "uint8", "uint8", "jpeg:95"),
}
PR_SET_CHILD_SUBREAPER = 36


def run(command):
    """Wall and processor time in seconds of a command and of all processes that it leaves behind."""
    before, start = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
    wall = time.perf_counter() - start
    try:
        while True:  # orphans, which have become ours
            os.waitpid(-1, 0)
    except ChildProcessError:
        pass
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def make_input(path, panorama, width, kind, compression):
    """A photograph at that size, with a sensor's noise: without it, files of enlarged pictures are too small."""
    options = ["--compression", compression] if compression else []
    top = ["--clamp:min=0:max=1"] if kind.startswith("uint") else []
    subprocess.run(["oiiotool", panorama, "--resize:filter=lanczos3", f"{width}x{width // 2}",
                    "--noise:type=gaussian:mean=0:stddev=0.01", "--clamp:min=0", *top, "-d", kind, *options, "-o", path],
                   check=True)


def copy_command(source, target, width, face, kind, compression):
    columns, rows = 3 * face, 2 * face
    wide, high = -(-columns // width), -(-rows // (width // 2))
    copies = ["--dup"] * (wide * high - 1)
    mosaic = [*copies, "--mosaic", f"{wide}x{high}"] if copies else []
    options = ["--compression", compression] if compression else []
    return ["oiiotool", source, *mosaic, "--cut", f"{columns}x{rows}", "-d", kind, *options, "-o", target]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("formats", nargs="*", metavar="FORMAT", help=" ".join(FORMATS))
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--filter", default="auto")
    parser.add_argument("--panorama", default=SOURCE / "testdata/panoramas/venice.hdr")
    parser.add_argument("--widths", type=int, nargs="*", default=[width for width, _ in SIZES])
    parser.add_argument("--folder", default="/dev/shm" if os.path.isdir("/dev/shm") else None)
    options = parser.parse_args()
    ctypes.CDLL(None, use_errno=True).prctl(PR_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    print(f"| {options.filter}: input, cube | format | envconv s | oiiotool s | wall ratio | processor ratio | size ratio |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory(dir=options.folder) as folder:
        for width, face in SIZES:
            if width not in options.widths:
                continue
            for name in options.formats or FORMATS:
                extension, kind, ours_kind, compression = FORMATS[name]
                source, ours, theirs = (f"{folder}/{part}.{extension}" for part in ("in", "ours", "theirs"))
                make_input(source, options.panorama, width, kind, compression)
                packed = ["--compression", compression] if compression else []
                convert = [BINARY, "convert", source, "-o", ours, "--size", str(face), "--type", ours_kind, "-q",
                           "--filter", options.filter, *packed]
                if extension == "hdr":
                    convert[convert.index("--type"):convert.index("--type") + 2] = []
                copy = copy_command(source, theirs, width, face, kind, compression)
                run(convert), run(copy)
                times = [(*run(convert), *run(copy)) for _ in range(options.runs)]
                wall, their_wall = (statistics.median(t[i] for t in times) for i in (0, 2))
                ratios = [statistics.median(t[i] / t[i + 2] for t in times) for i in (0, 1)]
                size = os.path.getsize(ours) / os.path.getsize(theirs)
                print(f"| {width}x{width // 2}, {face} | {name} | {wall:.2f} | {their_wall:.2f} | {ratios[0]:.2f} | "
                      f"{ratios[1]:.2f} | {size:.2f} |", flush=True)


main()
