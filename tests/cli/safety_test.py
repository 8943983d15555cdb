# SPDX-License-Identifier: Apache-2.0
"""Values that are hard to hold: too large, negative, subnormal, NaN, infinite; per format, and counted."""
import math
import struct
import unittest

from harness import Case, read_exr, read_png, write_constant, write_exr

MAP = ("--to", "latlong")
PLAIN = (*MAP, "--compression", "none")


class Limits(Case):
    def convert(self, name, *words):
        self.run_tool("convert", "in.exr", "-o", name, *MAP, *words)
        said, channels = self.err, self.json("info", name)["channels"]
        self.err = said
        return channels

    def test_half(self):
        # 65519 rounds to the largest half, 65520 would round to infinity.
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (65519.0, 65520.0, -1e30))
        self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN, "--type", "half")
        self.says("256 values are too large for half .exr: clamped")
        channels = read_exr(self.path("out.exr"))[2]
        self.assertEqual([channels[c][3][3] for c in "RGB"], [65504, 65504, -65504])
        info = self.json("info", "out.exr")["channels"]
        self.assertEqual([c["inf"] for c in info], [0, 0, 0])

    def test_radiance(self):
        # The largest value is 255 * 2^119; beyond it there must be neither 0 nor a smaller exponent.
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (3e38, 2e38, 1e38))
        channels = self.convert("out.hdr")
        self.says("256 values are too large for float .hdr: clamped")
        top = 255 * 2.0**119
        self.assertEqual([c["max"] for c in channels[:2]], [top, top])
        self.assertAlmostEqual(channels[2]["max"] / 1e38, 1, delta=0.01)
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (-2.0, 1.0, -0.001))
        channels = self.convert("out.hdr")
        self.says("256 values are negative, which float .hdr cannot hold: set to 0")
        self.assertEqual([c["min"] for c in channels], [0, 1, 0])

    def test_integers(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (-0.5, 0.5, 3.0))
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--view", "none")
        self.says("128 values are too large for uint8 .png", "128 values are negative, which uint8 .png cannot hold")
        self.assertEqual(read_png(self.path("out.png"))[2][3][3], (0, 188, 255))

    def test_negative_values_are_kept_and_reported(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (-0.25, 1.0, -1e-7))
        for name, kind in (("out.exr", "float"), ("half.exr", "half"), ("out.tif", "float"), ("out.pfm", "float")):
            channels = self.convert(name, "--type", kind)
            self.assertEqual([c["negative"] for c in channels], [128, 0, 128], name)
            self.assertAlmostEqual(channels[0]["min"], -0.25, delta=1e-6)
        self.assertIn("negative", self.run_tool("info", "out.exr").out)

    def test_all_faces_are_counted_together(self):
        write_constant(self.path("in.exr"), 1e6)
        report = self.json("convert", "in.exr", "-o", "o_{face}.exr", "--size", 4, "--type", "half")
        self.assertEqual(report["warnings"], ["288 values are too large for half .exr: clamped"])


class Subnormals(Case):
    def test_copies_are_exact(self):
        tiny = struct.unpack("<f", struct.pack("<I", 1))[0]
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (tiny * (x + 1), -tiny * (y + 1), 1e-39))
        self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN, "--type", "float").is_silent()
        self.assertEqual(read_exr(self.path("in.exr"))[2], read_exr(self.path("out.exr"))[2])

    def test_resampling_keeps_them(self):
        write_constant(self.path("in.exr"), 1e-39, 64, 32)
        for size in (4, 64):
            self.run_tool("convert", "in.exr", "-o", "out.exr", "--size", size, "--compression", "none").is_silent()
            for row in read_exr(self.path("out.exr"))[2]["G"]:
                for value in row:
                    self.assertAlmostEqual(value / 1e-39, 1, delta=1e-4)

    def test_curves_take_them_for_black(self):
        write_constant(self.path("in.exr"), 1e-40)
        self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN, "--out-colorspace", "g22_rec709").is_silent()
        for value in read_exr(self.path("out.exr"))[2]["G"][3]:
            self.assertLess(abs(value), 1e-15)


class Nonfinite(Case):
    def setUp(self):
        super().setUp()
        holes = {(4, 3): math.nan, (9, 5): math.inf, (12, 2): -math.inf}
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (holes.get((x, y), 0.5), 0.25, 70000.0))

    def test_clamped_to_the_largest_value_that_there_is(self):
        self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN, "--type", "float", "--nonfinite", "clamp")
        self.says("3 values are NaN or infinite: clamped")
        red = read_exr(self.path("out.exr"))[2]["R"]
        self.assertEqual([red[3][4], red[5][9], red[2][12]], [0, 70000, -70000])

    def test_they_are_gone_before_colours_are_changed(self):
        # A matrix would spread one channel's NaN over all three.
        self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN, "--type", "float", "--out-colorspace", "ACEScg")
        info = self.json("info", "out.exr")["channels"]
        self.assertEqual([(c["nan"], c["inf"]) for c in info], [(0, 0)] * 3)


if __name__ == "__main__":
    unittest.main()
