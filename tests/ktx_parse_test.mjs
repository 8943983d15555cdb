// SPDX-License-Identifier: Apache-2.0
// ktx-parse reads each of our KTX2 files and writes it again: the bytes must be the same.
// node ktx_parse_test.mjs FOLDER_OF_NPM CONTAINER_SAMPLES
import { execFileSync } from 'node:child_process';
import { mkdtempSync, readdirSync, readFileSync, rmSync } from 'node:fs';
import { tmpdir } from 'node:os';
import { join, resolve } from 'node:path';
import { createRequire } from 'node:module';

const [packages, samples] = process.argv.slice(2);
const { read, write } = createRequire(resolve(packages, 'package.json'))('ktx-parse');
const folder = mkdtempSync(join(tmpdir(), 'envconv-ktx-parse-'));
let files = 0, failures = 0;
try {
  execFileSync(samples, [folder]);
  for (const name of readdirSync(folder).filter((file) => file.endsWith('.ktx2')).sort()) {
    const bytes = readFileSync(join(folder, name));
    const again = write(read(bytes), { keepWriter: true });
    files += 1;
    if (Buffer.compare(bytes, Buffer.from(again)) === 0) continue;
    const at = bytes.findIndex((byte, i) => byte !== again[i]);
    console.error(`${name}: ${bytes.length} bytes become ${again.length}, which differ from byte ${at} on`);
    failures += 1;
  }
} finally {
  rmSync(folder, { recursive: true });
}
console.log(`${files} files, ${failures} differ`);
process.exit(files > 0 && failures === 0 ? 0 : 1);
