#!/usr/bin/env bash
# Two morph targets, one animated smoothly and one in steps: GLTFExporter merges the tracks with one interpolation.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cd "$folder"
npm install --silent --no-audit --no-fund three@0.187.0 >/dev/null || exit 2
cat >run.mjs <<'JS'
globalThis.FileReader = class { // of browsers
  readAsArrayBuffer(blob) { blob.arrayBuffer().then((data) => { this.result = data; this.onloadend?.(); }); }
  readAsDataURL(blob) {
    blob.arrayBuffer().then((data) => {
      this.result = 'data:;base64,' + Buffer.from(data).toString('base64');
      this.onloadend?.();
    });
  }
};
const THREE = await import('three');
const { GLTFExporter } = await import('three/addons/exporters/GLTFExporter.js');
const shape = new THREE.BufferGeometry();
shape.setAttribute('position', new THREE.Float32BufferAttribute([0, 0, 0, 1, 0, 0, 0, 1, 0], 3));
shape.morphAttributes.position = ['a', 'b'].map((name, k) => {
  const target = new THREE.Float32BufferAttribute([0, 0, k + 1, 0, 0, k + 1, 0, 0, k + 1], 3);
  target.name = name;
  return target;
});
shape.morphTargetsRelative = true;
const mesh = new THREE.Mesh(shape, new THREE.MeshStandardMaterial());
mesh.name = 'mesh';
mesh.updateMorphTargets();
const track = (name, mode) =>
  new THREE.NumberKeyframeTrack(`mesh.morphTargetInfluences[${name}]`, [0, 1, 2], [0, 1, 0], mode);
const found = [];
for (const [a, b] of [[THREE.InterpolateLinear, THREE.InterpolateDiscrete], [THREE.InterpolateDiscrete, THREE.InterpolateLinear]]) {
  const clip = new THREE.AnimationClip('clip', -1, [track('a', a), track('b', b)]);
  const file = await new GLTFExporter().parseAsync(mesh, { animations: [clip] });
  found.push(file.animations[0].samplers.map((sampler) => sampler.interpolation).join());
}
console.log(`three.js 0.187.0: smooth and steps become ${found[0]}, steps and smooth become ${found[1]}`);
process.exit(found[0] === 'LINEAR' && found[1] === 'STEP' ? 0 : 1);
JS
node run.mjs
