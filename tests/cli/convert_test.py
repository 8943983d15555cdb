# SPDX-License-Identifier: Apache-2.0
"""envconv convert on single inputs."""
import math
import os
import pathlib
import shlex
import shutil
import signal
import struct
import subprocess
import time
import unittest

from corpus import dds
from harness import (BINARY, PANORAMAS, SANITIZED, Case, comma_locale, read_exr, write_constant, write_directions,
                     write_exr, write_png)

PLAIN = ("--compression", "none", "--type", "float")
# Where the centres of the faces look, in the world frame.
CENTRES = {"px": (1, 0, 0), "nx": (-1, 0, 0), "py": (0, 1, 0), "ny": (0, -1, 0), "pz": (0, 0, 1), "nz": (0, 0, -1)}


class Pixels(Case):
    def centre(self, name):
        """Mean colour of the four texels in the middle of a face."""
        width, height, channels, _ = read_exr(self.path(name))
        middle = [(y, x) for y in (height // 2 - 1, height // 2) for x in (width // 2 - 1, width // 2)]
        return tuple(sum(channels[c][y][x] for y, x in middle) / 4 for c in "RGB")

    def check_centres(self, expected, pattern="sky_{}.exr"):
        for face, direction in expected.items():
            for got, wanted in zip(self.centre(pattern.format(face)), direction):
                self.assertAlmostEqual(got, wanted, delta=0.02, msg=face)

    def test_six_files_look_where_the_cube_does(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 16, *PLAIN).is_silent()
        self.assertEqual(self.files(), sorted(["in.exr", *(f"sky_{f}.exr" for f in CENTRES)]))
        self.check_centres(CENTRES)

    def test_rotation_takes_forward_to_the_right(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 16, "--rotate", "90,0,0", *PLAIN)
        self.check_centres({"px": (0, 0, 1), "pz": (-1, 0, 0), "py": (0, 1, 0)})
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 16, "--rotate", "-90,0,0", *PLAIN)
        self.check_centres({"nx": (0, 0, 1)})
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 16, "--rotate=0,90,0", *PLAIN)
        self.check_centres({"pz": (0, 1, 0)})

    def test_two_rotations_are_recorded_as_one(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "a.exr", "--to", "latlong", "--rotate", "30,20,10", *PLAIN)
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--to", "latlong", "--rotate", "-50,40,5", *PLAIN)
        yaw, pitch, roll = self.json("info", "b.exr")["rotation"]
        # The recorded rotation, applied to the original at once, gives the same picture.
        self.run_tool("convert", "in.exr", "-o", "c.exr", "--to", "latlong", f"--rotate={yaw},{pitch},{roll}", *PLAIN)
        b, c = (read_exr(self.path(name))[2] for name in ("b.exr", "c.exr"))
        worst = max(abs(p - q) for k in "RGB" for r, s in zip(b[k], c[k]) for p, q in zip(r, s))
        self.assertLess(worst, 0.05)

    def test_frame_changes_the_axes_of_the_lookup(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 16, "--frame", "opengl", *PLAIN)
        # Forward is -Z there.
        self.check_centres({"nz": (0, 0, 1), "pz": (0, 0, -1), "px": (1, 0, 0), "py": (0, 1, 0)})

    def test_back_and_forth_by_metadata_alone(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "a.exr", "--to", "octahedral", "--frame", "three", "--size", 64, *PLAIN)
        self.run_tool("convert", "a.exr", "-o", "b_{face}.exr", "--size", 16, *PLAIN).is_silent()
        self.check_centres(CENTRES, "b_{}.exr")
        source = self.json("convert", "a.exr", "-o", "c.exr", "--to", "latlong")["source"]
        self.assertEqual((source["layout"], source["frame"]), ("octahedral", "three"))

    def test_six_files_are_one_input(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "sky_{face}.exr", "--size", 32, *PLAIN)
        self.run_tool("convert", "sky_{face}.exr", "--from", "cube", "-o", "all.exr", "--packing", "row", *PLAIN)
        width, height, _, _ = read_exr(self.path("all.exr"))
        self.assertEqual((width, height), (6 * 32, 32))
        self.run_tool("convert", "all.exr", "-o", "again_{face}.exr", *PLAIN)
        for face in CENTRES:
            self.assertEqual(read_exr(self.path(f"sky_{face}.exr"))[2], read_exr(self.path(f"again_{face}.exr"))[2])

    def test_six_files_without_metadata(self):
        for face in CENTRES:
            write_constant(self.path(f"{face}.exr"), 0.5, 8, 8)
        self.run_tool("convert", "{face}.exr", "-o", "all.exr", "--to", "latlong", *PLAIN)
        _, _, channels, _ = read_exr(self.path("all.exr"))
        for row in channels["G"]:
            for value in row:
                self.assertAlmostEqual(value, 0.5, delta=1e-6)

    def test_a_missing_or_odd_face_is_named(self):
        for face in CENTRES:
            write_constant(self.path(f"s_{face}.exr"), 0.5, 8, 8)
        self.path("s_ny.exr").unlink()
        self.run_tool("convert", "s_{face}.exr", "-o", "all.exr", expect=3).says("s_ny.exr", "No such file")
        write_constant(self.path("s_ny.exr"), 0.5, 4, 4)
        self.run_tool("convert", "s_{face}.exr", "-o", "all.exr", expect=3).says("s_ny.exr", "4x4")
        self.assertNotIn("all.exr", self.files())

    def test_parts(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "parts.exr", "--packing", "parts", "--size", 16).is_silent()
        self.assertEqual(self.json("info", "parts.exr")["packing"], "parts")
        self.run_tool("convert", "parts.exr", "-o", "sky_{face}.exr", *PLAIN)
        self.check_centres(CENTRES)

    def test_parts_have_the_order_of_their_names(self):
        names, words = sorted(CENTRES, reverse=True), []
        for i, name in enumerate(names):
            write_constant(self.path(f"{name}.exr"), i + 1, 8, 8)
            words += [f"{name}.exr", "--attrib", "oiio:subimagename", name, *(["--siappend"] if i else [])]
        subprocess.run(["oiiotool", *words, "-o", "parts.exr"], cwd=self.folder, check=True)
        self.run_tool("convert", "parts.exr", "-o", "sky_{face}.exr", "--size", 8, *PLAIN).is_silent()
        for i, name in enumerate(names):
            self.assertEqual(read_exr(self.path(f"sky_{name}.exr"))[2]["G"][4][4], i + 1, name)

    def test_exposure_and_alpha(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (0.25, 0.25, 0.25, 0.5), "RGBA")
        self.run_tool("convert", "in.exr", "-o", "a.exr", "--to", "latlong", "--exposure", "2", *PLAIN)
        channels = read_exr(self.path("a.exr"))[2]
        self.assertEqual((channels["R"][3][3], channels["A"][3][3]), (1.0, 0.5))
        self.run_tool("convert", "in.exr", "-o", "b.exr", "--to", "latlong", "--alpha", "drop", "--exposure=-1", *PLAIN)
        channels = read_exr(self.path("b.exr"))[2]
        self.assertEqual(sorted(channels), ["B", "G", "R"])
        self.assertEqual(channels["R"][3][3], 0.125)

    def test_dropped_alpha_leaves_colour_as_stored(self):
        # OpenEXR stores colour times alpha, PNG stores colour: 188/255 in sRGB is 0.5029.
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (0.5, 0.25, 0.125, 0.5), "RGBA")
        self.run_tool("convert", "in.exr", "-o", "in.png", "--to", "latlong", "--type", "uint16").is_silent()
        for source, red, green in (("in.exr", 0.5, 0.25), ("in.png", 1, 0.5)):
            out = ("-o", "out.exr", "--to", "latlong", *PLAIN)
            self.run_tool("convert", source, *out).is_silent()
            channels = read_exr(self.path("out.exr"))[2]
            self.assertAlmostEqual(channels["G"][3][3], 0.25, delta=1e-4)
            self.run_tool("convert", source, *out, "--alpha", "drop").is_silent()
            channels = read_exr(self.path("out.exr"))[2]
            self.assertEqual(sorted(channels), ["B", "G", "R"])
            self.assertAlmostEqual(channels["R"][3][3], red, delta=1e-4)
            self.assertAlmostEqual(channels["G"][3][3], green, delta=1e-4)

    def test_the_same_layout_and_size_keep_every_bit(self):
        odd = (1e-42, 65000.0, 1e38, -0.0, -3.7, 1 / 3)
        write_exr(self.path("in.exr"), 64, 32, lambda x, y: tuple(odd[(x + 3 * y + i * x * y) % 6] for i in range(3)))
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--to", "latlong", *PLAIN).is_silent()
        before, after = (read_exr(self.path(name))[2] for name in ("in.exr", "out.exr"))
        for channel in "RGB":
            for a, b in zip(before[channel], after[channel]):
                self.assertEqual(struct.pack("<64f", *a), struct.pack("<64f", *b))

    def test_the_number_of_threads_changes_nothing(self):
        write_directions(self.path("in.exr"))
        for kind in ("exr", "hdr", "tif"):
            outputs = set()
            for threads in (1, 2, 7):
                self.run_tool("convert", "in.exr", "-o", f"out.{kind}", "--to", "octahedral", "-q", "-j", threads)
                outputs.add(self.path(f"out.{kind}").read_bytes())
            self.assertEqual(len(outputs), 1, kind)

    def test_size_texels_and_auto(self):
        write_constant(self.path("in.exr"), 1, 64, 32)
        self.assertEqual(self.json("convert", "in.exr", "-o", "a.exr", "--size", 20)["size"], 20)
        report = self.json("convert", "in.exr", "-o", "b.exr", "--texels", "6k")
        self.assertEqual(report["size"], 31)  # 6 x 31^2 <= 6000 < 6 x 32^2
        self.assertEqual(self.json("convert", "in.exr", "-o", "c.exr", "--to", "latlong")["size"], 32)
        self.assertGreater(self.json("convert", "in.exr", "-o", "d.exr", "--size", "auto")["size"], 8)


