# SPDX-License-Identifier: Apache-2.0
"""Hostile files of thirteen formats, made from small good ones: the same every time.

    python3 corpus.py FOLDER      with ENVCONV and ENVCONV_SOURCE set: writes the files there

What a file is to do is in its kind:
    truncated   must be refused
    claims      says it is larger than it is, or larger than anything: must be refused
    empty       has no pixels: must be refused
    bombs       small, and large when unpacked: refused by a limit
    late        damaged in its last bytes of pixels: must be refused
    metadata    correct pixels and malicious metadata: either way, but no crash, no hang
    flipped     a bit or a byte changed somewhere: either way
"""
import pathlib
import random
import struct
import subprocess
import sys
import zlib

from harness import BINARY, write_exr, write_png_rows

KINDS = ("truncated", "claims", "empty", "bombs", "late", "metadata", "flipped")
MUST_FAIL = ("truncated", "claims", "empty", "bombs", "late")


def chunk(kind, content):
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def tiff(width, height, strip, entries=()):
    """A little-endian TIFF of 8-bit RGB, uncompressed, of one strip."""
    count = len(strip)
    fields = {256: (4, 1, width), 257: (4, 1, height), 258: (3, 1, 8), 259: (3, 1, 1), 262: (3, 1, 2), 273: (4, 1, 0),
              277: (3, 1, 3), 278: (4, 1, height), 279: (4, 1, count)}
    fields.update(dict(entries))
    start = 8 + 2 + 12 * len(fields) + 4
    fields[273] = (4, 1, start) if 273 not in dict(entries) else fields[273]
    body = struct.pack("<H", len(fields))
    for tag, (kind, n, value) in sorted(fields.items()):
        body += struct.pack("<HHII", tag, kind, n, value)
    return b"II*\0" + struct.pack("<I", 8) + body + b"\0\0\0\0" + strip


def dds(width, height, data, levels=1, fourcc=116, depth=1):
    """A DDS of D3DFMT_A32B32G32R32F (116), or of another four-character code."""
    pixel_format = struct.pack("<II4sIIIII", 32, 4, struct.pack("<I", fourcc) if isinstance(fourcc, int) else fourcc,
                               0, 0, 0, 0, 0)
    return (b"DDS " + struct.pack("<IIIIIII", 124, 0x1007 | 0x20000, height, width, 16 * width & 0xFFFFFFFF, depth, levels)
            + b"\0" * 44 + pixel_format + struct.pack("<IIIII", 0x1000, 0, 0, 0, 0) + data)


def ktx2(width, height, data, levels=1, faces=1, length=None):
    """A KTX2 of R32G32B32A32_SFLOAT (VkFormat 109) with one level and the least descriptor."""
    descriptor = struct.pack("<I", 44) + struct.pack("<HHHH", 0, 0, 2, 40) + b"\1\1\1\0" + b"\0" * 28
    head = b"\xabKTX 20\xbb\r\n\x1a\n" + struct.pack("<IIIIIIIII", 109, 4, width, height, 0, 0, faces, levels, 0)
    at = len(head) + 32 + 24
    index = struct.pack("<IIIIQQ", at, len(descriptor), 0, 0, 0, 0)
    start = (at + len(descriptor) + 15) // 16 * 16
    level = struct.pack("<QQQ", start, len(data) if length is None else length, len(data))
    return (head + index + level + descriptor).ljust(start, b"\0") + data


