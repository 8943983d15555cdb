# SPDX-License-Identifier: Apache-2.0
"""Colour management and values that formats cannot hold, from outside."""
import json
import os
import shutil
import struct
import subprocess
import unittest

from harness import PANORAMAS, SOURCE, Case, read_exr, read_png, write_constant, write_exr, write_png

PLAIN = ("--to", "latlong", "--compression", "none", "--type", "float")
MAP = ("--to", "latlong")
REC709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)
AP1 = (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, 0.32168, 0.33767)
P3 = (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, 0.3127, 0.3290)

ADOBE = (0.64, 0.33, 0.21, 0.71, 0.15, 0.06, 0.3127, 0.3290)

# A configuration of one's own.
CONFIG = (SOURCE / "testdata/color/odd.ocio").read_text()


def srgb(v):
    return 12.92 * v if v <= 0.0031308 else 1.055 * v ** (1 / 2.4) - 0.055


def srgb_light(v):
    return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4


def solve(rows, wanted):
    """Cramer's rule for three unknowns."""
    def determinant(m):
        return sum(m[0][i] * (m[1][(i + 1) % 3] * m[2][(i + 2) % 3] - m[1][(i + 2) % 3] * m[2][(i + 1) % 3]) for i in range(3))

    return [determinant([[wanted[r] if c == k else rows[r][c] for c in range(3)] for r in range(3)]) / determinant(rows)
            for k in range(3)]


def icc_profile(xy, curve, blue=None, more=None):
    """Version 4, three colorants adapted to D50 by Bradford's matrix, and a curve (ICC.1:2022)."""
    def xyz(x, y):
        return (x / y, 1.0, (1 - x - y) / y)

    def times(matrix, v):
        return [sum(a * b for a, b in zip(row, v)) for row in matrix]

    bradford = ((0.8951, 0.2664, -0.1614), (-0.7502, 1.7135, 0.0367), (0.0389, -0.0685, 1.0296))
    d50, white = (0.9642, 1.0, 0.8249), xyz(*xy[6:])
    primaries = [xyz(*xy[2 * i : 2 * i + 2]) for i in range(3)]
    scale = solve([[p[r] for p in primaries] for r in range(3)], white) if len({p for p in primaries}) > 1 else (1, 1, 1)
    ratio = [a / b for a, b in zip(times(bradford, d50), times(bradford, white))]
    tags = {}
    for name, p, s in zip((b"rXYZ", b"gXYZ", b"bXYZ"), primaries, scale):
        adapted = solve(bradford, [a * b for a, b in zip(times(bradford, [s * v for v in p]), ratio)])
        tags[name] = b"XYZ \0\0\0\0" + struct.pack(">3i", *(round(v * 65536) for v in adapted))
    tags.update({b"rTRC": curve, b"gTRC": curve, b"bTRC": blue or curve, b"wtpt": b"XYZ \0\0\0\0" + struct.pack(">3i", 63190, 65536, 54061),
                 b"desc": b"mluc" + struct.pack(">III4sII", 0, 1, 12, b"enUS", 10, 28) + "sRGBx".encode("utf-16-be"), **(more or {})})
    table, data = b"", b""
    start = 132 + 12 * len(tags)
    for name, value in tags.items():
        table += struct.pack(">4sII", name, start + len(data), len(value))
        data += value + bytes(-len(value) % 4)
    size = start + len(data)
    head = struct.pack(">I4sI4s4s4s12s4s", size, b"test", 0x04300000, b"mntr", b"RGB ", b"XYZ ", bytes(12), b"acsp")
    return (head.ljust(68, b"\0") + struct.pack(">3i", 63190, 65536, 54061)).ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + data


def chromaticities(values):
    return ("chromaticities", struct.pack("<8f", *values))


def without_ocio(**more):
    return {**{k: v for k, v in os.environ.items() if not k.startswith("OCIO")}, **more}


class ColorCase(Case):
    def run_tool(self, *words, **options):
        options.setdefault("env", without_ocio())
        return super().run_tool(*words, **options)

    def constant(self, name, color, attributes=None):
        write_exr(self.path(name), 16, 8, lambda x, y: color, attributes=attributes)

    def color(self, name):
        channels = read_exr(self.path(name))[2]
        return tuple(channels[c][3][5] for c in "RGB")

    def check(self, got, wanted, delta):
        for a, b in zip(got, wanted):
            self.assertAlmostEqual(a, b, delta=delta)


