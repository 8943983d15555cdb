# SPDX-License-Identifier: Apache-2.0
"""envconv info and envconv layouts."""
import json
import unittest

from harness import PANORAMAS, Case, write_constant, write_exr


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
