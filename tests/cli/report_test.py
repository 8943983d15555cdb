# SPDX-License-Identifier: Apache-2.0
"""The report of envconv compare and the plot of envconv roundtrip, looked at in a browser (Chromium)."""
import html
import json
import re
import subprocess
import unittest

from harness import PANORAMAS, Case

WIDTH, HEIGHT = 1200, 1900

# Added to a copy of the page: leaves the places of its pictures, and whether they have loaded, in the document.
PROBE = """<script>addEventListener("load", () => {
  const box = e => { const r = e.getBoundingClientRect(); return [r.x, r.y, r.width, r.height]; };
  const all = q => [...document.querySelectorAll(q)];
  const found = {
    images: all("img").map(e => ({box: box(e), complete: e.complete, size: [e.naturalWidth, e.naturalHeight]})),
    plots: all("svg").map(e => ({box: box(e), paths: e.querySelectorAll("path.curve").length})),
    table: box(document.querySelector("table")), width: document.documentElement.scrollWidth,
    mode: document.compatMode};
  document.body.dataset.found = JSON.stringify(found);
});</script>"""


class Browser(Case):
    def chromium(self, page, *options):
        done = subprocess.run(["chromium", "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars",
                               "--disable-background-networking", f"--user-data-dir={self.folder}/profile",
                               f"--window-size={WIDTH},{HEIGHT}", *options, self.path(page).as_uri()],
                              cwd=self.folder, capture_output=True, timeout=120)
        self.assertEqual(done.returncode, 0, done.stderr.decode(errors="replace"))
        return done.stdout.decode()

    def look(self, page, dark=False):
        """The page's pixels: look(...)(x, y) is (r, g, b)."""
        scheme = ["--blink-settings=preferredColorScheme=0"] if dark else []
        self.chromium(page, f"--screenshot={self.path('shot.png')}", *scheme)
        data = subprocess.run(["ffmpeg", "-nostdin", "-v", "error", "-i", "shot.png", "-f", "rawvideo", "-pix_fmt",
                               "rgb24", "-"], cwd=self.folder, capture_output=True, check=True).stdout
        self.assertEqual(len(data), 3 * WIDTH * HEIGHT)
        return lambda x, y: tuple(data[3 * (y * WIDTH + x) : 3 * (y * WIDTH + x) + 3])

    def measure(self, page):
        text = self.path(page).read_text()
        self.path("probe.html").write_text(text.replace("</body>", PROBE + "</body>"))
        dom = self.chromium("probe.html", "--dump-dom")
        return json.loads(html.unescape(re.search(r'data-found="([^"]*)"', dom).group(1)))

    def colours(self, pixel, box, step=5):
        x, y, width, height = (round(v) for v in box)
        return [pixel(i, j) for j in range(y + 2, y + height - 2, step) for i in range(x + 2, x + width - 2, step)]

    def test_report(self):
        self.run_tool("convert", PANORAMAS / "venice.hdr", "-o", "b.exr", "--to", "diamond-12", "--size", 64, "-q")
        self.run_tool("compare", PANORAMAS / "venice.hdr", "b.exr", "--report", "r.html")
        found = self.measure("r.html")
        self.assertEqual(found["mode"], "CSS1Compat")  # not quirks: the doctype is understood
        self.assertLessEqual(found["width"], WIDTH)
        self.assertEqual([i["complete"] for i in found["images"]], [True] * 3)
        self.assertEqual([i["size"] for i in found["images"]], [[768, 384], [768, 384], [768, 424]])
        self.assertEqual([p["paths"] for p in found["plots"]], [1, 1])
        boxes = [i["box"] for i in found["images"]]
        # A and B stand side by side.
        self.assertEqual(boxes[0][1], boxes[1][1])
        self.assertGreaterEqual(boxes[1][0], boxes[0][0] + boxes[0][2])
        for dark in (False, True):
            pixel = self.look("r.html", dark)
            background = pixel(3, 3)
            self.assertTrue(max(background) < 60 if dark else min(background) > 230, background)
            for box in boxes:  # pictures: many colours
                self.assertGreater(len(set(self.colours(pixel, box))), 200)
            # A sky that is bright and blue, at the same place in both.
            for x, y, width, height in boxes[:2]:
                r, g, b = pixel(round(x + 0.25 * width), round(y + 0.1 * height))
                self.assertGreater(b, 90)
            for plot in found["plots"]:  # a curve in the first colour of the palette, which is a red
                ink = [c for c in self.colours(pixel, plot["box"], 2) if c[0] > c[1] + 50 and c[0] > c[2] + 50]
                self.assertGreater(len(ink), 100)
            text = self.colours(pixel, found["table"], 2)
            self.assertGreater(sum(abs(c[1] - background[1]) > 120 for c in text), 250)

    def test_plot(self):
        self.run_tool("roundtrip", PANORAMAS / "city.exr", "--via", "cube,isocube", "--sizes", "16,32", "--plot", "p.svg")
        for dark in (False, True):
            pixel = self.look("p.svg", dark)
            inside = self.colours(pixel, (0, 0, 720, 420), 1)
            dominant = max(set(inside), key=inside.count)
            self.assertTrue(max(dominant) < 60 if dark else min(dominant) > 230)
            reds = sum(c[0] > c[1] + 50 and c[0] > c[2] + 50 for c in inside)
            greens = sum(c[1] > c[0] + 50 for c in inside)
            self.assertGreater(reds, 300)
            self.assertGreater(greens, 300)


if __name__ == "__main__":
    unittest.main()