class Nonfinite(Case):
    def setUp(self):
        super().setUp()
        nan, inf = float("nan"), float("inf")
        bad = {(4, 4): (nan, 1, 1), (5, 4): (inf, 1, -inf)}
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: bad.get((x, y), (2, 1, 1)))

    def convert(self, *options, expect=0):
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--to", "latlong", *PLAIN, *options, expect=expect)
        return read_exr(self.path("out.exr"))[2] if expect == 0 else None

    def test_repair_is_the_default_and_counts(self):
        channels = self.convert()
        self.says("in.exr: warning: 3 values are NaN or infinite")
        self.assertEqual((channels["R"][4][4], channels["R"][4][5], channels["B"][4][5]), (2, 2, 1))

    def test_zero_and_clamp(self):
        channels = self.convert("--nonfinite", "zero")
        self.assertEqual((channels["R"][4][4], channels["R"][4][5], channels["B"][4][5]), (0, 0, 0))
        channels = self.convert("--nonfinite", "clamp", "-q")
        self.assertEqual((channels["R"][4][4], channels["R"][4][5], channels["B"][4][5]), (0, 65504, -65504))
        self.is_silent()

    def test_of_every_face(self):
        bad = {(44, 4): float("nan"), (3, 3): float("inf")}  # in the last and the first of six
        write_exr(self.path("in.exr"), 48, 8, lambda x, y: (bad.get((x, y), x // 8 + 1), 1, 1))
        same = ("convert", "in.exr", "-o", "out.exr", "--from", "cube", "--to", "cube", "--packing", "row", *PLAIN)
        for words, values in (((), (6, 1)), (("--nonfinite", "zero"), (0, 0)), (("--nonfinite", "clamp"), (0, 65504))):
            self.run_tool(*same, *words).says("2 values are NaN or infinite")
            channels = read_exr(self.path("out.exr"))[2]
            self.assertEqual((channels["R"][4][44], channels["R"][3][3]), values, words)
        bad.pop((3, 3))
        write_exr(self.path("in.exr"), 48, 8, lambda x, y: (bad.get((x, y), 1), 1, 1))
        self.run_tool(*same, "--nonfinite", "error", expect=3).says("in.exr: 1 value is NaN or infinite")

    def test_error(self):
        self.convert("--nonfinite", "error", expect=3)
        self.says("in.exr: 3 values are NaN or infinite")
        self.assertEqual(self.files(), ["in.exr"])


class Formats(Case):
    def test_channels_without_a_name_in_the_format(self):
        for names, taken in (("BRX", "B R X are taken for R G B"), ("GR", "G R are taken for Y A"), ("Z", "Z are taken for Y")):
            write_exr(self.path("in.exr"), 16, 8, lambda x, y: (0.5,) * len(names), channels=names)
            self.run_tool("convert", "in.exr", "-o", "out.png").says("channels " + taken, ".png has no names")
            self.run_tool("convert", "in.exr", "-o", "out.exr").is_silent()

    def test_parts_that_are_not_faces(self):
        write_exr(self.path("rgb.exr"), 32, 16, lambda x, y: (x / 32, 0.5, 0.25))
        write_exr(self.path("z.exr"), 32, 16, lambda x, y: (1000.0,), channels="Z")
        write_exr(self.path("left.exr"), 32, 16, lambda x, y: (0.0, 1.0, 0.0))
        self.run_tool("convert", "rgb.exr", "-o", "wanted.exr", "--size", 8, *PLAIN).is_silent()
        for second, words in (("z.exr", ()), ("left.exr", ()), ("z.exr", ("--from", "latlong"))):
            subprocess.run(["oiiotool", "rgb.exr", "--attrib", "oiio:subimagename", "beauty", second, "--attrib",
                            "oiio:subimagename", "other", "--siappend", "-o", "parts.exr"], cwd=self.folder, check=True)
            self.run_tool("convert", "parts.exr", "-o", "got.exr", "--size", 8, *PLAIN, *words)
            self.says("only the first of its 2 parts is read", "other")
            self.assertEqual(read_exr(self.path("got.exr"))[2], read_exr(self.path("wanted.exr"))[2])
            self.assertEqual(self.json("info", "parts.exr")["layout"], "latlong")
        # Faces of which one has another size are no passes.
        self.run_tool("convert", "rgb.exr", "-o", "cube.exr", "--size", 8, "--packing", "parts", *PLAIN).is_silent()
        self.run_tool("convert", "cube.exr", "--from", "latlong", "-o", "no.exr", expect=3).says("6 pictures")

    def test_types_follow_the_source_and_the_format(self):
        write_constant(self.path("float.exr"), 0.5)
        write_png(self.path("eight.png"), 16, 8, lambda x, y: (188, 188, 188))
        write_png(self.path("sixteen.png"), 16, 8, lambda x, y: (50000, 50000, 50000), 16)
        for source, output, wanted in (
            ("float.exr", "a.exr", "float"), ("eight.png", "b.exr", "half"), ("sixteen.png", "c.exr", "half"),
            ("float.exr", "d.png", "uint8"), ("eight.png", "e.png", "uint8"), ("sixteen.png", "f.png", "uint16"),
            ("eight.png", "g.hdr", "float"), ("a.exr", "h.exr", "float"), ("b.exr", "i.exr", "half"),
        ):
            report = self.json("convert", source, "-o", output, "--to", "latlong", "--from", "latlong")
            self.assertEqual(report["type"], wanted, (source, output))
        self.assertEqual(self.json("convert", "float.exr", "-o", "j.exr", "--type", "half")["type"], "half")

    def test_integer_files_are_srgb(self):
        write_png(self.path("in.png"), 16, 8, lambda x, y: (188, 188, 188))  # 188/255 in sRGB is 0.5029
        self.run_tool("convert", "in.png", "-o", "out.exr", "--to", "latlong", *PLAIN)
        self.assertAlmostEqual(read_exr(self.path("out.exr"))[2]["R"][2][2], 0.5029, delta=1e-3)

    def test_radiance(self):
        shutil.copy(PANORAMAS / "venice.hdr", self.path("venice.hdr"))
        self.run_tool("convert", "venice.hdr", "-o", "cube.exr", "--size", 64)
        info = self.json("info", "cube.exr")
        self.assertEqual((info["layout"], info["size"], info["packing"]), ("cube", 64, "row"))

    def test_dxt_with_colour_multiplied_by_alpha(self):
        # 4x2 blocks of one colour, 5:6:5 bits, and of one alpha each; DXT2 and DXT4 are DXT3 and DXT5 but for what alpha means.
        for straight, multiplied, alphas in ((b"DXT3", b"DXT2", (bytes(8), b"\x88" * 8, b"\xff" * 8)),
                                             (b"DXT5", b"DXT4", (bytes(8), b"\x88" * 2 + bytes(6), b"\xff" * 2 + bytes(6)))):
            pixels = {}
            for code in (straight, multiplied):
                for alpha, block in zip((0, 0x88 / 255, 1), alphas):
                    data = block + struct.pack("<HHI", 0x4208, 0x4208, 0)
                    self.path("x.dds").write_bytes(dds(16, 8, data * 8, fourcc=code))
                    self.run_tool("convert", "x.dds", "-o", "x.exr", "--to", "latlong", *PLAIN).is_silent()
                    channels = read_exr(self.path("x.exr"))[2]
                    self.assertAlmostEqual(channels["A"][3][5], alpha, delta=1e-6)
                    pixels[code, alpha] = channels["G"][3][5]
            stored = (16 << 2 | 16 >> 4) / 255  # green's six bits, as eight
            linear = ((stored + 0.055) / 1.055) ** 2.4
            half = 0x88 / 255
            self.assertAlmostEqual(pixels[straight, half], linear * half, delta=1e-5)
            # Alpha was multiplied by before the curve.
            self.assertAlmostEqual(pixels[multiplied, half], ((stored / half + 0.055) / 1.055) ** 2.4 * half, delta=1e-5)
            self.assertEqual((pixels[straight, 0], pixels[multiplied, 0]), (0, 0))
            for code in (straight, multiplied):
                self.assertAlmostEqual(pixels[code, 1], linear, delta=1e-5)

    def test_half_overflow_is_counted(self):
        write_constant(self.path("in.exr"), 1e6)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--to", "latlong", "--type", "half")
        self.says("384 values are too large for half .exr: clamped")
        self.run_tool("convert", "in.exr", "-o", "out.png", "--to", "latlong", "--view", "none")
        self.says("384 values are too large for uint8 .png")

    def test_a_format_that_cannot_hold_it(self):
        write_constant(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "out.xyz", expect=5).says("out.xyz")
        self.run_tool("convert", "in.exr", "-o", "out", expect=5).says("out")
        self.run_tool("convert", "in.exr", "-o", "out.png", "--packing", "parts", expect=5).says("out.png")
        self.run_tool("convert", "in.exr", "-o", "out.hdr", "--type", "uint8", expect=5).says("out.hdr")
        self.run_tool("convert", "in.exr", "-o", "o.exr", "--to", "latlong", "--packing", "cross", expect=5)
        self.says("cross", "latlong")
        self.assertEqual(self.files(), ["in.exr"])

    def test_channels_that_do_not_fit_are_found_before_the_work(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (1, 1, 1, 1), "RGBA")
        for options in ((), ("--dry-run",)):
            self.run_tool("convert", "in.exr", "-o", "out.hdr", *options, expect=5).says("4 channels", "--alpha drop")
        self.assertEqual(self.files(), ["in.exr"])
        self.run_tool("convert", "in.exr", "-o", "out.hdr", "--alpha", "drop").is_silent()

    def test_every_format_with_metadata_is_recognised_again(self):
        write_constant(self.path("in.exr"))
        for kind in ("exr", "hdr", "png", "tif", "jpg", "tga"):
            # As long as the line becomes: TGA stores it in pieces.
            self.run_tool("convert", "in.exr", "-o", f"out.{kind}", "--to", "polar-capped-conformal", "--frame",
                          "renderman", "--rotate", "10.123456,-20.25,170.5", "--size", 8).is_silent()
            info = self.json("info", f"out.{kind}")
            self.assertEqual((self.err, info["layout"], info["packing"], info["frame"]),
                             ("", "polar-capped-conformal", "grid", "renderman"), kind)
            for angle, wanted in zip(info["rotation"], (10.123456, -20.25, 170.5)):
                self.assertAlmostEqual(angle, wanted, delta=1e-6, msg=kind)

    def test_a_library_with_threads_of_its_own(self):
        # A reader that inherits a lock from a thread that it does not inherit waits, until it is stopped: now and then.
        write_constant(self.path("in.exr"), 0.5, 256, 128)
        self.run_tool("convert", "in.exr", "-o", "in.tif", "--to", "latlong")
        for _ in range(8):
            self.assertEqual(self.run_tool("info", "in.tif").err, "")

    @unittest.skipIf(SANITIZED, "a sanitizer needs /proc itself")
    def test_without_proc(self):
        hidden = ["unshare", "--mount", "sh", "-c", 'mount -t tmpfs none /proc && exec "$@"', "sh"]
        if subprocess.run([*hidden, "true"], capture_output=True).returncode != 0:
            self.skipTest("may not hide /proc")
        write_constant(self.path("in.exr"), 0.5)
        for kind in ("exr", "png", "tif", "jpg", "tga", "bmp", "webp", "ppm", "hdr"):
            for source, output in (("in.exr", f"out.{kind}"), (f"out.{kind}", "back.exr")):
                done = subprocess.run([*hidden, BINARY, "convert", source, "-o", output, "--to", "latlong", "-q"],
                                      cwd=self.folder, capture_output=True, timeout=60)
                self.assertEqual((done.returncode, done.stderr), (0, b""), (source, output))

    def test_verify(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--verify").is_silent()
        self.run_tool("convert", "in.exr", "-o", "out.png", "--verify", "-q").is_silent()


class Failures(Case):
    def test_missing_input(self):
        self.run_tool("convert", "no.exr", "-o", "out.exr", expect=3).says("no.exr: ", "No such file")
        self.assertEqual(self.files(), [])

    def test_not_an_image(self):
        for name, data in (("empty.exr", b""), ("page.exr", b"<html></html>"), ("cut.hdr", b"#?RADIANCE\n")):
            self.path(name).write_bytes(data)
            self.run_tool("convert", name, "-o", "out.exr", expect=3).says(name)
            self.assertNotIn("out.exr", self.files())

    def test_not_a_regular_file(self):
        self.path("folder").mkdir()
        os.mkfifo(self.path("fifo"))
        for name in ("folder", "fifo", "/dev/zero"):
            self.run_tool("convert", name, "-o", "out.exr", expect=3).says("not a regular file")

    def test_truncated(self):
        data = (PANORAMAS / "city.exr").read_bytes()
        self.path("cut.exr").write_bytes(data[: len(data) // 2])
        self.path("out.exr").write_bytes(b"old")
        self.run_tool("convert", "cut.exr", "-o", "out.exr", expect=3).says("cut.exr")
        self.assertEqual(self.files(), ["cut.exr", "out.exr"])
        self.assertEqual(self.path("out.exr").read_bytes(), b"old")

    def test_not_what_it_was_said_to_be(self):
        write_constant(self.path("in.exr"), 1, 30, 10)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--from", "cube", expect=3)
        self.says("in.exr: 30x10 does not fit cube: expected 6:1")
        self.run_tool("convert", "in.exr", "-o", "out.exr", expect=3)
        self.says("in.exr: 30x10 is the shape of no layout", "2:1")
        self.assertEqual(self.files(), ["in.exr"])

    def test_ambiguity_lists_the_candidates(self):
        write_constant(self.path("in.exr"), 1, 16, 16)
        self.run_tool("convert", "in.exr", "-o", "out.exr", expect=3).says("octahedral", "angular-map", "--from")

    def test_too_many_pixels(self):
        write_constant(self.path("in.exr"), 1, 64, 32)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--max-pixels", "2k", expect=6).says("in.exr", "--max-pixels")

    def test_output_is_the_input(self):
        write_constant(self.path("in.exr"))
        os.link(self.path("in.exr"), self.path("link.exr"))
        self.path("soft.exr").symlink_to("in.exr")
        before = self.path("in.exr").read_bytes()
        for name in ("in.exr", "./in.exr", "link.exr", "soft.exr", self.path("in.exr")):
            self.run_tool("convert", "in.exr", "-o", name, expect=2).says("in.exr", "itself")
        self.assertEqual(self.path("in.exr").read_bytes(), before)

    def test_output_folder_missing_or_odd(self):
        # Seen before the input is read: that is damaged.
        self.path("in.exr").write_bytes(b"damaged")
        self.path("folder").mkdir()
        os.mkfifo(self.path("fifo.exr"))
        self.run_tool("convert", "in.exr", "-o", "no/out.exr", expect=4).says("no/out.exr", "create")
        self.run_tool("convert", "in.exr", "-o", "in.exr/out.exr", expect=4)
        self.run_tool("convert", "in.exr", "-o", "folder", expect=2).says("is a folder")
        self.run_tool("convert", "in.exr", "-o", "fifo.exr", expect=2).says("not a regular file")

    def test_interrupted(self):
        shutil.copy(PANORAMAS / "city.exr", self.path("in.exr"))
        for number in (signal.SIGINT, signal.SIGTERM):
            tool = subprocess.Popen([BINARY, "convert", "in.exr", "-o", "out.exr", "--size", "3000", "-j", "1"],
                                    cwd=self.folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
            time.sleep(0.4)
            self.assertIsNone(tool.poll(), "the conversion was over before the signal")
            tool.send_signal(number)
            tool.communicate(timeout=60)
            self.assertEqual(tool.returncode, -number)
            self.assertEqual(self.files(), ["in.exr"])


class Streams(Case):
    def test_a_reader_that_goes_away(self):
        write_constant(self.path("in.exr"))
        read_end, write_end = os.pipe()
        os.close(read_end)
        done = subprocess.run([BINARY, "convert", "in.exr", "-o", "out.exr", "--json"], cwd=self.folder,
                              stdout=write_end, stderr=subprocess.PIPE)
        os.close(write_end)
        self.assertEqual((done.returncode, done.stderr), (0, b""))
        self.assertIn("out.exr", self.files())

    def test_full_disk_behind_stdout(self):
        with open("/dev/full", "wb") as full:
            done = subprocess.run([BINARY, "layouts"], stdout=full, stderr=subprocess.PIPE)
        self.assertEqual(done.returncode, 4)
        self.assertIn(b"standard output", done.stderr)

    def test_results_and_talk_are_apart(self):
        write_exr(self.path("in.exr"), 16, 8, lambda x, y: (float("inf") if x == y == 3 else 1.0, 1, 1))
        report = self.json("convert", "in.exr", "-o", "out.exr", "-v")
        self.says("warning: ", "to cube")
        self.assertEqual(report["output"], "out.exr")
        self.assertIsNone(report["error"])
        self.assertEqual(len(report["warnings"]), 1)
        self.run_tool("convert", "in.exr", "-o", "out.exr", "--json", "-q")
        self.assertEqual(self.err, "")

    def test_errors_are_in_the_json_too(self):
        self.path("in.exr").write_bytes(b"damaged")
        report = self.json("convert", "in.exr", "-o", "out.exr", expect=3)
        self.assertIn("in.exr", report["error"])
        self.assertEqual(report["status"], 3)

    def test_progress_only_when_asked_or_on_a_terminal(self):
        write_constant(self.path("in.exr"))
        done = subprocess.run([BINARY, "convert", "in.exr", "-o", "out.exr", "--progress", "always"], cwd=self.folder,
                              capture_output=True)
        self.assertEqual((done.returncode, done.stdout), (0, b""))
        self.assertIn(b"%", done.stderr)
        self.assertTrue(done.stderr.endswith(b"\r\x1b[K"), "the bar is left on the screen")

    def test_standard_input(self):
        write_directions(self.path("in.exr"))
        data = self.path("in.exr").read_bytes()
        self.run_tool("convert", "in.exr", "-o", "file.exr").is_silent()
        self.run_tool("convert", "-", "-o", "{stem}.exr", input=data).is_silent()  # a pipe
        with open(self.path("in.exr"), "rb") as whole:
            planned = self.run_tool("convert", "-", "-o", "redirected.exr", "--dry-run", stdin=whole).out
            self.assertTrue(planned.startswith("-: latlong 64x32"), planned)
            self.run_tool("convert", "-", "-o", "redirected.exr", stdin=whole).is_silent()
            self.run_tool("convert", "-", "-o", "in.exr", stdin=whole, expect=2).says("in.exr: is the input - itself")
            whole.seek(100)
            self.run_tool("convert", "-", "-o", "x.exr", stdin=whole, expect=3).says("-: not a picture")
        for name in ("stdin.exr", "redirected.exr"):
            self.assertEqual(self.path(name).read_bytes(), self.path("file.exr").read_bytes(), name)
        self.assertEqual(self.json("info", "-", input=data)["file"], "-")
        self.assertEqual(self.json("compare", "-", "in.exr", input=data)["rmse"], 0)
        for bad, said in ((b"", "an empty file"), (b"#!", "not a picture"), (data[:-1], "truncated or damaged")):
            self.run_tool("convert", "-", "-o", "x.exr", input=bad, expect=3).says(f"envconv: -: {said}")
        closed = f"exec 0<&-; exec {shlex.quote(BINARY)} convert - -o x.exr"
        done = subprocess.run(["sh", "-c", closed], cwd=self.folder, capture_output=True)
        self.assertEqual((done.returncode, done.stderr), (3, b"envconv: -: standard input cannot be read: Bad file descriptor\n"))
        self.run_tool("convert", "-", "-o", "x.exr", "--files-from", "-", input=b"in.exr\n", expect=2).says("--files-from")
        # More than there is memory for, of a process that may have little.
        if not SANITIZED:
            done = subprocess.run(["sh", "-c", "ulimit -v 1500000; exec \"$0\" convert - -o x.exr < /dev/zero", BINARY],
                                  cwd=self.folder, capture_output=True, timeout=120)
            self.assertEqual(done.returncode, 6, done.stderr)
            self.assertIn(b"envconv: -: standard input holds more than", done.stderr)
        self.assertFalse(self.path("x.exr").exists())
        # A file of that name is one by its path.
        self.path("-").write_bytes(data)
        self.run_tool("convert", "./-", "-o", "dash.exr").is_silent()

    def test_comma_locale(self):
        write_constant(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "-o", "a.exr", "--exposure", "0.5", "--json", env=comma_locale(self.folder))
        self.assertIn('"seconds":0.', self.out)

    def test_names_are_taken_literally(self):
        for name in ("a b.exr", "-dash.exr", "%04d.exr", "hash#.exr", "ümlaut.exr", "q?x=1.exr"):
            write_constant(self.path(name))
            self.run_tool("convert", "-o", "out.exr", "--", name).is_silent()
            self.run_tool("convert", "in.exr" if name == "x" else f"./{name}", "-o", f"./o{name}").is_silent()
            self.assertIn(f"o{name}", self.files())


class DryRun(Case):
    def test_nothing_is_written(self):
        write_constant(self.path("in.exr"), 1, 64, 32)
        out = self.run_tool("convert", "in.exr", "-o", "out.exr", "--dry-run").out
        for part in ("latlong 64x32", "cube", "out.exr", "MB"):
            self.assertIn(part, out)
        plan = self.json("convert", "in.exr", "-o", "sky_{face}_{size}.exr", "--dry-run")
        self.assertEqual(plan["source"]["layout"], "latlong")
        self.assertEqual(plan["files"][0], f"sky_px_{plan['size']}.exr")
        self.assertGreater(plan["peak_memory"], 64 * 32 * 3 * 4)
        self.assertEqual(self.files(), ["in.exr"])


if __name__ == "__main__":
    unittest.main()