def good_files(folder):
    """A small correct file of each format, by name, as bytes."""
    folder = pathlib.Path(folder)
    width, height = 32, 16
    write_exr(folder / "plain.exr", width, height, lambda x, y: (x / 32, y / 16, (x * y % 7) / 7))
    files = {"plain.exr": (folder / "plain.exr").read_bytes()}
    for name, options in (("zip.exr", ("--compression", "zip")), ("piz.exr", ("--compression", "piz")),
                          ("good.hdr", ()), ("good.tif", ("--type", "float")), ("zip.tif", ("--type", "uint8")),
                          ("good.jpg", ())):
        subprocess.run([BINARY, "convert", "plain.exr", "-o", name, "--to", "latlong", "-q", *options], cwd=folder,
                       check=True)
        files[name] = (folder / name).read_bytes()
    rows = [bytes((x * 8 + y * 3 + c * 50) % 256 for x in range(width) for c in range(3)) for y in range(height)]
    write_png_rows(folder / "good.png", width, height, rows)
    files["good.png"] = (folder / "good.png").read_bytes()
    files["raw.tif"] = tiff(width, height, b"".join(rows))
    values = struct.pack(f"<{width * height * 4}f", *(i % 11 / 11 for i in range(width * height * 4)))
    files["good.dds"] = dds(width, height, values)
    files["good.ktx2"] = ktx2(width, height, values)
    for name in ("good.bmp", "good.tga", "good.webp", "good.ppm", "good.pfm", "good.ktx"):
        subprocess.run([BINARY, "convert", "good.png", "-o", name, "--to", "latlong", "-q"], cwd=folder, check=True)
        files[name] = (folder / name).read_bytes()
    # Without its extension area, and so with pixels up to the footer.
    files["good.tga"] = files["good.tga"][: 18 + width * height * 3] + files["good.tga"][-26:]
    for path in list(folder.iterdir()):
        path.unlink()
    return files


def truncations(files):
    for name, data in files.items():
        for share in (0.02, 0.1, 0.25, 0.5, 0.75, 0.9):
            yield name, f"{int(share * 100):02}", data[: int(len(data) * share)]
        # JPEG's and TGA's last bytes are an end mark; without it, all pixels are there.
        yield name, "last", data[: -27 if name.endswith(".tga") else -16 if name.endswith(".jpg") else -1]


def replaced(data, at, new):
    return data[:at] + new + data[at + len(new) :]


def claims(files):
    sizes = (65535, 1 << 20, 0x7FFFFFFF, 0xFFFFFFFF)
    exr = files["plain.exr"]
    for attribute in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = exr.index(attribute) + len(attribute) + 4
        for size in (1 << 20, 0x7FFFFFFE):
            if attribute.startswith(b"data"):
                yield "plain.exr", f"wide{size}", replaced(exr, at + 8, struct.pack("<i", size))
                yield "plain.exr", f"high{size}", replaced(exr, at + 12, struct.pack("<i", size))
                yield "plain.exr", f"both{size}", replaced(exr, at + 8, struct.pack("<ii", size, size))
    for size in (0x7FFFFFFF, -5):
        yield "plain.exr", f"attribute{size}", exr[:8] + b"comments\0string\0" + struct.pack("<i", size) + exr[8:]
    for size in sizes:
        yield "good.hdr", f"high{size}", files["good.hdr"].replace(b"-Y 16", f"-Y {size}".encode())
        yield "good.hdr", f"both{size}", files["good.hdr"].replace(b"-Y 16 +X 32", f"-Y {size} +X {size}".encode())
        png = files["good.png"]
        for name, width, height in (("wide", size, 16), ("high", 32, size), ("both", size, size)):
            head = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
            yield "good.png", f"{name}{size}", png[:8] + head + png[33:]
            yield "raw.tif", f"{name}{size}", tiff(width, height, b"\0" * 1536)
            yield "good.dds", f"{name}{size}", dds(width, height, b"\0" * 8192)
            yield "good.ktx2", f"{name}{size}", ktx2(width, height, b"\0" * 8192)
    jpeg = files["good.jpg"]
    at = jpeg.index(b"\xff\xc0") + 5
    for height, width in ((65500, 32), (65500, 65500), (16, 65500)):
        yield "good.jpg", f"{width}x{height}", replaced(jpeg, at, struct.pack(">HH", height, width))
    yield "good.ktx2", "length", ktx2(32, 16, b"\0" * 8192, length=1 << 62)
    yield "good.ktx2", "faces", ktx2(32, 16, b"\0" * 8192, faces=0xFFFFFFFF)
    yield "raw.tif", "strip", tiff(32, 16, b"\0" * 1536, {273: (4, 1, 0xFFFFFFF0)}.items())
    yield "raw.tif", "header", tiff(32, 16, b"\0" * 1536, {273: (4, 1, 0)}.items())
    yield "raw.tif", "samples", tiff(32, 16, b"\0" * 1536, {277: (3, 1, 65535)}.items())


