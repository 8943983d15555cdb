# SPDX-License-Identifier: Apache-2.0
"""MIP levels and seams from the command line."""
import re
import struct
import subprocess
import unittest

from harness import Case, direction, read_exr, write_constant, write_directions, write_exr


def write_sun(path, width=64, height=32):
    """A grey sky with one texel of 5e4."""
    write_exr(path, width, height, lambda x, y: (5e4, 4e4, 3e4) if (x, y) == (40, 9) else (0.5 + 0.01 * x, 0.4, 0.3 + 0.01 * y))


# Tags of TIFF 6.0, and the one by which OpenImageIO and other renderers know a texture.
SUBFILE, WIDTH, HEIGHT, BITS, COMPRESSION, STRIPS, CHANNELS, ROWS_PER_STRIP = 254, 256, 257, 258, 259, 273, 277, 278
TILE_WIDTH, TILE_HEIGHT, TILES, TEXTURE_FORMAT = 322, 323, 324, 33302


def tiff_pictures(path, pixels=True):
    """Tags and rows of bytes of all pictures of a little-endian TIFF file that is not compressed."""
    data = path.read_bytes()
    mark, at = struct.unpack_from("<4sI", data)
    if mark != b"II*\0":
        raise ValueError("not a TIFF file of 32-bit offsets")
    pictures = []
    while at:
        tags = {SUBFILE: (0,)}
        count, = struct.unpack_from("<H", data, at)
        for i in range(count):
            place = at + 2 + 12 * i
            tag, kind, number = struct.unpack_from("<HHI", data, place)
            form = {2: f"{number}s", 3: f"{number}H", 4: f"{number}I"}.get(kind)
            if form is None:
                continue
            if struct.calcsize("<" + form) > 4:
                place = struct.unpack_from("<I", data, place + 8)[0] - 8
            tags[tag] = struct.unpack_from("<" + form, data, place + 8)
        at, = struct.unpack_from("<I", data, at + 2 + 12 * count)
        pictures.append((tags, tiff_rows(data, tags) if pixels else None))
    return pictures


