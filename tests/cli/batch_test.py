# SPDX-License-Identifier: Apache-2.0
"""envconv convert on many inputs: names of outputs, failures, what exists already."""
import json
import os
import unittest

from harness import Case, write_constant


class Batch(Case):
    def setUp(self):
        super().setUp()
        for name in ("a", "b", "c"):
            write_constant(self.path(f"{name}.exr"))
        self.path("out").mkdir()

    def outputs(self):
        return [f for f in self.files() if f.startswith("out/")]

    def test_fields(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/{index}_{stem}_{layout}_{size}.{ext}", "--size", 8)
        self.assertEqual(self.outputs(), ["out/0_a_cube_8.exr", "out/1_b_cube_8.exr"])

    def test_size_field_without_a_given_size(self):
        report = [json.loads(line) for line in
                  self.run_tool("convert", "a.exr", "b.exr", "-o", "out/{stem}{size}.exr", "--json").out.splitlines()]
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

    def test_an_output_that_is_another_input(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "{index}.exr").is_silent()
        before = self.path("1.exr").read_bytes()
        self.run_tool("convert", "a.exr", "1.exr", "-o", "{index}.exr", expect=2).says("1.exr", "itself")
        self.assertEqual(self.path("1.exr").read_bytes(), before)

    def test_stops_at_the_first_failure(self):
        self.path("b.exr").write_bytes(b"damaged")
        self.run_tool("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", expect=3).says("b.exr")
        self.assertEqual(self.outputs(), ["out/a.exr"])

    def test_a_missing_input_stops_all_before_any_work(self):
        self.run_tool("convert", "a.exr", "no.exr", "c.exr", "-o", "out/", expect=3).says("no.exr")
        self.assertEqual(self.outputs(), [])

    def test_keep_going(self):
        self.path("b.exr").write_bytes(b"damaged")
        self.run_tool("convert", "a.exr", "b.exr", "no.exr", "c.exr", "-o", "out/", "--keep-going", "--json", expect=7)
        self.says("b.exr: ", "no.exr: ", "4 inputs: 2 converted, 0 skipped, 2 failed")
        self.assertEqual(self.outputs(), ["out/a.exr", "out/c.exr"])
        report = [json.loads(line) for line in self.out.splitlines()]
        self.assertEqual([r["input"] for r in report], ["a.exr", "b.exr", "no.exr", "c.exr"])
        self.assertEqual([r["error"] is None for r in report], [True, False, False, True])

    def test_skip_existing(self):
        self.run_tool("convert", "a.exr", "b.exr", "-o", "out/", "--size", 8)
        stamp = os.stat(self.path("out/a.exr")).st_mtime_ns, os.stat(self.path("out/a.exr")).st_ino
        whole = self.path("out/b.exr").read_bytes()
        self.path("out/b.exr").write_bytes(whole[: len(whole) // 2])  # not complete
        out = self.run_tool("convert", "a.exr", "b.exr", "c.exr", "-o", "out/", "--size", 8, "-n", "--json").out
        report = [json.loads(line) for line in out.splitlines()]
        self.assertEqual([r.get("skipped", False) for r in report], [True, False, False])
        self.assertEqual((os.stat(self.path("out/a.exr")).st_mtime_ns, os.stat(self.path("out/a.exr")).st_ino), stamp)
        self.assertEqual(self.path("out/b.exr").read_bytes(), whole)


if __name__ == "__main__":
    unittest.main()
