// SPDX-License-Identifier: Apache-2.0
// three.js in Chromium shows a cube in DDS of BC6H, six faces in PNG and a lat-long in OpenEXR, all made from one
// panorama, in six views; each pixel must have the colour that the panorama has in its direction.
// node three_test.mjs FOLDER_OF_NPM ENVCONV
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readFileSync, rmSync, writeFileSync } from 'node:fs';
import { createServer } from 'node:http';
import { createRequire } from 'node:module';
import { tmpdir } from 'node:os';
import { extname, join, resolve } from 'node:path';

const [packages, envconv] = process.argv.slice(2).map((path) => resolve(path));
const { chromium } = createRequire(join(packages, 'package.json'))('playwright-core');
const folder = mkdtempSync(join(tmpdir(), 'envconv-three-'));
const size = 64;

// The panorama: right, up and forward as red, green and blue.
const color = (right, up, forward) => {
  const length = Math.hypot(right, up, forward);
  return [right, up, forward].map((v) => 0.5 + (0.45 * v) / length);
};

// A portable float map, rows from the bottom.
function writePanorama(path, width, height) {
  const pixels = new Float32Array(3 * width * height);
  for (let y = 0; y < height; ++y) {
    for (let x = 0; x < width; ++x) {
      const longitude = 2 * Math.PI * ((x + 0.5) / width - 0.5), polar = Math.PI * (1 - (y + 0.5) / height);
      const rgb = color(Math.sin(polar) * Math.sin(longitude), Math.cos(polar), Math.sin(polar) * Math.cos(longitude));
      pixels.set(rgb, 3 * (y * width + x));
    }
  }
  writeFileSync(path, Buffer.concat([Buffer.from(`PF\n${width} ${height}\n-1.0\n`), Buffer.from(pixels.buffer)]));
}

const page_text = `<!doctype html>
<script type="importmap">
{"imports": {"three": "/npm/three/build/three.module.js", "three/addons/": "/npm/three/examples/jsm/"}}
</script>
<script type="module">
import * as THREE from 'three';
import { DDSLoader } from 'three/addons/loaders/DDSLoader.js';
import { EXRLoader } from 'three/addons/loaders/EXRLoader.js';
const renderer = new THREE.WebGLRenderer({ preserveDrawingBuffer: true });
renderer.setPixelRatio(1);
renderer.setSize(${size}, ${size});
renderer.toneMapping = THREE.NoToneMapping;
const loaders = {
  async dds() {
    const file = await new DDSLoader().loadAsync('/sky.dds');
    const texture = new THREE.CompressedCubeTexture(file.image, file.format, THREE.HalfFloatType);
    const levels = file.image[0].mipmaps.length;
    texture.minFilter = levels > 1 ? THREE.LinearMipmapLinearFilter : THREE.LinearFilter;
    texture.needsUpdate = true;
    return texture;
  },
  async faces() {
    const names = ['px', 'nx', 'py', 'ny', 'pz', 'nz'].map((face) => '/sky_' + face + '.png');
    const texture = await new THREE.CubeTextureLoader().loadAsync(names);
    texture.colorSpace = THREE.SRGBColorSpace;
    return texture;
  },
  async latlong() {
    const texture = await new EXRLoader().loadAsync('/sky.exr');
    texture.mapping = THREE.EquirectangularReflectionMapping;
    return texture;
  },
};
// Colours of the view along \`forward\`, 90 degrees wide, from the top left.
window.show = async (kind, forward, up) => {
  const scene = new THREE.Scene();
  scene.background = await loaders[kind]();
  const camera = new THREE.PerspectiveCamera(90, 1, 0.1, 10);
  camera.up.set(...up);
  camera.lookAt(...forward);
  renderer.render(scene, camera);
  const canvas = document.createElement('canvas');
  canvas.width = canvas.height = ${size};
  const context = canvas.getContext('2d');
  context.drawImage(renderer.domElement, 0, 0);
  return [...context.getImageData(0, 0, ${size}, ${size}).data];
};
window.ready = true;
</script>`;

const types = { '.js': 'text/javascript', '.html': 'text/html', '.png': 'image/png' };
const server = createServer((request, response) => {
  const path = new URL(request.url, 'http://localhost').pathname;
  if (path === '/favicon.ico') return response.writeHead(204).end();
  try {
    const file = path.startsWith('/npm/') ? join(packages, 'node_modules', path.slice(5)) : join(folder, path);
    const content = readFileSync(file);
    response.writeHead(200, { 'content-type': types[extname(path)] ?? 'application/octet-stream' });
    response.end(content);
  } catch {
    response.writeHead(404);
    response.end();
  }
});

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const encoded = (v) => 255 * (v <= 0.0031308 ? 12.92 * v : 1.055 * v ** (1 / 2.4) - 0.055);
// What the panorama has where three.js looks along d.  Of cube maps it mirrors x, since its own axes are right-handed;
// of lat-longs the centre is +X and the right +Z.
const seen = {
  dds: (d) => color(-d[0], d[1], d[2]),
  faces: (d) => color(-d[0], d[1], d[2]),
  latlong: (d) => color(d[2], d[1], d[0]),
};
const views = [[[1, 0, 0], [0, 1, 0]], [[-1, 0, 0], [0, 1, 0]], [[0, 0, 1], [0, 1, 0]], [[0, 0, -1], [0, 1, 0]],
  [[0, 1, 0], [0, 0, 1]], [[0, -1, 0], [0, 0, 1]]];

let failures = 0, browser;
try {
  writePanorama(join(folder, 'in.pfm'), 512, 256);
  const convert = (...words) => execFileSync(envconv, ['convert', join(folder, 'in.pfm'), '-q', '-o', ...words]);
  convert(join(folder, 'sky.dds'), '--type', 'bc6h', '--size', '128');
  convert(join(folder, 'sky_{face}.png'), '--size', '128');
  convert(join(folder, 'sky.exr'), '--to', 'latlong', '--size', '256', '--type', 'half');
  writeFileSync(join(folder, 'page.html'), page_text);
  await new Promise((done) => server.listen(0, '127.0.0.1', done));
  browser = await chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
  });
  const page = await browser.newPage();
  page.on('pageerror', (error) => { console.error(String(error)); failures += 1; });
  page.on('console', (message) => { if (message.type() === 'error') console.error(message.text()); });
  await page.goto(`http://127.0.0.1:${server.address().port}/page.html`);
  await page.waitForFunction(() => window.ready, { timeout: 60000 });
  for (const kind of Object.keys(seen)) {
    let worst = 0, sum = 0;
    for (const [forward, up] of views) {
      const right = cross(forward, up), top = cross(right, forward);
      const pixels = await page.evaluate(([k, f, u]) => window.show(k, f, u), [kind, forward, up]);
      for (let i = 0; i < size * size; ++i) {
        const x = (2 * (i % size) + 1) / size - 1, y = 1 - (2 * Math.floor(i / size) + 1) / size;
        const d = [0, 1, 2].map((k) => forward[k] + x * right[k] + y * top[k]);
        seen[kind](d).forEach((v, c) => {
          const error = Math.abs(pixels[4 * i + c] - encoded(v));
          worst = Math.max(worst, error);
          sum += error;
        });
      }
    }
    const mean = sum / (views.length * size * size * 3);
    console.log(`${kind}: codes of 255 differ by ${mean.toFixed(3)} on average, ${worst.toFixed(2)} at most`);
    if (!(worst <= 4 && mean <= 0.6)) failures += 1;
  }
} finally {
  await browser?.close();
  server.close();
  rmSync(folder, { recursive: true });
}
process.exit(failures === 0 ? 0 : 1);
