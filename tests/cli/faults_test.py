# SPDX-License-Identifier: Apache-2.0
"""Faults injected one by one, and a list of forty things that go wrong in the world with the tests of each."""
import errno
import importlib
import json
import os
import re
import shutil
import signal
import struct
import subprocess
import unittest

from harness import (BINARY, PANORAMAS, SANITIZED, SOURCE, Case, comma_locale, read_exr, write_constant, write_exr,
                     write_png)

INJECTOR = os.path.abspath(os.environ["ENVCONV_INJECTOR"])

# Tests are MODULE.CLASS.TEST of this folder, or PROGRAM:SUITE.TEST of the C++ tests.
SCENARIOS = {
    1: ("truncated", ["corpus_test.Corpus.test_truncated", "damage_test.Damage.test_exr_cut_anywhere",
                      "io_damage_test:Io.TruncatedFilesAreErrors"]),
    2: ("huge claims", ["corpus_test.Corpus.test_claims", "io_damage_test:Io.HugeClaimsAreRefusedAtOnce"]),
    3: ("bombs", ["corpus_test.Corpus.test_bombs", "convert_test.Failures.test_too_many_pixels"]),
    4: ("no pixels", ["corpus_test.Corpus.test_empty"]),
    5: ("NaN and infinity", ["convert_test.Nonfinite.test_error", "convert_test.Nonfinite.test_zero_and_clamp",
                             "convert_test.Nonfinite.test_repair_is_the_default_and_counts",
                             "convert_test.Nonfinite.test_of_every_face"]),
    6: ("negative values", ["faults_test.Values.test_negative_values"]),
    7: ("what half and RGBE cannot hold", ["faults_test.Values.test_extremes", "convert_test.Formats.test_half_overflow_is_counted"]),
    8: ("wrong aspect", ["convert_test.Failures.test_not_what_it_was_said_to_be",
                         "convert_test.Failures.test_ambiguity_lists_the_candidates"]),
    9: ("envmap contradicts", ["faults_test.Values.test_envmap_that_cannot_be"]),
    10: ("channels", ["exr_kinds_test:Io.ExrChannels"]),
    11: ("deep", ["exr_kinds_test:Io.ExrKindsThatAreRefused"]),
    12: ("parts", ["io_test:Io.MultiPartKeepsNamesAndSizes", "convert_test.Pixels.test_parts",
                   "convert_test.Pixels.test_parts_have_the_order_of_their_names",
                   "convert_test.Formats.test_parts_that_are_not_faces"]),
    13: ("windows", ["exr_kinds_test:Io.ExrWindows"]),
    14: ("luma and chroma", ["exr_kinds_test:Io.ExrKindsThatAreRefused"]),
    15: ("disk full", ["faults_test.Disks.test_every_format", "faults_test.Disks.test_every_write",
                       "faults_test.Disks.test_a_disk_that_stays_full_ends_the_batch",
                       "faults_test.Disks.test_only_disks_that_stay_full_end_it",
                       "io_output_test:IoOutput.AFullDiskLeavesTheOldContent", "memory_test.Memory.test_a_disk_without_room_for_it"]),
    16: ("folder missing or read-only", ["convert_test.Failures.test_output_folder_missing_or_odd",
                                         "faults_test.Disks.test_a_read_only_folder"]),
    17: ("output is input", ["convert_test.Failures.test_output_is_the_input"]),
    18: ("odd outputs", ["faults_test.Files.test_outputs_that_are_no_files", "io_output_test:IoOutput.OutputsThatAreNotFiles"]),
    19: ("odd inputs", ["convert_test.Failures.test_not_a_regular_file", "convert_test.Streams.test_standard_input",
                        "io_damage_test:Io.WhatIsNotAPictureIsNamed"]),
    20: ("interrupts", ["signals_test.Signals.test_interrupted_batches_say_how_far_they_came",
                        "signals_test.Signals.test_at_any_point", "signals_test.Signals.test_a_second_signal_ends_it_at_once"]),
    21: ("sudden death", ["signals_test.Signals.test_killed_twenty_times_and_resumed"]),
    22: ("memory limits", ["memory_test.Memory.test_a_limit_on_the_address_space",
                           "memory_test.Memory.test_what_would_not_fit_is_refused_before_the_pixels",
                           "memory_test.Memory.test_what_does_not_fit_is_kept_on_disk"]),
    23: ("allocations fail", ["faults_test.Allocations.test_any_allocation_may_fail",
                              "faults_test.Allocations.test_codecs_without_memory"]),
    24: ("calls fail", ["faults_test.Disks.test_every_format", "faults_test.Disks.test_reads_that_fail"]),
    25: ("closed pipe", ["convert_test.Streams.test_a_reader_that_goes_away", "faults_test.Files.test_info_into_a_closed_pipe"]),
    26: ("/dev/full", ["convert_test.Streams.test_full_disk_behind_stdout"]),
    27: ("one bad file of many", ["faults_test.Files.test_one_bad_file_of_many",
                                  "faults_test.Files.test_folders_that_vanish_under_a_batch"]),
    28: ("one output for two", ["batch_test.Batch.test_collisions_are_found_before_any_work",
                                "batch_test.Batch.test_names_that_differ_in_case_only_are_two_here",
                                "faults_test.Disks.test_a_disk_that_folds_names"]),
    29: ("two batches", ["signals_test.Signals.test_batches_share_a_folder",
                         "signals_test.Signals.test_temporaries_of_the_dead_are_removed_and_of_the_living_kept"]),
    30: ("resuming", ["batch_test.Batch.test_skip_existing", "batch_test.Batch.test_skipping_looks_at_age_and_kind"]),
    31: ("comma locale", ["convert_test.Streams.test_comma_locale", "faults_test.Files.test_a_locale_changes_no_byte"]),
    32: ("names", ["faults_test.Files.test_names", "convert_test.Streams.test_names_are_taken_literally"]),
    33: ("paths out of templates", ["batch_test.Batch.test_stems_that_would_leave_the_folder"]),
    34: ("odd sizes", ["usage_test.Usage.test_sizes_out_of_range_name_the_limit"]),
    35: ("broken OpenColorIO configuration", ["faults_test.Files.test_a_broken_color_configuration",
                                             "color_test.Names.test_broken_configurations"]),
    36: ("metadata attacks", ["corpus_test.Corpus.test_metadata", "io_damage_test:Io.AReaderThatDiesIsAnError",
                              "faults_test.Files.test_what_a_file_says_stays_there"]),
    37: ("not an image", ["io_damage_test:Io.WhatIsNotAPictureIsNamed", "convert_test.Failures.test_not_an_image"]),
    38: ("late errors", ["corpus_test.Corpus.test_late", "damage_test.Damage.test_png", "damage_test.Damage.test_tiff",
                         "damage_test.Damage.test_tiff_of_streams_without_checksums",
                         "damage_test.Damage.test_rows_behind_the_last"]),
    39: ("verification", ["faults_test.Disks.test_verification", "io_output_test:IoOutput.VerificationFindsDamage"]),
    40: ("stack", ["memory_test.Memory.test_a_small_stack_is_enough"]),
}