def empty(files):
    exr = files["plain.exr"]
    at = exr.index(b"dataWindow\0box2i\0") + 17 + 4
    yield "plain.exr", "inverted", replaced(exr, at, struct.pack("<iiii", 10, 10, 5, 5))
    yield "plain.exr", "minus-one", replaced(exr, at, struct.pack("<iiii", 0, 0, -1, -1))
    yield "good.hdr", "zero", files["good.hdr"].replace(b"-Y 16 +X 32", b"-Y 0 +X 0")
    yield "good.hdr", "negative", files["good.hdr"].replace(b"-Y 16 +X 32", b"-Y -16 +X -32")
    png = files["good.png"]
    for width, height in ((0, 16), (32, 0), (0, 0)):
        yield "good.png", f"{width}x{height}", (png[:8] + chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0))
                                                + png[33:])
        yield "raw.tif", f"{width}x{height}", tiff(width, height, b"\0" * 1536)
        yield "good.dds", f"{width}x{height}", dds(width, height, b"")
        yield "good.ktx2", f"{width}x{height}", ktx2(width, height, b"")
    yield "good.ppm", "0x16", b"P6\n0 16\n255\n"
    yield "good.ppm", "0x0", b"P6\n0 0\n255\n"
    yield "good.pfm", "0x16", b"PF\n0 16\n-1.0\n"
    yield "good.tga", "0x16", struct.pack("<BBB9xHHBB", 0, 0, 2, 0, 16, 24, 0) + bytes(8) + b"TRUEVISION-XFILE.\0"
    for name in files:
        yield name, "no-bytes", b""


def bombs(files):
    """Honest, of a few kilobytes, and over the limits when unpacked."""
    del files
    rows = zlib.compressobj(9)
    line, data = b"\0" * (1 + 3 * 6000), b""
    for _ in range(6000):
        data += rows.compress(line)
    data += rows.flush()
    yield "bomb.png", "large", (b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 6000, 6000, 8, 2, 0, 0, 0))
                                + chunk(b"IDAT", data) + chunk(b"IEND", b""))
    # Old run lengths: four bytes repeat a pixel 255 times 65536 at most.
    yield "bomb.hdr", "runs", (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 32768 +X 65536\n" + b"\1\2\3\4"
                               + b"\1\1\1\xff\1\1\1\xff\1\1\1\xff" * 50)
    # Whole, and not too many pixels: 65536 = 1 + 255 + 255 * 256 of them in twelve bytes.
    yield "bomb.hdr", "ratio", (b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 16 +X 65536\n"
                                + b"\1\2\3\4\1\1\1\xff\1\1\1\xff" * 16)


def late(files):
    data = files["good.png"]
    yield "good.png", "checksum", replaced(data, len(data) - 16, b"\x12\x34\x56\x78")
    yield "good.png", "no-end-of-data", data[: len(data) - 40] + data[-12:]
    exr = files["zip.exr"]
    yield "zip.exr", "last-chunk", exr[:-12] + b"\xff" * 12
    hdr = files["good.hdr"]
    yield "good.hdr", "last-line", hdr[:-20] + b"\2\2\0\x20" + b"\xff" * 16
    # A stream that breaks off in an error: libraries forget it, and deliver what was in memory.
    tiff_file = files["zip.tif"]
    stream = tiff_file.index(b"x\x9c")
    yield "zip.tif", "stream", replaced(tiff_file, stream + 39, bytes([tiff_file[stream + 39] ^ 0x40]))
    yield "zip.tif", "checksum", replaced(tiff_file, stream + 200, bytes([tiff_file[stream + 200] ^ 1]))
    for name in ("good.dds", "good.ktx2"):
        yield name, "last-row", files[name][:-512]


