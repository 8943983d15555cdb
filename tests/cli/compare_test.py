# SPDX-License-Identifier: Apache-2.0
"""envconv compare and envconv roundtrip."""
import base64
import html.parser
import json
import math
import re
import subprocess
import unittest
import xml.etree.ElementTree
import zlib

from harness import PANORAMAS, Case, direction, write_constant, write_directions, write_exr, write_png

FIGURES = ["mean_a", "mean_b", "rmse", "mae", "max_error", "max_error_direction", "psnr", "psnr_hdr", "ws_psnr",
           "s_psnr", "ssim_sphere"]


def offset_maps(case):
    """a.exr is 0.5 everywhere, b.exr 0.75: every figure is known."""
    write_constant(case.path("a.exr"), 0.5)
    write_constant(case.path("b.exr"), 0.75)


class Compare(Case):
    def test_figures_of_a_constant_offset(self):
        offset_maps(self)
        report = self.json("compare", "a.exr", "b.exr", "--peak", 1)
        self.assertEqual(list(report), ["a", "b", "layout_a", "layout_b", *FIGURES, "peak", "nonfinite_a",
                                        "nonfinite_b", "excluded", "same_grid", "channels", "failed"])
        for key, value in (("mean_a", 0.5), ("mean_b", 0.75), ("rmse", 0.25), ("mae", 0.25), ("max_error", 0.25)):
            self.assertAlmostEqual(report[key], value, places=12)
        for key in ("psnr", "ws_psnr", "s_psnr"):
            self.assertAlmostEqual(report[key], 20 * math.log10(4), places=9)
        encoded = lambda x: math.log2(x + 1 / 1024)
        self.assertAlmostEqual(report["psnr_hdr"],
                               20 * math.log10((encoded(1) - encoded(0)) / (encoded(0.75) - encoded(0.5))), places=4)
        self.assertAlmostEqual(math.hypot(*report["max_error_direction"]), 1, places=6)
        self.assertEqual([c["name"] for c in report["channels"]], ["R", "G", "B"])
        for channel in report["channels"]:
            self.assertEqual(list(channel), ["name", *FIGURES])
            self.assertAlmostEqual(channel["rmse"], 0.25, places=12)
        self.assertEqual((report["failed"], report["excluded"], report["same_grid"]), ([], 0, True))

    def test_table(self):
        offset_maps(self)
        lines = self.run_tool("compare", "a.exr", "b.exr").out.splitlines()
        self.assertEqual(lines[2].split(), ["channel", *(f for f in FIGURES if f != "max_error_direction")])
        self.assertEqual([line.split()[0] for line in lines[3:7]], ["R", "G", "B", "total"])
        self.assertEqual(lines[6].split()[1:6], ["0.5", "0.75", "0.25", "0.25", "0.25"])
        self.assertEqual(self.err, "")

    def test_a_map_and_itself(self):
        write_directions(self.path("a.exr"))
        report = self.json("compare", "a.exr", "a.exr", "--min-psnr", 100, "--max-rmse", 0, "--max-error", 0)
        self.assertEqual((report["rmse"], report["max_error"], report["ssim_sphere"]), (0, 0, 1))
        self.assertIsNone(report["psnr"])  # infinite

    def test_between_layouts_sizes_packings_and_frames(self):
        write_directions(self.path("a.exr"), 256, 128)
        self.run_tool("convert", "a.exr", "-o", "b.exr", "--to", "cube", "--packing", "cross", "--frame", "blender",
                      "--size", 96)
        self.assertLess(self.json("compare", "a.exr", "b.exr")["rmse"], 1e-3)
        self.run_tool("convert", "a.exr", "-o", "{face}.exr", "--to", "cube", "--size", 64)
        self.assertLess(self.json("compare", "b.exr", "{face}.exr")["rmse"], 2e-3)

    def test_what_b_is_can_be_said(self):
        # A square could be many layouts.
        write_exr(self.path("a.exr"), 32, 32, lambda x, y: (1, 1, 1))
        write_constant(self.path("b.exr"), 1)
        self.run_tool("compare", "b.exr", "a.exr", expect=3).says("a.exr", "--from")
        self.assertEqual(self.json("compare", "b.exr", "a.exr", "--from-b", "octahedral")["layout_b"], "octahedral")
        self.assertEqual(self.json("compare", "a.exr", "b.exr", "--from", "octahedral")["layout_a"], "octahedral")

    def test_thresholds(self):
        offset_maps(self)
        kept = ("--max-rmse", 0.26, "--max-error", 0.25, "--min-psnr", 12, "--min-ws-psnr", 12.04, "--min-s-psnr", 12,
                "--min-psnr-hdr", 20, "--min-ssim", 0.5)
        self.run_tool("compare", "a.exr", "b.exr", "--peak", 1, *kept)
        for option, limit, figure in (("--max-rmse", 0.1, "rmse"), ("--max-error", 0.2, "max_error"),
                                      ("--min-psnr", 13, "psnr"), ("--min-ws-psnr", 12.05, "ws_psnr"),
                                      ("--min-psnr-hdr", 100, "psnr_hdr"), ("--min-s-psnr", 12.05, "s_psnr"),
                                      ("--min-ssim", 1, "ssim_sphere")):
            self.run_tool("compare", "a.exr", "b.exr", "--peak", 1, *kept, option, limit, expect=1)
            self.assertEqual(len(self.err.splitlines()), 1)
            self.says("b.exr: ", figure + " ", str(limit), f"({option})")
            report = self.json("compare", "a.exr", "b.exr", "--peak", 1, *kept, option, limit, expect=1)
            self.assertEqual([(f["threshold"], f["figure"], f["limit"]) for f in report["failed"]],
                             [(option, figure, limit)])
            self.assertEqual(report["failed"][0]["value"], report[figure])

    def test_the_seam_error_is_the_converted_map_s(self):
        write_directions(self.path("a.exr"), 128, 64)
        self.run_tool("convert", "a.exr", "-o", "plain.exr", "--size", 32)
        self.run_tool("convert", "a.exr", "-o", "stretched.exr", "--size", 32, "--seam", "stretch", "--type", "float")
        self.run_tool("compare", "a.exr", "stretched.exr", "--max-seam", 0)
        # A lat-long of directions has seams; that it is compared with a cube does not make them count.
        self.run_tool("compare", "plain.exr", "stretched.exr", "--max-seam", 0)
        report = self.json("compare", "a.exr", "plain.exr", "--max-seam", 0, expect=1)
        self.says("plain.exr: seam_error", "(--max-seam)")
        self.assertEqual([(f["threshold"], f["figure"]) for f in report["failed"]], [("--max-seam", "seam_error")])
        told = json.loads(self.run_tool("info", "plain.exr", "--seams", "--json").out)["seams"]["largest"]
        self.assertAlmostEqual(report["failed"][0]["value"], told, places=9)

    def test_nonfinite_values_are_counted_and_fail_thresholds(self):
        offset_maps(self)
        spoiled = {(3, 2): (float("nan"), 0.75, 0.75), (9, 6): (0.75, float("inf"), float("-inf"))}
        write_exr(self.path("c.exr"), 16, 8, lambda x, y: spoiled.get((x, y), (0.75, 0.75, 0.75)))
        report = self.json("compare", "a.exr", "c.exr")
        self.says("c.exr", "3 values are NaN or infinite")
        self.assertEqual((report["nonfinite_a"], report["nonfinite_b"]), (0, 3))
        self.assertAlmostEqual(report["rmse"], 0.25, places=12)
        # The two texels' shares of the sphere: rows 2 and 6 of 8, one of 16 columns.
        share = sum(math.cos(math.pi * j / 8) - math.cos(math.pi * (j + 1) / 8) for j in (2, 6)) / 2 / 16
        self.assertAlmostEqual(report["excluded"], share, places=6)
        self.run_tool("compare", "a.exr", "c.exr", "--max-rmse", 1, expect=1).says("NaN or infinite", "--max-rmse")

    def test_peak(self):
        for name, value in (("a.png", 128), ("b.png", 129)):
            write_png(self.path(name), 16, 8, lambda x, y: (value, value, value))
        self.assertEqual(self.json("compare", "a.png", "b.png")["peak"], 1)
        write_exr(self.path("a.exr"), 16, 8, lambda x, y: (1, 5 if x == y == 3 else 1, 1))
        write_constant(self.path("b.exr"), 2)
        report = self.json("compare", "a.exr", "b.exr")
        self.assertEqual(report["peak"], 5)
        self.assertAlmostEqual(self.json("compare", "a.exr", "b.exr", "--peak", 50)["psnr"] - report["psnr"], 20)

    def test_channels_that_only_one_map_has(self):
        write_exr(self.path("a.exr"), 16, 8, lambda x, y: (1, 2, 3, 1), "RGBA")
        write_constant(self.path("b.exr"), 1)
        report = self.json("compare", "a.exr", "b.exr")
        self.says("a.exr", "channel A is not compared")
        self.assertEqual([c["name"] for c in report["channels"]], ["R", "G", "B"])
        write_exr(self.path("y.exr"), 16, 8, lambda x, y: (1,), "Y")
        self.run_tool("compare", "a.exr", "y.exr", expect=5).says("y.exr", "in common")

    def test_twice_the_same_bytes_from_any_number_of_threads(self):
        self.run_tool("convert", PANORAMAS / "interior.exr", "-o", "b.exr", "--to", "isocube", "--size", 48, "-q")
        seen = set()
        for threads in (1, 1, 2):
            words = ("compare", PANORAMAS / "interior.exr", "b.exr", "--json", "-j", threads, "--error-map", "e.png",
                     "--size", 64, "--to", "cube", "--report", "r.html")
            seen.add((self.run_tool(*words).out, self.path("e.png").read_bytes(), self.path("r.html").read_bytes()))
        self.assertEqual(len(seen), 1)
        self.assertEqual(self.files(), ["b.exr", "e.png", "r.html"])

    def test_wrong_command_lines(self):
        offset_maps(self)
        self.run_tool("compare", "a.exr", expect=2).says("A B is missing")
        self.run_tool("compare", "a.exr", "b.exr", "a.exr", expect=2)
        self.run_tool("compare", "a.exr", "b.exr", "--max-rmse", "x", expect=2).says("--max-rmse", "'x'")
        self.run_tool("compare", "a.exr", "b.exr", "--from-b", "cub", expect=2).says("--from-b", "'cube'")
        self.run_tool("compare", "a.exr", "b.exr", "--to", "cube", expect=2).says("--error-map")
        self.run_tool("compare", "a.exr", "none.exr", expect=3).says("none.exr")
        self.run_tool("compare", "a.exr", "b.exr", "--error-map", "no/e.png", expect=4).says("no/e.png")
        self.run_tool("compare", "a.exr", "b.exr", "--report", "no/r.html", expect=4).says("no/r.html")
        self.run_tool("compare", "a.exr", "b.exr", "--error-map", "e.xyz", expect=5).says("e.xyz")
        self.run_tool("compare", "a.exr", "b.exr", "--report", "./b.exr", expect=2).says("b.exr", "an input")