def formats():
    """Extensions of all formats that can be written, as the tool lists them."""
    err = subprocess.run([BINARY, "convert", str(PANORAMAS / "city.exr"), "-o", "a.none"], capture_output=True).stderr
    return re.search(rb"can be written: ([a-z0-9 ]+)", err)[1].decode().split()


class Scenarios(Case):
    def test_all_forty_have_tests(self):
        self.assertEqual(sorted(SCENARIOS), list(range(1, 41)))
        for number, (_, tests) in SCENARIOS.items():
            self.assertTrue(tests, number)
            for test in tests:
                if ":" in test:
                    program, name = test.split(":")
                    suite, case = name.split(".")
                    text = (SOURCE / "tests" / f"{program}.cpp").read_text()
                    self.assertRegex(text, rf"TEST(_F|_P)?\({suite}, {case}\)", (number, test))
                else:
                    module, case, name = test.split(".")
                    found = globals() if module == "faults_test" else vars(importlib.import_module(module))
                    self.assertTrue(hasattr(found.get(case), name), (number, test))


class Injected(Case):
    def run_injected(self, order, *words, expect=None, **environment):
        """Exit status and what was said; `expect` is a collection of statuses."""
        env = {**os.environ, "LD_PRELOAD": INJECTOR, "ENVCONV_INJECT": order, "ENVCONV_INJECT_LOG": str(self.path(".log")),
               **environment}
        done = subprocess.run([BINARY, "convert", *map(str, words)], cwd=self.folder, capture_output=True, timeout=60,
                              env=env)
        self.out, self.err = done.stdout.decode(), done.stderr.decode(errors="replace")
        log = self.path(".log")
        self.calls = int(log.read_text() or 0) if log.exists() else 0
        if log.exists():
            log.unlink()
        if expect is not None:
            self.assertIn(done.returncode, expect, (order, words, self.err))
        for line in self.err.splitlines():
            self.assertTrue(line.startswith("envconv: "), (order, words, line))
        return done.returncode


