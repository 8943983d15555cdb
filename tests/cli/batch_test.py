# SPDX-License-Identifier: Apache-2.0
"""envconv convert on many inputs: names of outputs, failures, what exists already."""
import json
import os
import subprocess
import unittest

from harness import BINARY, Case, write_constant


class Batch(Case):
    def setUp(self):
        super().setUp()
        for name in ("a", "b", "c"):
            write_constant(self.path(f"{name}.exr"))
        self.path("out").mkdir()

    def outputs(self):
        return [f for f in self.files() if f.startswith("out/")]

    def reports(self):
        """The objects of the last run's files; the summary, which must be the last, is in self.summary."""
        *files, last = [json.loads(line) for line in self.out.splitlines()]
        self.summary = last["summary"]
        return files

    def test_fields(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/{index}_{stem}_{layout}_{size}.{ext}", "--size", 8)
        self.assertEqual(self.outputs(), ["out/0_a_cube_8.exr", "out/1_b_cube_8.exr"])

    def test_size_field_without_a_given_size(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/{stem}{size}.exr", "--json")
        report = self.reports()
        self.assertEqual(self.outputs(), [f"out/a{report[0]['size']}.exr", f"out/b{report[1]['size']}.exr"])

    def test_dir_and_braces(self):
        self.run_tool("convert", "./a.exr", "-o", "{dir}/out/{{x}}_{stem}.exr").is_silent()
        self.assertEqual(self.outputs(), ["out/{x}_a.exr"])

    def test_escaped_braces_are_no_field(self):
        self.run_tool("convert", "a.exr", "-o", "out/{{face}}.exr", "--size", 8).is_silent()
        self.assertEqual(self.outputs(), ["out/{face}.exr"])
        self.run_tool("convert", "a.exr", "-o", "out/{{face}}_{face}.exr", "--size", 8).is_silent()
        self.assertIn("out/{face}_px.exr", self.outputs())

    def test_folder(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/").is_silent()
        self.assertEqual(self.outputs(), ["out/a.exr", "out/b.exr"])
        self.run_tool("convert", "a.exr", "-o", "out/", "--packing", "files", "--size", 8).is_silent()
        self.assertIn("out/a_px.exr", self.outputs())

    def test_face_index(self):
        self.run_tool("convert", "a.exr", "-o", "out/{stem}{face_index}.exr", "--size", 8).is_silent()
        self.assertEqual(self.outputs(), [f"out/a{i}.exr" for i in range(6)])

    def test_template_is_wanted_and_checked(self):
        for output, said in (
            ("out/x.exr", "{stem}"), ("out/{layout}.exr", "{stem}"), ("out/{stme}.exr", "'stem'"),
            ("out/{stem.exr", "single '{'"), ("out/stem}.exr", "single '}'"),
        ):
            self.run_tool("convert", "a.exr", "b.exr", "-o", output, expect=2).says(said)
        self.run_tool("convert", "a.exr", "-o", "out/x.exr", "--packing", "files", expect=2).says("{face}")
        self.run_tool("convert", "a.exr", "-o", "out/{face}.exr", "--packing", "row", expect=2).says("--packing files")
        self.assertEqual(self.outputs(), [])

    def test_collisions_are_found_before_any_work(self):
        self.path("sub").mkdir()
        write_constant(self.path("sub/a.exr"))
        self.run_tool("convert", "a.exr", "b.exr", "sub/a.exr", "-o", "out/{stem}.exr", expect=2)
        self.says("out/a.exr", "a.exr", "sub/a.exr", "twice")
        self.assertEqual(self.outputs(), [])
        self.run_tool("convert", "a.exr", "sub/a.exr", "-o", "out/../{dir}/out_{stem}.exr").is_silent()
        # However the folder is spelled.
        self.path("link").symlink_to("sub")
        for first, second in (("a.exr", "sub/../a.exr"), ("sub/a.exr", "link/a.exr")):
            self.run_tool("convert", first, second, "-o", "{dir}/x_{stem}.exr", expect=2).says("twice")
        self.assertEqual([f for f in self.files() if "x_" in f], [])

    def test_an_output_that_is_another_input(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "{index}.exr").is_silent()
        before = self.path("1.exr").read_bytes()
        self.run_tool("convert", "a.exr", "1.exr", "-o", "{index}.exr", expect=2).says("1.exr", "itself")
        self.assertEqual(self.path("1.exr").read_bytes(), before)

    def test_stops_at_the_first_failure(self):
        # Exactly what comes before it is there, whoever was quicker.
        self.path("b.exr").write_bytes(b"damaged")
        for threads in (1, 2, 7):
            self.run_tool("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "-j", threads, "--json", expect=3)
            self.says("b.exr")
            self.assertEqual(self.outputs(), ["out/a.exr"])
            self.assertEqual([r["input"] for r in self.reports()], ["a.exr", "b.exr"])
            self.assertEqual((self.summary["failures"], self.summary["not_done"]), (["b.exr"], 1))
            self.path("out/a.exr").unlink()

    def test_a_missing_input_stops_all_before_any_work(self):
        self.run_tool("convert", "a.exr", "no.exr", "c.exr", "-o", "out/", expect=3).says("no.exr")
        self.assertEqual(self.outputs(), [])

    def test_keep_going(self):
        self.path("b.exr").write_bytes(b"damaged")
        self.run_tool("convert", "a.exr", "b.exr", "no.exr", "c.exr", "-o", "out/", "--keep-going", "--json", expect=7)
        self.says("b.exr: ", "no.exr: ", "4 inputs: 2 converted, 0 skipped, 2 failed")
        self.assertEqual(self.outputs(), ["out/a.exr", "out/c.exr"])
        report = self.reports()
        self.assertEqual([r["input"] for r in report], ["a.exr", "b.exr", "no.exr", "c.exr"])
        self.assertEqual([r["error"] is None for r in report], [True, False, False, True])

    def test_skip_existing(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/", "--size", 8)
        stamp = os.stat(self.path("out/a.exr")).st_mtime_ns, os.stat(self.path("out/a.exr")).st_ino
        whole = self.path("out/b.exr").read_bytes()
        self.path("out/b.exr").write_bytes(whole[: len(whole) // 2])  # not complete
        self.run_tool("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "--size", 8, "-n", "--json")
        self.assertEqual([r.get("skipped", False) for r in self.reports()], [True, False, False])
        self.assertEqual((os.stat(self.path("out/a.exr")).st_mtime_ns, os.stat(self.path("out/a.exr")).st_ino), stamp)
        self.assertEqual(self.path("out/b.exr").read_bytes(), whole)
        # Not complete, and only its last pixels tell.
        self.path("out/b.exr").write_bytes(whole[:-1])
        self.run_tool("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "--size", 8, "-n", "--json")
        self.assertEqual([r.get("skipped", False) for r in self.reports()], [True, False, True])
        self.assertEqual(self.path("out/b.exr").read_bytes(), whole)

    def test_skipping_looks_at_age_and_kind(self):
        convert = ("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "--size", 8, "--json")
        self.run_tool(*convert)
        os.utime(self.path("out/b.exr"), (1, 1))  # older than its input
        self.run_tool(*convert, "-n")
        self.assertEqual([r.get("skipped", False) for r in self.reports()], [True, False, True])
        self.run_tool(*convert, "-n", "--to", "isocube")
        self.assertEqual(self.summary_of("skipped"), 0)
        self.run_tool(*convert, "-n", "--to", "isocube", "--frame", "three")
        self.assertEqual(self.summary_of("skipped"), 0)
        self.run_tool(*convert, "-n", "--to", "isocube", "--frame", "three")
        self.assertEqual(self.summary_of("skipped"), 3)

    def test_skipping_compares_what_is_asked_for(self):
        convert = ("convert", "a.exr", "b.exr", "-n", "--json", "-o")
        changes = (("--size", 8), ("--size", 4), ("--type", "float"), ("--type", "half"), ("--mips",), ("--rotate", "10,20,30"),
                   ("--seam", "stretch"), ("--seam", "gutter:1"), ("--packing", "row"), ("--packing", "column"),
                   ("--frame", "three"), ("--to", "octahedral"))
        for output in ("out/{stem}.exr", "out/{stem}.ktx2", "out/{stem}_{mip}.exr"):
            before = ()
            for change in changes:
                words = (*convert, output, *(() if "--size" in change else ("--size", 16)), *change)
                if "ktx2" in output and ("--packing" in change or "--seam" in change):
                    continue
                if change == ("--mips",) and output != "out/{stem}.exr":
                    continue  # as usual there
                self.run_tool(*words)
                self.assertEqual(self.summary_of("converted"), 2, (before, words))
                self.run_tool(*words)
                self.assertEqual(self.summary_of("skipped"), 2, words)
                before = words
        # What a format does not tell is not compared: of Radiance files the size is.
        self.run_tool(*convert, "out/{stem}.hdr", "--size", 8)
        self.run_tool(*convert, "out/{stem}.hdr", "--size", 8, "--exposure", 1)
        self.assertEqual(self.summary_of("skipped"), 2)
        self.run_tool(*convert, "out/{stem}.hdr", "--size", 4)
        self.assertEqual(self.summary_of("skipped"), 0)
        # A size of the tool's own choice comes from the input.
        self.run_tool(*convert, "out/{stem}.hdr")
        self.assertEqual(self.summary_of("skipped"), 0)
        self.run_tool(*convert, "out/{stem}.hdr")
        self.assertEqual(self.summary_of("skipped"), 2)

    def summary_of(self, key):
        self.reports()
        return self.summary[key]

    def test_files_from(self):
        names = ["a.exr", "with space.exr", "new\nline.exr", "#hash.exr", "-dash.exr"]
        for name in names[1:]:
            write_constant(self.path(name))
        out = ("-o", "out/{index}.exr", "--size", 4)
        self.path("list").write_text("\n".join(n for n in names if "\n" not in n) + "\n\n")
        self.run_tool("convert", "--files-from", "list", *out).is_silent()
        self.assertEqual(len(self.outputs()), 4)
        self.run_tool("convert", "--files-from", "-", "-0", *out, input="\0".join(names).encode()).is_silent()
        self.assertEqual(len(self.outputs()), 5)
        # Those on the command line come first.
        self.run_tool("convert", "--files-from", "list", "--json", "-o", "out/x{index}.exr", "--size", 4, "b.exr")
        self.assertEqual([r["input"] for r in self.reports()], ["b.exr", "a.exr", *names[1:2], *names[3:]])

    def test_a_list_that_is_missing_odd_or_empty(self):
        out = ("-o", "out/{stem}.exr")
        self.run_tool("convert", "--files-from", "no", *out, expect=3).says("no: cannot be read: No such file")
        self.run_tool("convert", "--files-from", ".", *out, expect=3).says("Is a directory")
        self.run_tool("convert", "--files-from", "-", *out, input=b"a.exr\0b.exr\0", expect=2).says("-0")
        self.run_tool("convert", "a.exr", "-0", *out, expect=2).says("--files-from")
        self.run_tool("convert", "--files-from", "-", *out, "--json", input=b"")
        self.assertEqual(self.reports(), [])
        self.assertEqual(self.outputs(), [])

    def test_shards_together_are_the_batch(self):
        names = [f"p{i}.exr" for i in range(7)]
        for i, name in enumerate(names):
            write_constant(self.path(name), i)
        convert = ("convert", *names, "--size", 4, "--json")
        self.run_tool(*convert, "-o", "out/{index}_{stem}.exr")
        whole = {name: self.path(name).read_bytes() for name in self.outputs()}
        for name in whole:
            self.path(name).unlink()
        seen = []
        for shard in range(1, 4):
            self.run_tool(*convert, "-o", "out/{index}_{stem}.exr", f"--shard={shard}/3")
            seen += [r["index"] for r in self.reports()]
        self.assertEqual(seen, [0, 3, 6, 1, 4, 2, 5])
        self.assertEqual({name: self.path(name).read_bytes() for name in self.outputs()}, whole)
        self.run_tool(*convert, "-o", "out/{index}.exr", "--shard", "9/9")
        self.assertEqual(self.reports(), [])
        # Whatever is wrong with the batch, every shard says so.
        self.run_tool("convert", "a.exr", "b.exr", "./a.exr", "-o", "out/", "--shard", "2/3", expect=2).says("twice")
        for shard in ("0/3", "4/3", "1", "1/", "/3", "a/b", "1/0", "-1/3", "1/3/4", "1 / 3"):
            self.run_tool(*convert, "-o", "out/", f"--shard={shard}", expect=2).says("--shard", "I/N")

    def test_reports_are_in_order_and_alike_for_any_number_of_threads(self):
        for i in range(12):
            write_constant(self.path(f"p{i}.exr"), i, 16 * (12 - i), 8 * (12 - i))  # the first take longest
        self.path("p5.exr").write_bytes(b"damaged")
        names = [f"p{i}.exr" for i in range(12)]
        seen = set()
        for threads in (1, 2, 7):
            self.run_tool("convert", *names, "-o", "out/", "--keep-going", "--json", "--size", 8, "-j", threads, expect=7)
            reports = self.reports()
            self.assertEqual([r["input"] for r in reports], names)
            for report in [*reports, self.summary]:
                for key in ("seconds", "stages", "peak_memory", "texels_per_second"):
                    report.pop(key, None)
            bytes_of = {name: self.path(name).read_bytes() for name in self.outputs()}
            seen.add((json.dumps([*reports, self.summary]), self.err, tuple(sorted(bytes_of.items()))))
        self.assertEqual(len(seen), 1)

    def test_the_json_of_a_file_and_of_the_batch(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/", "--size", 8, "--json")
        report = self.reports()[0]
        self.assertEqual((report["input"], report["output"], report["layout"], report["size"], report["warnings"],
                          report["error"]), ("a.exr", "out/a.exr", "cube", 8, [], None))
        self.assertGreater(report["seconds"], 0)
        self.assertGreater(report["peak_memory"], 1e6)  # a process is never smaller
        summary = self.summary
        self.assertEqual((summary["files"], summary["converted"], summary["skipped"], summary["failed"]), (2, 2, 0, 0))
        self.assertEqual(summary["texels"], 2 * 6 * 64)
        self.assertIsNone(summary["signal"])

    def test_stems_that_would_leave_the_folder(self):
        write_constant(self.path("...exr"))  # its stem is ".."
        self.run_tool("convert", "...exr", "-o", "out/{stem}/x.exr", expect=2).says("outside of out")
        self.path("out/...exr").mkdir()
        self.run_tool("convert", "...exr", "-o", "out/{stem}/{stem}.exr", expect=2)
        self.path("sub").mkdir()
        write_constant(self.path("sub/a.exr"))
        self.run_tool("convert", "sub/../a.exr", "-o", "out/{dir}/x.exr", "--size", 4, expect=4).says("create it first")
        self.run_tool("convert", "../b.exr", "-o", "../out/{dir}/x.exr", expect=2, cwd=self.path("sub"))
        self.says("outside of ../out")
        # By way of a link, too; and a name that begins as the folder's does is another folder.
        self.path("out-of-it").mkdir()
        self.path("out/a").symlink_to("../out-of-it")
        self.run_tool("convert", "a.exr", "-o", "out/{stem}/x.exr", expect=2).says("outside of out")
        self.assertEqual([f for f in self.files() if "x.exr" in f], [])
        # {dir} at the beginning is what the user asked for.
        self.run_tool("convert", "sub/a.exr", "-o", "{dir}/{stem}_out.exr", "--size", 4).is_silent()
        self.assertIn("sub/a_out.exr", self.files())

    def test_names_that_differ_in_case_only_are_two_here(self):
        write_constant(self.path("A.exr"))
        self.run_tool("convert", "a.exr", "A.exr", "-o", "out/", "--size", 4).is_silent()
        self.assertEqual(self.outputs(), ["out/A.exr", "out/a.exr"])

    def test_progress_counts(self):
        self.path("b.exr").write_bytes(b"damaged")
        self.run_tool("convert", "a.exr", "-o", "out/", "--size", 4)
        done = subprocess.run([BINARY, "convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "--size", "4",
                               "--keep-going", "-n", "--progress", "always"], cwd=self.folder, capture_output=True, timeout=60)
        self.assertEqual((done.returncode, done.stdout), (7, b""))
        self.assertIn(b" of 3", done.stderr)
        self.assertTrue(done.stderr.endswith(b"3 inputs: 1 converted, 1 skipped, 1 failed\n"))


if __name__ == "__main__":
    unittest.main()
