# SPDX-License-Identifier: Apache-2.0
"""Memory: what is predicted, what is allowed, and what happens where there is less."""
import errno
import json
import os
import pathlib
import re
import resource
import subprocess
import sys
import tempfile
import time
import unittest

from harness import BINARY, SANITIZED, Case, write_constant, write_directions, write_exr

INJECTOR = os.path.abspath(os.environ["ENVCONV_INJECTOR"])
MB = 1000 * 1000


def with_limit(kind, bytes_allowed):
    return lambda: resource.setrlimit(kind, (bytes_allowed, bytes_allowed))


class Memory(Case):
    def predicted(self, *words):
        return self.json("convert", *words, "--dry-run")["peak_memory"]

    def measured(self, *words):
        """The most memory of the process as the system counts it: its own, and not that of the decoder."""
        # A process begins with the peak of the one that started it: let that be a small one.
        measure = ("import resource, subprocess, sys; done = subprocess.run(sys.argv[1:]).returncode; "
                   "print(done, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)")
        out = subprocess.run([sys.executable, "-S", "-c", measure, BINARY, "convert", *map(str, words), "-q"],
                             cwd=self.folder, capture_output=True, check=True, close_fds=False).stdout
        status, kilobytes = map(int, out.split())
        self.assertEqual(status, 0, words)
        return kilobytes * 1024

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_the_prediction_is_within_a_fifth(self):
        self.make_large("in.exr", 512)
        self.run_tool("convert", "in.exr", "-o", "in.png", "--to", "latlong", "-q")
        self.run_tool("convert", "in.exr", "-o", "cube.exr", "-q")
        for words in (
            ("in.exr", "-o", "a.exr"), ("in.exr", "-o", "b.exr", "--size", 700), ("in.exr", "-o", "c.png"),
            ("in.exr", "-o", "d.exr", "--to", "latlong"), ("in.exr", "-o", "e.hdr", "--filter", "nearest"),
            ("in.png", "-o", "f.exr", "--size", 64), ("cube.exr", "-o", "g.exr", "--to", "octahedral"),
            ("in.exr", "-o", "h_{face}.tif", "--size", 600), ("in.exr", "-o", "i.exr", "--size", 600, "--verify"),
        ):
            self.check_prediction(self.predicted(*words), self.measured(*words), words)

    def check_prediction(self, predicted, measured, words):
        # The program's own pages count as far as the system has mapped them: a few megabytes either way.
        self.assertLess(abs(predicted - measured), max(0.2 * measured, 12 * MB), (words, predicted, measured))

    def make_large(self, name, height):
        write_exr(self.path("small.exr"), 32, 16, lambda x, y: (x / 32, y / 16, 0.5))
        self.run_tool("convert", "small.exr", "-o", name, "--to", "latlong", "--size", height, "--type", "float",
                      "--filter", "nearest")

    def test_what_would_not_fit_is_refused_before_the_pixels(self):
        # A header that is right, and no pixels at all: they are not missed.
        write_constant(self.path("in.exr"), 1, 512, 256)
        data = self.path("in.exr").read_bytes()
        self.path("cut.exr").write_bytes(data[: len(data) // 2])
        for words in (("cut.exr", "-o", "out.exr", "--size", 2000), ("in.exr", "-o", "out.exr", "--size", 2000)):
            self.run_tool("convert", *words, "--memory", "60M", expect=6)
            self.says(words[0] + ": needs about", "60 MB are allowed", "--memory", "--size")
            self.run_tool("convert", *words, "--memory", "60M", "--dry-run", expect=6).says("needs about")
        self.assertEqual(self.files(), ["cut.exr", "in.exr"])
        needed = self.predicted("in.exr", "-o", "out.exr", "--size", 500)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--size", 500, "--memory", needed).is_silent()
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--size", 500, "--memory", needed - 1, expect=6)

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_what_does_not_fit_is_kept_on_disk(self):
        self.make_large("in.exr", 700)
        for name, size, more in (
            ("out.exr", 1400, ("--type", "half", "--compression", "none")), ("out.ktx2", 1400, ("--type", "float")),
            ("out.exr", 1400, ("--mips", "--packing", "parts", "--compression", "none")),
            ("out.hdr", 3200, ("--to", "octahedral", "--verify")),
        ):
            words = ("in.exr", "-o", name, "--size", size, "--filter", "nearest", "-j", 2, *more)
            self.run_tool("convert", *words)
            whole = self.path(name).read_bytes()
            self.path(name).unlink()
            allowed = 130 * MB
            words += ("--memory", allowed)
            plan = self.json("convert", *words, "--dry-run")
            self.assertGreater(plan["scratch"], 0, words)
            peak = self.measured(*words)
            self.assertTrue(self.path(name).read_bytes() == whole, words)
            self.path(name).unlink()
            self.assertLess(peak, allowed, words)
            self.check_prediction(plan["peak_memory"], peak, words)
        self.assertEqual(self.files(), ["in.exr", "small.exr"])

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_columns_of_a_panorama_count_too(self):
        # Texels at its sides lie in every row: all of its 216 MB are touched where they are read.
        self.make_large("in.exr", 3000)
        for words in (("in.exr", "-o", "out.exr", "--size", 400), ("in.exr", "-o", "out.exr", "--rotate", "40,50,60",
                      "--to", "octahedral", "--size", 600)):
            needed = int(re.search(r"about (\d+) MB", self.run_tool("convert", *words, "--memory", "1M", expect=6).err)[1])
            words += ("--memory", (needed + 2) * MB)
            self.assertGreater(self.json("convert", *words, "--dry-run")["scratch"], 0, words)
            self.assertLess(self.measured(*words), (needed + 2) * MB, words)

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_no_layout_of_a_source_takes_more_than_predicted(self):
        write_directions(self.path("small.exr"))
        layouts = [layout["name"] for layout in self.json("layouts")["layouts"]]
        self.assertGreater(len(layouts), 20)
        for layout in layouts:
            self.run_tool("convert", "small.exr", "-o", "in.exr", "--to", layout, "--texels", "1M", "--type", "float",
                          "--compression", "none", "--filter", "nearest", "-q")
            words = ("in.exr", "-o", "out.exr", "--rotate", "40,50,60", "--size", 64, "-j", 2)
            predicted, measured = self.predicted(*words), self.measured(*words)
            self.assertLess(measured, predicted + 4 * MB, layout)
            # The working memory of so small an output is at most a third of all.
            self.assertLess(predicted, 1.5 * measured, layout)

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_texels_far_from_each_other_count_by_their_pages(self):
        # About the point behind a mirror ball, each sample of a row lies in other pages.
        write_directions(self.path("small.exr"))
        self.run_tool("convert", "small.exr", "-o", "in.exr", "--to", "mirror-ball", "--texels", "16M", "--type", "float",
                      "--compression", "none", "--filter", "nearest", "-q")
        for options in (("--to", "octahedral", "--size", 600, "--filter", "bilinear"), ("--to", "latlong", "--size", 500)):
            words = ("in.exr", "-o", "out.exr", "--rotate", "40,50,60", "--compression", "none", "-j", 2, *options)
            self.run_tool("convert", *words)
            whole = self.path("out.exr").read_bytes()
            words += ("--memory", 175 * MB)
            self.assertGreater(self.json("convert", *words, "--dry-run")["scratch"], 0)
            self.assertLess(self.measured(*words), 175 * MB, options)
            self.assertTrue(self.path("out.exr").read_bytes() == whole, options)

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_in_a_batch_too(self):
        self.make_large("b.exr", 2048)
        names = ["a.exr", "b.exr", "c.exr"]
        for name in ("a.exr", "c.exr"):
            write_constant(self.path(name))
        self.path("out").mkdir()
        words = (*names, "-o", "out/", "--to", "octahedral", "--filter", "nearest", "-j", 2, "--memory", 140 * MB)
        plans = self.run_tool("convert", *words, "--dry-run", "--json").out.splitlines()
        self.assertEqual([json.loads(plan)["scratch"] > 0 for plan in plans], [False, True, False])
        self.assertLess(self.measured(*words), 140 * MB)
        self.assertEqual(sorted(os.listdir(self.path("out"))), names)

    @unittest.skipIf(SANITIZED, "a sanitizer wants to be loaded first")
    def test_a_disk_without_room_for_it(self):
        write_constant(self.path("in.exr"), 1, 512, 256)
        self.path("out.exr").write_bytes(b"old")
        words = ("convert", "in.exr", "-o", "out.exr", "--size", 2000, "--memory", 130 * MB, "--filter", "nearest")
        # The source's, a face's and the packed image's.
        for n, size in ((1, 2), (2, 49), (8, 289)):
            self.run_tool(*words, expect=4, env={**os.environ, "LD_PRELOAD": INJECTOR,
                                                 "ENVCONV_INJECT": f"allocate:{n}:{errno.ENOSPC}"})
            self.says("out.exr: " + os.strerror(errno.ENOSPC), f"for {size} MB of scratch storage in .")
            self.assertEqual(self.path("out.exr").read_bytes(), b"old")
            self.assertEqual(self.files(), ["in.exr", "out.exr"])
        # A limit on the size of files is one as well.
        self.run_tool(*words, expect=4, preexec_fn=with_limit(resource.RLIMIT_FSIZE, 20 * MB))
        self.says("out.exr: " + os.strerror(errno.EFBIG))
        self.assertEqual(self.files(), ["in.exr", "out.exr"])

    def test_killed_while_it_is_in_use(self):
        write_constant(self.path("in.exr"), 1, 512, 256)
        words = [BINARY, "convert", "in.exr", "-o", "out.exr", "--size", "2000", "--memory", "130M", "--compression",
                 "none", "--filter", "nearest"]
        tool = subprocess.Popen(words, cwd=self.folder)
        mapped = self.folder.name.encode()
        while tool.poll() is None and mapped not in pathlib.Path(f"/proc/{tool.pid}/maps").read_bytes():
            time.sleep(0.001)
        self.assertIsNone(tool.poll())
        tool.kill()
        tool.wait()
        for name in self.files():
            self.assertTrue(name == "in.exr" or re.fullmatch(r"\.envconv-\d+-[0-9a-f]{12}\.tmp", name), name)
        self.run_tool(*words[1:])
        self.assertEqual(self.files(), ["in.exr", "out.exr"])

    def test_a_folder_in_memory_is_no_place_for_it(self):
        if not os.access("/dev/shm", os.W_OK):
            self.fail("no /dev/shm")
        write_constant(self.path("in.exr"), 1, 512, 256)
        with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
            words = ("in.exr", "-o", folder + "/out.exr", "--size", 2000, "--memory", 130 * MB, "--dry-run")
            self.run_tool("convert", *words, env={**os.environ, "TMPDIR": str(self.folder)})
            self.assertIn(f"of scratch storage in {self.folder}", self.out)
            self.run_tool("convert", *words, env={**os.environ, "TMPDIR": folder})
            self.assertIn("of scratch storage in /var/tmp", self.out)

    def test_in_a_batch_only_the_large_one_fails(self):
        write_constant(self.path("a.exr"))
        write_constant(self.path("b.exr"), 1, 1024, 512)
        write_constant(self.path("c.exr"))
        self.path("out").mkdir()
        self.run_tool("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "--memory", "25M", "--keep-going", "--json",
                      expect=7).says("b.exr: needs about")
        self.assertEqual([f for f in self.files() if f.startswith("out/")], ["out/a.exr", "out/c.exr"])
        self.assertEqual([json.loads(line).get("status") for line in self.out.splitlines()[:3]], [None, 6, None])

    @unittest.skipIf(SANITIZED, "a sanitizer takes memory of its own")
    def test_a_batch_keeps_within_it(self):
        self.make_large("0.exr", 384)
        names = ["0.exr"]
        for i in range(1, 6):
            os.link(self.path("0.exr"), self.path(f"{i}.exr"))
            names.append(f"{i}.exr")
        self.path("out").mkdir()
        one = self.predicted("0.exr", "-o", "out/", "--size", 450, "-j", 4)
        peak = {}
        for room in (1, 4):
            peak[room] = self.measured(*names, "-o", "out/", "--size", 450, "-j", 4, "--memory", one * room)
            self.assertLess(peak[room], 1.2 * one * room)
        # And uses what it may, else the memory was no reason for anything.
        self.assertGreater(peak[4], 1.5 * peak[1])

    @unittest.skipIf(SANITIZED, "a sanitizer's shadow needs the address space")
    def test_a_limit_on_the_address_space(self):
        write_constant(self.path("in.exr"), 1, 512, 256)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--size", 3000, expect=6,
                      preexec_fn=with_limit(resource.RLIMIT_AS, 1000 * MB))
        self.says("in.exr: needs about", "of memory")
        # Told that there is more than there is, it finds out, and still says how much was needed.
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--size", 3000, "--memory", "8G", expect=6,
                      preexec_fn=with_limit(resource.RLIMIT_AS, 1000 * MB))
        self.says("in.exr: ", "not enough memory", "MB are needed")
        self.assertEqual(self.files(), ["in.exr"])
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--size", 100,
                      preexec_fn=with_limit(resource.RLIMIT_AS, 1000 * MB)).is_silent()

    def test_a_small_stack_is_enough(self):
        write_constant(self.path("in.exr"), 1, 512, 256)
        size = 1024 * 1024 if SANITIZED else 256 * 1024  # a sanitizer needs some itself
        for kind in ("exr", "hdr", "png", "tif", "jpg"):
            for source, output in (("in.exr", f"out.{kind}"), (f"out.{kind}", "back.exr")):
                self.run_tool("convert", source, "-o", output, "-q", preexec_fn=with_limit(resource.RLIMIT_STACK, size))

    def test_sizes_as_words(self):
        write_constant(self.path("in.exr"))
        for size in ("0", "-1", "1.5G", "4GiB", "x", ""):
            self.run_tool("convert", "in.exr", "-o", "out.exr", f"--memory={size}", expect=2)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--memory", "1G").is_silent()


if __name__ == "__main__":
    unittest.main()