@unittest.skipIf(SANITIZED, "a sanitizer wants to be loaded first")
class Disks(Injected):
    def options_of(self, kind):
        """Ways to write a format: without levels, and with where it has them."""
        plain = ("in.exr", "-o", f"out.{kind}", "--size", 32, "-q")
        yield plain
        done = subprocess.run([BINARY, "convert", *map(str, plain), "--mips", "--dry-run"], cwd=self.folder,
                              capture_output=True)
        if done.returncode == 0:
            yield (*plain, "--mips")

    def check_failed(self, order, words, said, expect=(4,)):
        output = self.path(words[2])
        output.write_bytes(b"old")
        before = self.files()
        self.run_injected(order, *words, expect=expect)
        self.assertIn(words[2] + ": ", self.err, order)
        self.assertIn(said, self.err, order)
        self.assertEqual(output.read_bytes(), b"old", order)
        self.assertEqual(self.files(), before, order)

    def test_every_format(self):
        write_exr(self.path("in.exr"), 32, 16, lambda x, y: (x / 32, y / 16, 0.5))
        full, broken = os.strerror(errno.ENOSPC), os.strerror(errno.EIO)
        for kind in formats():
            if kind == "pgm":
                continue  # one channel; pnm is the same writer
            for words in self.options_of(kind):
                self.run_injected("write:0:0", *words, expect=(0,))
                writes = self.calls
                self.assertGreater(writes, 0, kind)
                self.check_failed(f"write:1:{errno.ENOSPC}:from", words, full)
                self.check_failed(f"write:{writes}:{errno.EIO}", words, broken)
                self.check_failed(f"fsync:1:{errno.ENOSPC}", words, full)
                self.check_failed(f"close:1:{errno.EIO}", words, broken)
                self.check_failed(f"rename:1:{errno.EIO}", words, broken)

    def test_every_write(self):
        # Large enough for many writes of its bands.
        write_exr(self.path("in.exr"), 32, 16, lambda x, y: ((x * 7 + y * 11) % 13, x * y % 17, y))
        for kind, size, *levels in (("exr", 300), ("hdr", 600), ("pfm", 200), ("tif", 300), ("tif", 256, "--mips")):
            words = ("in.exr", "-o", f"out.{kind}", "--size", size, "-q", *levels)
            if kind in ("exr", "tif"):
                words += ("--compression", "none")
            self.run_injected("write:0:0", *words, expect=(0,))
            self.assertGreater(self.calls, 1, kind)
            for n in sorted({1, 2, self.calls // 2, self.calls - 1, self.calls} - {0}):
                self.check_failed(f"write:{n}:{errno.ENOSPC}:from", words, os.strerror(errno.ENOSPC))

    def test_files_of_faces(self):
        write_constant(self.path("in.exr"))
        # The third of six: the two before it are whole and stay.
        self.run_injected(f"rename:3:{errno.ENOSPC}", "in.exr", "-o", "{face}.exr", "--size", 8, expect=(4,))
        self.assertIn("py.exr: ", self.err)
        self.assertEqual(self.files(), ["in.exr", "nx.exr", "px.exr"])

    def test_a_read_only_folder(self):
        # Seen before the input is read, which is damaged.
        self.path("in.exr").write_bytes(b"damaged")
        done = subprocess.run(["unshare", "--mount", "sh", "-c",
                               'mount -t tmpfs -o ro none out && exec "$@"', "sh", BINARY, "convert", "in.exr", "-o",
                               "out/x.exr"], cwd=self.folder, capture_output=True) if self.path("out").mkdir() is None else None
        if b"unshare" in done.stderr or b"mount" in done.stderr:
            # No right to mount; the call that would find out is there in any case.
            write_constant(self.path("in.exr"))
            self.run_injected(f"open:1:{errno.EROFS}", "in.exr", "-o", "out/x.exr", expect=(4,))
            self.assertIn(os.strerror(errno.EROFS), self.err)
            return
        self.assertEqual(done.returncode, 4, done.stderr)
        self.assertIn(b"Read-only file system", done.stderr)

    def test_a_disk_that_stays_full_ends_the_batch(self):
        self.path("out").mkdir()
        names = [f"{i}.exr" for i in range(8)]
        for name in names:
            write_constant(self.path(name))
        self.run_injected(f"write:1:{errno.ENOSPC}:from", *names, "-o", "out/", "--size", 4, "--keep-going", "--json",
                          "-j", 1, expect=(7,))
        summary = json.loads(self.out.splitlines()[-1])["summary"]
        self.assertEqual((summary["failed"], summary["not_done"]), (3, 5))
        self.assertIn("the disk is full", self.err)
        # One that is full now and then is none.
        self.run_injected(f"fsync:2:{errno.ENOSPC}", *names, "-o", "out/", "--size", 4, "--keep-going", "--json", expect=(7,))
        summary = json.loads(self.out.splitlines()[-1])["summary"]
        self.assertEqual((summary["failed"], summary["converted"]), (1, 7))

    def test_only_disks_that_stay_full_end_it(self):
        self.path("out").mkdir()
        names = [f"{i}.exr" for i in range(8)]
        for name in names:
            write_constant(self.path(name))
        convert = (*names, "-o", "out/", "--size", 4, "--keep-going", "--json", "-j", 1)

        def check(failed, converted):
            summary = json.loads(self.out.splitlines()[-1])["summary"]
            self.assertEqual((summary["failed"], summary["converted"], summary["not_done"]), (failed, converted, 0))
            self.assertNotIn("the disk is full", self.err)

        # Every third finds room; then another fault every time; then a fault of another kind in between.
        self.run_injected(f"rename:1:{errno.ENOSPC}:but3", *convert, expect=(7,))
        check(6, 2)
        self.run_injected(f"rename:1:{errno.EIO}:from", *convert, expect=(7,))
        check(8, 0)
        for name in ("2.exr", "5.exr"):
            self.path(name).write_bytes(b"damaged")
        self.run_injected(f"rename:1:{errno.ENOSPC}:from", *convert, expect=(7,))
        check(8, 0)

    def test_a_disk_that_folds_names(self):
        for folder in ("in", "out"):
            self.path(folder).mkdir()
        for name in ("a.exr", "A.exr", "b.exr"):
            write_constant(self.path("in/" + name))
        folds = {"ENVCONV_INJECT_FOLDS": "1"}
        self.run_injected("none:0:0", "in/a.exr", "in/A.exr", "-o", "out/", "--size", 4, expect=(2,), **folds)
        for part in ("in/a.exr", "in/A.exr", "twice"):
            self.assertIn(part, self.err)
        self.assertEqual(os.listdir(self.path("out")), [])
        self.run_injected("none:0:0", "in/a.exr", "in/b.exr", "-o", "out/", "--size", 4, expect=(0,), **folds)

    def test_reads_that_fail(self):
        # Several buffers of each.  What is not compressed would pass for pixels, whatever it is.
        write_exr(self.path("in.exr"), 256, 128, lambda x, y: (x % 13 / 13, (x * 7 + y) % 31 / 31, (y + 1) / 128))
        for kind, *words in (("exr",), ("exr", "--compression", "none"), ("exr", "--compression", "b44"), ("hdr",),
                             ("png",), ("tif",), ("tif", "--compression", "none"), ("jpg",), ("pfm",), ("dds",)):
            self.run_tool("convert", "in.exr", "-o", f"x.{kind}", "--to", "latlong", "-q", *words)
            self.run_tool("convert", f"x.{kind}", "-o", "good.exr", "--to", "latlong", "-q")
            good = self.path("good.exr").read_bytes()
            for n in (*range(1, 9), 12, 20, 40):
                for rest in ("", ":from"):
                    if self.path("out.exr").exists():
                        self.path("out.exr").unlink()
                    status = self.run_injected(f"read:{n}:{errno.EIO}{rest}", f"x.{kind}", "-o", "out.exr", "--to",
                                               "latlong", "-q", expect=(0, 3))
                    # Either right or refused, never something else.
                    self.assertEqual(self.path("out.exr").exists(), status == 0)
                    if status == 0:
                        self.assertTrue(self.path("out.exr").read_bytes() == good, (kind, words, n, rest))
                    else:
                        self.assertIn(f"x.{kind}: ", self.err)

    def test_verification(self):
        write_exr(self.path("in.exr"), 32, 16, lambda x, y: (x, y, 0.5))
        for kind in ("exr", "hdr", "pfm"):
            words = ("in.exr", "-o", f"out.{kind}", "--size", 64, "-q")
            env = {**os.environ, "ENVCONV_TEST_WRITER": "flip"}
            self.path(f"out.{kind}").write_bytes(b"old")
            self.run_tool("convert", *words, "--verify", expect=4, env=env).says(f"out.{kind}: ", "read back")
            self.assertEqual(self.path(f"out.{kind}").read_bytes(), b"old")
            self.assertEqual(len([f for f in self.files() if f.startswith(".")]), 0)


@unittest.skipIf(SANITIZED, "a sanitizer wants to be loaded first")
class Allocations(Injected):
    def pixels(self, name):
        """Of a file whose chunks may be stored as they are: a codec without memory does that."""
        self.run_tool("convert", name, "-o", "plain.exr", "--compression", "none", "-q")
        found = read_exr(self.path("plain.exr"))[2]
        self.path("plain.exr").unlink()
        return found

    def check_allocations(self, words, runs, expect):
        """Fails one allocation, or all from one on, of a conversion to out.exr, so many times spread over it."""
        self.run_injected("malloc:0:0", *words, expect=(0,))
        good, calls = self.pixels("out.exr"), self.calls
        self.assertGreater(calls, 200)
        step = max(1, calls // runs)
        for rest in ("", ":from"):
            for n in range(1 + len(rest), calls, step):
                if self.path("out.exr").exists():
                    self.path("out.exr").unlink()
                status = self.run_injected(f"malloc:{n}:{errno.ENOMEM}{rest}", *words, expect=expect)
                if status == 6:
                    self.assertIn("not enough memory", self.err, (n, rest))
                elif status != 0:
                    self.assertIn(".exr: ", self.err, (n, rest))
                self.assertLessEqual(set(self.files()), {"in.exr", "out.exr", "in.hdr"}, (n, rest, self.err))
                # What failed may have come when the output had its name.
                if status == 0 or self.path("out.exr").exists():
                    self.assertEqual(self.pixels("out.exr"), good, (n, rest))

    def test_any_allocation_may_fail(self):
        write_exr(self.path("in.exr"), 32, 16, lambda x, y: (x, y, 0.5))
        size = ("--size", 16, "-j", 1)
        self.check_allocations(("in.exr", "-o", "out.exr", *size), 40, (0, 6))
        # A view is made by OpenColorIO, some of whose functions may not throw; the reader and levels have their own.
        self.run_tool("convert", "in.exr", "-o", "in.hdr", "--to", "latlong", "-q")
        view = ("--view", "ACES 1.0 - SDR Video", "--mips")
        self.check_allocations(("in.hdr", "-o", "out.exr", *size, *view), 20, (0, 6))

    def test_codecs_without_memory(self):
        # OpenEXR's own compressors take no notice of an allocation that fails, and store rubbish: --verify finds it.
        # What they notice they call an error of the file.
        write_exr(self.path("in.exr"), 32, 16, lambda x, y: (x, y, 0.5))
        words = ("in.exr", "-o", "out.exr", "--size", 16, "-j", 1, "--compression", "piz", "--verify")
        self.check_allocations(words, 20, (0, 4, 6))

    def test_writers_without_memory(self):
        # libtiff says what it had no memory for in words of its own.
        write_exr(self.path("in.exr"), 64, 32, lambda x, y: (x / 64, y / 32, 0.5))
        for name, *words in (("out.png", "--type", "uint16"), ("out.jpg",), ("out.tif", "--compression", "zip"),
                             ("out.tif", "--compression", "lzw")):
            line = ("in.exr", "-o", name, "--size", 64, "-j", 1, *words)
            self.run_injected("malloc:0:0", *line, expect=(0,))
            good, calls = self.path(name).read_bytes(), self.calls
            # Writing comes last.
            for n in range(calls - 60, calls, 2):
                self.path(name).unlink(missing_ok=True)
                status = self.run_injected(f"malloc:{n}:{errno.ENOMEM}", *line, expect=(0, 4, 6))
                if status != 0:
                    self.assertRegex(self.err, r"(not enough|[Oo]ut of|[Nn]o space|writing)", (name, n))
                if status == 0:
                    self.assertEqual(self.path(name).read_bytes(), good, (name, n))


class Values(Case):
    PLAIN = ("--compression", "none", "--type", "float", "--to", "latlong")

    def test_negative_values(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (-1 if x == 3 else 1, 1, 1))
        self.run_tool("convert", "in.exr", "-o", "out.exr", *self.PLAIN).is_silent()
        self.assertEqual(read_exr(self.path("out.exr"))[2]["R"][0][3], -1)
        for kind in ("hdr", "png"):
            self.run_tool("convert", "in.exr", "-o", f"out.{kind}", "--to", "latlong")
            self.says(f"8 values are negative, which", f".{kind} cannot hold: set to 0")
            self.assertEqual(self.json("info", f"out.{kind}")["channels"][0]["min"], 0)

    def test_extremes(self):
        odd = struct.unpack("6f", struct.pack("6f", 1e-42, -0.0, 65504.0, 65519.0, 1e38, 6e-8))
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (odd[x % 6],) * 3)
        self.run_tool("convert", "in.exr", "-o", "out.exr", *self.PLAIN).is_silent()
        row = read_exr(self.path("out.exr"))[2]["G"][2]
        self.assertEqual(struct.pack("6f", *row[:6]), struct.pack("6f", *odd))
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--to", "latlong", "--type", "half", "--compression", "none")
        self.says("too large for half")
        row = read_exr(self.path("out.exr"))[2]["G"][2]
        self.assertEqual((row[2], row[3], row[4]), (65504, 65504, 65504))
        # Radiance's largest is 255 / 256 * 2^127: what is larger does not become 0.
        write_constant(self.path("in.exr"), 3e38)
        self.run_tool("convert", "in.exr", "-o", "out.hdr", "--to", "latlong").says("too large for")
        self.assertGreater(self.json("info", "out.hdr")["channels"][0]["min"], 1.6e38)

    def test_envmap_that_cannot_be(self):
        kinds = {"cube": b"\1", "odd": b"\x4d"}
        for name, value in kinds.items():
            write_exr(self.path(f"{name}.exr"), 16, 8, lambda x, y: (1, 1, 1), attributes={"envmap": ("envmap", value)})
        # 16x8 is no cube: the size wins, and a warning says so.
        self.run_tool("convert", "cube.exr", "-o", "out.exr").says("cube.exr: warning: ")
        # A kind that OpenEXR does not know could be anything.
        self.run_tool("convert", "odd.exr", "-o", "odd.png", expect=3).says("odd.exr: ", "unknown 77", "--from")
        self.assertFalse(self.path("odd.png").exists())
        self.run_tool("convert", "odd.exr", "-o", "odd.png", "--from", "latlong")


class Files(Case):
    def test_outputs_that_are_no_files(self):
        write_constant(self.path("in.exr"))
        self.path("folder").mkdir()
        os.mkfifo(self.path("fifo.exr"))
        self.path("device.exr").symlink_to("/dev/null")
        self.path("nowhere.exr").symlink_to("missing.exr")
        self.path("folder/real.exr").write_bytes(b"old")
        self.path("link.exr").symlink_to("folder/real.exr")
        for name in ("folder", "fifo.exr", "device.exr", "nowhere.exr"):
            self.run_tool("convert", "in.exr", "-o", name, expect=2).says(name)
        # A link to a file is followed, and stays a link.
        self.run_tool("convert", "in.exr", "-o", "link.exr").is_silent()
        self.assertTrue(self.path("link.exr").is_symlink())
        self.assertEqual(self.json("info", "folder/real.exr")["layout"], "cube")

    def test_info_into_a_closed_pipe(self):
        write_constant(self.path("in.exr"))
        read_end, write_end = os.pipe()
        os.close(read_end)
        done = subprocess.run([BINARY, "info", "in.exr"], cwd=self.folder, stdout=write_end, stderr=subprocess.PIPE)
        os.close(write_end)
        self.assertIn(done.returncode, (0, -signal.SIGPIPE))
        self.assertEqual(done.stderr, b"")

    def test_one_bad_file_of_many(self):
        names = [f"{i:03}.exr" for i in range(100)]
        for name in names:
            write_constant(self.path(name), 1, 8, 4)
        data = self.path("050.exr").read_bytes()
        self.path("out").mkdir()
        convert = ("convert", *names, "-o", "out/", "--size", 2, "--keep-going")
        for make_bad in (lambda p: p.write_bytes(data[:-20]), lambda p: p.write_bytes(b""), lambda p: p.unlink()):
            make_bad(self.path("050.exr"))
            self.run_tool(*convert, expect=7).says("050.exr: ", "100 inputs: 99 converted, 0 skipped, 1 failed")
            self.assertTrue(self.err.endswith("1 failed\n"))
            self.assertEqual(len([f for f in self.files() if f.startswith("out/")]), 99)
        # Root reads everything, unless it gives that right up.
        drop = ("setpriv", "--bounding-set=-dac_override,-dac_read_search") if os.geteuid() == 0 else ()
        self.path("050.exr").write_bytes(data)
        self.path("050.exr").chmod(0)
        done = subprocess.run([*drop, BINARY, *map(str, convert), "--json"], cwd=self.folder, capture_output=True)
        self.assertEqual(done.returncode, 7, done.stderr)
        self.assertIn(b"050.exr: ", done.stderr)
        self.assertIn(os.strerror(errno.EACCES).encode(), done.stderr)
        *reports, summary = map(json.loads, done.stdout.splitlines())
        self.assertEqual([r["input"] for r in reports if r["error"]], ["050.exr"])
        self.assertEqual(summary["summary"]["failures"], ["050.exr"])
        # The one that failed is all that the next run does, once it is mended.
        self.path("050.exr").chmod(0o644)
        self.run_tool(*convert, "-n", "-v").says("100 inputs: 1 converted, 99 skipped, 0 failed")

    def test_folders_that_vanish_under_a_batch(self):
        for vanishing, left in (("in", "out"), ("out", "in")):
            for folder in ("in", "out"):
                self.path(folder).mkdir(exist_ok=True)
            names = [f"in/{i:03}.exr" for i in range(60)]
            for name in names:
                write_constant(self.path(name), 1, 128, 64)
            tool = subprocess.Popen([BINARY, "convert", *names, "-o", "out/", "--size", "64", "--keep-going", "--json",
                                     "-j", "1"], cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            first = tool.stdout.readline()
            while self.path(vanishing).exists():  # a file may have come in the meantime
                shutil.rmtree(self.path(vanishing), ignore_errors=True)
            out, err = tool.communicate(timeout=120)
            self.assertEqual(tool.returncode, 7, err)
            *reports, summary = map(json.loads, (first + out).splitlines())
            summary = summary["summary"]
            self.assertEqual(sum(summary[key] for key in ("converted", "failed", "not_done")), 60)
            self.assertGreater(min(summary["converted"], summary["failed"]), 0)
            failed = [r for r in reports if r["error"]]
            self.assertEqual({r["status"] for r in failed}, {3 if vanishing == "in" else 4})
            for r in failed:
                self.assertRegex(r["error"], os.strerror(errno.ENOENT) + "|the folder does not exist")
            # What is left in the other folder is whole, and only that.
            written = {r["output"] for r in reports if not r["error"]} if left == "out" else set(names)
            self.assertEqual({f for f in self.files() if f.startswith(left)}, written)
            for name in sorted(written)[:3]:
                self.json("info", name)
            shutil.rmtree(self.path(left))

    @unittest.skipIf(SANITIZED, "a sanitizer wants to be loaded first")
    def test_a_locale_changes_no_byte(self):
        # The tool in the locale that the environment names, as the library is in a program that sets it.
        comma = {**comma_locale(self.folder), "LD_PRELOAD": INJECTOR, "ENVCONV_INJECT_LOCALE": "1"}
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (x / 7, y / 3, 0.3),
                  attributes={"envconv:rotation": "0.5,1.25,0", "envconv:layout": "latlong"})
        ways = (("out.hdr", "--rotate", "10.5,0,0", "--exposure", "0.5", "--out-colorspace", "ACEScg"), ("out.pfm",),
                ("out.png", "--out-colorspace", "g22_rec709"), ("out.tif", "--type", "float"), ("out.jpg", "--view", "none"),
                ("out.ktx2", "--seam", "average:2"), ("view.png", "--view", "ACES 1.0 - SDR Video"))
        for name, *words in ways:
            seen = set()
            for env in (dict(os.environ), comma):
                self.run_tool("convert", "in.exr", "-o", name, *words, env=env)
                self.run_tool("convert", name, "-o", "back.exr", "--exposure", "-0.25", env=env)
                told = self.run_tool("info", name, "--json", env=env).out
                seen.add((self.path(name).read_bytes(), self.path("back.exr").read_bytes(), told))
            self.assertEqual(len(seen), 1, name)
        # Numbers of the file's header: what pixels were multiplied by, and what they are to be.
        head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=0.5\n\n-Y 4 +X 8\n" + bytes([128, 128, 128, 129]) * 32
        self.path("half.hdr").write_bytes(head)
        self.path("half.pfm").write_bytes(b"PF\n8 4\n-0.5\n" + struct.pack("<f", 0.25) * 96)
        for name, value in (("half.hdr", 2), ("half.pfm", 0.125)):
            for env in (dict(os.environ), comma):
                self.assertEqual(self.json("info", name, env=env)["channels"][0]["max"], value, name)

    def test_names(self):
        odd = [b"a b", b"new\nline", b"hash#", b"%04d", b"*", b"{}", b"{{x}}", b"{stem}", b"?x=1", b"bytes\xff\xfe", b"-o",
               b"\xc3\xbc", b"'", b'"', b"$HOME", b"a" * 251]
        for name in (b"new\nline", b"\x1b[31m", b"\x7f"):
            done = subprocess.run([BINARY, b"convert", name, b"-o", b"out.exr"], cwd=self.folder, capture_output=True)
            self.assertEqual((done.returncode, done.stdout), (3, b""), name)
            # One line, which does nothing to a terminal.
            self.assertRegex(done.stderr, rb"\Aenvconv: [^\x00-\x1f\x7f]+\n\Z", name)
        os.mkdir(self.path("out"))
        for name in odd:
            file = os.path.join(os.fsencode(self.folder), name + b".exr")
            write_constant(os.fsdecode(file), 1, 8, 4)
            done = subprocess.run([BINARY, b"convert", b"-o", b"out/", b"--size", b"2", b"--", name + b".exr"],
                                  cwd=self.folder, capture_output=True)
            self.assertEqual((done.returncode, done.stdout, done.stderr), (0, b"", b""), name)
            os.unlink(file)
        self.assertEqual(sorted(os.listdir(os.fsencode(self.path("out")))), sorted(name + b".exr" for name in odd))
        # Six files, unless there is one of that name.
        write_constant(self.path("{face}.exr"), 1, 8, 4)
        self.run_tool("convert", "{face}.exr", "-o", "one.exr", "--size", 2).is_silent()

    def test_what_a_file_says_stays_there(self):
        secret = "not-to-be-handed-on"
        words = {name: secret for name in ("comments", "owner", "envconv:note", "exif:GPSLatitude")}
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (1, 1, 1), attributes=words)
        chunks = [(b"tEXt", f"{name}\0{secret}".encode()) for name in ("Comment", "Author", "envconv:note")]
        write_png(self.path("in.png"), 16, 8, lambda x, y: (x, y, 9), chunks=chunks)
        for source in ("in.exr", "in.png"):
            for kind in ("exr", "hdr", "png", "tif", "jpg", "tga", "dds", "ktx2", "ktx"):
                self.run_tool("convert", source, "-o", f"out.{kind}", "-q", "--size", 8)
                self.assertNotIn(secret.encode(), self.path(f"out.{kind}").read_bytes(), (source, kind))

    def test_a_broken_color_configuration(self):
        # Refused before anything is read, by whatever way it is named: an input that is damaged is not spoken of.
        self.path("in.exr").write_bytes(b"damaged")
        whole = ("ocio_profile_version: 2\nroles: {default: raw, scene_linear: raw}\ndisplays:\n"
                 "  d: [!<View> {name: v, colorspace: raw}]\ncolorspaces:\n  - !<ColorSpace> {name: raw%s}\n")
        texts = {"yaml": "ocio_profile_version: [", "empty": "", "binary": "\0\1\2" * 99, "page": "<html></html>",
                 "version": whole.replace("2", "99", 1) % "", "deep": "[" * 200000,
                 "no_space": whole.replace("default: raw", "default: none").replace("colorspace: raw", "colorspace: none") % ""}
        for name, text in texts.items():
            self.path(f"{name}.ocio").write_text(text)
        for config in (*(f"{name}.ocio" for name in texts), "no-such-file", "/dev/null", "."):
            for words, env in ((("--ocio-config", config), {}), ((), {"OCIO": config})):
                self.run_tool("convert", "in.exr", "-o", "out.png", *words, expect=2, env={**os.environ, **env})
                self.says(config, "OpenColorIO")
                self.assertNotIn("in.exr", self.err)
                self.assertFalse(self.path("out.png").exists())
        # A table that is not there, or is none, is found when a space that needs it is.
        for source in ("missing.cube", "/etc/passwd"):
            self.path("table.ocio").write_text(
                whole % (", from_scene_reference: !<FileTransform> {src: %s}" % source))
            self.run_tool("convert", "in.exr", "-o", "out.png", "--ocio-config", "table.ocio", "--in-colorspace", "raw",
                          expect=2).says(source.split("/")[-1])


if __name__ == "__main__":
    unittest.main()
