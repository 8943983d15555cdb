# SPDX-License-Identifier: Apache-2.0
"""Reads DDS, KTX and KTX2 files, from their specifications and strictly: any byte out of place is an AssertionError.

read(path) gives a Texture, whose levels[level][picture] are Pictures: rows of RGB floats, or None for BC6H, which is
checked for its size alone.
"""
import collections
import math
import struct
import subprocess
import zlib

Picture = collections.namedtuple("Picture", "width height texels")  # row by row, tuples of three
Texture = collections.namedtuple("Texture", "cube format levels keys")

# Bytes of a texel, or of a block of 4x4.
SIZES = {"half": 8, "float": 16, "uint8": 4, "r11g11b10f": 4, "rgb9e5": 4, "bc6h": 16}


def read(path):
    data = path.read_bytes()
    if data[:4] == b"DDS ":
        return read_dds(data)
    if data[:12] == b"\xabKTX 11\xbb\r\n\x1a\n":
        return read_ktx1(data)
    assert data[:12] == b"\xabKTX 20\xbb\r\n\x1a\n", "of no known format"
    return read_ktx2(data)


# --- texels ---------------------------------------------------------------------------------------------------------


def unsigned_float(code, mantissa_bits):
    exponent, mantissa = code >> mantissa_bits, code & ((1 << mantissa_bits) - 1)
    assert exponent < 31, "infinite"
    if exponent == 0:
        return mantissa * 2.0 ** (-14 - mantissa_bits)
    return (1 + mantissa * 2.0**-mantissa_bits) * 2.0 ** (exponent - 15)


def linear(code):
    v = code / 255
    return v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4


def texel(kind, data):
    if kind in ("half", "float"):
        r, g, b, a = struct.unpack("<4e" if kind == "half" else "<4f", data)
        assert a == 1, "not opaque"
        return r, g, b
    if kind == "uint8":
        assert data[3] == 255, "not opaque"
        return tuple(linear(c) for c in data[:3])
    (code,) = struct.unpack("<I", data)
    if kind == "r11g11b10f":
        return unsigned_float(code & 0x7FF, 6), unsigned_float(code >> 11 & 0x7FF, 6), unsigned_float(code >> 22, 5)
    return tuple((code >> (9 * c) & 0x1FF) * 2.0 ** ((code >> 27) - 24) for c in range(3))


def surface_size(kind, width, height):
    if kind == "bc6h":
        return (width + 3) // 4 * ((height + 3) // 4) * 16
    return width * height * SIZES[kind]


def picture(kind, width, height, data):
    assert len(data) == surface_size(kind, width, height)
    if kind == "bc6h":
        return Picture(width, height, None)
    size = SIZES[kind]
    return Picture(width, height, [texel(kind, data[i : i + size]) for i in range(0, len(data), size)])


def sizes_of(width, height, levels):
    assert 1 <= levels <= max(width, height).bit_length()
    return [(max(1, width >> level), max(1, height >> level)) for level in range(levels)]


# --- DDS: Microsoft, "Programming Guide for DDS" ---------------------------------------------------------------------


