# SPDX-License-Identifier: Apache-2.0
"""envconv info and envconv layouts."""
import json
import math
import struct
import unittest

from harness import PANORAMAS, Case, direction, write_constant, write_exr


class Info(Case):
    def test_text(self):
        out = self.run_tool("info", PANORAMAS / "city.exr").out
        for part in ("latlong", "1024x512", "R G B", "float", "negative", "mean"):
            self.assertIn(part, out)
        self.assertEqual(self.err, "")

    def test_numbers(self):
        values = {(3, 2): float("nan"), (4, 2): float("-inf"), (5, 2): -3.0}
        write_exr(self.path("in.exr"), 32, 16, lambda x, y: (values.get((x, y), 2.0), 0.5, 0.25))
        info = self.json("info", "in.exr")
        red, green = info["channels"][0], info["channels"][1]
        self.assertEqual((red["min"], red["max"], red["nan"], red["inf"], red["negative"]), (-3, 2, 1, 1, 2))
        self.assertAlmostEqual(green["mean"], 0.5, delta=1e-5)
        self.assertEqual((info["layout"], info["size"], info["type"], info["levels"]), ("latlong", 16, "float", 1))
        self.assertEqual([c["name"] for c in info["channels"]], ["R", "G", "B"])

    def test_mean_is_over_the_sphere(self):
        # A white upper eighth of the rows covers (1 - cos 22.5 degrees) / 2 of the sphere, not an eighth.
        write_exr(self.path("in.exr"), 64, 32, lambda x, y: (1.0 if y < 4 else 0.0,) * 3)
        self.assertAlmostEqual(self.json("info", "in.exr")["channels"][0]["mean"], 0.03806, delta=1e-4)

    def test_luminance(self):
        # Rec. 709 (ITU-R BT.709-6, item 3.2), and the same light as the film's primaries have it.
        for attributes, weights in (({}, (0.2126, 0.7152, 0.0722)),
                                    ({"chromaticities": ("chromaticities", struct.pack("<8f", 0.713, 0.293, 0.165, 0.83,
                                                                                       0.128, 0.044, 0.32168, 0.33767))},
                                     (0.27223, 0.67408, 0.05369))):
            write_exr(self.path("in.exr"), 32, 16, lambda x, y: (1.0, 2.0, 4.0), attributes=attributes)
            wanted = sum(w * v for w, v in zip(weights, (1, 2, 4)))
            luminance = self.json("info", "in.exr")["luminance"]
            for value in (luminance["min"], luminance["max"], luminance["mean"], *luminance["percentiles"].values()):
                self.assertAlmostEqual(value, wanted, delta=2e-4)

    def test_percentiles_are_of_the_sphere(self):
        # Rows of 64 get brighter downwards; of the sphere, (1 - cos theta) / 2 lies above polar angle theta.
        write_exr(self.path("in.exr"), 128, 64, lambda x, y: (2.0 ** (y / 8),) * 3)
        info = self.json("info", "in.exr")
        for share, value in info["luminance"]["percentiles"].items():
            theta = math.acos(1 - 2 * float(share) / 100)
            row = min(63, math.floor(theta / math.pi * 64 - 1e-9))
            self.assertAlmostEqual(math.log2(value) * 8, row, delta=0.01, msg=share)
        self.assertAlmostEqual(info["dynamic_range_stops"], 63 / 8, delta=1e-4)
        # 1 % lies above 11.48 degrees (row 4), 99 % above 168.52 (row 59).
        self.assertAlmostEqual(info["dynamic_range_stops_98"], 55 / 8, delta=1e-3)

    def test_the_brightest_direction(self):
        at = direction(45, 9, 64, 32)
        write_exr(self.path("in.exr"), 64, 32, lambda x, y: (900.0 if (x, y) == (45, 9) else 1.0,) * 3)
        self.run_tool("convert", "in.exr", "-o", "three.exr", "--to", "latlong", "--frame", "three", "--type", "float",
                      "--size", 32, "--filter", "nearest")
        for name in ("in.exr", "three.exr"):
            info = self.json("info", name)
            # The frame turns the map, not the sky.
            for got, wanted in zip(info["brightest"]["direction"], at):
                self.assertAlmostEqual(got, wanted, delta=1e-6 if name == "in.exr" else 0.06)
            self.assertAlmostEqual(info["luminance"]["max"], 900, delta=0.01)
        info = self.json("info", "in.exr")
        self.assertEqual([info["brightest"][k] for k in ("face", "x", "y")], ["latlong", 45, 9])
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 64)
        brightest = self.json("info", "sky_{face}.exr")["brightest"]
        self.assertEqual(brightest["face"], max(zip(map(abs, at), ("px", "py", "pz")))[1])  # all three are positive
        for got, wanted in zip(brightest["direction"], at):
            self.assertAlmostEqual(got, wanted, delta=0.06)
        text = self.run_tool("info", "in.exr").out
        for part in ("luminance", "percentiles", "50% 1,", "brightest", "texel 45,9 of latlong", "9.814 stops"):
            self.assertIn(part, text)

    def test_luminance_where_there_is_little(self):
        write_constant(self.path("black.exr"), 0.0)
        info = self.json("info", "black.exr")
        self.assertEqual((info["luminance"]["max"], info["dynamic_range_stops"]), (0, 0))
        write_constant(self.path("nan.exr"), float("nan"))
        self.assertNotIn("luminance", self.json("info", "nan.exr"))
        write_exr(self.path("z.exr"), 16, 8, lambda x, y: (1.0, 2.0), "Zq")
        self.assertNotIn("luminance", self.json("info", "z.exr"))
        write_exr(self.path("y.exr"), 16, 8, lambda x, y: (0.3,), "Y")
        self.assertAlmostEqual(self.json("info", "y.exr")["luminance"]["percentiles"]["50"], 0.3, delta=1e-7)
        write_exr(self.path("neg.exr"), 16, 8, lambda x, y: (-1.0 if y < 4 else 2.0,) * 3)
        info = self.json("info", "neg.exr")
        self.assertAlmostEqual(info["luminance"]["percentiles"]["25"], -1, delta=1e-6)
        self.assertEqual((info["luminance"]["min"], info["dynamic_range_stops"]), (-1, 0))

    def test_several_files(self):
        write_constant(self.path("a.exr"))
        write_constant(self.path("b.exr"))
        self.assertEqual([i["file"] for i in self.json("info", "a.exr", "b.exr")], ["a.exr", "b.exr"])
        report = self.json("info", "a.exr", "no.exr", "b.exr", expect=3)
        self.assertIn("error", report[1])
        self.assertEqual(report[2]["layout"], "latlong")

    def test_not_recognised_is_told_not_guessed(self):
        write_constant(self.path("in.exr"), 1, 30, 10)
        self.assertIsNone(self.json("info", "in.exr")["layout"])
        self.assertIn("not recognised", self.run_tool("info", "in.exr").out)
        self.run_tool("info", "in.exr", "--from", "latlong", expect=3)

    def test_ambiguity_lists_the_candidates(self):
        write_constant(self.path("in.exr"), 0.5, 16, 16)
        info = self.json("info", "in.exr")
        self.assertIsNone(info["layout"])
        self.assertEqual(info["channels"][0]["max"], 0.5)
        for name in ("octahedral", "angular-map", "mirror-ball"):
            self.assertIn(name, info["candidates"])
        out = self.run_tool("info", "in.exr").out
        for part in ("could be any of", "octahedral", "--from", "16x16"):
            self.assertIn(part, out)
        self.assertEqual(self.err, "")
        self.assertNotIn("candidates", self.json("info", "in.exr", "--from", "octahedral"))

    def test_names_cannot_forge_lines(self):
        name = "a\nlayout\x1b[31m.exr"
        write_constant(self.path(name))
        self.assertIn("a\\x0alayout\\x1b[31m.exr\n", self.run_tool("info", name).out)
        self.assertEqual(self.json("info", name)["file"], name)
        self.assertEqual(len(self.run_tool("convert", name, "-o", "out.exr", "--dry-run").out.splitlines()), 1)

    def test_six_files(self):
        for face in ("px", "nx", "py", "ny", "pz", "nz"):
            write_constant(self.path(f"{face}.exr"), 1, 8, 8)
        info = self.json("info", "{face}.exr")
        self.assertEqual((info["layout"], info["packing"], info["size"], info["parts"]), ("cube", "files", 8, 6))


