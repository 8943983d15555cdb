# SPDX-License-Identifier: Apache-2.0
"""Signals and sudden death: what is there is whole, what is not is gone, and -n does the rest."""
import json
import os
import random
import re
import signal
import subprocess
import time
import unittest

from harness import BINARY, SANITIZED, Case, write_constant, write_exr

TEMPORARY = re.compile(r"\.envconv-\d+-[0-9a-f]{12}\.tmp")


class Signals(Case):
    def make(self, count, width=32):
        for i in range(count):
            write_exr(self.path(f"{i:03}.exr"), width, width // 2, lambda x, y: (x + i, y * i, 0.5))
        self.path("out").mkdir()
        return [f"{i:03}.exr" for i in range(count)]

    def start(self, *words, **options):
        return subprocess.Popen([BINARY, "convert", *map(str, words)], cwd=self.folder, stdout=subprocess.PIPE,
                                stderr=subprocess.PIPE, **options)

    def outputs(self):
        return sorted(os.listdir(self.path("out")))

    def whole(self, names, *words):
        """The bytes of an undisturbed run, whose outputs are then removed."""
        self.run_tool("convert", *names, "-o", "out/", *words).is_silent()
        found = {name: self.path("out/" + name).read_bytes() for name in self.outputs()}
        for name in found:
            self.path("out/" + name).unlink()
        return found

    def wait_for_outputs(self, tool, count):
        while len([n for n in self.outputs() if not n.startswith(".")]) < count:
            self.assertIsNone(tool.poll(), "it was over too early")
            time.sleep(0.001)

    def test_interrupted_batches_say_how_far_they_came(self):
        names = self.make(40)
        whole = self.whole(names, "--size", 64)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            tool = self.start(*names, "-o", "out/", "--size", 64, "--json")
            self.wait_for_outputs(tool, 3)
            start = time.monotonic()
            tool.send_signal(number)
            out, err = tool.communicate(timeout=60)
            self.assertLess(time.monotonic() - start, 10 if SANITIZED else 1.5)
            self.assertEqual(tool.returncode, -number)
            said = re.fullmatch(r"envconv: interrupted: (\d+) of 40 done\n", err.decode())
            self.assertTrue(said, err)
            *files, last = [json.loads(line) for line in out.splitlines()]
            summary = last["summary"]
            self.assertEqual((summary["signal"], summary["converted"]), (signal.Signals(number).name, int(said[1])))
            self.assertEqual(len(files), int(said[1]))
            # All that were reported are there, and whole; at most one a thread was finished and not yet counted.
            done = {os.path.basename(f["output"]) for f in files}
            self.assertLessEqual(done, set(self.outputs()))
            self.assertLessEqual(len(self.outputs()) - len(done), os.cpu_count() + 1)
            for name in self.outputs():
                self.assertEqual(self.path("out/" + name).read_bytes(), whole[name])
            self.run_tool("convert", *names, "-o", "out/", "--size", 64, "-n").is_silent()
            self.assertEqual({n: self.path("out/" + n).read_bytes() for n in self.outputs()}, whole)
            for name in self.outputs():
                self.path("out/" + name).unlink()

    def test_at_any_point(self):
        names = self.make(6, 128)
        start = time.monotonic()
        self.whole(names, "--size", 128)
        duration = time.monotonic() - start
        for i in range(20):
            tool = self.start(*names, "-o", "out/", "--size", 128)
            time.sleep(duration * i / 20)
            tool.send_signal(signal.SIGTERM)
            _, err = tool.communicate(timeout=60)
            self.assertIn(tool.returncode, (-signal.SIGTERM, 0))
            self.assertEqual([n for n in self.outputs() if n not in names], [])
            self.assertRegex(err.decode(), r"\A(envconv: interrupted: \d of 6 done\n)?\Z")

    @unittest.skipIf("thread" in os.environ.get("ENVCONV_SANITIZE", ""), "it holds signals back while a write is stuck")
    def test_a_second_signal_ends_it_at_once(self):
        write_constant(self.path("in.exr"), 1, 1024, 512)
        read_end, write_end = os.pipe()
        # With the pipe full, the first signal's last words are stuck; the deadline helps, and so does a second signal.
        os.set_blocking(write_end, False)
        try:
            while True:
                os.write(write_end, b"x" * 4096)
        except BlockingIOError:
            os.set_blocking(write_end, True)
        for signals in (1, 2):
            tool = subprocess.Popen([BINARY, "convert", "in.exr", "-o", "out.exr", "--size", "4000"], cwd=self.folder,
                                    stderr=write_end)
            time.sleep(0.3)
            self.assertIsNone(tool.poll())
            start = time.monotonic()
            for _ in range(signals):
                tool.send_signal(signal.SIGINT)
                time.sleep(0.1)
            self.assertEqual(tool.wait(timeout=60), -signal.SIGINT)
            if not SANITIZED:
                self.assertLess(time.monotonic() - start, 1.5)
            self.assertEqual(self.files(), ["in.exr"])
        os.close(read_end)
        os.close(write_end)

    def test_a_pause_is_not_a_hang(self):
        # Decoding is given two seconds without processor time here, of which it spends one; and then all are stopped.
        write_constant(self.path("in.exr"))
        tool = self.start("in.exr", "-o", "out.exr", start_new_session=True,
                          env={**os.environ, "ENVCONV_TEST_READER": "pause"})
        time.sleep(0.6)
        os.killpg(tool.pid, signal.SIGSTOP)
        time.sleep(4)
        self.assertIsNone(tool.poll())
        os.killpg(tool.pid, signal.SIGCONT)
        self.assertEqual((tool.communicate(timeout=60), tool.returncode), ((b"", b""), 0))
        self.assertEqual(self.files(), ["in.exr", "out.exr"])
        # And a hang is one.
        self.run_tool("convert", "in.exr", "-o", "out.exr", env={**os.environ, "ENVCONV_TEST_READER": "hang"}, expect=3)
        self.says("in.exr: the reader was stopped after taking too long")

    def test_what_was_ignored_stays_ignored(self):
        names = self.make(30)
        tool = self.start(*names, "-o", "out/", "--size", 64, preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_IGN))
        self.wait_for_outputs(tool, 1)
        tool.send_signal(signal.SIGHUP)
        tool.communicate(timeout=60)
        self.assertEqual(tool.returncode, 0)

    def test_killed_twenty_times_and_resumed(self):
        names = self.make(300, 16)
        convert = (*names, "-o", "out/", "--size", 8)
        start = time.monotonic()
        whole = self.whole(names, "--size", 8)
        duration = time.monotonic() - start
        chance = random.Random(20)
        temporaries = 0
        for _ in range(20):
            tool = self.start(*convert, "-n")
            time.sleep(chance.uniform(0, duration / 12))
            tool.kill()
            tool.communicate()
            for name in self.outputs():
                if name.startswith("."):
                    self.assertRegex(name, TEMPORARY)
                    temporaries += 1
                else:
                    self.assertEqual(self.path("out/" + name).read_bytes(), whole[name], name)
        self.run_tool("convert", *convert, "-n").is_silent()
        self.assertEqual({n: self.path("out/" + n).read_bytes() for n in self.outputs()}, whole)

    def test_the_old_content_stays_until_the_new_is_whole(self):
        write_constant(self.path("in.exr"), 1, 256, 128)
        self.path("out.exr").write_bytes(b"old")
        for delay in (0.02, 0.05, 0.1, 0.2):
            tool = self.start("in.exr", "-o", "out.exr", "--size", 1500)
            time.sleep(delay)
            tool.kill()
            tool.communicate()
            if self.path("out.exr").read_bytes() != b"old":
                self.json("info", "out.exr")

    def test_temporaries_of_the_dead_are_removed_and_of_the_living_kept(self):
        names = self.make(1)
        dead = subprocess.Popen(["true"])
        dead.wait()
        stale, living = f".envconv-{dead.pid}-0123456789ab.tmp", f".envconv-{os.getpid()}-0123456789ab.tmp"
        for name in (stale, living, ".envconv-notes.tmp"):
            self.path("out/" + name).write_bytes(b"x")
        self.run_tool("convert", *names, "-o", "out/").is_silent()
        self.assertEqual(self.outputs(), sorted([living, ".envconv-notes.tmp", *names]))
        # When there is nothing to write, too.
        self.path("out/" + stale).write_bytes(b"x")
        self.run_tool("convert", *names, "-o", "out/", "-n").is_silent()
        self.assertEqual(self.outputs(), sorted([living, ".envconv-notes.tmp", *names]))

    def test_batches_share_a_folder(self):
        names = self.make(20)
        whole = self.whole(names, "--size", 16)
        for _ in range(3):
            tools = [self.start(*names, "-o", "out/", "--size", 16) for _ in range(4)]
            for tool in tools:
                self.assertEqual((tool.communicate(timeout=120), tool.returncode), ((b"", b""), 0))
            self.assertEqual({n: self.path("out/" + n).read_bytes() for n in self.outputs()}, whole)

    def test_a_folder_that_vanishes(self):
        # While the input is decoded: the folder was there when the plan was made.
        write_constant(self.path("in.exr"), 1, 512, 256)
        self.path("out").mkdir()
        tool = self.start("in.exr", "-o", "out/x.exr", env={**os.environ, "ENVCONV_TEST_READER": "pause"})
        time.sleep(0.6)
        self.path("out").rmdir()
        _, err = tool.communicate(timeout=60)
        self.assertEqual(tool.returncode, 4)
        self.assertIn(b"out/x.exr: ", err)
        self.assertEqual(self.files(), ["in.exr"])


if __name__ == "__main__":
    unittest.main()
