# SPDX-License-Identifier: Apache-2.0
"""Runs the tool in a folder of its own, and writes and reads small images without the tool's own libraries.

ENVCONV names the binary, ENVCONV_SOURCE the source tree.
"""
import json
import math
import os
import pathlib
import shutil
import signal
import struct
import subprocess
import tempfile
import unittest
import zlib

BINARY = os.path.abspath(os.environ["ENVCONV"])
SOURCE = pathlib.Path(os.environ["ENVCONV_SOURCE"]).resolve()
SANITIZED = bool(os.environ.get("ENVCONV_SANITIZE"))  # a build that is many times slower
PANORAMAS = SOURCE / "testdata" / "panoramas"

# A shell's background job, and nohup, ignore them, and what is ignored is inherited by the tool, which keeps to it.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


class Case(unittest.TestCase):
    """One test in an empty folder, which is the current one of everything that it runs."""

    maxDiff = None

    def setUp(self):
        self.folder = pathlib.Path(tempfile.mkdtemp(prefix="envconv-cli-"))
        self.addCleanup(shutil.rmtree, self.folder)

    def run_tool(self, *words, expect=0, **options):
        """Runs envconv; the exit status must be `expect`."""
        options.setdefault("timeout", 600 if SANITIZED else 120)
        options.setdefault("cwd", self.folder)
        done = subprocess.run([BINARY, *map(str, words)], capture_output=True, **options)
        out, err = done.stdout.decode(), done.stderr.decode(errors="replace")
        self.assertEqual(done.returncode, expect, f"{words}\nstdout: {out}\nstderr: {err}")
        for line in err.splitlines():
            self.assertTrue(line.startswith("envconv: "), f"a line on stderr is not ours: {line!r}")
        self.out, self.err = out, err
        return self

    def says(self, *parts):
        """What the last run said on stderr contains all of `parts`."""
        for part in parts:
            self.assertIn(part, self.err)

    def is_silent(self):
        self.assertEqual((self.out, self.err), ("", ""))

    def json(self, *words, **options):
        return json.loads(self.run_tool(*words, "--json", **options).out)

    def files(self):
        """All files in the folder, hidden ones too."""
        return sorted(str(p.relative_to(self.folder)) for p in self.folder.rglob("*") if p.is_file())

    def path(self, name):
        return self.folder / name


def comma_locale(folder):
    """An environment whose locale has a decimal comma, which is made in that folder."""
    subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", f"{folder}/de_DE.UTF-8"], check=True, capture_output=True)
    env = {**os.environ, "LOCPATH": str(folder), "LC_ALL": "de_DE.UTF-8"}
    told = subprocess.run(["locale", "decimal_point"], env=env, check=True, capture_output=True).stdout
    assert told == b",\n", told
    return env


def write_exr(path, width, height, pixel, channels="RGB", attributes=None):
    """An uncompressed float OpenEXR file; pixel(x, y) gives the channels' values.

    Attributes are texts, or pairs of a type and bytes.
    """
    names = sorted(channels)

    def attribute(name, kind, data):
        return name.encode() + b"\0" + kind.encode() + b"\0" + struct.pack("<i", len(data)) + data

    chlist = b"".join(n.encode() + b"\0" + struct.pack("<iiii", 2, 0, 1, 1) for n in names) + b"\0"
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    head = struct.pack("<ii", 20000630, 2)
    head += attribute("channels", "chlist", chlist) + attribute("compression", "compression", b"\0")
    head += attribute("dataWindow", "box2i", window) + attribute("displayWindow", "box2i", window)
    for name, value in (attributes or {}).items():
        head += attribute(name, *(value if isinstance(value, tuple) else ("string", value.encode())))
    head += attribute("lineOrder", "lineOrder", b"\0") + attribute("pixelAspectRatio", "float", struct.pack("<f", 1))
    head += attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0, 0))
    head += attribute("screenWindowWidth", "float", struct.pack("<f", 1)) + b"\0"
    line_size = 4 * width * len(names)
    start = len(head) + 8 * height
    data = bytearray(head)
    for y in range(height):
        data += struct.pack("<Q", start + y * (8 + line_size))
    for y in range(height):
        row = [dict(zip(channels, pixel(x, y))) for x in range(width)]
        data += struct.pack("<ii", y, line_size)
        for name in names:
            data += struct.pack(f"<{width}f", *(p[name] for p in row))
    pathlib.Path(path).write_bytes(data)