class Layouts(Case):
    def test_json(self):
        layouts = {l["name"]: l for l in self.json("layouts")["layouts"]}
        self.assertAlmostEqual(layouts["cube"]["sampling_requirement"], 24, delta=1e-3)
        self.assertAlmostEqual(layouts["cube"]["anisotropy"], 3**0.5, delta=1e-3)
        self.assertAlmostEqual(layouts["latlong"]["sampling_requirement"], 19.739, delta=1e-3)
        self.assertIsNone(layouts["latlong"]["anisotropy"])
        self.assertIsNone(layouts["sphere-map"]["sampling_requirement"])
        self.assertEqual([f["name"] for f in layouts["cube"]["faces"]], ["px", "nx", "py", "ny", "pz", "nz"])

    def test_table(self):
        lines = self.run_tool("layouts").out.splitlines()
        self.assertTrue(lines[0].startswith("name"))
        self.assertIn(" inf ", self.out)
        names = [layout["name"] for layout in self.json("layouts")["layouts"]]
        self.assertEqual([line.split()[0] for line in lines[1:]], names)

    def test_named(self):
        out = self.run_tool("layouts", "cube", "octahedral").out
        self.assertIn("px nx py ny pz nz", out)
        self.assertEqual(len(self.json("layouts", "cube", "octahedral")["layouts"]), 2)


if __name__ == "__main__":
    unittest.main()