class Conversions(ColorCase):
    def test_linear_spaces(self):
        self.constant("in.exr", (1.0, 0.0, 0.0))
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--out-colorspace", "ACEScg", *PLAIN).is_silent()
        self.check(self.color("out.exr"), (0.6131, 0.0702, 0.0206), 5e-5)
        # What was recorded leads back.
        self.run_tool("convert", "out.exr", "-o", "back.exr", "--out-colorspace", "lin_rec709", *PLAIN).is_silent()
        self.check(self.color("back.exr"), (1, 0, 0), 1e-6)

    def test_negative_and_large_values_survive(self):
        self.constant("in.exr", (-0.25, 60000.0, 3.0))
        self.run_tool("convert", "in.exr", "-o", "a.exr", "--out-colorspace", "aces2065_1", *PLAIN).is_silent()
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--out-colorspace", "scene_linear", *PLAIN).is_silent()
        self.check(self.color("b.exr"), (-0.25, 60000.0, 3.0), 0.02)

    def test_the_same_space_keeps_every_bit(self):
        shutil.copy(PANORAMAS / "venice.hdr", self.path("in.hdr"))
        self.run_tool("convert", "in.hdr", "-o", "a.exr", *PLAIN)
        self.run_tool("convert", "in.hdr", "-o", "b.exr", "--out-colorspace", "lin_rec709", *PLAIN)
        self.assertEqual(self.path("a.exr").read_bytes(), self.path("b.exr").read_bytes())

    def test_input_is_what_it_is_said_to_be(self):
        write_png(self.path("in.png"), 16, 8, lambda x, y: (128, 64, 32))
        for name, curve in (("g22_rec709", 2.2), ("g18_rec709", 1.8), ("g24_rec709", 2.4), ("Raw", 1.0),
                            ("lin_rec709", 1.0)):
            self.run_tool("convert", "in.png", "-o", "out.exr", "--in-colorspace", name, *PLAIN).is_silent()
            self.check(self.color("out.exr"), [(v / 255) ** curve for v in (128, 64, 32)], 1e-6)
        # Data stays what it is in integers, too.
        self.run_tool("convert", "in.png", "-o", "out.png", "--in-colorspace", "Raw", *MAP).is_silent()
        self.assertEqual(read_png(self.path("out.png"))[2][3][5], (128, 64, 32))
        self.run_tool("convert", "in.png", "-o", "a.exr", "--in-colorspace", "sRGB - Texture", *PLAIN)
        self.run_tool("convert", "in.png", "-o", "b.exr", *PLAIN)
        self.check(self.color("a.exr"), self.color("b.exr"), 1e-6)

    def test_a_linear_output_is_resampled_in(self):
        # Half black, half white: the mean is taken in light, whatever the output's curve.
        write_png(self.path("in.png"), 64, 32, lambda x, y: ((255,) * 3 if (x + y) % 2 else (0,) * 3))
        self.run_tool("convert", "in.png", "-o", "out.png", "--size", 2, "--out-colorspace", "g22_rec709", *MAP)
        for row in read_png(self.path("out.png"))[2]:
            for texel in row:
                self.check(texel, [255 * 0.5 ** (1 / 2.2)] * 3, 1)

    def test_integers_are_stored_as_they_are(self):
        self.constant("in.exr", (0.18, 0.5, 1.0))
        out = ("-o", "out.png", *MAP, "--type", "uint16", "--verify")
        for name, curve in (("g22_rec709", lambda v: v ** (1 / 2.2)), ("lin_rec709", lambda v: v), ("srgb_tx", srgb)):
            self.run_tool("convert", "in.exr", *out, "--out-colorspace", name).is_silent()
            self.check(read_png(self.path("out.png"))[2][3][5], [65535 * curve(v) for v in (0.18, 0.5, 1)], 1.5)

    def test_alpha_is_taken_off_before_a_curve(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (0.1, 0.2, 0.05, 0.25), "RGBA")
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--out-colorspace", "srgb_tx", *PLAIN).is_silent()
        channels = read_exr(self.path("out.exr"))[2]
        self.check([channels[c][3][5] for c in "RGBA"],
                   [0.25 * srgb(0.4), 0.25 * srgb(0.8), 0.25 * srgb(0.2), 0.25], 1e-6)

    def test_other_primaries_become_srgb_in_integers(self):
        # ACEScg of Rec. 709 red and of half of its green.
        self.constant("in.exr", (0.6131 + 0.5 * 0.33952, 0.0702 + 0.5 * 0.91635, 0.0206 + 0.5 * 0.10957),
                      {"chromaticities": chromaticities(AP1)})
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP)
        self.check(read_png(self.path("out.png"))[2][3][5], (255, 188, 0), 1)

    def test_the_number_of_threads_changes_nothing(self):
        shutil.copy(PANORAMAS / "venice.hdr", self.path("in.hdr"))
        outputs = set()
        for threads in (1, 2, 7):
            self.run_tool("convert", "in.hdr", "-o", "out.png", "--size", 64, *MAP, "-j", threads)
            outputs.add(self.path("out.png").read_bytes())
        self.assertEqual(len(outputs), 1)

    def test_names_of_files(self):
        self.constant("sky_acescg.exr", (0.6131, 0.0702, 0.0206))
        self.run_tool("convert", "sky_acescg.exr", "-o", "out.exr", "--out-colorspace", "lin_rec709", *PLAIN)
        self.check(self.color("out.exr"), (1, 0, 0), 2e-4)
        # What envconv recorded is stronger than a name that stayed.
        self.run_tool("convert", "sky_acescg.exr", "-o", "b_acescg.exr", "--out-colorspace", "lin_rec709", *PLAIN)
        self.run_tool("convert", "b_acescg.exr", "-o", "out.exr", "--out-colorspace", "lin_rec709", *PLAIN)
        self.check(self.color("out.exr"), (1, 0, 0), 2e-4)


    def test_faces_of_one_environment_have_one_space(self):
        faces = ("px", "nx", "py", "ny", "pz", "nz")
        for face in faces:
            write_exr(self.path(f"{face}.exr"), 8, 8, lambda x, y: (1, 1, 1),
                      attributes={"chromaticities": chromaticities(AP1 if face == "py" else P3)})
        self.run_tool("convert", "{face}.exr", "-o", "out.exr", expect=3).says("py.exr", "px.exr", "--in-colorspace")
        self.run_tool("convert", "{face}.exr", "-o", "out.exr", "--in-colorspace", "ACEScg").is_silent()
        write_exr(self.path("py.exr"), 8, 8, lambda x, y: (1, 1, 1), attributes={"chromaticities": chromaticities(P3)})
        self.run_tool("convert", "{face}.exr", "-o", "out.exr").is_silent()
        self.assertEqual(self.json("info", "out.exr")["primaries"]["name"], "p3-d65")


