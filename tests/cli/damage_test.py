# SPDX-License-Identifier: Apache-2.0
"""Files that are damaged where their formats have means to notice: the same pixels as before, or an error."""
import json
import os
import pathlib
import random
import shutil
import struct
import subprocess
import tempfile
import unittest
import zlib

import corpus
from harness import BINARY, write_exr

WIDTH, HEIGHT = 48, 24
ADAM7 = ((0, 0, 8, 8), (4, 0, 8, 8), (0, 4, 4, 8), (2, 0, 4, 4), (0, 2, 2, 4), (1, 0, 2, 2), (0, 1, 1, 2))


def value(x, y, c):
    return (x * 5 + y * 7 + c * 60 + x * y % 11) % 256


def row(y, columns=range(WIDTH), channels=range(3)):
    return bytes(value(x, y, c) for x in columns for c in channels)


def png(interlaced=False, adler=True):
    """The picture in three IDAT chunks."""
    if interlaced:
        lines = [row(y, range(x0, WIDTH, dx)) for x0, y0, dx, dy in ADAM7 for y in range(y0, HEIGHT, dy)]
    else:
        lines = [row(y) for y in range(HEIGHT)]
    data = zlib.compress(b"".join(b"\0" + line for line in lines), 9)
    if not adler:
        data = data[:-1] + bytes([data[-1] ^ 1])
    third = len(data) // 3
    head = corpus.chunk(b"IHDR", struct.pack(">IIBBBBB", WIDTH, HEIGHT, 8, 2, 0, 0, interlaced))
    parts = (data[:third], data[third : 2 * third], data[2 * third :])
    return (b"\x89PNG\r\n\x1a\n" + head + corpus.chunk(b"gAMA", struct.pack(">I", 45455))
            + b"".join(corpus.chunk(b"IDAT", part) for part in parts) + corpus.chunk(b"IEND", b""))


def tiff(blocks, tile=None, rows=HEIGHT, planar=False, compression=8, order=1, code=lambda d: zlib.compress(d, 9)):
    """A little-endian TIFF of 8-bit RGB whose directory comes first, and where its blocks begin."""
    blocks = [code(block) for block in blocks]
    if order == 2:
        blocks = [bytes(int(f"{byte:08b}"[::-1], 2) for byte in block) for block in blocks]
    fields = [(256, 3, [WIDTH]), (257, 3, [HEIGHT]), (258, 3, [8, 8, 8]), (259, 3, [compression]), (262, 3, [2]),
              (266, 3, [order]), (277, 3, [3]), (284, 3, [2 if planar else 1])]
    offsets, counts = (324, 325) if tile else (273, 279)
    fields += [(322, 3, [tile]), (323, 3, [tile])] if tile else [(278, 3, [rows])]
    fields += [(offsets, 4, [0] * len(blocks)), (counts, 4, [len(block) for block in blocks])]
    fields.sort()
    more_at = 8 + 2 + 12 * len(fields) + 4
    start = more_at + sum(n * len(v) for _, kind, v in fields if (n := {3: 2, 4: 4}[kind]) * len(v) > 4)
    entries, more = b"", b""
    for tag, kind, values in fields:
        if tag == offsets:
            values = [start + sum(map(len, blocks[:i])) for i in range(len(blocks))]
        data = struct.pack(f"<{len(values)}{'H' if kind == 3 else 'I'}", *values)
        entries += struct.pack("<HHI", tag, kind, len(values))
        entries += data.ljust(4, b"\0") if len(data) <= 4 else struct.pack("<I", more_at + len(more))
        more += data if len(data) > 4 else b""
    head = b"II*\0" + struct.pack("<IH", 8, len(fields)) + entries + b"\0\0\0\0" + more
    return head + b"".join(blocks), start


