# SPDX-License-Identifier: Apache-2.0
"""envconv analyze."""
import math
import unittest
import xml.etree.ElementTree as ElementTree

from harness import Case

# Herron, table 1, as printed (16.57 is cut off there to 16.5); None: infinite.
TABLE_1 = {
    "tennis-ball": ("14.80", "1.41"),
    "polar-capped": ("14.80", "1.41"),
    "dual-equidistant": ("19.7", "1.57"),
    "latlong": ("19.7", None),
    "cube": ("24", "1.73"),
    "paraboloid": ("32", "1"),
    "sphere-map": (None, None),
}


class Analyze(Case):
    def test_published_rows(self):
        rows = {row["name"]: row for row in self.json("analyze")["layouts"]}
        for name, published in TABLE_1.items():
            for key, printed in zip(("sampling_requirement", "anisotropy"), published):
                value = rows[name][key]
                if printed is None:
                    self.assertIsNone(value, (name, key))
                else:
                    digits = len(printed.partition(".")[2])
                    self.assertEqual(f"{value:.{digits}f}", f"{float(printed):.{digits}f}", (name, key))

    def test_keys_are_those_of_layouts(self):
        measured = self.json("analyze", "isocube", "latlong")["layouts"]
        listed = self.json("layouts", "isocube", "latlong")["layouts"]
        for ours, theirs in zip(measured, listed):
            for key in ("name", "sampling_requirement", "anisotropy", "texel_ratio"):
                self.assertEqual(ours[key], theirs[key])
        self.assertEqual([row["name"] for row in measured], ["isocube", "latlong"])

    def test_texels(self):
        row = self.json("analyze", "cube", "--size", 2)["layouts"][0]
        self.assertEqual((row["size"], row["texels"], row["used_texels"], row["used_share"]), (2, 24, 24, 1))
        # Four texels to a face, alike.
        self.assertAlmostEqual(row["smallest_texel"], 4 * math.pi / 24, delta=1e-6)
        self.assertAlmostEqual(row["largest_texel"], 4 * math.pi / 24, delta=1e-6)
        # Centres (1/2, 1/2, 1): cos = 1/2 + 1/4 over 3/2 on a face, (1 / 4 + 2 / 2) over 3/2 over an edge.
        inside, across = math.degrees(math.acos(2 / 3)), math.degrees(math.acos(1.25 / 1.5))
        self.assertAlmostEqual(row["largest_distance"], max(inside, across), delta=1e-9)
        self.assertAlmostEqual(row["mean_distance"], (inside + across) / 2, delta=1e-9)

    def test_texels_option_takes_suffixes(self):
        row = self.json("analyze", "cube", "--texels", "6k")["layouts"][0]
        self.assertEqual((row["size"], row["texels"]), (31, 5766))

    def test_order_of_discrepancies(self):
        rows = self.json("analyze", "cube", "isocube", "healpix", "--texels", "20k")["layouts"]
        cube, isocube, healpix = (row["discrepancy"] * row["texels"] ** 0.75 for row in rows)
        self.assertGreater(cube, 3 * isocube)
        self.assertAlmostEqual(isocube / healpix, 1, delta=0.05)
        for row in rows:
            self.assertLess(row["discrepancy_error"], 1e-4 * row["discrepancy"])

    def test_table(self):
        out = self.run_tool("analyze", "isocube", "sphere-map").out
        lines = out.splitlines()
        self.assertEqual(len(lines), 3)
        self.assertIn("discrepancy", lines[0])
        self.assertIn(" inf ", lines[2])
        self.assertEqual(out, self.run_tool("analyze", "isocube", "sphere-map").out)

    def test_plot(self):
        self.run_tool("analyze", "cube", "isocube", "--texels", "3k", "--plot", "d.svg")
        first = self.path("d.svg").read_text()
        ElementTree.fromstring(first)
        for text in ("cube", "isocube", "points", "discrepancy"):
            self.assertIn(text, first)
        self.run_tool("analyze", "cube", "isocube", "--texels", "3k", "--plot", "e.svg")
        self.assertEqual(first, self.path("e.svg").read_text())
        self.run_tool("analyze", "cube", "--plot", "no/d.svg", expect=4).says("no/d.svg")

    def test_picture(self):
        self.run_tool("analyze", "isocube", "--picture", "p.png")
        info = self.json("info", "p.png")
        self.assertGreater(info["width"], info["height"])
        # The anisotropy varies, the density does not: both in one picture, which is neither black nor white.
        mean = [c["max"] for c in info["channels"]]
        self.assertGreater(min(mean), 0.3)
        self.run_tool("analyze", "--picture", "p.png", expect=2).says("one layout")
        self.run_tool("analyze", "isocube", "--picture", "p.xyz", expect=5).says("p.xyz")

    def test_mistakes(self):
        self.run_tool("analyze", "isocub", expect=2).says("isocube")
        self.run_tool("analyze", "cube", "--size", 3, "--texels", 10, expect=2).says("--texels")
        self.run_tool("analyze", "cube", "--texels", "2G", expect=6).says("--texels")
        self.run_tool("analyze", "cube", "--size", 16000, expect=6).says("--size")


if __name__ == "__main__":
    unittest.main()