class Views(ColorCase):
    def test_hdr_is_not_clipped_in_integers(self):
        write_exr(self.path("in.exr"), 64, 32, lambda x, y: (2.0 ** (x // 8 - 3),) * 3)
        for name in ("out.png", "out.jpg"):
            self.run_tool("convert", "in.exr", "-o", name, *MAP)
            self.says("values up to 16 ", "ACES 1.0 - SDR Video", "--view none")
            self.assertNotIn("clamped", self.err)
        row = read_png(self.path("out.png"))[2][16]
        steps = [row[8 * i + 4][1] for i in range(8)]
        self.assertEqual(steps, sorted(set(steps)), "steps of light that look alike")
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--view", "none").says("too large for uint8")
        row = read_png(self.path("out.png"))[2][16]
        self.assertEqual([row[8 * i + 4][1] for i in range(3, 8)], [255] * 5)

    def test_what_fits_is_stored_as_srgb_in_silence(self):
        self.constant("in.exr", (0.18, 1.0, 0.0))
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP).is_silent()
        self.check(read_png(self.path("out.png"))[2][3][5], (round(255 * srgb(0.18)), 255, 0), 0)
        write_png(self.path("a.png"), 16, 8, lambda x, y: (x * 16, y * 32, 255))
        self.run_tool("convert", "a.png", "-o", "b.png", *MAP).is_silent()
        self.assertEqual(read_png(self.path("a.png"))[2], read_png(self.path("b.png"))[2])

    def test_views_by_name(self):
        self.constant("in.exr", (0.18, 0.18, 0.18))
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--view", "Un-tone-mapped").is_silent()
        self.check(read_png(self.path("out.png"))[2][3][5], [255 * 0.461356] * 3, 0.51)
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--view", "un-tone-mapped", "--display",
                      "Rec.1886 Rec.709 - Display").is_silent()
        self.check(read_png(self.path("out.png"))[2][3][5], [255 * 0.18 ** (1 / 2.4)] * 3, 0.51)
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--view", "un-tone-mapped", "--exposure", 1)
        self.check(read_png(self.path("out.png"))[2][3][5], [255 * srgb(0.36)] * 3, 0.51)
        # The display's own first view.
        self.run_tool("convert", "in.exr", "-o", "a.png", *MAP, "--display", "sRGB - Display")
        self.run_tool("convert", "in.exr", "-o", "b.png", *MAP, "--view", "ACES 1.0 - SDR Video")
        self.assertEqual(self.path("a.png").read_bytes(), self.path("b.png").read_bytes())

    def test_a_preview_is_read_as_what_it_is(self):
        self.constant("in.exr", (4.0, 2.0, 1.0))
        self.run_tool("convert", "in.exr", "-o", "look.png", *MAP)
        info = self.json("info", "look.png")
        self.assertEqual((info["colorspace"], info["colorspace_from"]), ("sRGB - Texture", "recorded"))
        self.run_tool("convert", "look.png", "-o", "again.png", *MAP).is_silent()
        self.assertEqual(read_png(self.path("look.png"))[2], read_png(self.path("again.png"))[2])


class Names(ColorCase):
    def setUp(self):
        super().setUp()
        # Never read: names are found out before.
        self.path("in.exr").write_bytes(b"damaged")

    def refused(self, *words, **options):
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, *words, expect=2, **options)
        self.assertEqual(len(self.err.splitlines()), 1)
        self.assertNotIn("out.png", self.files())
        return self

    def test_near_misses(self):
        self.refused("--out-colorspace", "ACEScq").says("--out-colorspace", "'ACEScq'", "did you mean 'ACEScg'?")
        self.refused("--in-colorspace", "lin_rec790").says("--in-colorspace", "did you mean 'lin_rec709'?")
        self.refused("--view", "Untonemapped").says("--view", "did you mean 'Un-tone-mapped'?")
        self.refused("--display", "sRGB Display").says("--display", "did you mean 'sRGB - Display'?")
        self.refused("--out-colorspace", "completely different").says("there are: ", "ACEScg", "Linear Rec.2020")
        self.refused("--out-colorspace", "").says("--out-colorspace")

    def test_contradictions(self):
        self.refused("--out-colorspace", "ACEScg", "--view", "Raw").says("--out-colorspace", "--view")
        self.refused("--out-colorspace", "ACEScg", "--display", "sRGB - Display").says("--out-colorspace")
        self.refused("--view", "none", "--display", "sRGB - Display").says("--display")

    def test_broken_configurations(self):
        def file(name, text):
            self.path(name).write_text(text)
            return name

        lut = CONFIG + "  - !<ColorSpace>\n    name: lut\n    to_scene_reference: !<FileTransform> {src: /etc/passwd}\n"
        broken = {
            file("yaml.ocio", "ocio_profile_version: 2\nroles: {default: [\n"): "yaml",
            file("empty.ocio", ""): "profile",
            file("version.ocio", CONFIG.replace("version: 2", "version: 99")): "version",
            file("deep.ocio", "[" * 200000): "",
            "missing.ocio": "No such file",
            file("space.ocio", CONFIG.replace("scene_linear: ref", "scene_linear: nix")): "nix",
            ".": "regular file",
        }
        for name, text in broken.items():
            self.refused("--ocio-config", name).says(name, "OpenColorIO", text)
            # The same by way of the environment: it fails, and nothing else takes its place.
            self.refused(env=without_ocio(OCIO=name)).says(name, text, "$OCIO")
            self.run_tool("info", "in.exr", expect=2, env=without_ocio(OCIO=name)).says(name, "$OCIO")
        self.refused("--ocio-config", file("lut.ocio", lut), "--out-colorspace", "lut").says("passwd")
        self.refused("--ocio-config", "lut.ocio", "--in-colorspace", "lut").says("passwd")
        file("view.ocio", lut.replace('v # 1", colorspace: "gamma 1,5"', 'v # 1", colorspace: lut'))
        self.refused("--ocio-config", "view.ocio", "--view", "v # 1").says("v # 1", "passwd")
        os.mkfifo(self.path("fifo"))
        self.refused("--ocio-config", "fifo").says("regular file")

    def test_a_configuration_that_is_not_related_to_others(self):
        lone = "\n".join(line for line in CONFIG.splitlines() if "aces_interchange" not in line)
        self.path("lone.ocio").write_text(lone)
        self.refused("--ocio-config", "lone.ocio", "--out-colorspace", "ref").says("aces_interchange", "--in-colorspace")
        self.constant("in.exr", (0.25, 0.25, 0.25))
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--ocio-config", "lone.ocio", "--in-colorspace",
                      "gamma 1,5", "--out-colorspace", "ref", *PLAIN).is_silent()
        self.check(self.color("out.exr"), (0.125,) * 3, 1e-5)
        # Nothing is asked of it here.
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--ocio-config", "lone.ocio", *PLAIN).is_silent()
        self.check(self.color("out.exr"), (0.25,) * 3, 0)


