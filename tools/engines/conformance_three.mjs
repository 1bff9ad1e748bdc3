// Frames of the conformance suite by three.js (WebGPURenderer, WebGL back end) in headless Chromium.
//
//   npm install three@0.187 puppeteer-core
//   node PATH/tools/engines/conformance_three.mjs SUITE FRAMES [CASE ...]
//   taubench-gl conformance score npz:FRAMES --mapping PATH/tools/engines/conformance_three.toml

import { run } from "./conformance_browser.mjs";

await run("conformance_three.page.mjs", {
  "three": "three/build/three.webgpu.js",
  "three/webgpu": "three/build/three.webgpu.js",
  "three/tsl": "three/build/three.tsl.js",
  "three/loader": "three/examples/jsm/loaders/GLTFLoader.js",
});