def tiffs():
    strips = [b"".join(row(y) for y in range(top, top + 10) if y < HEIGHT) for top in range(0, HEIGHT, 10)]
    planes = [b"".join(row(y, channels=[c]) for y in range(HEIGHT)) for c in range(3)]

    def tiles(channels):
        return [b"".join(row(y, range(x0, x0 + 32), channels) for y in range(y0, y0 + 32)) for y0 in range(0, HEIGHT, 32)
                for x0 in range(0, WIDTH, 32)]

    yield "strips.tif", tiff(strips, rows=10)
    yield "reversed.tif", tiff(strips, rows=10, order=2)
    yield "old.tif", tiff(strips, rows=10, compression=32946)
    yield "planes.tif", tiff(planes, planar=True)
    yield "tiles.tif", tiff(tiles(range(3)), tile=32)
    yield "plane-tiles.tif", tiff([t for c in range(3) for t in tiles([c])], tile=32, planar=True)


def damages(data, first):
    """Pairs of what was done behind byte `first`, and the file."""
    chance = random.Random(len(data))
    last = len(data)
    for at in sorted({first, *(first + (last - first) * i // 8 for i in range(8)), last - 12, last - 4, last - 1}):
        yield f"cut{at}", data[:at]
    # All of the last bytes, where checksums are.
    for at in sorted({*chance.sample(range(first, last), 16), *range(last - 4, last)}):
        yield f"flip{at}", corpus.replaced(data, at, bytes([data[at] ^ (1 << chance.randrange(8))]))
    for at in chance.sample(range(first, last - 32), 4):
        yield f"zeros{at}", corpus.replaced(data, at, bytes(32))
        yield f"gap{at}", data[:at] + data[at + 8 :]


class Damage(unittest.TestCase):
    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="envconv-damage-"))
        self.addCleanup(shutil.rmtree, self.folder)

    def make(self, name, *words):
        write_exr(self.folder / "in.exr", WIDTH, HEIGHT, lambda x, y: tuple(value(x, y, c) / 256 for c in range(3)))
        subprocess.run([BINARY, "convert", "in.exr", "-o", name, "-q", "--filter", "nearest", *words], cwd=self.folder,
                       check=True)
        return (self.folder / name).read_bytes()

    def convert(self, files, *words):
        """Runs the tool over {name: bytes}; {name: None or (status, message)}, and what was written."""
        for name, data in files.items():
            (self.folder / name).write_bytes(data)
        (self.folder / "out").mkdir(exist_ok=True)
        done = subprocess.run(
            [BINARY, "convert", "--files-from", "-", "-o", "out/{stem}_{ext}.exr", "--to", "latlong", "--size", "24", "--filter",
             "nearest", "--compression", "none", "--keep-going", "--json", *words], cwd=self.folder,
            input="\n".join(files).encode(), capture_output=True, timeout=300)
        reports = [json.loads(line) for line in done.stdout.splitlines()]
        self.assertEqual(len(reports), len(files) + 1, done.stderr)
        ends = {r["input"]: (r["status"], r["error"]) if r["error"] else None for r in reports[:-1]}
        written = {name: self.folder / "out" / (name.replace(".", "_") + ".exr") for name in files if not ends[name]}
        return ends, {name: path.read_bytes() for name, path in written.items()}

    def check(self, name, good, first, *words):
        """All damages of a file, each of which must be an error or change no pixel."""
        stem, kind = name.rsplit(".", 1)
        files = {f"{stem}-{what}.{kind}": data for what, data in damages(good, first)}
        files = {n: data for n, data in files.items() if data != good}
        ends, written = self.convert({name: good, **files}, *words)
        self.assertIsNone(ends[name])
        self.assertGreater(sum(map(bool, ends.values())), 30)
        for damaged in files:
            if ends[damaged]:
                self.assertEqual(ends[damaged][0], 3, (damaged, ends[damaged]))
                self.assertIn(damaged + ": ", ends[damaged][1])
            else:
                self.assertEqual(written[damaged], written[name], f"{damaged} has other pixels")
        for path in (self.folder / "out").iterdir():
            path.unlink()

    def test_png(self):
        for name, data in (("plain.png", png()), ("interlaced.png", png(interlaced=True))):
            self.check(name, data, 8)
            self.check(name, data, 8, "--trust-input")
        # What checksums of chunks cannot tell.
        whole = png()
        pixels = whole.index(b"IDAT") - 4
        ends, _ = self.convert({"adler.png": png(adler=False), "no-end.png": whole[:-12],
                                "short.png": whole[: whole.index(b"IDAT", pixels + 8) - 4] + whole[-12:],
                                "none.png": whole[:pixels] + whole[-12:], "more.png": whole + b"more"})
        for name in ("adler.png", "no-end.png", "short.png", "none.png"):
            self.assertEqual((ends[name] or [None])[0], 3, name)
        self.assertIsNone(ends["more.png"])

    def test_tiff(self):
        for name, (data, start) in tiffs():
            self.check(name, data, start)
        self.check(name, data, start, "--trust-input")

    def refused(self, files, *words):
        """All but the first one, which is good; the messages."""
        ends, _ = self.convert(files, "--from", "latlong", *words)
        first, *others = files
        self.assertIsNone(ends[first])
        for name in others:
            self.assertEqual((ends[name] or [None])[0], 3, name)
        return {name: ends[name][1] for name in others}

    def test_png_with_other_sizes(self):
        whole = png()

        def of(width, height, depth=8, color=2, interlaced=0):
            head = corpus.chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, color, 0, 0, interlaced))
            return whole[:8] + head + whole[33:]

        sizes = {f"{w}x{h}.png": of(w, h) for w, h in ((48, 23), (48, 12), (48, 25), (47, 24), (24, 12), (2, 1))}
        kinds = {"gray.png": of(48, 24, 8, 0), "sixteen.png": of(24, 24, 16), "adam7.png": of(48, 24, interlaced=1)}
        self.assertEqual(of(WIDTH, HEIGHT), whole)
        self.refused({"good.png": whole, "interlaced.png": of(48, 24, interlaced=1), **sizes, **kinds})
        ends, _ = self.convert({"whole-interlaced.png": png(interlaced=True)})
        self.assertIsNone(ends["whole-interlaced.png"])

    def test_png_with_colours_that_its_palette_lacks(self):
        def of(depth, color, colors, filters, interlaced=0):
            # All index 1, and one pixel of another colour.
            width, height = WIDTH, HEIGHT
            data = b""
            for x0, y0, dx, dy in ADAM7 if interlaced else ((0, 0, 1, 1),):
                above = None
                for y in range(y0, height, dy):
                    indices = [color if (x, y) == (45, 23) else 1 for x in range(x0, width, dx)]
                    indices += [(1 << depth) - 1] * (-len(indices) % (8 // depth))  # no pixels, of any value
                    line = [int("".join(f"{v:0{depth}b}" for v in indices[i : i + 8 // depth]), 2)
                            for i in range(0, len(indices), 8 // depth)]
                    up = above or [0] * len(line)
                    left, corner = [0, *line[:-1]], [0, *up[:-1]]
                    kind = filters[y % len(filters)]
                    guess = ([0] * len(line), left, up, [(a + b) // 2 for a, b in zip(left, up)],
                             [min((abs(b - c), 0, a), (abs(a - c), 1, b), (abs(a + b - 2 * c), 2, c))[2]
                              for a, b, c in zip(left, up, corner)])[kind]
                    data += bytes([kind]) + bytes((v - g) & 255 for v, g in zip(line, guess))
                    above = line
            head = struct.pack(">IIBBBBB", width, height, depth, 3, 0, 0, interlaced)
            return (b"\x89PNG\r\n\x1a\n" + corpus.chunk(b"IHDR", head) + corpus.chunk(b"PLTE", bytes(range(3 * colors)))
                    + corpus.chunk(b"IDAT", zlib.compress(data)) + corpus.chunk(b"IEND", b""))

        files = {}
        for depth, colors in ((2, 3), (4, 5), (8, 70)):
            for interlaced in (0, 1):
                for filters in ([0], [1, 2], [3], [4]):
                    for what, color in (("good", colors - 1), ("bad", colors)):
                        name = f"{what}-{depth}-{interlaced}-{filters[0]}.png"
                        files[name] = of(depth, color, colors, filters, interlaced)
        ends, _ = self.convert(files)
        for name, end in ends.items():
            self.assertIn("palette" if name.startswith("bad") else "None", str(end), name)

    def test_tiff_of_streams_without_checksums(self):
        strips = [b"".join(row(y) for y in range(top, min(top + 10, HEIGHT))) for top in range(0, HEIGHT, 10)]

        def packed(data):  # PackBits: in pieces of 100 bytes as they are
            return b"".join(bytes([len(data[i : i + 100]) - 1]) + data[i : i + 100] for i in range(0, len(data), 100))

        def lzw(data):  # TIFF's: the highest bit first, codes get longer one early
            table, codes, word = {bytes([i]): i for i in range(256)}, [(256, 9)], b""
            for byte in data:
                longer = word + bytes([byte])
                if longer in table:
                    word = longer
                    continue
                codes.append((table[word], (len(table) + 2).bit_length()))
                table[longer] = len(table) + 2
                word = bytes([byte])
                if len(table) == 4092:
                    codes.append((256, 12))
                    table = {bytes([i]): i for i in range(256)}
            codes += [(table[word], (len(table) + 2).bit_length()), (257, (len(table) + 3).bit_length())]
            bits = "".join(f"{code:0{width}b}" for code, width in codes)
            return bytes(int(bits[i : i + 8].ljust(8, "0"), 2) for i in range(0, len(bits), 8))

        for compression, code in ((5, lzw), (32773, packed)):
            good, start = tiff(strips, rows=10, compression=compression, code=code)
            whole, _ = tiff(strips[:-1] + [strips[-1] + bytes(6 * 3 * WIDTH)], rows=10, compression=compression, code=code)
            ends, written = self.convert({"good.tif": good, "whole.tif": whole})
            self.assertEqual(ends, {"good.tif": None, "whole.tif": None})
            self.assertEqual(written["good.tif"], written["whole.tif"])
            bad = {f"{what}.tif": tiff([*strips[:-2], change(strips[-2]), strips[-1]], rows=10, compression=compression,
                                       code=code)[0] for what, change in
                   (("short", lambda d: d[:-1]), ("long", lambda d: d[:-40] + bytes(80)), ("half", lambda d: d[: len(d) // 2]))}
            self.refused({"good.tif": good, **bad})

    def test_tiff_of_decoders_that_go_on(self):
        (self.folder / "in.png").write_bytes(png())
        subprocess.run(["oiiotool", "in.png", "--compression", "jpeg", "-o", "j.tif"], cwd=self.folder, check=True,
                       capture_output=True)
        good = (self.folder / "j.tif").read_bytes()
        start, end = good.index(b"\xff\xda") + 14, good.rindex(b"\xff\xd9")
        middle = (start + end) // 2
        self.assertGreater(end - start, 200)
        self.refused({"j.tif": good, "zeros.tif": good[:middle] + bytes(end - middle) + good[end:],
                      "end.tif": corpus.replaced(good, middle, b"\xff\xd9")})

    def test_tiff_fields_that_cannot_be(self):
        strip = b"".join(row(y) for y in range(HEIGHT))
        good = corpus.tiff(WIDTH, HEIGHT, strip)
        cases = {"kind": {262: (3, 1, 77)}, "cmyk": {262: (3, 1, 5)}, "float8": {339: (3, 1, 3)},
                 "size-0": {279: (4, 1, 0)}, "size-1": {279: (4, 1, 1)}, "size+1": {279: (4, 1, len(strip) + 1)},
                 "size-4G": {279: (4, 1, 0xFFFFFFFF)}, "in-directory": {273: (4, 1, 12)}, "around-it": {273: (4, 1, 8)}}
        bad = {f"{what}.tif": corpus.tiff(WIDTH, HEIGHT, strip + strip[:200], fields.items()) for what, fields in cases.items()}
        bad["size+1.tif"] = corpus.tiff(WIDTH, HEIGHT, strip, cases["size+1"].items())
        self.refused({"good.tif": good, **bad})

    def test_jpeg(self):
        good = self.make("j.jpg", "--to", "latlong")
        start = good.index(b"\xff\xda") + 14
        middle = (start + len(good)) // 2
        frame = good.index(b"\xff\xc0") + 5
        bad = {"zeros": good[:middle] + bytes(len(good) - middle), "zeros-end": good[:middle] + bytes(len(good) - middle - 2) + good[-2:],
               "early-end": good[:middle] + good[-2:], "cut": good[:middle], "no-end": good[:-2],
               "marker": good[:middle] + b"\xff\xd3" + good[middle:],
               "small": corpus.replaced(good, frame, struct.pack(">HH", 8, 16)),
               "quantiser": corpus.replaced(good, good.index(b"\xff\xdb") + 9, b"\0"),
               "more": good[:-2] + bytes(64) + good[-2:], "progressive": good.replace(b"\xff\xc0", b"\xff\xc2"),
               "arithmetic": good.replace(b"\xff\xc0", b"\xff\xc9")}
        self.refused({"good.jpg": good, **{f"{what}.jpg": data for what, data in bad.items()}})
        # Behind the end mark, cameras put whatever they like.
        ends, written = self.convert({"good.jpg": good, "tail.jpg": good + bytes(range(256)) * 4})
        self.assertIsNone(ends["tail.jpg"])
        self.assertEqual(written["tail.jpg"], written["good.jpg"])

    def test_rows_behind_the_last(self):
        hdr = self.make("h.hdr", "--to", "latlong")
        flat = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 24 +X 48\n" + bytes(range(16, 112)) * 48
        for good in (hdr, flat):
            self.refused({"good.hdr": good, **{f"{h}.hdr": good.replace(b"-Y 24", b"-Y %d" % h) for h in (1, 12, 23, 25)},
                          "words.hdr": good.replace(b"+X 48", b"+X 48 48"), "twice.hdr": good + good[-len(good) // 2 :]})
        ends, _ = self.convert({"line.hdr": hdr + b"\n"})
        self.assertIsNone(ends["line.hdr"])
        ppm = b"P6\n# c\n48 24 255\n" + b"".join(row(y) for y in range(HEIGHT))
        pfm = b"PF\n48 24\n-1\n" + struct.pack("<f", 0.5) * (48 * 24 * 3)
        self.refused({"good.ppm": ppm, "low.ppm": ppm.replace(b"48 24", b"48 23"), "gray.ppm": ppm.replace(b"P6", b"P5"),
                      "narrow.ppm": ppm.replace(b"48 24", b"24 24"), "zero.ppm": ppm.replace(b" 255", b" 0"),
                      "minus.ppm": ppm.replace(b" 255", b" -1"), "wide.ppm": ppm.replace(b" 255", b" 65536")})
        self.refused({"good.pfm": pfm, "low.pfm": pfm.replace(b"48 24", b"48 20"), "zero.pfm": pfm.replace(b"-1", b"0"),
                      "nan.pfm": pfm.replace(b"-1", b"nan"), "inf.pfm": pfm.replace(b"-1", b"-inf")})
        # These formats allow pictures behind each other.
        ends, _ = self.convert({"two.ppm": ppm + ppm, "two.pfm": pfm + pfm})
        self.assertEqual(ends, {"two.ppm": None, "two.pfm": None})

    def test_exr_chunks_and_flags(self):
        for compression in ("piz", "b44", "rle", "dwaa", "zip"):
            good = self.make("c.exr", "--to", "latlong", "--compression", compression, "--type", "half")
            table = good.index(b"screenWindowWidth\0float\0") + len(b"screenWindowWidth\0float\0") + 8 + 1
            chunk, = struct.unpack_from("<Q", good, table)
            size, = struct.unpack_from("<i", good, chunk + 4)
            bad = {f"size{v}.exr": corpus.replaced(good, chunk + 4, struct.pack("<i", v)) for v in (0, -1, 1 << 30)}
            bad["deep.exr"] = corpus.replaced(good, 5, bytes([good[5] | 8]))
            if compression == "zip":
                bad["longer.exr"] = corpus.replaced(good, chunk + 4, struct.pack("<i", size + 1))
            self.refused({"good.exr": good, **bad})

    def test_exr_without_an_attribute_that_all_have(self):
        write_exr(self.folder / "in.exr", WIDTH, HEIGHT, lambda x, y: (0.5, 0.25, 1))
        good = (self.folder / "in.exr").read_bytes()
        names, at, bad = [], 8, {}
        while good[at]:
            end = good.index(b"\0", good.index(b"\0", at) + 1) + 1
            end += 4 + struct.unpack_from("<i", good, end)[0]
            name = good[at : good.index(b"\0", at)].decode()
            names.append(name)
            # The table of chunks says where they are in the shorter file.
            offsets = struct.unpack_from(f"<{HEIGHT}Q", good, first := good.index(b"screenWindowWidth\0float\0") + 33)
            offsets = struct.pack(f"<{HEIGHT}Q", *(o - (end - at) for o in offsets))
            bad[f"no-{name}.exr"] = good[:at] + good[end:first] + offsets + good[first + len(offsets) :]
            at = end
        self.assertEqual(len(names), 8)  # all that the format asks for, and no other
        said = self.refused({"good.exr": good, **bad})
        for name in names:
            self.assertIn(f"its header has no {name}", said[f"no-{name}.exr"])
        # A name twice: OpenEXR makes one channel of both.
        said = self.refused({"good.exr": good, "twice.exr": good.replace(b"\0B\0", b"\0R\0", 1)})
        self.assertIn("has channel R twice", said["twice.exr"])

    def test_exr_chunks_that_do_not_unpack_to_their_pixels(self):
        # PIZ: a stream that breaks off, and one that is whole of other channels than the header says.
        good = self.make("p.exr", "--to", "latlong", "--compression", "piz", "--type", "half")
        table = good.index(b"screenWindowWidth\0float\0") + 33
        chunk, = struct.unpack_from("<Q", good, table)
        size, = struct.unpack_from("<i", good, chunk + 4)
        least, most = struct.unpack_from("<HH", good, chunk + 8)
        stream = chunk + 8 + 4 + most - least + 1
        self.assertEqual(stream + 4 + struct.unpack_from("<i", good, stream)[0], chunk + 8 + size)
        bits, = struct.unpack_from("<i", good, stream + 16)
        types = good.index(b"channels\0chlist\0") + 16 + 4
        one = bytearray(good)
        for c in range(3):
            one[types + 18 * c + 2] = 2  # float
        bad = {"zeros": good[: chunk + 8 + size // 2] + bytes(size - size // 2) + good[chunk + 8 + size :],
               "float": bytes(one), "bits-": corpus.replaced(good, stream + 16, struct.pack("<i", bits - 1)),
               "bits+": corpus.replaced(good, stream + 16, struct.pack("<i", bits + 1)),
               "length": corpus.replaced(good, stream, struct.pack("<i", size)),
               "set": corpus.replaced(good, chunk + 8 + 4, bytes(most - least + 1))}
        self.refused({"good.exr": good, **{f"{what}.exr": data for what, data in bad.items()}})
        # RLE: runs that make fewer or more bytes than a line has.
        head = self.make("r.exr", "--to", "latlong", "--compression", "rle", "--type", "half")[:table]
        self.assertEqual(head[-5:], b"\0\0\x80\x3f\0")

        def lines(*runs):
            packed = b"".join(bytes([count - 1, 128]) for count in runs)
            places = (table + 8 * HEIGHT + y * (8 + len(packed)) for y in range(HEIGHT))
            return (head + b"".join(struct.pack("<Q", at) for at in places)
                    + b"".join(struct.pack("<ii", y, len(packed)) + packed for y in range(HEIGHT)))

        line = 2 * 3 * WIDTH  # bytes
        self.assertEqual(line, 288)
        self.refused({"runs.exr": lines(128, 128, 32), "fewer.exr": lines(128, 128, 31), "none.exr": lines(128),
                      "more.exr": lines(128, 128, 33), "another.exr": lines(128, 128, 32, 1)})
        # B44: blocks of zeros stand for NaN, which no block is made of.
        good = self.make("b.exr", "--to", "latlong", "--compression", "b44", "--type", "half")
        chunk, = struct.unpack_from("<Q", good, table)
        self.refused({"good.exr": good, "zeros.exr": good[: chunk + 8] + bytes(len(good) - chunk - 8)})

    def test_blocks_up_to_the_last(self):
        (self.folder / "in.png").write_bytes(png())
        oiiotool, ffmpeg = ("oiiotool", "in.png", "-o"), ("ffmpeg", "-v", "error", "-i", "in.png")
        for name, words in (("a.gif", oiiotool), ("a.jp2", ffmpeg), ("a.j2k", ffmpeg), ("a.bmp", oiiotool), ("raw.tga", oiiotool),
                            ("runs.tga", (*oiiotool[:2], "--compression", "rle", "-o"))):
            subprocess.run([*words, name], cwd=self.folder, check=True, capture_output=True)
            kind = name.split(".")[1]
            good = (self.folder / name).read_bytes()
            if kind == "j2k":  # without the boxes
                good = good[good.index(b"\xff\x4f\xff\x51") :]
            size = len(good)
            cuts = {f"cut{n}.{kind}": good[:-n] for n in (1, 2, 7, 18, 26, 27, size // 3, size // 2)}
            if kind != "bmp":
                cuts[f"zeros.{kind}"] = good[: size // 2] + bytes(size - size // 2)
            self.refused({name: good, **cuts})
            tail = good + bytes(99)
            ends, _ = self.convert({f"tail.{kind}": tail}, "--from", "latlong")
            # Of Targa the end is what tells whether there are areas behind the pixels.
            self.assertEqual(bool(ends[f"tail.{kind}"]), kind == "tga", name)
        # SGI's rows have places and lengths, and codes that must make their width.  OpenImageIO's reader dies of some.
        def sgi(change=lambda row: row, bits=8):
            codes = lambda values: b"".join(struct.pack(">B" if bits == 8 else ">H", v) for v in values)
            rows = [change(codes((WIDTH - 8, y, 128 + 8, *range(8), 0))) for y in range(3 * HEIGHT)]
            places = [512 + 8 * len(rows) + sum(map(len, rows[:y])) for y in range(len(rows))]
            return (struct.pack(">HBBHHHHII", 474, 1, bits // 8, 3, WIDTH, HEIGHT, 3, 0, 255).ljust(512, b"\0")
                    + struct.pack(f">{len(rows)}I", *places) + struct.pack(f">{len(rows)}I", *map(len, rows)) + b"".join(rows))

        good = sgi()
        self.refused({"good.sgi": good, "cut.sgi": good[:-1], "short.sgi": sgi(lambda row: row[2:]),
                      "long.sgi": sgi(lambda row: b"\1\1" + row), "endless.sgi": sgi(lambda row: row[:-1]),
                      "outside.sgi": corpus.replaced(good, 512 + 4, struct.pack(">I", len(good) + 1)),
                      "header.sgi": corpus.replaced(good, 512 + 4, struct.pack(">I", 12))})
        ends, _ = self.convert({"wide.sgi": sgi(bits=16)})
        self.assertIsNone(ends["wide.sgi"])
        bmp = (self.folder / "a.bmp").read_bytes()
        self.assertEqual(struct.unpack_from("<iiHHI", bmp, 18), (WIDTH, HEIGHT, 1, 24, 0))
        cases = {"low": (22, HEIGHT // 2), "narrow": (18, WIDTH // 2), "place": (10, 20), "packed": (30, 0x10000),
                 "bits": (28, 8)}
        self.refused({"good.bmp": bmp, "down.bmp": corpus.replaced(bmp, 22, struct.pack("<i", -HEIGHT + 1)),
                      **{f"{what}.bmp": corpus.replaced(bmp, at, struct.pack("<i", v)) for what, (at, v) in cases.items()}})
        # One pixel of a run more than there are.
        good = bytes([0, 0, 10]) + bytes(9) + struct.pack("<HHBB", WIDTH, HEIGHT, 24, 0) + b"\x97abc" * (2 * HEIGHT)
        self.refused({"good.tga": good, "run.tga": good[:-4] + b"\x98abc", "fewer.tga": good[:-4] + b"\x96abc"})
        self.assertEqual(0x97 - 127, WIDTH // 2)

    def test_nothing_finite(self):
        for what in ("nan", "inf"):
            write_exr(self.folder / "no.exr", WIDTH, HEIGHT, lambda x, y: (float(what),) * 3)
            data = (self.folder / "no.exr").read_bytes()
            ends, _ = self.convert({"no.exr": data})
            self.assertEqual(ends["no.exr"][0], 3)
            self.assertIn("no finite value", ends["no.exr"][1])
            ends, _ = self.convert({"no.exr": data}, "--nonfinite", "zero")
            self.assertIsNone(ends["no.exr"])

    def test_tiff_of_other_programs_with_levels(self):
        # Levels are behind each other, the directories at the end.
        data = self.make("levels.tif", "--to", "latlong", "--mips", "--type", "uint8", "--compression", "zip")
        end = len(data) - 16
        for level in (0, 1):
            ends, _ = self.convert({f"cut{at}.tif": data[:at] for at in range(8, end, end // 12)}, "--level", str(level))
            for name, end_of in ends.items():
                self.assertEqual((end_of or [None])[0], 3, name)

    def test_exr(self):
        for compression in ("zip", "zips", "pxr24"):
            good = self.make("c.exr", "--to", "latlong", "--compression", compression, "--type", "float")
            table = good.index(b"screenWindowWidth\0float\0") + len(b"screenWindowWidth\0float\0") + 8 + 1
            self.check(compression + ".exr", good, table)

    def test_exr_cut_anywhere(self):
        compressions = ("none", "rle", "zips", "zip", "piz", "pxr24", "b44", "b44a", "dwaa", "dwab")
        cases = [(("--to", "latlong", "--size", "300"), c) for c in compressions]  # several chunks of each
        cases += [(("--size", "16", "--mips", "--packing", packing), c) for packing in ("column", "parts") for c in ("none", "dwab")]
        for words, compression in cases:
            good = self.make("m.exr", *words, "--compression", compression)
            size = len(good)
            cuts = {f"cut{at}.exr": good[:at] for at in (size // 2, *range(size - 800, size, 160), size - 1)}
            for level in ("0", "2") if "--mips" in words else ("0",):
                ends, _ = self.convert({"m.exr": good, **cuts}, "--level", level)
                self.assertIsNone(ends.pop("m.exr"), (words, compression))
                for name, end in ends.items():
                    self.assertEqual((end or [None])[0], 3, (words, compression, level, name))

    def test_ktx2(self):
        for compression in ("zlib", "zstd"):
            good = self.make("k.ktx2", "--size", "16", "--type", "half", "--compression", compression, "--mips=1")
            offset, size = struct.unpack_from("<QQ", good, 80)
            self.assertEqual(offset + size, len(good))
            self.check(compression + ".ktx2", good, offset)
        # Levels that nobody asked for.
        for compression in ("zlib", "zstd"):
            good = self.make("l.ktx2", "--size", "16", "--type", "half", "--compression", compression)
            offset, size, unpacked = struct.unpack_from("<QQQ", good, 80 + 24)
            bad = {"shorter": corpus.replaced(good, 88 + 24, struct.pack("<Q", size - 1)),
                   "flip": corpus.replaced(good, offset + size // 2, bytes([good[offset + size // 2] ^ 4]))}
            ends, _ = self.convert({"l.ktx2": good, **{f"{what}.ktx2": data for what, data in bad.items()}})
            self.assertIsNone(ends.pop("l.ktx2"))
            for name, end in ends.items():
                self.assertEqual((end or [None])[0], 3, name)


if __name__ == "__main__":
    unittest.main()
