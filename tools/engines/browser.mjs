// Renders the scene of scene.py with three.js or Babylon.js in headless Chromium: one .npy file for each pass and frame.
//
//     npm install three@0.187.0 @babylonjs/core@9.31.0 puppeteer-core     # in the folder MODULES
//     node tools/engines/browser.mjs MODULES SCENE OUT three-webgl|three-webgpu|babylon
import { createServer } from 'node:http';
import { mkdirSync, readFileSync, writeFileSync } from 'node:fs';
import { createRequire } from 'node:module';
import { extname, join, resolve } from 'node:path';

const [modules, sceneFolder, out, program] = process.argv.slice(2);
const puppeteer = createRequire(join(resolve(modules), 'package.json'))('puppeteer-core');
const poses = JSON.parse(readFileSync(join(sceneFolder, 'poses.json')));
const page = `<script type="importmap">{"imports": {"three/webgpu": "/node_modules/three/build/three.webgpu.js",
  "three/tsl": "/node_modules/three/build/three.tsl.js", "@babylonjs/core/": "/node_modules/@babylonjs/core/"}}</script>`;
const types = { '.js': 'text/javascript', '.mjs': 'text/javascript', '.html': 'text/html' };
const server = createServer((request, answer) => {
  const path = request.url.split('?')[0];
  try {
    const body = path === '/' ? page : readFileSync(join(modules, path));
    answer.writeHead(200, { 'Content-Type': types[extname(path)] ?? 'text/html' }).end(body);
  } catch { answer.writeHead(404).end(); }
}).listen(0);

async function three(poses, forceWebGL) {
  const THREE = await import('three/webgpu');
  const { mrt, output, velocity, positionWorld, normalWorld, vec4 } = await import('three/tsl');
  const [width, height] = poses.size, scene = new THREE.Scene(), objects = {};
  for (const [name, [positions, normals, triangles]] of Object.entries(poses.meshes)) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute('position', new THREE.Float32BufferAttribute(positions.flat(), 3));
    geometry.setAttribute('normal', new THREE.Float32BufferAttribute(normals.flat(), 3));
    geometry.setIndex(triangles.flat());
    if (poses.morphs[name]) {
      geometry.morphAttributes.position = [new THREE.Float32BufferAttribute(poses.morphs[name].flat(), 3)];
      geometry.morphTargetsRelative = true;
    }
    objects[name] = new THREE.Mesh(geometry, new THREE.MeshBasicNodeMaterial({ color: 0x808080, side: THREE.DoubleSide }));
    scene.add(objects[name]);
  }
  const camera = new THREE.PerspectiveCamera((poses.yfov * 180) / Math.PI, width / height, poses.near, 100);
  for (const thing of [...Object.values(objects), camera]) thing.matrixAutoUpdate = false;
  const renderer = new THREE.WebGPURenderer({ forceWebGL, requiredLimits: forceWebGL ? {} : { maxColorAttachmentBytesPerSample: 64 } });
  await renderer.init();
  renderer.setSize(width, height);
  const target = new THREE.RenderTarget(width, height, { count: 4, type: THREE.FloatType });
  const names = ['output', 'velocity', 'position', 'normal'];
  names.forEach((name, i) => { target.textures[i].name = name; });
  renderer.setMRT(mrt({ output, velocity, position: vec4(positionWorld, 1), normal: vec4(normalWorld, 1) }));
  renderer.setClearColor(0x000000, 0);
  renderer.setRenderTarget(target);
  const frames = {};
  for (const [number, frame] of Object.entries(poses.frames)) {
    for (const [name, thing] of [...Object.entries(objects), ['camera', camera]]) {
      thing.matrix.fromArray(frame[name].flat()).transpose();
      thing.matrixWorldNeedsUpdate = true;
      if (thing.morphTargetInfluences) thing.morphTargetInfluences[0] = frame.weight;
    }
    renderer._nodes.nodeFrame.update();  // what an animation loop does for every frame
    renderer.render(scene, camera);
    frames[number] = {};
    for (const [i, name] of names.entries()) {
      const pixels = await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height, i);
      const row = pixels.length / height;  // WebGPU pads rows to 256 bytes
      frames[number][name] = Array.from({ length: height }, (_, y) => Array.from(pixels.slice(y * row, y * row + 4 * width))).flat();
    }
  }
  return { frames, backend: renderer.backend.constructor.name };
}

