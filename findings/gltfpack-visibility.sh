#!/usr/bin/env bash
# A node that KHR_node_visibility hides: gltfpack drops the extension and keeps the node's mesh.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund gltfpack@1.3.0 >/dev/null || exit 2
cat >make.mjs <<'JS'
import { writeFileSync } from 'node:fs';
const data = Buffer.from(new Float32Array([0, 0, 0, 1, 0, 0, 0, 1, 0]).buffer);
const hidden = { KHR_node_visibility: { visible: false } };
writeFileSync('in.gltf', JSON.stringify({
  asset: { version: '2.0' }, extensionsUsed: ['KHR_node_visibility'], scene: 0, scenes: [{ nodes: [0, 1] }],
  nodes: [{ mesh: 0, name: 'shown' }, { mesh: 0, name: 'hidden', translation: [3, 0, 0], extensions: hidden }],
  meshes: [{ primitives: [{ attributes: { POSITION: 0 } }] }],
  accessors: [{ bufferView: 0, componentType: 5126, count: 3, type: 'VEC3', min: [0, 0, 0], max: [1, 1, 0] }],
  bufferViews: [{ buffer: 0, byteLength: 36 }],
  buffers: [{ byteLength: 36, uri: 'data:application/octet-stream;base64,' + data.toString('base64') }],
}));
JS
node make.mjs
said=$(npx gltfpack -i in.gltf -o out.gltf 2>&1)
cat >look.mjs <<'JS'
import { readFileSync } from 'node:fs';
const file = JSON.parse(readFileSync('out.gltf'));
const used = file.extensionsUsed ?? [], drawn = file.nodes.filter((node) => node.mesh !== undefined).length;
console.log(`gltfpack 1.3.0: extensionsUsed ${JSON.stringify(used)}, ${drawn} nodes with a mesh, said '${process.argv[2]}'`);
process.exit(used.includes('KHR_node_visibility') || drawn !== 2 || process.argv[2] ? 1 : 0);
JS
node look.mjs "$said"
