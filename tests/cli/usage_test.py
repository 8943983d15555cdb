# SPDX-License-Identifier: Apache-2.0
"""Wrong command lines: status 2, a line that says what to do, and nothing read or written."""
import os
import unittest

from harness import BINARY, SANITIZED, Case, write_constant


class Usage(Case):
    def test_no_verb(self):
        self.run_tool(expect=2).says("a verb is missing", "envconv --help")

    def test_unknown_verb_names_the_nearest(self):
        self.run_tool("conver", "a.exr", expect=2).says("conver", "did you mean 'convert'?")

    def test_unknown_option_names_the_nearest(self):
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--filtr=box", expect=2).says("--filtr", "'--filter'")
        self.run_tool("--versoin", expect=2).says("'--version'")

    def test_unknown_layout_names_the_nearest(self):
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--to", "octahedrl", expect=2).says("'octahedral'")
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--from", "latlng", expect=2).says("'latlong'")
        self.run_tool("layouts", "cubes", expect=2).says("'cube'")

    def test_value_missing(self):
        self.run_tool("convert", "a.exr", "-o", expect=2).says("-o: a value must follow")

    def test_input_or_output_missing(self):
        self.run_tool("convert", "-o", "b.exr", expect=2).says("INPUT... is missing")
        write_constant(self.path("a.exr"))
        self.run_tool("convert", "a.exr", expect=2).says("--output: missing")

    def test_sizes_out_of_range_name_the_limit(self):
        write_constant(self.path("a.exr"))
        for size in ("0", "-5", "65537", "1e9", "4e9", "99999999999", "99999999999999999999", "nan", "64.0", " 64", "", "0x40"):
            self.run_tool("convert", "a.exr", "-o", "b.exr", "--size", size, expect=2)
            self.says("--size", "from 1 to 65536")
        self.assertEqual(self.files(), ["a.exr"])

    def test_other_numbers(self):
        for option, value in (
            ("--texels", "1.5M"), ("--texels", "0"), ("--texels", "9999999999G"), ("--rotate", "90"),
            ("--rotate", "1,2,x"), ("--rotate", "1,2,3,4"), ("--rotate", "nan,0,0"), ("--exposure", "1,5"),
            ("--exposure", "inf"), ("--exposure", "1000"), ("--samples", "0"), ("-j", "-1"), ("--max-pixels", "0"),
        ):
            self.run_tool("convert", "a.exr", "-o", "b.exr", option, value, expect=2)

    def test_choices(self):
        for option in ("--type", "--alpha", "--nonfinite", "--filter", "--progress", "--packing", "--frame"):
            self.run_tool("convert", "a.exr", "-o", "b.exr", option, "nonsense", expect=2).says("nonsense")

    def test_an_empty_name(self):
        self.run_tool("info", "", expect=3).says('"": an empty name')
        self.run_tool("convert", "", "-o", "b.exr", expect=3).says('"": an empty name')

    def test_one_advice_is_enough(self):
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--to", "octahedrl", expect=2)
        self.assertEqual(self.err.count("("), 1)

    def test_size_and_texels_exclude_each_other(self):
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--size", 8, "--texels", "1k", expect=2).says("only one")

    def test_control_characters_are_shown(self):
        self.run_tool("convert", "a\nb\x1b[31m.exr", "-o", "b.exr", expect=3).says("a\\x0ab\\x1b[31m.exr")


class Help(Case):
    def test_help_fits_a_screen(self):
        self.run_tool("--help")
        lines = self.out.splitlines()
        self.assertLessEqual(len(lines), 24)
        self.assertLessEqual(max(map(len, lines)), 80)
        self.assertEqual(self.err, "")

    def test_help_of_every_verb_fits_the_width_and_tells_defaults(self):
        for verb in ("convert", "info", "layouts", "completion"):
            out = self.run_tool(verb, "--help").out
            self.assertLessEqual(max(map(len, out.splitlines())), 80, verb)
        out = self.run_tool("convert", "--help").out
        for part in ("[cube]", "[world]", "[auto]", "[repair]", "lanczos", "opengl"):
            self.assertIn(part, out)

    def test_version(self):
        out = self.run_tool("--version").out
        for part in ("envconv 0.", "OpenEXR 3.", "OpenImageIO 2.", "OpenColorIO 2.", "SIMD ", "Apache-2.0"):
            self.assertIn(part, out)

    def test_start_up_is_without_the_image_library(self):
        # The loader's list of what a start needs.
        self.run_tool("--version", env={**os.environ, "LD_TRACE_LOADED_OBJECTS": "1"})
        self.assertIn("libOpenEXR", self.out, f"no list of libraries from {BINARY}")
        self.assertNotIn("OpenImageIO", self.out)


if __name__ == "__main__":
    unittest.main()
