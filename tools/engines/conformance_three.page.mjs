// The page of conformance_three.mjs: one scene at a time, vectors by three's own VelocityNode.

import * as THREE from "three";
import { mrt, output, positionWorld, vec4, velocity } from "three/tsl";
import { GLTFLoader } from "three/loader";

window.version = `three.js ${THREE.REVISION}`;

window.draw = async (url, [width, height]) => {
  const renderer = new THREE.WebGPURenderer({ antialias: false, forceWebGL: true });
  renderer.setSize(width, height, false);
  renderer.setClearColor(0x000000, 0);
  await renderer.init();
  const target = new THREE.RenderTarget(width, height, { count: 3, type: THREE.FloatType });
  // Vectors of skinned meshes are right only if the output has this name.
  ["output", "velocity", "place"].forEach((name, i) => (target.textures[i].name = name));
  for (const texture of target.textures) texture.minFilter = texture.magFilter = THREE.NearestFilter;
  renderer.setMRT(mrt({ output, velocity, place: vec4(positionWorld, 1) }));

  const gltf = await new GLTFLoader().loadAsync(url);
  const mixer = new THREE.AnimationMixer(gltf.scene);
  for (const clip of gltf.animations) {
    const action = mixer.clipAction(clip);
    action.setLoop(THREE.LoopOnce);
    action.clampWhenFinished = true;
    action.play();
  }
  const scene = new THREE.Scene();
  scene.add(gltf.scene, new THREE.AmbientLight());
  const camera = gltf.cameras[0];
  if (camera.isPerspectiveCamera) camera.aspect = width / height;
  else [camera.left, camera.right] = [(camera.bottom * width) / height, (camera.top * width) / height];

  const read = async (index) => {
    const data = await renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height, index);
    const out = new Float32Array(width * height * 4); // the rows of the WebGL back end start at the bottom
    for (let row = 0; row < height; row++)
      out.set(data.subarray((height - 1 - row) * width * 4, (height - row) * width * 4), row * width * 4);
    return out;
  };
  return {
    async frame({ time_s, jitter_px }) {
      mixer.setTime(time_s);
      camera.clearViewOffset();
      camera.updateProjectionMatrix();
      velocity.setProjectionMatrix(camera.projectionMatrix.clone()); // without the jitter, as three's TRAANode does
      if (jitter_px[0] || jitter_px[1]) camera.setViewOffset(width, height, jitter_px[0], jitter_px[1], width, height);
      renderer.setRenderTarget(target);
      await renderer.renderAsync(scene, camera);
      return { velocity: { data: await read(1), components: 4 }, place: { data: await read(2), components: 4 } };
    },
    async close() {
      target.dispose();
      renderer.dispose();
    },
  };
};