class AgainstFfmpeg(Case):
    def test_psnr(self):
        """On an equal-area layout all texels weigh the same, so PSNR is the plain one of the picture."""
        size = 16
        value = lambda x, y, k: (x * 7 + y * 13 + k * 29 + x * y) % 200

        def noisy(x, y, k):
            return value(x, y, k) + (x * x + 3 * y + k) % 50

        for name, f in (("a", value), ("b", noisy)):
            pixel = lambda x, y: tuple(f(x, y, k) for k in range(3))
            write_png(self.path(f"{name}.png"), 6 * size, size, pixel)
            # ffmpeg takes the codes as they are, so they are our linear values.
            write_exr(self.path(f"{name}.exr"), 6 * size, size, lambda x, y: tuple(v / 255 for v in pixel(x, y)))
        done = subprocess.run(["ffmpeg", "-nostdin", "-i", "a.png", "-i", "b.png", "-lavfi", "psnr", "-f", "null", "-"],
                              cwd=self.folder, capture_output=True, text=True)
        found = re.search(r"PSNR r:([\d.]+) g:([\d.]+) b:([\d.]+) average:([\d.]+)", done.stderr)
        theirs = [float(number) for number in found.groups()]
        report = self.json("compare", "a.exr", "b.exr", "--from", "isocube", "--from-b", "isocube", "--peak", 1)
        ours = [channel["psnr"] for channel in report["channels"]] + [report["psnr"]]
        for mine, its in zip(ours, theirs):
            self.assertAlmostEqual(mine, its, delta=1e-5 * its)


