// Frames of the conformance suite by Babylon.js (WebGL 2, geometry buffer with linear velocity) in headless Chromium.
//
//   npm install babylonjs babylonjs-loaders puppeteer-core
//   node PATH/tools/engines/conformance_babylon.mjs SUITE FRAMES [CASE ...]
//   taubench-gl conformance score npz:FRAMES --mapping PATH/tools/engines/conformance_babylon.toml

import { run } from "./conformance_browser.mjs";

await run("conformance_babylon.page.mjs", {});