class Configurations(ColorCase):
    def setUp(self):
        super().setUp()
        self.path("c.ocio").write_text(CONFIG)

    def test_odd_names(self):
        self.constant("in.exr", (0.5, 0.5, 0.5))
        for env, words in ((without_ocio(), ("--ocio-config", "c.ocio")), (without_ocio(OCIO="c.ocio"), ())):
            self.run_tool("convert", "in.exr", "-o", "out.exr", *words, "--out-colorspace", "the: odd, 'one'", *PLAIN,
                          env=env).is_silent()
            self.check(self.color("out.exr"), (0.5,) * 3, 1e-5)
            self.run_tool("convert", "in.exr", "-o", "out.exr", *words, "--out-colorspace", "ref", *PLAIN, env=env)
            self.check(self.color("out.exr"), (0.25,) * 3, 1e-5)
            self.run_tool("convert", "in.exr", "-o", "out.png", *words, "--view", "v # 1", *MAP, env=env).is_silent()
            self.check(read_png(self.path("out.png"))[2][3][5], [255 * 0.25 ** (1 / 1.5)] * 3, 0.51)

    def test_the_option_is_stronger_than_the_environment(self):
        self.constant("in.exr", (0.5, 0.5, 0.5))
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--ocio-config", "c.ocio", "--out-colorspace", "ref",
                      *PLAIN, env=without_ocio(OCIO="missing"))

    def test_file_rules(self):
        self.constant("plate_1.exr", (0.25, 0.25, 0.25))
        self.run_tool("convert", "plate_1.exr", "-o", "out.exr", "--ocio-config", "c.ocio", *PLAIN).is_silent()
        self.check(self.color("out.exr"), (0.125,) * 3, 1e-5)
        info = self.json("info", "plate_1.exr", "--ocio-config", "c.ocio")
        self.assertEqual(info["colorspace"], "gamma 1,5")
        self.assertAlmostEqual(info["channels"][0]["max"], 0.125, delta=1e-5)

    def test_a_recorded_space_that_is_unknown_elsewhere(self):
        self.constant("in.exr", (0.5, 0.5, 0.5))
        self.run_tool("convert", "in.exr", "-o", "own.png", "--ocio-config", "c.ocio", "--out-colorspace", "gamma 1,5",
                      *MAP)
        self.run_tool("convert", "own.png", "-o", "out.exr", "--ocio-config", "c.ocio", *PLAIN).is_silent()
        self.check(self.color("out.exr"), (0.25,) * 3, 3e-3)
        self.run_tool("convert", "own.png", "-o", "no.exr", *PLAIN, expect=3).says("gamma 1,5", "--in-colorspace")
        self.assertNotIn("no.exr", self.files())

    def test_comma_locale(self):
        # Made here, since a machine may not have it.
        locale = self.path("de_DE.UTF-8")
        subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", locale], check=True, capture_output=True)
        self.constant("in.exr", (0.5, 4.0, 0.25))
        outputs = []
        for more in ({}, {"LC_ALL": "de_DE.UTF-8", "LOCPATH": str(self.folder)}):
            self.run_tool("convert", "in.exr", "-o", "out.exr", "--ocio-config", "c.ocio", "--out-colorspace",
                          "gamma 1,5", *PLAIN, env=without_ocio(**more)).is_silent()
            self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, env=without_ocio(**more))
            outputs.append((self.path("out.exr").read_bytes(), self.path("out.png").read_bytes()))
        self.assertEqual(outputs[0], outputs[1])


