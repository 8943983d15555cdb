# SPDX-License-Identifier: Apache-2.0
"""How well a batch overlaps its stages: wall time of all cores against the sums of the stages on one core.

    ENVCONV=build/envconv python3 tests/bench/batch_bench.py [PANORAMA [FILES [OPTION...]]]

Not a test: other work on the machine changes the figures, though less the ratio, since both runs suffer from it.
"""
import json
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

BINARY = os.path.abspath(os.environ["ENVCONV"])
SOURCE = pathlib.Path(__file__).resolve().parents[2]


def run(folder, names, threads, options):
    out = subprocess.run([BINARY, "convert", *names, "-o", "out/", "--json", "-q", "-j", str(threads), *options],
                         cwd=folder, check=True, capture_output=True).stdout
    *files, last = map(json.loads, out.splitlines())
    sums = {stage: sum(f["stages"][stage] for f in files) for stage in ("read", "resample", "write")}
    return last["summary"]["seconds"], sums


def main():
    panorama = sys.argv[1] if len(sys.argv) > 1 else SOURCE / "testdata" / "panoramas" / "city.exr"
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 40
    cores = os.cpu_count()
    with tempfile.TemporaryDirectory() as folder:
        os.mkdir(f"{folder}/out")
        names = [f"{i}{pathlib.Path(panorama).suffix}" for i in range(count)]
        for name in names:
            shutil.copy(panorama, f"{folder}/{name}")
        alone, sums = run(folder, names, 1, sys.argv[3:])
        together, _ = run(folder, names, cores, sys.argv[3:])
    files, pixels = sums["read"] + sums["write"], sums["resample"]
    print(f"{count} files: decoding and encoding {files:.2f} s, resampling {pixels:.2f} s, one after another {alone:.2f} s")
    print(f"on {cores} cores {together:.2f} s, {together / max(files, pixels):.2f} of the larger")


main()
