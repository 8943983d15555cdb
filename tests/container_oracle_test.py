# SPDX-License-Identifier: Apache-2.0
"""Maps of directions in DDS, KTX and KTX2, read by texture_reader.py, which knows the specifications and not our code.

CONTAINER_SAMPLES names the program that writes every layout in every format at all levels; frames are tried through
the command line.  A colour is 0.5 + 0.45 (x, y, z) of the direction that the texel should hold.
"""
import math
import os
import pathlib
import shutil
import struct
import subprocess
import tempfile
import unittest

import texture_reader
from harness import SANITIZED, Case, direction, write_exr

PACKAGES = {"nvddsinfo": "libnvtt-bin", "zstd": "zstd"}
CUBE_MAPS = ("cube", "isocube", "equi-angular-cube")
TYPES = ("half", "float", "uint8", "r11g11b10f", "rgb9e5", "bc6h")
CONTAINERS = ("dds", "ktx", "ktx2", "zstd.ktx2", "zlib.ktx2")
# The largest step of the type below 1, halved, and a little for what follows the curve of sRGB or several channels.
STEPS = {"half": 2**-11, "float": 0, "uint8": 0.0045, "r11g11b10f": 2**-6, "rgb9e5": 2**-9 * 0.96}

# Right, up and forward of the panorama in the consumer's axes: the geometry contract, section "One frame", as the
# consumer's x, y, z in terms of right, up, forward.
FRAMES = {
    "world": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "opengl": ((1, 0, 0), (0, 1, 0), (0, 0, -1)),
    "openexr": ((-1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "three": ((0, 0, 1), (0, 1, 0), (1, 0, 0)),
    "blender": ((0, 0, 1), (-1, 0, 0), (0, 1, 0)),
    "unity": ((0, 0, 1), (0, 1, 0), (-1, 0, 0)),
    "unreal": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
    "renderman": ((0, 0, 1), (1, 0, 0), (0, 1, 0)),
}


def setUpModule():
    for program, package in PACKAGES.items():
        if not shutil.which(program):
            raise AssertionError(f"{program} is not installed (package {package}); 'tools/setup.sh test' installs it")


def cube_direction(face, s, t):
    """Table "Cube map face selection" of OpenGL and Vulkan; s, t in [-1, 1], the first row at t = -1.  Not unit."""
    return ((1, -t, -s), (-1, -t, s), (s, 1, t), (s, -1, -t), (s, -t, 1), (-s, -t, -1))[face]


def equi_angular(face, s, t):
    return cube_direction(face, math.tan(s * math.pi / 4), math.tan(t * math.pi / 4))


def isocube(face, s, t):
    """Wan, Wong & Leung, appendix C, solved for the direction: on the equator y = 2/3 Qy and the azimuth is linear
    along each row; on a cap 3 (1 - |y|) = c^2 where c is the larger of |Qx| and |Qz|."""
    x, y, z = cube_direction(face, s, t)
    if face in (2, 3):
        c = max(abs(x), abs(z))
        height = math.copysign(1 - c * c / 3, y)
    else:
        c = 1
        height = 2 * y / 3
    if c == 0:
        return 0, height, 0
    # Quarter turns from +X towards +Z: 2 phi c is the coordinate along the side of the square.
    if x >= abs(z):
        phi = z / (2 * c)
    elif z >= abs(x):
        phi = 1 - x / (2 * c)
    elif -x >= abs(z):
        phi = 2 - z / (2 * c)
    else:
        phi = 3 + x / (2 * c)
    radius = math.sqrt(1 - height * height)
    return radius * math.cos(phi * math.pi / 2), height, radius * math.sin(phi * math.pi / 2)


FORMULAS = {"cube": cube_direction, "equi-angular-cube": equi_angular, "isocube": isocube}


def color(d):
    length = math.sqrt(sum(v * v for v in d))
    return tuple(0.5 + 0.45 * v / length for v in d)


class Samples(Case):
    """What the library writes."""

    @classmethod
    def setUpClass(cls):
        cls.samples = pathlib.Path(tempfile.mkdtemp(prefix="envconv-containers-"))
        cls.addClassCleanup(shutil.rmtree, cls.samples)
        subprocess.run([os.environ["CONTAINER_SAMPLES"], cls.samples], check=True, timeout=3000 if SANITIZED else 600)
        cls.layouts = sorted(p.stem for p in cls.samples.glob("*.expected"))

    def expected(self, layout):
        """Levels of pictures, (width, height, texels)."""
        data, at, pictures = (self.samples / f"{layout}.expected").read_bytes(), 0, []
        while at < len(data):
            width, height = struct.unpack_from("<ii", data, at)
            values = struct.unpack_from(f"<{3 * width * height}f", data, at + 8)
            pictures.append((width, height, list(zip(*[iter(values)] * 3))))
            at += 8 + 12 * width * height
        levels = []
        for p in pictures:
            if not levels or levels[-1][0][:2] != p[:2]:
                levels.append([])
            levels[-1].append(p)
        return levels

    def check(self, texture, expected, where):
        self.assertEqual(len(texture.levels), len(expected), where)
        for level, pictures in enumerate(expected):
            self.assertEqual(len(texture.levels[level]), len(pictures), where)
            for i, (width, height, texels) in enumerate(pictures):
                got = texture.levels[level][i]
                self.assertEqual((got.width, got.height), (width, height), where)
                if texture.format == "bc6h":
                    continue
                worst = max(abs(a - b) for t, u in zip(got.texels, texels) for a, b in zip(t, u))
                self.assertLessEqual(worst, STEPS[texture.format] + 1e-6, f"{where}, level {level}, picture {i}")

    def test_every_layout_in_every_format(self):
        self.assertGreaterEqual(len(self.layouts), 20)
        for layout in self.layouts:
            expected = self.expected(layout)
            for kind in TYPES:
                for container in CONTAINERS:
                    where = f"{layout}.{kind}.{container}"
                    texture = texture_reader.read(self.samples / where)
                    self.assertEqual(texture.format, kind, where)
                    self.assertEqual(texture.cube, layout in CUBE_MAPS, where)
                    if container == "dds":
                        self.assertEqual(texture.keys["note"], f"ENVC{layout}")
                    else:
                        self.assertEqual(texture.keys["envconv:layout"], layout)
                    self.check(texture, expected, where)

    def test_cube_maps_by_their_own_formulas(self):
        for layout, formula in FORMULAS.items():
            for container in CONTAINERS:
                texture = texture_reader.read(self.samples / f"{layout}.float.{container}")
                self.assertEqual(len(texture.levels), 3)
                for level in texture.levels:
                    for face, picture in enumerate(level):
                        n = picture.width
                        for i, got in enumerate(picture.texels):
                            s, t = (2 * (i % n) + 1) / n - 1, (2 * (i // n) + 1) / n - 1
                            for a, b in zip(got, color(formula(face, s, t))):
                                self.assertAlmostEqual(a, b, delta=1e-6, msg=f"{layout} {container} {face} {s} {t}")

    def test_headers_as_nvidias_tool_reads_them(self):
        for layout in ("cube", "tennis-ball"):
            for kind, dxgi in (("half", 10), ("float", 2), ("uint8", 29), ("bc6h", 95)):
                done = subprocess.run(
                    ["nvddsinfo", self.samples / f"{layout}.{kind}.dds"], capture_output=True, text=True, timeout=60
                )
                lines = [line.strip() for line in done.stdout.splitlines()]
                width, levels = (6, 3) if layout == "cube" else (18, 5)
                wanted = ["Height: 6", f"Width: {width}", f"Mipmap count: {levels}", "FourCC: 'DX10'"]
                wanted += ["DDSCAPS_COMPLEX", "DDSCAPS_TEXTURE", "DDSCAPS_MIPMAP"]
                if layout == "cube":
                    wanted += ["DDSCAPS2_CUBEMAP_ALL_FACES", "Misc flag: 4", "Array size: 1"]
                else:
                    wanted += ["Misc flag: 0", "Array size: 2"]
                for line in wanted:
                    self.assertIn(line, lines, done.stdout)
                self.assertTrue(any(line.startswith(f"DXGI Format: {dxgi} ") for line in lines), done.stdout)


class Frames(Case):
    """What the tool writes for other axes: the table holds in the consumer's."""

    def test_every_frame(self):
        write_exr(self.path("in.exr"), 128, 64, lambda x, y: color(direction(x, y, 128, 64)))
        for frame, axes in FRAMES.items():
            for container in ("dds", "ktx2", "ktx"):
                name = f"{frame}.{container}"
                self.run_tool("convert", "in.exr", "-o", name, "--size", 8, "--frame", frame, "--type", "float")
                texture = texture_reader.read(self.path(name))
                self.assertTrue(texture.cube)
                for face, picture in enumerate(texture.levels[0]):
                    for i, got in enumerate(picture.texels):
                        s, t = (2 * (i % 8) + 1) / 8 - 1, (2 * (i // 8) + 1) / 8 - 1
                        consumer = cube_direction(face, s, t)
                        # right = the sum of the consumer's coordinates, each with its own share of right ...
                        world = [sum(consumer[k] * axes[k][j] for k in range(3)) for j in range(3)]
                        for a, b in zip(got, color(world)):
                            self.assertAlmostEqual(a, b, delta=0.02, msg=f"{name}, face {face}, texel {i}")


class ThroughTheTool(Case):
    """Reading back what it wrote."""

    def setUp(self):
        super().setUp()
        write_exr(self.path("in.exr"), 64, 32, lambda x, y: color(direction(x, y, 64, 32)))

    def test_recognised(self):
        cases = [("cube", "dds"), ("isocube", "dds"), ("isocube", "ktx2"), ("tennis-ball", "ktx2"), ("healpix", "ktx"),
                 ("octahedral", "ktx2"), ("diamond-30", "dds"), ("polar-capped", "ktx2"), ("openexr-cube", "dds")]
        for layout, container in cases:
            name = f"{layout}.{container}"
            self.run_tool("convert", "in.exr", "-o", name, "--to", layout, "--size", 16, "--frame", "three", "--verify")
            info = self.json("info", name)
            self.assertEqual((info["layout"], info["frame"]), (layout, "three"), name)
            self.run_tool("convert", name, "-o", "back.dds", "--to", "latlong", "--size", 32, "--type", "float")
            picture = texture_reader.read(self.path("back.dds")).levels[0][0]
            for i, got in enumerate(picture.texels):
                for a, b in zip(got, color(direction(i % 64, i // 64, 64, 32))):
                    self.assertAlmostEqual(a, b, delta=0.06, msg=f"{name}, texel {i}")

    def test_without_metadata(self):
        def strip(name):
            data = bytearray(self.path(name).read_bytes())
            data[32:76] = bytes(44)
            self.path(name).write_bytes(data)

        for layout in ("cube", "diamond-8", "diamond-30", "tennis-ball"):
            self.run_tool("convert", "in.exr", "-o", "a.dds", "--to", layout, "--size", 4)
            strip("a.dds")
            self.assertEqual(self.json("info", "a.dds")["layout"], layout)
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--to", "healpix", "--size", 4)
        strip("a.dds")
        self.run_tool("convert", "a.dds", "-o", "b.exr", expect=3)
        self.says("a.dds: holds 12 pictures", "diamond-12, healpix", "--from")
        self.run_tool("convert", "a.dds", "-o", "b.exr", "--from", "healpix")

    def test_refusals(self):
        self.run_tool("convert", "in.exr", "-o", "a.exr", "--type", "bc6h", expect=5)
        self.says("cannot hold bc6h")
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--compression", "zstd", expect=5)
        self.says("no compression")
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--to", "polar-capped", "--packing", "parts", expect=5)
        self.says("differ in size")
        self.path("cut.ktx2").write_bytes(b"\xabKTX 20\xbb\r\n\x1a\n" + bytes(20))
        self.run_tool("convert", "cut.ktx2", "-o", "b.exr", expect=3)
        self.says("cut.ktx2: truncated")
        self.assertEqual(self.err.count("\n"), 1)
        self.assertEqual(self.files(), ["cut.ktx2", "in.exr"])

    def test_a_folder_and_face_files(self):
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--size", 4)
        self.path("out").mkdir()
        self.run_tool("convert", "a.dds", "-o", "out/")
        self.assertTrue(texture_reader.read(self.path("out/a.dds")).cube)
        self.run_tool("convert", "in.exr", "-o", "f_{face}.dds", "--size", 4)
        self.assertEqual(len(texture_reader.read(self.path("f_nz.dds")).levels[0]), 1)
        self.run_tool("convert", "f_nz.dds", "-o", "b.exr", expect=3)
        self.says("one face of the 6 of cube")
        self.assertEqual(self.json("info", "f_{face}.dds")["layout"], "cube")

    def test_whole_blocks(self):
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--type", "half")
        size = texture_reader.read(self.path("a.dds")).levels[0][0].width
        self.assertNotEqual(size % 4, 0, "the test needs another input")
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--type", "bc6h").is_silent()
        self.assertEqual(texture_reader.read(self.path("a.dds")).levels[0][0].width, size + -size % 4)
        self.run_tool("convert", "in.exr", "-o", "a.dds", "--type", "bc6h", "--size", 6)
        self.says("multiples of 4")

    def test_packings_make_one_picture(self):
        self.run_tool("convert", "in.exr", "-o", "cross.ktx2", "--packing", "cross", "--size", 8, "--type", "half")
        texture = texture_reader.read(self.path("cross.ktx2"))
        self.assertFalse(texture.cube)
        self.assertEqual([(p.width, p.height) for p in texture.levels[0]], [(32, 24)])
        self.assertEqual(self.json("info", "cross.ktx2")["packing"], "cross")


if __name__ == "__main__":
    unittest.main()
