# SPDX-License-Identifier: Apache-2.0
"""envconv pattern."""
import math
import unittest

from harness import Case, direction, read_exr

PLAIN = ("--compression", "none")
KINDS = ("directions", "labels", "grid", "zoneplate", "noise", "constant", "sun")


class Pattern(Case):
    def pixels(self, name):
        width, height, channels, _ = read_exr(self.path(name))
        return width, height, channels

    def test_every_kind_is_recognised_again(self):
        for kind in KINDS:
            self.run_tool("pattern", kind, "--to", "isocube", "--size", 16, "--packing", "grid", "-o", f"{kind}.exr")
            info = self.json("info", f"{kind}.exr")
            self.assertEqual((info["layout"], info["packing"], info["size"]), ("isocube", "grid", 16), kind)
            self.assertIn("metadata", info["how"])
            self.assertEqual([c["nan"] + c["inf"] for c in info["channels"]], [0, 0, 0], kind)

    def test_directions_are_the_contracts(self):
        self.run_tool("pattern", "directions", "--to", "latlong", "--size", 32, "-o", "d.exr", *PLAIN).is_silent()
        width, height, channels = self.pixels("d.exr")
        self.assertEqual((width, height), (64, 32))
        self.check_directions(width, height, channels)

    def check_directions(self, width, height, channels):
        # Not next to the poles, where a texel's mean is not what its centre shows.
        for y in range(4, height - 4):
            for x in range(width):
                for c, wanted in zip("RGB", direction(x, y, width, height)):
                    self.assertAlmostEqual(channels[c][y][x], wanted, delta=0.005)

    def test_directions_follow_the_frame(self):
        # Whoever looks up a direction of its own axes, by the layout's formula, finds that direction.
        for frame in ("blender", "opengl", "unreal"):
            self.run_tool("pattern", "directions", "--to", "latlong", "--size", 32, "--frame", frame, "-o", "d.exr", *PLAIN)
            self.check_directions(*self.pixels("d.exr"))
            self.assertEqual(self.json("info", "d.exr")["frame"], frame)

    def test_constant(self):
        self.run_tool("pattern", "constant", "--to", "cube", "--size", 4, "--value", "1,2,0.5", "-o", "c.exr")
        self.assertEqual([c["mean"] for c in self.json("info", "c.exr")["channels"]], [1, 2, 0.5])
        self.run_tool("pattern", "constant", "--to", "cube", "--size", 4, "--value", "3", "-o", "c.exr")
        self.assertEqual([c["max"] for c in self.json("info", "c.exr")["channels"]], [3, 3, 3])

    def test_sun_energy(self):
        share = math.sin(math.radians(0.53 / 4)) ** 2
        for layout in ("cube", "latlong", "tennis-ball", "octahedral"):
            for where in ("0,1,0", "1,1,1", "0,0,-1"):
                self.run_tool("pattern", "sun", "--to", layout, "--size", 32, "--direction", where, "--radiance",
                              "1000,500,1", "--type", "float", "-o", "sun.exr")
                for channel, radiance in zip(self.json("info", "sun.exr")["channels"], (1000, 500, 1)):
                    self.assertAlmostEqual(channel["mean"] / (radiance * share), 1, delta=2e-6, msg=(layout, where))

    def test_noise_is_seeded(self):
        for name, seed in (("a", 1), ("b", 1), ("c", 7)):
            self.run_tool("pattern", "noise", "--to", "cube", "--size", 16, "--seed", seed, "-o", f"{name}.exr")
        a, b, c = (self.path(f"{name}.exr").read_bytes() for name in "abc")
        self.assertEqual(a, b)
        self.assertNotEqual(a, c)
        for channel in self.json("info", "a.exr")["channels"]:
            self.assertAlmostEqual(channel["mean"], 0.5, delta=1e-5)

    def test_files_of_faces(self):
        self.run_tool("pattern", "labels", "--size", 32, "-o", "{stem}_{face}.png").is_silent()
        self.assertEqual(self.files(), sorted(f"labels_{f}.png" for f in ("px", "nx", "py", "ny", "pz", "nz")))

    def test_texels_and_types(self):
        self.run_tool("pattern", "grid", "--to", "healpix", "--texels", "12k", "--type", "half", "-o", "g.exr")
        info = self.json("info", "g.exr")
        self.assertEqual((info["layout"], info["size"], info["type"]), ("healpix", 31, "half"))

    def test_rotation_is_recorded_and_done(self):
        self.run_tool("pattern", "sun", "--to", "latlong", "--size", 32, "--direction", "0,0,1", "--diameter", 20,
                      "--rotate", "90,0,0", "-o", "s.exr", *PLAIN)
        _, _, channels = self.pixels("s.exr")
        # What was ahead, in the middle, is on the right: three quarters of the width.
        self.assertEqual((channels["R"][16][48], channels["R"][16][32]), (1, 0))
        self.assertEqual(self.json("info", "s.exr")["rotation"], [90, 0, 0])

    def test_mistakes(self):
        self.run_tool("pattern", "label", "-o", "x.exr", expect=2).says("labels")
        self.run_tool("pattern", "labels", expect=2).says("--output")
        self.run_tool("pattern", "sun", "--diameter", "0", "--size", 4, "-o", "x.exr", expect=2).says("diameter")
        self.run_tool("pattern", "sun", "--direction", "0,0,0", "--size", 4, "-o", "x.exr", expect=2).says("direction")
        self.run_tool("pattern", "constant", "--value", "1,2", "-o", "x.exr", expect=2).says("--value")
        self.run_tool("pattern", "grid", "--to", "latlong", "--packing", "cross", "-o", "x.exr", expect=5).says("cross")
        self.run_tool("pattern", "grid", "--size", 4, "-o", "no/x.exr", expect=4).says("no/x.exr")
        self.assertEqual(self.files(), [])


if __name__ == "__main__":
    unittest.main()
