# SPDX-License-Identifier: Apache-2.0
"""The same input through envconv and through other programs: exrenvmap (OpenEXR) and the filter v360 of ffmpeg.

The input's colours are directions, 0.5 + 0.45 (x, y, z), so each texel of an output tells which direction its program
believes to be there.  Errors are angles between two such directions in texels: divided by the angle to the texel's
neighbour, the farther one of those across and down.
"""
import array
import collections
import math
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

from harness import Case, write_exr, write_png_rows

PACKAGES = {"exrenvmap": "openexr", "ffmpeg": "ffmpeg"}
# Within (0, 1): at the largest code the filter's interpolation overflows.
OFFSET, SCALE = 0.5, 0.45

Picture = collections.namedtuple("Picture", "width height directions")  # row by row
Error = collections.namedtuple("Error", "worst usual")  # usual: the 99th percentile


def setUpModule():
    for program, package in PACKAGES.items():
        if not shutil.which(program):
            raise AssertionError(f"{program} is not installed (package {package}); 'tools/setup.sh test' installs it")


def decode(red, green, blue, unit):
    """Directions of planes of colours, where `unit` is the code of 1."""
    for rgb in zip(red, green, blue):
        x, y, z = ((c / unit - OFFSET) / SCALE for c in rgb)
        length = math.sqrt(x * x + y * y + z * z) or 1
        yield (x / length, y / length, z / length)


def latlong_direction(u, v):
    """The geometry contract, once more."""
    longitude, polar = 2 * math.pi * (u - 0.5), math.pi * v
    return (math.sin(polar) * math.sin(longitude), math.cos(polar), math.sin(polar) * math.cos(longitude))


def latlong(width, height, inclusive=False):
    """The right answer of a latlong: centres inside the image, or on the poles and on both ends of the seam."""
    if inclusive:
        centres = [(i / (width - 1), j / (height - 1)) for j in range(height) for i in range(width)]
    else:
        centres = [((i + 0.5) / width, (j + 0.5) / height) for j in range(height) for i in range(width)]
    return Picture(width, height, [latlong_direction(u, v) for u, v in centres])


def write_source_png(path, width, height):
    """A latlong of directions with 16 bits."""
    columns = [2 * math.pi * ((i + 0.5) / width - 0.5) for i in range(width)]
    sines, cosines = [math.sin(a) for a in columns], [math.cos(a) for a in columns]
    rows = []
    for j in range(height):
        polar = math.pi * (j + 0.5) / height
        scale, offset = 65535 * SCALE, 65535 * OFFSET + 0.5
        radius = scale * math.sin(polar)
        row = array.array("H", bytes(6 * width))
        row[0::3] = array.array("H", [int(offset + radius * s) for s in sines])
        row[1::3] = array.array("H", [int(offset + scale * math.cos(polar))] * width)
        row[2::3] = array.array("H", [int(offset + radius * c) for c in cosines])
        if sys.byteorder == "little":
            row.byteswap()
        rows.append(row.tobytes())
    write_png_rows(path, width, height, rows, bits=16)


def angle(a, b):
    """Between unit vectors; exact for small angles too."""
    return 2 * math.asin(min(1, math.dist(a, b) / 2))


def texel_angles(picture, columns=1, rows=1):
    """For each texel the angle to its farther neighbour in its own face; faces lie in a grid."""
    width, height, d = picture
    face_width, face_height = width // columns, height // rows
    sizes = []
    for j in range(height):
        down = width if (j + 1) % face_height else -width
        for i in range(width):
            across = 1 if (i + 1) % face_width else -1
            at = j * width + i
            sizes.append(max(angle(d[at], d[at + across]), angle(d[at], d[at + down])))
    return sizes