def read_dds(data):
    (size, flags, height, width, pitch, depth, count) = struct.unpack_from("<7I", data, 4)
    assert size == 124 and flags & 0x1007 == 0x1007
    pf_size, pf_flags, fourcc, bits, *masks = struct.unpack_from("<II4sI4I", data, 76)
    assert (pf_size, pf_flags, fourcc, bits, masks) == (32, 4, b"DX10", 0, [0] * 4)
    caps, caps2, caps3, caps4, reserved = struct.unpack_from("<5I", data, 108)
    dxgi, dimension, misc, array, alpha_mode = struct.unpack_from("<5I", data, 128)
    assert dimension == 3 and (caps3, caps4, reserved) == (0, 0, 0)
    kind = {2: "float", 10: "half", 26: "r11g11b10f", 29: "uint8", 67: "rgb9e5", 95: "bc6h"}[dxgi]
    assert alpha_mode == (3 if kind in ("half", "float", "uint8") else 0)
    cube = misc == 4
    assert misc in (0, 4)
    if cube:
        assert array == 1 and caps2 == 0xFE00 and width == height
    else:
        assert caps2 == 0
    pictures = 6 if cube else array
    if kind == "bc6h":
        assert flags & 0x80008 == 0x80000 and pitch == surface_size(kind, width, height)
    else:
        assert flags & 0x80008 == 0x8 and pitch == width * SIZES[kind]
    assert bool(flags & 0x20000) == (count > 1) == bool(caps & 0x400000)
    assert caps & 0x1000 and bool(caps & 8) == (count > 1 or pictures > 1)
    sizes, at = sizes_of(width, height, count), 148
    levels = [[] for _ in sizes]
    for _ in range(pictures):
        for level, (w, h) in enumerate(sizes):
            end = at + surface_size(kind, w, h)
            levels[level].append(picture(kind, w, h, data[at:end]))
            at = end
    assert at == len(data)
    note = data[32:76].rstrip(b"\0").decode()
    return Texture(cube, kind, levels, {"note": note})


# --- KTX: Khronos ---------------------------------------------------------------------------------------------------


def key_values(data):
    keys, at = {}, 0
    while at < len(data):
        (size,) = struct.unpack_from("<I", data, at)
        key, value = data[at + 4 : at + 4 + size].split(b"\0", 1)
        assert key.decode() not in keys
        keys[key.decode()] = value
        end = at + 4 + size
        at = (end + 3) // 4 * 4
        assert data[end:at] == bytes(at - end), "padding that is not zero"
    assert at == len(data)
    for key, value in keys.items():
        assert value.endswith(b"\0") and value.count(b"\0") == 1, "a text ends with its only zero"
        keys[key] = value[:-1].decode()
    return keys


def read_ktx1(data):
    endian, kind, type_size, form, internal, base, width, height, depth, array, faces, count, pairs = struct.unpack_from(
        "<13I", data, 12
    )
    assert endian == 0x04030201 and depth == 0 and faces in (1, 6)
    rgb, rgba = 0x1907, 0x1908
    name = {
        (0x140B, 2, rgba, 0x881A, rgba): "half",
        (0x1406, 4, rgba, 0x8814, rgba): "float",
        (0x1401, 1, rgba, 0x8C43, rgba): "uint8",
        (0x8C3B, 4, rgb, 0x8C3A, rgb): "r11g11b10f",
        (0x8C3E, 4, rgb, 0x8C3D, rgb): "rgb9e5",
        (0, 1, 0, 0x8E8F, rgb): "bc6h",
    }[kind, type_size, form, internal, base]
    keys, at = key_values(data[64 : 64 + pairs]), 64 + pairs
    assert keys["KTXorientation"] == "S=r,T=d"
    pictures = faces * max(array, 1)
    levels = []
    for w, h in sizes_of(width, height, count):
        (size,) = struct.unpack_from("<I", data, at)
        one = surface_size(name, w, h)
        assert one % 4 == 0 and size == (one if faces == 6 and array == 0 else one * pictures)
        at += 4
        levels.append([picture(name, w, h, data[at + i * one : at + (i + 1) * one]) for i in range(pictures)])
        at += one * pictures
    assert at == len(data)
    return Texture(faces == 6, name, levels, keys)


# Channel, offset, bits, and qualifiers (float 0x80, signed 0x40, exponent 0x20, linear 0x10) of samples.
R, G, B, A = 0, 1, 2, 15
SAMPLES = {
    97: [(c | 0xC0, 16 * i, 16) for i, c in enumerate((R, G, B, A))],
    109: [(c | 0xC0, 32 * i, 32) for i, c in enumerate((R, G, B, A))],
    43: [(c | (0x10 if c == A else 0), 8 * i, 8) for i, c in enumerate((R, G, B, A))],
    122: [(R | 0x80, 0, 11), (G | 0x80, 11, 11), (B | 0x80, 22, 10)],
    123: [s for i, c in enumerate((R, G, B)) for s in ((c, 9 * i, 9), (c | 0x20, 27, 5))],
    143: [(R | 0x80, 0, 128)],
}
# Name, size of the type, transfer function (1 linear, 2 sRGB), colour model, size of a block's side.
VULKAN = {
    97: ("half", 2, 1, 1, 1),
    109: ("float", 4, 1, 1, 1),
    43: ("uint8", 1, 2, 1, 1),
    122: ("r11g11b10f", 4, 1, 1, 1),
    123: ("rgb9e5", 4, 1, 1, 1),
    143: ("bc6h", 1, 1, 133, 4),
}