def metadata(files):
    jpeg, png = files["good.jpg"], files["good.png"]

    def with_icc(profile):
        body = b"ICC_PROFILE\0\1\1" + profile
        return jpeg[:2] + b"\xff\xe2" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]

    head = struct.pack(">I4sI4s4s4s", 500, b"lcms", 0x0260000, b"mntr", b"RGB ", b"XYZ ").ljust(36, b"\0") + b"acsp"
    head = head.ljust(128, b"\0")
    for name, offset, size in (("small", 200, 4), ("zero", 200, 0), ("outside", 0x7FFFFFFF, 100),
                               ("wrap", 0xFFFFFFF0, 0x100), ("huge", 200, 0xFFFFFFFF)):
        for tag in (b"desc", b"cprt"):
            profile = head + struct.pack(">I4sII", 1, tag, offset, size) + b"text" + b"\0" * 300
            yield "good.jpg", f"icc-{tag.decode()}-{name}", with_icc(profile)
    xmp = b"http://ns.adobe.com/xap/1.0/\0"
    for name, text in (("deep", b"<rdf:Seq><rdf:li>" * 3000), ("unclosed", b"<x:xmpmeta" * 1000), ("zeros", b"\0" * 30000)):
        body = (xmp + text)[:65000]
        yield "good.jpg", f"xmp-{name}", jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]
        yield "good.png", f"xmp-{name}", png[:33] + chunk(b"iTXt", b"XML:com.adobe.xmp\0\0\0\0\0" + text) + png[33:]
    loop = b"II*\0" + struct.pack("<IHHHIII", 8, 1, 0x8769, 4, 1, 8, 8)  # a directory whose sub-directory is itself
    body = b"Exif\0\0" + loop
    yield "good.jpg", "exif-loop", jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(body) + 2) + body + jpeg[2:]
    yield "good.png", "text-bomb", png[:33] + chunk(b"zTXt", b"Comment\0\0" + zlib.compress(b"\0" * (64 << 20), 9)) + png[33:]
    yield "good.png", "many-chunks", png[:33] + chunk(b"tEXt", b"a\0b") * 20000 + png[33:]
    yield "good.png", "control", png[:33] + chunk(b"tEXt", b"Comment\0\x1b[31m\x1b]0;x\x07") + png[33:]
    exr = files["plain.exr"]
    text = b"\x1b[31m\x1b]0;x\x07\n\r" * 10
    attribute = b"comments\0string\0" + struct.pack("<i", len(text)) + text
    yield "plain.exr", "control", exr[:8] + attribute + exr[8:]
    yield "good.dds", "levels", dds(32, 16, b"\0" * 8192, levels=0xFFFFFFFF)
    yield "good.dds", "dxt4", dds(4, 4, b"\0" * 16, fourcc=b"DXT4")
    yield "good.hdr", "lines", files["good.hdr"].replace(b"\n\n", b"\n" + b"A=" * 50000 + b"\n\n", 1)
    yield "good.hdr", "exposure", files["good.hdr"].replace(b"\n\n", b"\nEXPOSURE=nan\nEXPOSURE=1e999\n\n", 1)


def flips(files):
    chance = random.Random(641)
    for name, data in files.items():
        for i in range(12):
            # Half of them in the header, where they do most.
            at = chance.randrange(min(len(data), 400) if i % 2 else len(data))
            yield name, f"{i:02}", replaced(data, at, bytes([data[at] ^ (1 << chance.randrange(8))]))
        for i in range(4):
            at = chance.randrange(len(data) - 8)
            yield name, f"run{i}", replaced(data, at, chance.choice((b"\xff", b"\0", b"\x80")) * 8)


def write_corpus(folder):
    """Writes all files; {kind: [names]}."""
    folder = pathlib.Path(folder)
    files = good_files(folder)
    makers = dict(zip(KINDS, (truncations, claims, empty, bombs, late, metadata, flips)))
    names = {}
    for kind, maker in makers.items():
        for name, what, data in maker(files):
            stem, extension = name.rsplit(".", 1)
            path = folder / f"{kind}-{stem}-{what}.{extension}"
            assert not path.exists(), path
            path.write_bytes(data)
            names.setdefault(kind, []).append(path.name)
    return names


if __name__ == "__main__":
    print({kind: len(names) for kind, names in write_corpus(sys.argv[1]).items()})