async function babylon(poses) {
  const B = {};
  for (const path of ['Engines/engine', 'scene', 'Cameras/targetCamera', 'Meshes/mesh', 'Meshes/mesh.vertexData', 'Maths/math.vector',
    'Materials/standardMaterial', 'Morph/morphTargetManager', 'Morph/morphTarget', 'Rendering/geometryBufferRenderer',
    'Rendering/geometryBufferRendererSceneComponent', 'Lights/hemisphericLight'])
    Object.assign(B, await import('@babylonjs/core/' + path + '.js'));
  const [width, height] = poses.size, canvas = document.createElement('canvas');
  [canvas.width, canvas.height] = [width, height];
  const engine = new B.Engine(canvas, false), scene = new B.Scene(engine), objects = {};
  scene.useRightHandedSystem = true;
  for (const [name, [positions, normals, triangles]] of Object.entries(poses.meshes)) {
    const mesh = objects[name] = new B.Mesh(name, scene), data = new B.VertexData();
    [data.positions, data.normals, data.indices] = [positions.flat(), normals.flat(), triangles.flat()];
    data.applyToMesh(mesh);
    mesh.material = new B.StandardMaterial(name, scene);
    mesh.material.backFaceCulling = false;
    if (poses.morphs[name]) {
      const manager = mesh.morphTargetManager = new B.MorphTargetManager(scene), target = new B.MorphTarget('up', 0, scene);
      target.setPositions(positions.map((p, i) => p.map((v, k) => v + poses.morphs[name][i][k])).flat());
      manager.addTarget(target);
    }
  }
  const camera = new B.TargetCamera('camera', B.Vector3.Zero(), scene);
  [camera.fov, camera.minZ, camera.maxZ] = [poses.yfov, poses.near, 100];
  const buffer = scene.enableGeometryBufferRenderer(1, undefined, 1);
  buffer.enablePosition = true;
  buffer.enableVelocityLinear = true;
  await scene.whenReadyAsync();
  const frames = {}, kinds = { position: 'POSITION', normal: 'NORMAL', velocity: 'VELOCITY_LINEAR' };
  for (const [number, frame] of Object.entries(poses.frames)) {
    for (const [name, mesh] of Object.entries(objects)) {
      const matrix = B.Matrix.FromArray(frame[name].flat()).transpose();
      mesh.rotationQuaternion ??= new B.Quaternion();
      matrix.decompose(mesh.scaling, mesh.rotationQuaternion, mesh.position);
      if (mesh.morphTargetManager) mesh.morphTargetManager.getTarget(0).influence = frame.weight;
    }
    const m = frame.camera;
    camera.rotationQuaternion ??= new B.Quaternion();
    const rotation = [...m.slice(0, 3).map((row) => [...row.slice(0, 3), 0]), [0, 0, 0, 1]].flat();
    B.Matrix.FromArray(rotation).transpose().decompose(undefined, camera.rotationQuaternion);
    camera.position.set(m[0][3], m[1][3], m[2][3]);
    scene.render();
    frames[number] = {};
    for (const [name, kind] of Object.entries(kinds)) {
      const index = buffer.getTextureIndex(B.GeometryBufferRenderer[kind + '_TEXTURE_TYPE']);
      const pixels = await buffer.getGBuffer().textures[index].readPixels();
      frames[number][name] = Array.from(pixels, Number);
      frames[number][name + '_type'] = pixels.constructor.name;
    }
  }
  return { frames, backend: engine.description };
}

const browser = await puppeteer.launch({
  executablePath: '/usr/bin/chromium',
  args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--enable-unsafe-webgpu',
    '--use-webgpu-adapter=swiftshader', '--enable-features=Vulkan'],
});
const tab = await browser.newPage();
tab.on('console', (message) => console.log(message.text()));
tab.on('pageerror', (error) => console.log(String(error)));
await tab.goto(`http://localhost:${server.address().port}/`);
const done = program === 'babylon' ? await tab.evaluate(babylon, poses) : await tab.evaluate(three, poses, program === 'three-webgl');
await browser.close();
server.close();
console.log(program, done.backend);
mkdirSync(out, { recursive: true });
const [width, height] = poses.size;
for (const [number, passes] of Object.entries(done.frames)) {
  for (const [name, values] of Object.entries(passes).filter(([, values]) => Array.isArray(values))) {
    const shape = `(${height}, ${width}, ${values.length / width / height})`;
    const text = `{'descr': '<f4', 'fortran_order': False, 'shape': ${shape}, }`;
    const header = Buffer.from('\x93NUMPY\x01\x00..' + text.padEnd(117) + '\n', 'latin1');
    header.writeUInt16LE(118, 8);
    const path = join(out, `${name}_${number.padStart(4, '0')}.npy`);
    writeFileSync(path, Buffer.concat([header, Buffer.from(Float32Array.from(values).buffer)]));
  }
}