class ErrorMap(Case):
    def read(self, name):
        """(width, height, rows of pixels) of a picture, through ffmpeg."""
        probe = subprocess.run(["ffprobe", "-v", "error", "-show_entries", "stream=width,height", "-of", "csv=p=0",
                                name], cwd=self.folder, capture_output=True, text=True, check=True)
        width, height = map(int, probe.stdout.split(","))
        data = subprocess.run(["ffmpeg", "-nostdin", "-v", "error", "-i", name, "-f", "rawvideo", "-pix_fmt", "rgb24",
                               "-"], cwd=self.folder, capture_output=True, check=True).stdout
        pixel = lambda x, y: tuple(data[3 * (y * width + x) : 3 * (y * width + x) + 3])
        return width, height, [[pixel(x, y) for x in range(width)] for y in range(height)]

    def test_colours_follow_the_error_and_the_scale_is_drawn(self):
        # The error grows from pole to pole, over four decades.
        write_constant(self.path("a.exr"), 0, 128, 64)
        write_exr(self.path("b.exr"), 128, 64, lambda x, y: (10 ** (-4 + 4 * (y + 0.5) / 64),) * 3)
        self.run_tool("compare", "a.exr", "b.exr", "--error-map", "e.png", "--size", 200)
        width, height, rows = self.read("e.png")
        self.assertEqual((width, height), (400, 240))
        light = [sum(w * (v / 255) ** 2.2 for w, v in zip((0.21, 0.72, 0.07), rows[y][100])) for y in range(200)]
        self.assertTrue(all(a < b for a, b in zip(light[10:190:4], light[14:194:4])), "lightness rises with the error")
        self.assertLess(light[10], 0.05)
        self.assertGreater(light[190], 0.6)
        # The strip: its bar runs through the same colours from left to right, under a caption and over numbers.
        bar = rows[200 + 19]
        self.assertLess(sum(abs(a - b) for a, b in zip(bar[40], rows[10][100])), 60)
        self.assertLess(sum(abs(a - b) for a, b in zip(bar[360], rows[190][100])), 60)
        white = lambda y: sum(min(p) > 200 for p in rows[y])
        self.assertGreater(sum(white(200 + y) for y in range(4, 12)), 100)  # the caption
        self.assertGreater(sum(white(200 + y) for y in range(27, 36)), 50)  # the numbers

    def test_any_layout(self):
        write_directions(self.path("a.exr"))
        write_constant(self.path("b.exr"), 0.1)
        for layout, size in (("cube", (400, 300)), ("diamond-12", (400, 300)), ("angular-map", (360, 100))):
            packing = ("--packing", "cross") if layout == "cube" else ()
            self.run_tool("compare", "a.exr", "b.exr", "--error-map", f"{layout}.png", "--to", layout, "--size", 100,
                          *packing)
            width, height, rows = self.read(f"{layout}.png")
            self.assertEqual((width, height), (size[0], size[1] + 40))
        self.assertEqual(len(set(rows[0][131:135])), 1)  # a corner of the disc: no direction there, plain grey
        r, g, b = rows[0][132]
        self.assertTrue(r == g == b and 100 < r < 160)


