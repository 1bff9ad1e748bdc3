#!/usr/bin/env bash
# The tolerance of resample holds for each removed key against its neighbors: small steps add up.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund @gltf-transform/core@4.5.1 @gltf-transform/functions@4.5.1 >/dev/null || exit 2
cat >run.mjs <<'JS'
import { Document } from '@gltf-transform/core';
import { resample } from '@gltf-transform/functions';
const count = 7200, times = new Float32Array(count), places = new Float32Array(3 * count);
for (let i = 0; i < count; i++) {
  times[i] = i / 24;
  places[3 * i] = Math.sin((i / count) * Math.PI); // 1 m forth and back in five minutes
}
const file = new Document(), buffer = file.createBuffer(), node = file.createNode();
const accessor = (type, array) => file.createAccessor().setType(type).setArray(array.slice()).setBuffer(buffer);
const sampler = file.createAnimationSampler().setInterpolation('LINEAR')
  .setInput(accessor('SCALAR', times)).setOutput(accessor('VEC3', places));
file.createScene().addChild(node);
file.createAnimation().addSampler(sampler)
  .addChannel(file.createAnimationChannel().setTargetNode(node).setTargetPath('translation').setSampler(sampler));
await file.transform(resample({ tolerance: 1e-4 }));
const kept = sampler.getInput().getArray(), values = sampler.getOutput().getArray();
let worst = 0;
for (let i = 0, k = 0; i < count; i++) {
  while (k < kept.length - 2 && kept[k + 1] < times[i]) k++;
  const part = (times[i] - kept[k]) / (kept[k + 1] - kept[k]);
  worst = Math.max(worst, Math.abs(values[3 * k] * (1 - part) + values[3 * k + 3] * part - places[3 * i]));
}
console.log(`glTF Transform 4.5.1: ${count} keys become ${kept.length}; largest error ${worst.toFixed(4)} m, tolerance 1e-4`);
process.exit(worst > 0.03 ? 0 : 1);
JS
node run.mjs
