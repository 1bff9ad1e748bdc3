// Runs an engine of the web over the conformance suite in headless Chromium and writes NPZ files.
//
//   import { run } from "./conformance_browser.mjs";
//   run("conformance_three.page.mjs", { three: "three/build/three.webgpu.js", ... });
//
// The page module sets window.draw(scene, size) -> { frame(entry) -> { array: {data, components} }, close() }.  Needs the
// packages of the engine and puppeteer-core in node_modules of the working folder, and Chromium (CHROMIUM: its path).

import { execFileSync } from "node:child_process";
import { createServer } from "node:http";
import { mkdirSync, readFileSync, writeFileSync } from "node:fs";
import { createRequire } from "node:module";
import path from "node:path";
import { crc32 } from "node:zlib";

const TYPES = { ".js": "text/javascript", ".mjs": "text/javascript", ".glb": "model/gltf-binary", ".json": "application/json" };
const HERE = path.dirname(new URL(import.meta.url).pathname);

export async function run(pageModule, imports) {
  const [suite, frames, ...names] = process.argv.slice(2);
  const listed = JSON.parse(readFileSync(path.join(suite, "suite.json"), "utf8"));
  const roots = { "/suite/": suite, "/modules/": "node_modules", "/engine/": HERE };
  const map = Object.fromEntries(Object.entries(imports).map(([name, file]) => [name, `/modules/${file}`]));
  const html = `<!doctype html><script type="importmap">${JSON.stringify({ imports: map })}</script>
    <script type="module" src="/engine/${pageModule}"></script>`;
  const server = createServer((request, response) => {
    const root = Object.keys(roots).find((prefix) => request.url.startsWith(prefix));
    try {
      const body = root ? readFileSync(path.join(roots[root], decodeURIComponent(request.url.slice(root.length)))) : html;
      response.writeHead(200, { "Content-Type": TYPES[path.extname(request.url)] ?? "text/html" }).end(body);
    } catch {
      response.writeHead(404).end();
    }
  });
  await new Promise((done) => server.listen(0, "127.0.0.1", done));
  const puppeteer = createRequire(path.join(process.cwd(), "x.js"))("puppeteer-core");
  const executablePath = process.env.CHROMIUM ?? execFileSync("which", ["chromium"], { encoding: "utf8" }).trim();
  const args = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"];
  const browser = await puppeteer.launch({ executablePath, args, protocolTimeout: 600000 });
  try {
    const page = await browser.newPage();
    page.on("pageerror", (error) => console.error(String(error)));
    page.on("console", (message) => message.type() === "error" && console.error(message.text()));
    await page.goto(`http://127.0.0.1:${server.address().port}/`);
    await page.waitForFunction("window.draw", { timeout: 120000 });
    for (const entry of listed.cases.filter((each) => !names.length || names.includes(each.name))) {
      const drawn = await page.evaluate(async (entry, size) => {
        const base64 = (data) => {
          let text = "";
          for (const byte of new Uint8Array(data.buffer, data.byteOffset, data.byteLength)) text += String.fromCharCode(byte);
          return btoa(text);
        };
        try {
          const scene = await window.draw(`/suite/${entry.scene}`, size);
          const frames = [];
          for (const frame of entry.frames) {
            const arrays = await scene.frame(frame);
            frames.push(Object.fromEntries(Object.entries(arrays).map(
              ([name, { data, components }]) => [name, { data: base64(data), components }])));
          }
          await scene.close();
          return frames;
        } catch (error) {
          return String(error.stack ?? error);
        }
      }, entry, [listed.width, listed.height]);
      if (typeof drawn === "string") {
        console.error(`${entry.name}: ${drawn}`);
        continue;
      }
      const folder = path.join(frames, entry.name);
      mkdirSync(folder, { recursive: true });
      drawn.forEach((arrays, number) => {
        const files = Object.entries(arrays).map(([name, { data, components }]) =>
          [`${name}.npy`, npy(Buffer.from(data, "base64"), [listed.height, listed.width, components])]);
        writeFileSync(path.join(folder, `frame_000${number}.npz`), zip(files));
      });
      console.log(entry.name);
    }
    console.log(await page.evaluate("window.version"));
  } finally {
    await browser.close();
    server.close();
  }
}

// One array of 32-bit floats in NumPy's format.
function npy(data, shape) {
  const text = `{'descr': '<f4', 'fortran_order': False, 'shape': (${shape.join(", ")}), }`;
  const header = text.padEnd(Math.ceil((text.length + 11) / 64) * 64 - 11) + "\n";
  const length = Buffer.alloc(2);
  length.writeUInt16LE(header.length);
  return Buffer.concat([Buffer.from("\x93NUMPY\x01\x00", "latin1"), length, Buffer.from(header, "latin1"), data]);
}

// An archive of stored files.
function zip(files) {
  const bodies = [], entries = [];
  let offset = 0;
  for (const [name, data] of files) {
    const common = Buffer.alloc(26);
    common.writeUInt16LE(20, 0);
    common.writeUInt32LE(crc32(data), 10);
    common.writeUInt32LE(data.length, 14);
    common.writeUInt32LE(data.length, 18);
    common.writeUInt16LE(name.length, 22);
    const rest = Buffer.alloc(14);
    rest.writeUInt32LE(offset, 10);
    bodies.push(Buffer.from("PK\x03\x04", "latin1"), common, Buffer.from(name), data);
    entries.push(Buffer.from("PK\x01\x02\x14\x00", "latin1"), common, rest, Buffer.from(name));
    offset += 30 + name.length + data.length;
  }
  const directory = Buffer.concat(entries), end = Buffer.alloc(22);
  end.write("PK\x05\x06", "latin1");
  end.writeUInt16LE(files.length, 8);
  end.writeUInt16LE(files.length, 10);
  end.writeUInt32LE(directory.length, 12);
  end.writeUInt32LE(offset, 16);
  return Buffer.concat([...bodies, directory, end]);
}