class Pages(html.parser.HTMLParser):
    """Elements that do not match are errors; what a page refers to is collected."""

    VOID = {"meta", "img", "br", "link"}

    def __init__(self, text):
        super().__init__()
        self.open, self.names, self.sources, self.text = [], [], [], ""
        self.feed(text)
        self.close()
        assert not self.open, self.open

    def handle_starttag(self, tag, attributes):
        self.names.append(tag)
        self.sources += [v for k, v in attributes if k in ("src", "href", "data")]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.names.append(tag)

    def handle_endtag(self, tag):
        assert self.open and self.open.pop() == tag, tag

    def handle_data(self, data):
        self.text += data


class Report(Case):
    def make(self):
        self.run_tool("convert", PANORAMAS / "venice.hdr", "-o", "b & <c>.exr", "--to", "octahedral", "--size", 100)
        self.run_tool("compare", PANORAMAS / "venice.hdr", "b & <c>.exr", "--report", "r.html", "--json")
        return self.path("r.html").read_text()

    def test_one_self_contained_page(self):
        text = self.make()
        page = Pages(text)
        self.assertTrue(text.startswith("<!DOCTYPE html>"))
        self.assertNotIn("script", page.names)
        self.assertEqual((page.names.count("img"), page.names.count("svg"), page.names.count("table")), (3, 2, 1))
        self.assertEqual(len(page.sources), 3)
        for source in page.sources:
            self.assertTrue(source.startswith("data:image/png;base64,"))
            self.check_png(base64.b64decode(source.split(",")[1], validate=True))
        self.assertNotIn("url(", text)
        self.assertIn("b & <c>.exr", page.text)
        self.assertIn("prefers-color-scheme:dark", text)
        for figure in ("rmse", "ws_psnr", "ssim_sphere"):
            self.assertIn(figure, page.text)
        self.assertIn(f"{json.loads(self.out)['rmse']:.6g}", page.text)

    def check_png(self, data):
        self.assertEqual(data[:8], b"\x89PNG\r\n\x1a\n")
        at, packed, kinds = 8, b"", []
        while at < len(data):
            size, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
            self.assertEqual(zlib.crc32(data[at + 4 : at + 8 + size]),
                             int.from_bytes(data[at + 8 + size : at + 12 + size], "big"))
            kinds.append(kind)
            packed += data[at + 8 : at + 8 + size] if kind == b"IDAT" else b""
            at += 12 + size
        self.assertEqual(kinds, [b"IHDR", b"sRGB", b"IDAT", b"IEND"])
        width, height = (int.from_bytes(data[k : k + 4], "big") for k in (16, 20))
        self.assertEqual(len(zlib.decompress(packed)), height * (3 * width + 1))