class Records(ColorCase):
    def test_chromaticities_of_openexr(self):
        self.constant("in.exr", (0.25, 0.5, 0.75))
        for words, wanted in (((), REC709), (("--out-colorspace", "ACEScg"), AP1),
                              (("--out-colorspace", "Linear P3-D65"), P3)):
            self.run_tool("convert", "in.exr", "-o", "out.exr", *words, *PLAIN)
            attribute = read_exr(self.path("out.exr"))[3]["chromaticities"]
            self.check(struct.unpack("<8f", attribute), wanted, 1e-6)
            self.assertIn("chromaticities", subprocess.run(["exrheader", self.path("out.exr")], capture_output=True,
                                                            text=True, check=True).stdout)
        # It is defined for linear light.
        for words in (("--out-colorspace", "srgb_tx"), ("--view", "Un-tone-mapped"), ("--in-colorspace", "Raw")):
            self.run_tool("convert", "in.exr", "-o", "out.exr", *words, *PLAIN)
            self.assertNotIn("chromaticities", read_exr(self.path("out.exr"))[3])

    def test_chromaticities_are_kept(self):
        own = (0.7, 0.3, 0.2, 0.75, 0.14, 0.05, 0.3127, 0.3290)
        self.constant("in.exr", (0.25, -0.5, 7.0), {"chromaticities": chromaticities(own)})
        self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN).is_silent()
        self.check(struct.unpack("<8f", read_exr(self.path("out.exr"))[3]["chromaticities"]), own, 1e-6)
        self.check(self.color("out.exr"), (0.25, -0.5, 7.0), 0)
        self.run_tool("convert", "in.exr", "-o", "out.hdr", *MAP, "-q")
        self.assertIn(b"\nPRIMARIES=0.7 0.3 0.2 0.75 0.14 0.05 0.3127 0.329\n", self.path("out.hdr").read_bytes())
        primaries = self.json("info", "out.hdr")["primaries"]
        self.assertIsNone(primaries["name"])
        self.check(primaries["green"], (0.2, 0.75), 1e-6)

    def test_chromaticities_that_mean_nothing(self):
        for values in ((0,) * 8, (float("nan"),) * 8, (1e30,) * 8, (0.3,) * 8):
            self.constant("in.exr", (1, 1, 1), {"chromaticities": chromaticities(values)})
            self.run_tool("convert", "in.exr", "-o", "out.exr", *PLAIN)
            self.check(struct.unpack("<8f", read_exr(self.path("out.exr"))[3]["chromaticities"]), REC709, 1e-6)

    def test_chunks_of_png(self):
        self.constant("in.exr", (0.25, 0.5, 0.75))
        rec709 = struct.pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)
        for words, cicp, gamma, srgb_chunk in (
            ((), (1, 13), 45455, b"\0"),
            (("--out-colorspace", "lin_rec709"), (1, 8), 100000, None),
            (("--out-colorspace", "g22_rec709"), (1, 4), 45455, None),
            (("--out-colorspace", "g24_rec709"), (1, 1), 41667, None),
            (("--out-colorspace", "g18_rec709"), None, 55556, None),
            (("--view", "Un-tone-mapped"), (1, 13), 45455, b"\0"),
        ):
            self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, *words)
            chunks = read_png(self.path("out.png"))[3]
            self.assertEqual(chunks.get("cICP"), cicp and bytes([*cicp, 0, 1]), words)
            self.assertEqual(chunks["gAMA"], struct.pack(">I", gamma), words)
            self.assertEqual(chunks.get("sRGB"), srgb_chunk, words)
            self.assertEqual(chunks["cHRM"], rec709, words)
        for name, code in (("Linear Rec.2020", 9), ("Linear P3-D65", 12)):
            self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--out-colorspace", name, "--type", "uint16")
            self.assertEqual(read_png(self.path("out.png"))[3]["cICP"], bytes([code, 8, 0, 1]))
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP, "--out-colorspace", "Raw")
        self.assertFalse({"cICP", "gAMA", "cHRM", "sRGB"} & set(read_png(self.path("out.png"))[3]))

    def test_others_read_the_chunks(self):
        self.constant("in.exr", (0.25, 0.5, 0.75))
        self.run_tool("convert", "in.exr", "-o", "out.png", *MAP)
        # Debian's Python, whose packages are not this one's.
        program = ("import json, sys, PIL.Image; i = PIL.Image.open(sys.argv[1]); i.load(); "
                   "print(json.dumps([i.info['srgb'], i.info['gamma'], i.info['chromaticity'], i.getpixel((5, 3))]))")
        done = subprocess.run(["/usr/bin/python3", "-c", program, self.path("out.png")], capture_output=True, check=True)
        intent, gamma, xy, pixel = json.loads(done.stdout)
        self.assertEqual((intent, gamma, pixel), (0, 0.45455, list(read_png(self.path("out.png"))[2][3][5])))
        self.check(xy, (0.3127, 0.329, 0.64, 0.33, 0.30, 0.60, 0.15, 0.06), 1e-6)

    def test_chunks_are_read(self):
        xy = struct.pack(">8I", 31270, 32900, 68000, 32000, 26500, 69000, 15000, 6000)
        for chunks, value, name, how in (
            ([(b"gAMA", struct.pack(">I", 50000))], 0.25, "rec709", "gAMA"),
            ([(b"gAMA", struct.pack(">I", 100000)), (b"cHRM", xy)], 0.5, "p3-d65", "gAMA"),
            ([(b"gAMA", struct.pack(">I", 50000)), (b"sRGB", b"\0")], 0.2140, "rec709", "sRGB"),
            ([(b"sRGB", b"\0"), (b"cICP", bytes([12, 8, 0, 1]))], 0.5, "p3-d65", "cICP"),
            ([(b"cICP", bytes([9, 1, 0, 1]))], 0.5**2.4, "rec2020", "cICP"),
        ):
            write_png(self.path("in.png"), 16, 8, lambda x, y: (32768,) * 3, 16, chunks)
            for words in ((), ("--trust-input",)):
                info = self.json("info", "in.png", *words)
                self.assertAlmostEqual(info["channels"][1]["max"], value, delta=1e-4)
                self.assertEqual((info["primaries"]["name"], info["colorspace_from"]), (name, how))
        write_png(self.path("in.png"), 16, 8, lambda x, y: (128,) * 3, 8, [(b"cICP", bytes([9, 16, 0, 1]))])
        self.run_tool("info", "in.png").says("PQ", "not supported")

    def save_with_profiles(self, profiles, color=(128, 64, 32)):
        """A picture of one colour with each profile, in each format that holds one."""
        for name, profile in profiles.items():
            self.path(f"{name}.icc").write_bytes(profile)
        program = """
import sys
from PIL import Image
for name in sys.argv[1].split():
    for kind in ("png", "jpg", "tif"):
        Image.new("RGB", (16, 8), tuple(map(int, sys.argv[2:]))).save(
            f"{name}.{kind}", quality=100, subsampling=0, icc_profile=open(f"{name}.icc", "rb").read())
"""
        subprocess.run(["/usr/bin/python3", "-c", program, " ".join(profiles), *map(str, color)], cwd=self.folder, check=True)

    def test_icc_profiles(self):
        cube = (0.8, 0.3, 0.1)
        d50 = (0.34567, 0.35850)  # what colorants are relative to
        identity = b"para\0\0\0\0\0\0\0\0" + struct.pack(">i", 65536)
        table = b"curv" + struct.pack(">II", 0, 256) + struct.pack(">256H", *(round((i / 255) ** 1.8 * 65535) for i in range(256)))
        srgb_curve = b"para" + struct.pack(">IHH5i", 0, 3, 0, *(round(v * 65536) for v in (
            2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)))
        power = b"curv" + struct.pack(">IIH", 0, 1, 563) + b"\0\0"  # 2.19921875, as in Adobe RGB (1998)
        profiles = {"linear": (REC709, identity), "empty": (REC709, b"curv" + bytes(8)), "p3": (P3, srgb_curve),
                    "adobe": (ADOBE, power), "wide": ((0.7347, 0.2653, 0.1596, 0.8404, 0.0366, 0.0001, *d50), table)}
        decode = {"linear": lambda v: v, "empty": lambda v: v, "p3": srgb_light, "adobe": lambda v: v ** (563 / 256),
                  "wide": lambda v: v ** 1.8}
        color = tuple(round(v * 255) for v in cube)
        self.save_with_profiles({name: icc_profile(*what) for name, what in profiles.items()}, color)
        for name, (xy, _) in profiles.items():
            light = [decode[name](v / 255) for v in color]
            # The same light in a file that says what it is by other means.
            self.constant("same.exr", light, {"chromaticities": chromaticities(xy)})
            self.run_tool("convert", "same.exr", "-o", "wanted.exr", "--out-colorspace", "lin_rec709", *PLAIN)
            for kind in ("png", "jpg", "tif"):
                info = self.json("info", f"{name}.{kind}")
                self.assertEqual((info["colorspace_from"], self.err), ("ICC profile", ""), (name, kind))
                self.run_tool("convert", f"{name}.{kind}", "-o", "got.exr", "--out-colorspace", "lin_rec709", *PLAIN)
                self.check(self.color("got.exr"), self.color("wanted.exr"), 0.012 if kind == "jpg" else 0.003)

    def test_icc_profiles_of_little_cms(self):
        program = """
from PIL import ImageCms
open("s.icc", "wb").write(ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes())
open("lab.icc", "wb").write(ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes())
"""
        subprocess.run(["/usr/bin/python3", "-c", program], cwd=self.folder, check=True)
        self.save_with_profiles({"s": self.path("s.icc").read_bytes()})
        for kind in ("png", "jpg", "tif"):
            info = self.json("info", f"s.{kind}")
            self.assertEqual((info["color"], info["primaries"]["name"], self.err), ("sRGB", "rec709", ""))
        # What is no matrix and curve, and what is none of all three or damaged.
        good = icc_profile(P3, b"curv" + bytes(8))
        s_curve = b"curv" + struct.pack(">II9H", 0, 9, *(0, 500, 2000, 9000, 33000, 56000, 63500, 65000, 65535)) + b"\0\0"
        odd = {"s_curve": icc_profile(P3, s_curve), "lut": icc_profile(P3, s_curve[:12], more={b"A2B0": b"mft2" + bytes(60)}),
               "uneven": icc_profile(P3, b"curv" + bytes(8), blue=s_curve), "cut": good[:200], "gray": good.replace(b"RGB XYZ", b"GRAYXYZ"),
               "flat": icc_profile((0.3, 0.3) * 4, b"curv" + bytes(8)),
               "steps": icc_profile(P3, b"curv" + struct.pack(">II", 0, 0xFFFFFFFF))}
        self.save_with_profiles(odd)
        for name in odd:
            for kind in ("png", "jpg", "tif"):
                self.assertEqual(self.json("info", f"{name}.{kind}")["color"], "sRGB", (name, kind))
        own = "sRGBx".encode("utf-16-be")
        self.assertEqual(odd["lut"].count(own), 1)
        self.save_with_profiles({"other": odd["lut"].replace(own, "Paper".encode("utf-16-be"))})
        self.json("info", "other.png")
        self.says('ICC profile "Paper" is no matrix with a simple curve, and not applied', "--in-colorspace")

    def test_chunks_that_lie(self):
        for chunks in ([(b"cICP", b"\1")], [(b"gAMA", b"\0\0\0\0")], [(b"cHRM", bytes(32)), (b"gAMA", b"\0\0\xb1\x8f")],
                       [(b"cICP", bytes(5))], [(b"tEXt", bytes(3))] * 1500):
            write_png(self.path("in.png"), 16, 8, lambda x, y: (128,) * 3, 8, chunks)
            self.assertAlmostEqual(self.json("info", "in.png")["channels"][0]["max"], 0.216, delta=0.004)

    def test_radiance_primaries(self):
        pixels = bytes([2, 2, 0, 8]) + b"".join(bytes([0x88, v]) for v in (128, 64, 32, 129))
        for line, name in (("PRIMARIES= 0.64 0.33 0.30 0.60 0.15 0.06 0.3127 0.329", "rec709"),
                           ("PRIMARIES=0 0 0 0 0 0 0 0", "rec709"), ("PRIMARIES=1 2 3", "rec709"),
                           ("PRIMARIES=0.713 0.293 0.165 0.83 0.128 0.044 0.32168 0.33767", "aces-ap1")):
            self.path("in.hdr").write_bytes(
                f"#?RADIANCE\n{line}\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n".encode() + pixels * 4)
            info = self.json("info", "in.hdr")
            self.assertEqual(info["primaries"]["name"], name)
            self.assertEqual(info["channels"][0]["max"], 1)

    def test_info_says_what_is_assumed(self):
        self.constant("float.exr", (1, 1, 1))
        write_png(self.path("byte.png"), 16, 8, lambda x, y: (128,) * 3)
        self.constant("ap1.exr", (1, 1, 1), {"chromaticities": chromaticities(AP1)})
        for name, space, how in (("float.exr", "Linear Rec.709 (sRGB)", "assumed for floating point"),
                                 ("byte.png", "sRGB - Texture", "assumed for integers"),
                                 ("ap1.exr", "ACEScg", "chromaticities")):
            info = self.json("info", name)
            self.assertEqual((info["colorspace"], info["colorspace_from"]), (space, how))
            self.assertRegex(self.run_tool("info", name).out, rf"colour +{space.replace('(', '.').replace(')', '.')}, {how}")

    def test_the_report_of_a_conversion(self):
        self.constant("in.exr", (1, 1, 1))
        report = self.json("convert", "in.exr", "-o", "out.exr", "--out-colorspace", "lin_ap1", *MAP)
        self.assertEqual((report["source"]["colorspace"], report["colorspace"]), ("Linear Rec.709 (sRGB)", "ACEScg"))
        plan = self.json("convert", "in.exr", "-o", "o_{size}.exr", "--in-colorspace", "acescg", "--dry-run")
        self.assertEqual(plan["source"]["colorspace"], "ACEScg")


if __name__ == "__main__":
    unittest.main()
