# SPDX-License-Identifier: Apache-2.0
"""Hostile files through convert and info: no crash, no hang, no silent success, nothing left behind."""
import json
import os
import pathlib
import shutil
import subprocess
import tempfile
import time
import unittest

import corpus
from harness import BINARY, SANITIZED


class Corpus(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = pathlib.Path(tempfile.mkdtemp(prefix="envconv-corpus-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder)
        cls.names = corpus.write_corpus(cls.folder)
        all_names = sorted(n for names in cls.names.values() for n in names)
        assert len(all_names) >= 300, len(all_names)
        (cls.folder / "out").mkdir()
        start = time.monotonic()
        # One process for all: if it dies, or hangs, every test fails.
        cls.done = subprocess.run(
            [BINARY, "convert", "--files-from", "-", "-o", "out/{index}_{stem}.exr", "--from", "latlong", "--size", "8",
             "--max-pixels", "4M", "--memory", "1G", "--keep-going", "--json", "-j", "4"],
            cwd=cls.folder, input="\n".join(all_names).encode(), capture_output=True, timeout=600)
        cls.seconds = time.monotonic() - start
        reports = [json.loads(line) for line in cls.done.stdout.splitlines()]
        cls.reports = {r["input"]: r for r in reports[:-1]}
        cls.all_names = all_names

    def test_the_batch_goes_on(self):
        self.assertEqual(self.done.returncode, 7, self.done.stderr[-2000:])
        self.assertEqual(sorted(self.reports), self.all_names)
        for name, report in self.reports.items():
            self.assertIn(report.get("status"), (None, 3, 5, 6), (name, report["error"]))
            self.assertLess(report["seconds"], 300 if SANITIZED else 60, name)
            if report["error"]:
                self.assertIn(name, report["error"])
        for line in self.done.stderr.splitlines():
            self.assertTrue(line.startswith(b"envconv: "), line)
            self.assertFalse(any(byte < 0x20 or byte == 0x7F for byte in line), line)

    def test_nothing_is_left_and_what_succeeded_is_whole(self):
        written = {os.path.basename(r["output"]) for r in self.reports.values() if r["error"] is None}
        self.assertEqual(set(os.listdir(self.folder / "out")), written)
        self.assertEqual(sorted(n for n in os.listdir(self.folder) if n != "out"), self.all_names)

    def refused(self, kind):
        for name in self.names[kind]:
            self.assertIsNotNone(self.reports[name]["error"], f"{name} was converted")

    def test_truncated(self):
        self.refused("truncated")

    def test_claims(self):
        self.refused("claims")

    def test_empty(self):
        self.refused("empty")
        for name in self.names["empty"]:
            self.assertEqual(self.reports[name]["status"], 3, name)
            # Of other formats the libraries find something else to be wrong first.
            if name.endswith((".hdr", ".dds", ".ppm", ".pfm", ".tga")):
                wanted = "an empty file" if "no-bytes" in name else "an empty image"
                self.assertIn(wanted, self.reports[name]["error"], name)

    def test_bombs(self):
        self.refused("bombs")
        for name in self.names["bombs"]:
            too_dense = "ratio" in name
            self.assertEqual(self.reports[name]["status"], 3 if too_dense else 6, name)
            self.assertIn("MB of pixels in a file of" if too_dense else "--max-pixels", self.reports[name]["error"])

    def test_late(self):
        self.refused("late")

    def test_metadata(self):
        # Some of them kill the codec, which is why it has a process of its own: that is an error like others.
        for name in self.names["metadata"]:
            self.assertIn(self.reports[name].get("status"), (None, 3, 6), name)

    def test_memory_is_not_given_to_claims(self):
        summary = json.loads(self.done.stdout.splitlines()[-1])["summary"]
        if not SANITIZED:
            self.assertLess(summary["peak_memory"], 300e6)

    def test_the_same_files_fail_whatever_memory_held(self):
        # Stale memory would show: what is allocated is filled with something else in each run.
        names = [n for n in self.all_names if self.reports[n]["error"] is None]
        self.assertTrue(names)
        again = self.folder / "again"
        again.mkdir()
        self.addCleanup(shutil.rmtree, again)
        subprocess.run([BINARY, "convert", "--files-from", "-", "-o", "again/{stem}_{ext}.exr", "--from", "latlong", "--size", "8",
                        "--keep-going", "-q"], cwd=self.folder, input="\n".join(names).encode(), check=True,
                       capture_output=True, env={**os.environ, "MALLOC_PERTURB_": "165"}, timeout=600)
        for name in names:
            first = (self.folder / self.reports[name]["output"]).read_bytes()
            self.assertEqual((again / (name.replace(".", "_") + ".exr")).read_bytes(), first, name)

    def test_info(self):
        done = subprocess.run([BINARY, "info", "--json", "--max-pixels", "4M", *self.all_names], cwd=self.folder,
                              capture_output=True, timeout=600)
        self.assertIn(done.returncode, (0, 3, 6))
        for line in done.stderr.splitlines():
            self.assertTrue(line.startswith(b"envconv: "), line)


if __name__ == "__main__":
    unittest.main()