def check_descriptor(data, vulkan):
    name, _, transfer, model, side = VULKAN[vulkan]
    total, vendor_and_type, version_and_size = struct.unpack_from("<3I", data, 0)
    samples = SAMPLES[vulkan]
    assert total == len(data) == 28 + 16 * len(samples) and vendor_and_type == 0
    assert version_and_size == 2 | (total - 4) << 16
    assert tuple(data[12:16]) == (model, 1, transfer, 0)  # BT.709 primaries, straight alpha
    assert tuple(data[16:20]) == (side - 1, side - 1, 0, 0)
    assert tuple(data[20:28]) == (SIZES[name],) + (0,) * 7
    for i, (channel, offset, bits) in enumerate(samples):
        at, length, kind, position, lower, upper = struct.unpack_from("<HBBIII", data, 28 + 16 * i)
        assert (at, length, kind, position) == (offset, bits - 1, channel, 0)
        one = struct.unpack("<I", struct.pack("<f", 1))[0]
        if vulkan == 123:
            assert (lower, upper) == ((15, 31) if channel & 0x20 else (0, 8448))
        elif channel & 0x80:
            assert (lower, upper) == ((one | 0x80000000 if channel & 0x40 else 0), one)
        else:
            assert (lower, upper) == (0, (1 << bits) - 1)


def unpacked(scheme, data):
    if scheme == 2:
        return subprocess.run(["zstd", "-dcq"], input=data, stdout=subprocess.PIPE, check=True).stdout
    return zlib.decompress(data) if scheme == 3 else data


def read_ktx2(data):
    vulkan, type_size, width, height, depth, layers, faces, count, scheme = struct.unpack_from("<9I", data, 12)
    dfd_at, dfd_size, kvd_at, kvd_size, sgd_at, sgd_size = struct.unpack_from("<4I2Q", data, 48)
    name, expected_type_size, *_ = VULKAN[vulkan]
    assert type_size == expected_type_size and depth == 0 and faces in (1, 6) and (sgd_at, sgd_size) == (0, 0)
    assert scheme in (0, 2, 3)
    if faces == 6:
        assert width == height and layers == 0
    pictures = faces * max(layers, 1)
    assert dfd_at == 80 + 24 * count and kvd_at == dfd_at + dfd_size
    check_descriptor(data[dfd_at:kvd_at], vulkan)
    keys, at = key_values(data[kvd_at : kvd_at + kvd_size]), kvd_at + kvd_size
    assert list(keys) == sorted(keys), "keys out of order"
    assert keys["KTXorientation"] == "rd" and keys["KTXwriter"].startswith("envconv ")
    levels = [None] * count
    sizes = sizes_of(width, height, count)
    for level in reversed(range(count)):  # in the order of the file
        offset, size, unpacked_size = struct.unpack_from("<3Q", data, 80 + 24 * level)
        if scheme == 0:
            end = -(-at // math.lcm(SIZES[name], 4)) * math.lcm(SIZES[name], 4)
            assert data[at:end] == bytes(end - at)
            at = end
        assert offset == at, "a hole or an overlap"
        w, h = sizes[level]
        one = surface_size(name, w, h)
        assert unpacked_size == one * pictures
        content = unpacked(scheme, data[at : at + size])
        assert len(content) == unpacked_size
        levels[level] = [picture(name, w, h, content[i * one : (i + 1) * one]) for i in range(pictures)]
        at += size
    assert at == len(data)
    return Texture(faces == 6, name, levels, keys)