def compare(ours, theirs, sizes, inside=None):
    """Error of texels for which `inside` holds, a list of booleans."""
    errors = sorted(angle(a, b) / size for k, (a, b, size) in enumerate(zip(ours.directions, theirs.directions, sizes))
                    if inside is None or inside[k])
    return Error(errors[-1], errors[len(errors) * 99 // 100])


def disc(size, rim):
    """Which texels of a square image lie in its disc, at least `rim` texels from its edge."""
    middle = (size - 1) / 2
    return [math.hypot(i - middle, j - middle) <= size / 2 - rim for j in range(size) for i in range(size)]


def without_poles(picture):
    """All but two rows at each pole: a texel there is a wedge, its mean up to a sixth of a texel off its middle."""
    return [2 <= k // picture.width < picture.height - 2 for k in range(picture.width * picture.height)]


def blocks(picture, size):
    """Each texel is the mean of a block of size x size."""
    if size == 1:
        return picture
    width, height, d = picture.width // size, picture.height // size, picture.directions
    means = []
    for j in range(height):
        for i in range(width):
            at = j * size * picture.width + i * size
            block = [v for k in range(size) for v in d[at + k * picture.width : at + k * picture.width + size]]
            total = [sum(axis) for axis in zip(*block)]
            length = math.hypot(*total) or 1
            means.append(tuple(c / length for c in total))
    return Picture(width, height, means)


def spoilt(picture):
    """What a wrong program could have answered."""
    width, height, d = picture
    lines = [d[at : at + width] for at in range(0, width * height, width)]
    yield "mirrored", Picture(width, height, [v for line in lines for v in reversed(line)])
    yield "upside down", Picture(width, height, [v for line in reversed(lines) for v in line])
    yield "one texel to the right", Picture(width, height, [v for line in lines for v in line[-1:] + line[:-1]])
    yield "one texel down", Picture(width, height, [v for line in lines[-1:] + lines[:-1] for v in line])


class OracleCase(Case):
    def run_other(self, *words):
        done = subprocess.run([*map(str, words)], cwd=self.folder, capture_output=True, timeout=120)
        self.assertEqual(done.returncode, 0, f"{words}\n{done.stderr.decode(errors='replace')}")
        return done.stdout

    def ffmpeg(self, *words):
        return self.run_other("ffmpeg", "-nostdin", "-v", "error", "-y", *words)

    def read(self, name, width, height):
        """A picture, read by ffmpeg whoever wrote it."""
        exr = name.endswith(".exr")
        data = self.ffmpeg("-i", name, "-f", "rawvideo", "-pix_fmt", "gbrpf32le" if exr else "rgb48le", "-")
        values = array.array("f" if exr else "H", data)
        if sys.byteorder == "big":
            values.byteswap()
        count = width * height
        self.assertEqual(len(values), 3 * count, f"{name} is not {width} x {height}")
        if exr:
            green, blue, red = (values[at : at + count] for at in (0, count, 2 * count))
            return Picture(width, height, list(decode(red, green, blue, 1)))
        return Picture(width, height, list(decode(values[0::3], values[1::3], values[2::3], 65535)))

    def check(self, label, ours, theirs, sizes, worst, usual, inside=None):
        """Both agree, and would not if `theirs` were another picture."""
        error = compare(ours, theirs, sizes, inside)
        print(f"{label}: 99 % within {error.usual:.3f} texel, worst {error.worst:.3f}", flush=True)
        self.assertLess(error.usual, usual, label)
        self.assertLess(error.worst, worst, label)
        for fault, picture in spoilt(theirs):
            noticed = compare(ours, picture, sizes, inside)
            self.assertGreater(noticed.usual, 2 * usual, f"{label}: would pass {fault}")
            self.assertGreater(noticed.worst, 2 * worst, f"{label}: would pass {fault}")


class Exrenvmap(OracleCase):
    """OpenEXR's own converter; a tiny filter makes its texels samples."""

    SHARP = ("-f", 0.01, 3)
    FACE = 64
    # Its outputs are half floats: half a code is up to 0.03 degrees in each of x, y and z.
    TOLERANCE = {"worst": 0.1, "usual": 0.08}

    def setUp(self):
        super().setUp()
        # As ImfEnvmap.h has it: the outermost centres are the poles and both ends of the seam.
        width, height = 512, 256
        write_exr(self.path("in.exr"), width, height,
                  lambda x, y: (OFFSET + SCALE * c for c in latlong_direction(x / (width - 1), y / (height - 1))),
                  attributes={"envmap": ("envmap", b"\0")})

    def check_cube(self, label, ours, theirs):
        ours, theirs = (self.read(name, self.FACE, 6 * self.FACE) for name in (ours, theirs))
        self.check(label, ours, theirs, texel_angles(ours, rows=6), **self.TOLERANCE)

    def check_latlong(self, label, ours, theirs):
        sizes = [math.pi / theirs.height] * len(theirs.directions)
        self.check(label, ours, theirs, sizes, inside=without_poles(theirs), **self.TOLERANCE)

    def test_latlong_to_cube(self):
        self.run_tool("convert", "in.exr", "-o", "ours.exr", "--to", "openexr-cube", "--size", self.FACE)
        self.run_other("exrenvmap", "-c", "-w", self.FACE, *self.SHARP, "in.exr", "theirs.exr")
        self.check_cube("exrenvmap -c", "ours.exr", "theirs.exr")

    def test_cube_to_latlong(self):
        self.run_tool("convert", "in.exr", "-o", "cube.exr", "--to", "openexr-cube", "--size", self.FACE)
        self.run_tool("convert", "cube.exr", "-o", "ours.exr", "--to", "latlong-inclusive", "--size", 128)
        self.run_other("exrenvmap", "-l", "-w", 256, *self.SHARP, "cube.exr", "theirs.exr")
        ours, theirs = (self.read(name, 256, 128) for name in ("ours.exr", "theirs.exr"))
        self.check_latlong("exrenvmap -l", ours, theirs)
        self.check_latlong("exrenvmap -l, against the truth", latlong(256, 128, inclusive=True), theirs)

    def test_our_latlong_is_its_input(self):
        self.run_tool("convert", "in.exr", "-o", "ours.exr", "--to", "latlong-inclusive", "--size", 128)
        self.run_other("exrenvmap", "-c", "-w", self.FACE, *self.SHARP, "ours.exr", "theirs.exr")
        self.run_tool("convert", "ours.exr", "-o", "cube.exr", "--to", "openexr-cube", "--size", self.FACE)
        self.check_cube("exrenvmap -c of our latlong-inclusive", "cube.exr", "theirs.exr")

    def test_its_outputs_are_our_input(self):
        self.run_other("exrenvmap", "-c", "-w", self.FACE, *self.SHARP, "in.exr", "cube.exr")
        self.run_other("exrenvmap", "-l", "-w", 256, *self.SHARP, "in.exr", "latlong.exr")
        for name, layout in (("cube.exr", "openexr-cube"), ("latlong.exr", "latlong-inclusive")):
            with self.subTest(layout):
                self.assertEqual(self.json("info", name)["layout"], layout)
                self.run_tool("convert", name, "-o", "plain.exr", "--to", "latlong", "--size", 128)
                self.check_latlong(f"exrenvmap's {layout}, read", self.read("plain.exr", 256, 128), latlong(256, 128))

    def test_the_placement_of_texels_shows(self):
        """Half a texel at the edges is all that tells one placement from the other."""
        self.run_other("exrenvmap", "-l", "-w", 256, *self.SHARP, "in.exr", "theirs.exr")
        theirs = self.read("theirs.exr", 256, 128)
        sizes = [math.pi / 128] * (256 * 128)
        self.assertLess(compare(latlong(256, 128, inclusive=True), theirs, sizes).worst, self.TOLERANCE["worst"])
        self.assertGreater(compare(latlong(256, 128), theirs, sizes).worst, 4 * self.TOLERANCE["worst"])


class V360(OracleCase):
    """ffmpeg's filter samples its input half a texel off: texel i is at u = i/W, not (i + 1/2)/W.  So the input is
    large: that offset of up to 0.12 degrees is less than a tenth of a texel of an output.

    Its outputs hold samples and ours means over texels, which differ where a picture is creased, and it places the
    texels of some outputs up to half a texel off: those are asked for larger, and each texel is the mean of a block.
    """

    HEIGHT = 1024
    FACE = 64
    # Of each, 0.09 is the input's offset.
    TOLERANCE = {"worst": 0.15, "usual": 0.13}

    @classmethod
    def setUpClass(cls):
        folder = pathlib.Path(tempfile.mkdtemp(prefix="envconv-oracle-"))
        cls.addClassCleanup(shutil.rmtree, folder)
        cls.source = folder / "in.png"
        write_source_png(cls.source, 2 * cls.HEIGHT, cls.HEIGHT)

    def convert(self, layout, packing, *words, face=FACE):
        output = "{face}.png" if packing == "files" else "ours.png"
        self.run_tool("convert", self.source, "-o", output, "--to", layout, "--packing", packing, "--size", face,
                      *words)

    def v360(self, output, width, height, *options, then=""):
        """Writes theirs.png."""
        words = ":".join((f"e:{output}", "interp=linear", f"w={width}", f"h={height}", *options))
        self.ffmpeg("-i", self.source, "-vf", f"format=rgb48le,v360={words}{then}", "-pix_fmt", "rgb48be", "theirs.png")

    def check_output(self, output, *options, label="", name="ours.png", columns=1, rows=1, face=FACE, block=1,
                     pad=(0, 0), then="", inside=None):
        """Ours and theirs, `columns` x `rows` faces in a grid."""
        width, height = columns * face, rows * face
        self.v360(output, block * width + pad[0], block * height + pad[1], *options, then=then)
        ours = self.read(name, width, height)
        theirs = blocks(self.read("theirs.png", block * width, block * height), block)
        self.check(f"v360 {label or output}", ours, theirs, texel_angles(ours, columns, rows), inside=inside,
                   **self.TOLERANCE)

    def check_reading(self, label, layout, packing):
        """theirs.png, read, has the right directions; in texels of a face."""
        self.run_tool("convert", "theirs.png", "-o", "back.png", "--from", layout, "--from-packing", packing,
                      "--to", "latlong", "--size", 128)
        right = latlong(256, 128)
        self.check(f"v360 {label}, read", self.read("back.png", 256, 128), right,
                   [math.pi / 2 / self.FACE] * len(right.directions), inside=without_poles(right), **self.TOLERANCE)

    def test_latlong(self):
        self.convert("latlong", "row", face=128)
        self.check_output("e", columns=2, face=128, block=4)

    def test_cube(self):
        for output, packing, columns, rows in (("c6x1", "row", 6, 1), ("c1x6", "column", 1, 6), ("c3x2", "grid", 3, 2)):
            with self.subTest(output):
                self.convert("cube", packing)
                self.check_output(output, columns=columns, rows=rows)
                self.check_reading(output, "cube", packing)

    def test_equi_angular_cube(self):
        self.convert("equi-angular-cube", "youtube")
        # Two texels of padding around each row of faces.
        n = self.FACE
        then = f",split[a][b];[a]crop={3 * n}:{n}:2:2[top];[b]crop={3 * n}:{n}:2:{n + 6}[bottom];[top][bottom]vstack"
        self.check_output("eac", columns=3, rows=2, pad=(4, 8), then=then)
        self.check_reading("eac", "equi-angular-cube", "youtube")

    def test_octahedral(self):
        self.convert("octahedral", "row", face=128)
        self.check_output("octahedron", face=128, block=4)

    def test_balls(self):
        # Each of the outermost texels holds many directions.
        inside = disc(128, 2)
        self.convert("sphere-map", "row", face=128)
        self.check_output("ball", face=128, inside=inside)
        # A mirror shows what is behind the camera, with its right on the right.
        self.convert("mirror-ball", "row", face=128)
        self.check_output("ball", "d_flip=1", label="ball of what is behind", face=128, inside=inside)

    def test_angular_map(self):
        self.convert("angular-map", "row", face=128)
        self.check_output("fisheye", "h_fov=360", "v_fov=360", label="fisheye of 360 degrees", face=128, block=4,
                          inside=disc(128, 1))

    def test_hemispheres(self):
        for layout, output in (("dual-equidistant", "fisheye"), ("paraboloid", "sg")):
            self.convert(layout, "files")
            for face, yaw in (("front", 0), ("back", 180)):
                with self.subTest(layout, face=face):
                    self.check_output(output, "h_fov=180", "v_fov=180", f"yaw={yaw}", label=f"{output}, {face}",
                                      name=f"{face}.png", block=4, inside=disc(self.FACE, 0))

    def test_polar_caps(self):
        self.convert("polar-capped", "files")
        for face, pitch in (("north", 90), ("south", -90)):
            with self.subTest(face):
                self.check_output("fisheye", "h_fov=90", "v_fov=90", f"pitch={pitch}", label=f"fisheye, {face}",
                                  name=f"{face}.png", block=4, inside=disc(self.FACE, 0))

    def test_rotation(self):
        # Theirs turns the camera, ours the environment: the angles' signs and order are the inverse's.
        self.convert("cube", "grid", "--rotate=30,20,-50")
        self.check_output("c3x2", "yaw=-30", "pitch=20", "roll=-50", "rorder=rpy", label="c3x2, turned", columns=3,
                          rows=2)

    def test_half_a_texel_shows(self):
        self.convert("cube", "grid")
        ours = self.read("ours.png", 3 * self.FACE, 2 * self.FACE)
        self.v360("c3x2", ours.width, ours.height, "yaw=0.7")
        theirs = self.read("theirs.png", ours.width, ours.height)
        error = compare(ours, theirs, texel_angles(ours, 3, 2))
        self.assertGreater(error.usual, 2 * self.TOLERANCE["usual"])


if __name__ == "__main__":
    unittest.main()