class Roundtrip(Case):
    def test_best_first_and_json(self):
        report = self.json("roundtrip", PANORAMAS / "city.exr", "--via", "sphere-map,cube,latlong", "--texels", "20k")
        results = report["results"]
        self.assertEqual({r["layout"] for r in results}, {"sphere-map", "cube", "latlong"})
        for result in results:
            self.assertEqual(list(result)[:14], ["layout", "size", "texels", *FIGURES])
            self.assertLessEqual(result["texels"], 20000)
            self.assertTrue(result["same_grid"])
        psnr = [r["psnr"] for r in results]
        self.assertEqual(psnr, sorted(psnr, reverse=True))
        table = self.run_tool("roundtrip", PANORAMAS / "city.exr", "--via", "sphere-map,cube,latlong", "--texels",
                              "20k").out.splitlines()
        self.assertEqual([line.split()[0] for line in table], ["layout"] + [r["layout"] for r in results])
        by_error = self.json("roundtrip", PANORAMAS / "city.exr", "--via", "sphere-map,cube,latlong", "--texels", "20k",
                             "--figure", "max_error")["results"]
        errors = [r["max_error"] for r in by_error]
        self.assertEqual(errors, sorted(errors))

    def test_the_way_back_is_what_convert_and_compare_say(self):
        self.run_tool("convert", PANORAMAS / "city.exr", "-o", "there.exr", "--to", "octahedral", "--size", 100,
                      "--type", "float")
        self.run_tool("convert", "there.exr", "-o", "back.exr", "--to", "latlong", "--size", 512, "--type", "float")
        steps = self.json("compare", PANORAMAS / "city.exr", "back.exr")
        trip = self.json("roundtrip", PANORAMAS / "city.exr", "--via", "octahedral", "--size", 100)["results"][0]
        for figure in FIGURES:
            self.assertEqual(trip[figure], steps[figure], figure)

    def test_nothing_is_lost_in_the_same_layout_and_size(self):
        result = self.json("roundtrip", PANORAMAS / "city.exr", "--via", "latlong")["results"][0]
        self.assertEqual((result["size"], result["rmse"], result["psnr"]), (512, 0, None))

    def test_thresholds(self):
        words = ("roundtrip", PANORAMAS / "city.exr", "--via", "latlong,cube", "--size", 512)
        self.run_tool(*words, "--min-psnr", 1)
        self.run_tool(*words, "--max-error", 1e-6, expect=1).says("city.exr", "via cube of size 512", "(--max-error)")
        self.assertEqual(len(self.err.splitlines()), 1)

    def test_sizes_and_plot(self):
        write_directions(self.path("a.exr"), 256, 128)
        report = self.json("roundtrip", "a.exr", "--via", "cube,isocube", "--sizes", "32,8,16", "--plot", "p.svg")
        rows = [(r["size"], r["layout"]) for r in report["results"]]
        self.assertEqual([size for size, _ in rows], [8, 8, 16, 16, 32, 32])
        for layout in ("cube", "isocube"):
            psnr = [r["psnr"] for r in report["results"] if r["layout"] == layout]
            self.assertTrue(psnr[0] + 3 < psnr[1] < psnr[2] - 3, psnr)
            self.assertEqual([r["texels"] for r in report["results"] if r["layout"] == layout], [384, 1536, 6144])
        svg = xml.etree.ElementTree.fromstring(self.path("p.svg").read_text())
        name = "{http://www.w3.org/2000/svg}"
        self.assertEqual(svg.tag, name + "svg")
        texts = [t.text for t in svg.iter(name + "text")]
        for part in ("cube", "isocube", "texels", "PSNR (dB)", "There and back: a.exr"):
            self.assertIn(part, texts)
        # Three points a curve and one in the legend, inside the picture.
        dots = list(svg.iter(name + "circle"))
        self.assertEqual(len(dots), 8)
        self.assertTrue(all(0 < float(d.get("cx")) < 720 and 0 < float(d.get("cy")) < 420 for d in dots))

    def test_nonfinite_input_is_repaired(self):
        write_exr(self.path("a.exr"), 64, 32, lambda x, y: (float("nan") if (x, y) == (20, 9) else 1.0, 1, 1))
        result = self.json("roundtrip", "a.exr", "--via", "cube")["results"][0]
        self.says("a.exr", "1 value is NaN or infinite")
        self.assertLess(result["rmse"], 1e-5)

    def test_wrong_command_lines(self):
        write_constant(self.path("a.exr"))
        self.run_tool("roundtrip", "a.exr", expect=2).says("--via")
        self.run_tool("roundtrip", "a.exr", "--via", "cub", expect=2).says("'cube'")
        self.run_tool("roundtrip", "a.exr", "--via", "cube", "--size", 8, "--sizes", "8,9", expect=2).says("--sizes")
        self.run_tool("roundtrip", "a.exr", "--via", "cube", "--plot", "p.svg", expect=2).says("--sizes")
        self.run_tool("roundtrip", "a.exr", "--via", "cube", "--sizes", "8,x", expect=2).says("'x'")
        self.run_tool("roundtrip", "none.exr", "--via", "cube", expect=3).says("none.exr")


if __name__ == "__main__":
    unittest.main()