def tiff_rows(data, tags):
    if tags[COMPRESSION] != (1,):
        raise ValueError("a compressed TIFF file")
    (width,), (height,), (channels,) = tags[WIDTH], tags[HEIGHT], tags[CHANNELS]
    texel = channels * tags[BITS][0] // 8
    tile_width, tile_height = tags.get(TILE_WIDTH, (width,))[0], tags.get(TILE_HEIGHT, tags.get(ROWS_PER_STRIP))[0]
    across = -(-width // tile_width)
    rows = [bytearray() for _ in range(height)]
    for i, offset in enumerate(tags.get(TILES) or tags[STRIPS]):
        top, left = i // across * tile_height, i % across * tile_width
        for y in range(top, min(height, top + tile_height)):
            start = offset + (y - top) * tile_width * texel
            rows[y] += data[start : start + min(tile_width, width - left) * texel]
    return rows


class Levels(Case):
    def means(self, name, *options):
        return [c["mean"] for c in self.json("info", name, *options)["channels"]]

    def test_every_level_of_a_file_has_the_same_mean(self):
        write_sun(self.path("in.exr"))
        for layout in ("cube", "tennis-ball", "sphere-map", "latlong", "octahedral"):
            for mip_filter in ("box", "lanczos"):
                self.run_tool("convert", "in.exr", "--to", layout, "--size", 16, "--packing", "parts", "--mips",
                              "--mip-filter", mip_filter, "--type", "float", "-o", "out.exr")
                info = self.json("info", "out.exr")
                self.assertEqual(info["layout"], layout)
                widest = max(max(f["width"], f["height"]) for f in info["faces"])
                self.assertEqual(info["levels"], widest.bit_length())
                for level in range(info["levels"]):
                    told = self.json("info", "out.exr", "--level", level)
                    self.assertEqual(told["level"], level)
                    for face, first in zip(told["faces"], info["faces"]):
                        self.assertEqual(face["width"], max(1, first["width"] >> level))
                        self.assertEqual(face["height"], max(1, first["height"] >> level))
                    for a, b in zip(told["channels"], info["channels"]):
                        self.assertLess(abs(a["mean"] / b["mean"] - 1), 1e-5, (layout, mip_filter, level))
                        self.assertEqual(a["negative"], 0)

    def test_openexr_reads_the_levels(self):
        write_sun(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "--size", 16, "--mips", "-o", "out.exr")
        header = subprocess.run(["exrheader", "out.exr"], cwd=self.folder, capture_output=True, check=True, text=True).stdout
        self.assertIn("mip-map", header)
        self.assertIn("level sizes rounded down", header)
        # Another program that reads tiles of all levels, and writes them again.
        subprocess.run(["exrmultipart", "-combine", "-i", "out.exr", "-o", "again.exr"], cwd=self.folder, check=True,
                       capture_output=True)
        for level in range(5):
            self.assertEqual(self.means("out.exr", "--level", level), self.means("again.exr", "--level", level, "--from", "cube"))

    def test_level_of_an_input(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "--size", 16, "--mips", "-o", "cube.exr")
        self.run_tool("convert", "cube.exr", "--level", 1, "--to", "latlong", "--size", 16, "--type", "float",
                      "--compression", "none", "-o", "back.exr")
        width, height, channels, _ = read_exr(self.path("back.exr"))
        for y in range(height):
            for x in range(width):
                for name, value in zip("RGB", direction(x, y, width, height)):
                    self.assertLess(abs(channels[name][y][x] - value), 0.06)
        for level in (9, 31):
            self.run_tool("convert", "cube.exr", "--level", level, "-o", "x.exr", expect=3).says("has no level", "0 to")
            self.run_tool("info", "cube.exr", "--level", level, expect=3).says("has no level")
        self.assertEqual(self.files(), ["back.exr", "cube.exr", "in.exr"])

    def test_a_file_a_level(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "--to", "tennis-ball", "--size", 12, "-o", "out_{mip}.exr")
        self.assertEqual(self.files(), ["in.exr"] + [f"out_{k}.exr" for k in range(6)])  # 36 12 18 ... 1
        for k in range(6):
            info = self.json("info", f"out_{k}.exr")
            self.assertEqual(info["layout"], "tennis-ball")
            self.assertEqual((info["faces"][0]["width"], info["faces"][0]["height"]), (36 >> k, max(1, 12 >> k)))
            self.run_tool("convert", f"out_{k}.exr", "--to", "latlong", "--size", 4, "-o", "back.exr")
        self.run_tool("convert", "in.exr", "--size", 8, "--mips=2", "-o", "{face}-{mip}.png")
        self.assertEqual(len([f for f in self.files() if f.endswith(".png")]), 12)
        # Of an automatic size the header tells.
        self.run_tool("convert", "in.exr", "--mips=2", "-o", "auto_{mip}.hdr")
        self.assertIn("auto_1.hdr", self.files())

    def test_what_formats_cannot_hold(self):
        write_constant(self.path("in.exr"))
        run = lambda *words, expect=5: self.run_tool("convert", "in.exr", *words, expect=expect)
        for name in ("x.png", "x.hdr", "x.jpg"):
            run("--mips", "--size", 8, "-o", name).says("MIP levels", "{mip}", ".dds")
        run("--mips", "--size", 12, "-o", "x.exr").says("level 3", "--packing parts", "{mip}")
        run("--mips", "--size", 8, "--seam", "gutter:2", "-o", "x.exr").says("gutters", "{mip}", "--mips=1")
        run("--mips=2", "--size", 8, "-o", "x.exr").says("whole chain", "--mips")
        run("--mips", "--size", 12, "-o", "x.tif").says("level 3", "a power of two", "{mip}")
        run("--mips", "--size", 8, "--seam", "gutter:2", "-o", "x.tif").says("gutters", "{mip}", "--mips=1")
        run("--mips", "--size", 8, "--packing", "parts", "-o", "x.tif").says("several pictures")
        self.assertEqual(self.files(), ["in.exr"])
        run("--mips", "--size", 12, "--packing", "parts", "-o", "x.exr", expect=0)
        run("--mips=1", "--size", 12, "-o", "x.png", expect=0)
        run("--mips", "--size", 1, "-o", "x.png", expect=0)

    def test_wrong_words(self):
        write_constant(self.path("in.exr"))
        for words in (["--mips=0"], ["--mips=x"], ["--mips=33"], ["--mip-filter", "sharp"], ["--seam", "glue"],
                      ["--seam", "gutter"], ["--seam", "gutter:0"], ["--seam", "stretch:2"], ["--max-seam", "-1"],
                      ["--max-seam", "x"], ["--level", "-1"]):
            self.run_tool("convert", "in.exr", *words, "-o", "x.exr", expect=2).says(words[0].split("=")[0])
        self.assertEqual(self.files(), ["in.exr"])
        # The switch takes no word after it: that is an operand.
        self.run_tool("convert", "--mips", "in.exr", "--size", 8, "-o", "x.exr")

    def test_plan(self):
        write_constant(self.path("in.exr"))
        plain = self.json("convert", "in.exr", "--size", 64, "--dry-run", "-o", "x.exr")
        mips = self.json("convert", "in.exr", "--size", 64, "--mips", "--seam", "stretch", "--dry-run", "-o", "x.exr")
        self.assertEqual((plain["levels"], plain["seam"]), (1, "none"))
        self.assertEqual((mips["levels"], mips["seam"]), (7, "stretch"))

    def test_a_tiff_with_levels(self):
        write_sun(self.path("in.exr"))
        for kind, layout, packing, size in (("float", "cube", "cross", 32), ("half", "latlong", "row", 128),
                                            ("uint16", "octahedral", "row", 70), ("uint8", "cube", "column", 16)):
            common = ["--to", layout, "--packing", packing, "--size", size, "--type", kind, "--compression", "none",
                      "--in-colorspace", "raw", "-q"]
            self.run_tool("convert", "in.exr", *common, "--mips", "--verify", "-o", "all.tif")
            self.run_tool("convert", "in.exr", *common, "-o", "level_{mip}.tif")
            pictures = tiff_pictures(self.path("all.tif"))
            self.assertEqual(len(pictures), self.json("info", "all.tif")["levels"])
            self.assertEqual(len(pictures), len([f for f in self.files() if f.startswith("level_")]))
            for k, (tags, rows) in enumerate(pictures):
                (alone, expected), = tiff_pictures(self.path(f"level_{k}.tif"))
                self.assertEqual(tags[SUBFILE], (1,) if k else (0,))
                self.assertEqual((tags[WIDTH], tags[HEIGHT]), (alone[WIDTH], alone[HEIGHT]))
                self.assertEqual((tags[TILE_WIDTH], tags[TILE_HEIGHT]), ((64,), (64,)))
                self.assertEqual(tags[TEXTURE_FORMAT], (b"Plain Texture\0",))
                self.assertEqual(rows, expected, (kind, layout, k))
                self.path(f"level_{k}.tif").unlink()
        # As many levels as are asked for.
        self.run_tool("convert", "in.exr", "--size", 32, "--mips=3", "-o", "three.tif")
        self.assertEqual(len(tiff_pictures(self.path("three.tif"), pixels=False)), 3)

    def test_openimageio_reads_the_levels_of_a_tiff(self):
        write_sun(self.path("in.exr"))
        for kind, compression in (("float", "lzw"), ("half", "zip"), ("uint16", "packbits"), ("uint8", "none")):
            self.run_tool("convert", "in.exr", "--to", "latlong", "--size", 128, "--type", kind, "--compression",
                          compression, "--mips", "--in-colorspace", "raw", "-q", "-o", "all.tif")
            told = subprocess.run(["oiiotool", "--info", "-v", "-a", "all.tif"], cwd=self.folder, capture_output=True,
                                  check=True, text=True).stdout
            self.assertIn(f"256 x  128, 3 channel, {kind} tiff", told)
            self.assertIn("MIP-map levels: 256x128 128x64 64x32 32x16 16x8 8x4 4x2 2x1 1x1", told)
        self.run_tool("convert", "in.exr", "--to", "latlong", "--size", 128, "--type", "float", "--mips", "-o", "all.tif")
        self.run_tool("convert", "in.exr", "--to", "latlong", "--size", 128, "--type", "float", "--compression", "none",
                      "-o", "level_{mip}.exr")
        for k in range(9):
            subprocess.run(["oiiotool", "all.tif", "--selectmip", str(k), "--scanline", "--compression", "none", "-d",
                            "float", "-o", "one.exr"], cwd=self.folder, capture_output=True, check=True)
            self.assertEqual(read_exr(self.path("one.exr"))[2], read_exr(self.path(f"level_{k}.exr"))[2])

    def test_levels_of_a_tiff(self):
        write_directions(self.path("in.exr"))
        subprocess.run(["maketx", "--filter", "box", "-d", "float", "in.exr", "-o", "in.tif"], cwd=self.folder, check=True,
                       capture_output=True)
        info = self.json("info", "in.tif", "--from", "latlong")
        self.assertEqual((info["levels"], info["width"], info["height"]), (7, 64, 32))
        info = self.json("info", "in.tif", "--from", "latlong", "--level", 2)
        self.assertEqual((info["level"], info["width"], info["height"]), (2, 16, 8))
        self.run_tool("convert", "in.tif", "--from", "latlong", "--level", 2, "--to", "latlong", "--size", 8, "--type",
                      "float", "--compression", "none", "-o", "back.exr")
        width, height, channels, _ = read_exr(self.path("back.exr"))
        for y in range(height):
            for x in range(width):
                for name, value in zip("RGB", direction(x, y, width, height)):
                    self.assertLess(abs(channels[name][y][x] - value), 0.1)


class Seams(Case):
    def test_stretch(self):
        write_sun(self.path("in.exr"))
        for layout in ("cube", "isocube", "equi-angular-cube", "diamond-12"):
            self.run_tool("convert", "in.exr", "--to", layout, "--size", 16, "--packing", "parts", "--mips", "--seam",
                          "stretch", "--type", "float", "-o", "out.exr")
            for level in range(5):
                info = self.json("info", "--seams", "out.exr", "--level", level)
                n = 16 >> level
                self.assertEqual(info["seam"], "stretch")
                self.assertEqual(info["lookup"], {"scale": [(n - 1) / n] * 2, "offset": [0.5 / n] * 2})
                self.assertLess(info["seams"]["largest"], 1e-9)
                self.assertGreater(info["seams"]["points"], 0)
        self.assertIn("lookup", self.run_tool("info", "out.exr").out)

    def test_stretch_is_read_where_its_texels_are(self):
        write_directions(self.path("in.exr"))
        self.run_tool("convert", "in.exr", "--size", 16, "--seam", "stretch", "--type", "float", "--compression", "none",
                      "-o", "cube.exr")
        # Where nothing changes, every texel is copied.
        self.run_tool("convert", "cube.exr", "--size", 16, "--seam", "stretch", "--type", "float", "--compression",
                      "none", "-o", "same.exr")
        self.assertEqual(read_exr(self.path("cube.exr"))[2], read_exr(self.path("same.exr"))[2])
        self.run_tool("convert", "cube.exr", "--to", "latlong", "--size", 16, "--type", "float", "--compression", "none",
                      "-o", "back.exr")
        width, height, channels, _ = read_exr(self.path("back.exr"))
        # Not next to the poles, where a texel's mean is not the value at its centre.
        worst = max(abs(channels[name][y][x] - value) for y in range(3, height - 3) for x in range(width)
                    for name, value in zip("RGB", direction(x, y, width, height)))
        self.assertLess(worst, 0.01)  # a half-texel's shift would be 0.06

    def test_gutter(self):
        write_directions(self.path("in.exr"))
        common = ["--to", "isocube", "--size", 16, "--type", "float", "--compression", "none"]
        self.run_tool("convert", "in.exr", *common, "-o", "plain.exr")
        self.run_tool("convert", "in.exr", *common, "--seam", "gutter:3", "-o", "grown.exr")
        info = self.json("info", "--seams", "grown.exr")
        self.assertEqual((info["width"], info["height"], info["size"]), (6 * 22, 22, 16))
        self.assertEqual(info["lookup"], {"scale": [16 / 22] * 2, "offset": [3 / 22] * 2})
        self.assertLess(info["seams"]["largest"], info["seams"]["inside_largest"])
        # The gutters come off, and what is left is the plain map.
        self.run_tool("convert", "grown.exr", *common, "-o", "cut.exr")
        self.assertEqual(read_exr(self.path("cut.exr"))[2], read_exr(self.path("plain.exr"))[2])

    def test_a_limit(self):
        write_sun(self.path("in.exr"))
        run = lambda *words, expect=0: self.run_tool("convert", "in.exr", "--size", 16, *words, expect=expect)
        run("--max-seam", 0.001, "-o", "plain.exr", expect=1)
        told = re.fullmatch(r"envconv: plain\.exr: the largest seam error is (\S+), at level 0, above --max-seam 0\.001\n", self.err)
        self.assertIsNotNone(told, self.err)
        # The number is that of info, and the file is there.
        self.assertAlmostEqual(float(told[1]) / self.json("info", "--seams", "plain.exr")["seams"]["largest"], 1, 2)
        run("--max-seam", 0, "--seam", "stretch", "--mips", "-o", "stretched.exr")
        run("--max-seam", 0.001, "--seam", "average", "--mips", "-o", "averaged.exr")


if __name__ == "__main__":
    unittest.main()