def read_exr(path):
    """(width, height, {channel: rows}, {attribute: bytes}) of an uncompressed single-part OpenEXR file."""
    data = pathlib.Path(path).read_bytes()
    magic, version = struct.unpack_from("<ii", data)
    assert magic == 20000630 and version & ~0x400 == 2, "not a single-part scan-line file"
    at, attributes, types = 8, {}, {}

    def text():
        nonlocal at
        end = data.index(b"\0", at)
        word, at = data[at:end].decode(), end + 1
        return word

    while name := text():
        text()
        (size,) = struct.unpack_from("<i", data, at)
        attributes[name] = data[at + 4 : at + 4 + size]
        at += 4 + size
    chlist, c = attributes["channels"], 0
    while chlist[c]:
        end = chlist.index(b"\0", c)
        types[chlist[c:end].decode()] = struct.unpack_from("<i", chlist, end + 1)[0]
        c = end + 17
    assert attributes["compression"] == b"\0", "compressed"
    x0, y0, x1, y1 = struct.unpack("<iiii", attributes["dataWindow"])
    width, height = x1 - x0 + 1, y1 - y0 + 1
    channels = {name: [] for name in types}
    offsets = struct.unpack_from(f"<{height}Q", data, at)
    for offset in offsets:
        at = offset + 8
        for name, kind in types.items():
            code, size = {1: ("e", 2), 2: ("f", 4)}[kind]
            channels[name].append(struct.unpack_from(f"<{width}{code}", data, at))
            at += size * width
    return width, height, channels, attributes


def write_png(path, width, height, pixel, bits=8, chunks=()):
    """A PNG file; pixel(x, y) gives (r, g, b), each 0 to 255 (or 65535 with 16 bits).

    `chunks` are pairs of a type and its data, which stand before the pixels.
    """
    code = "B" if bits == 8 else "H"
    rows = (b"".join(struct.pack(f">3{code}", *pixel(x, y)) for x in range(width)) for y in range(height))
    write_png_rows(path, width, height, rows, bits, chunks)


def write_png_rows(path, width, height, rows, bits=8, chunks=()):
    """A PNG file of RGB rows, each of them bytes."""
    data = b"".join(b"\0" + row for row in rows)

    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, bits, 2, 0, 0, 0)
    pathlib.Path(path).write_bytes(
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + b"".join(chunk(*c) for c in chunks) + chunk(b"IDAT", zlib.compress(data, 1)) + chunk(b"IEND", b"")
    )


def read_png(path):
    """(width, height, rows of tuples, {chunk: data}) of a PNG file of 8 or 16 bits, grey or RGB, not interlaced."""
    data = pathlib.Path(path).read_bytes()
    assert data[:8] == b"\x89PNG\r\n\x1a\n", "no PNG"
    at, chunks, packed = 8, {}, b""
    while at < len(data):
        (size,) = struct.unpack_from(">I", data, at)
        kind, content = data[at + 4 : at + 8], data[at + 8 : at + 8 + size]
        assert struct.unpack_from(">I", data, at + 8 + size)[0] == zlib.crc32(kind + content), f"checksum of {kind}"
        if kind == b"IDAT":
            packed += content
        else:
            assert kind.isupper() or not packed or kind not in (b"cICP", b"sRGB", b"gAMA", b"cHRM"), "after the pixels"
            chunks[kind.decode()] = content
        at += 12 + size
    width, height, bits, color, _, _, interlace = struct.unpack(">IIBBBBB", chunks["IHDR"])
    channels = {0: 1, 2: 3, 4: 2, 6: 4}[color]
    assert interlace == 0
    size = channels * bits // 8
    stride, raw, above, rows = width * size, zlib.decompress(packed), bytes(width * size), []
    for y in range(height):
        method, line = raw[y * (stride + 1)], bytearray(raw[y * (stride + 1) + 1 : (y + 1) * (stride + 1)])
        for i in range(stride):
            left = line[i - size] if i >= size else 0
            corner = above[i - size] if i >= size else 0
            up, guess = above[i], left + above[i] - corner
            nearest = min((abs(guess - left), 0, left), (abs(guess - up), 1, up), (abs(guess - corner), 2, corner))[2]
            line[i] = (line[i] + (0, left, up, (left + up) // 2, nearest)[method]) & 255
        values = struct.unpack(f">{width * channels}{'B' if bits == 8 else 'H'}", line)
        rows.append([values[i : i + channels] for i in range(0, len(values), channels)])
        above = line
    return width, height, rows, chunks


def direction(x, y, width, height):
    """The world direction of a lat-long pixel: the geometry contract, once more."""
    longitude = 2 * math.pi * ((x + 0.5) / width - 0.5)
    polar = math.pi * (y + 0.5) / height
    return (math.sin(polar) * math.sin(longitude), math.cos(polar), math.sin(polar) * math.cos(longitude))


def write_directions(path, width=64, height=32):
    """A lat-long whose colour is its direction."""
    write_exr(path, width, height, lambda x, y: direction(x, y, width, height))


def write_constant(path, value=1.0, width=16, height=8):
    write_exr(path, width, height, lambda x, y: (value, value, value))


if __name__ == "__main__":
    unittest.main()
