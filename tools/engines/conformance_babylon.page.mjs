// The page of conformance_babylon.mjs: one scene at a time, vectors by the geometry buffer.

for (const file of ["babylonjs/babylon.js", "babylonjs-loaders/babylonjs.loaders.js"]) {
  const script = document.createElement("script");
  script.src = `/modules/${file}`;
  await new Promise((done) => {
    script.onload = done;
    document.head.append(script);
  });
}

window.version = `Babylon.js ${BABYLON.Engine.Version}`;

window.draw = async (url, [width, height]) => {
  const canvas = Object.assign(document.createElement("canvas"), { width, height });
  const engine = new BABYLON.Engine(canvas, false, { preserveDrawingBuffer: true });
  const scene = new BABYLON.Scene(engine);
  scene.useRightHandedSystem = true;
  await BABYLON.SceneLoader.AppendAsync("", url, scene);
  const camera = scene.cameras[0];
  scene.activeCamera = camera;
  for (const group of scene.animationGroups) {
    group.start(false);
    group.pause();
  }
  const { GeometryBufferRenderer: G, Constants: C } = BABYLON;
  const kind = { textureType: C.TEXTURETYPE_FLOAT, textureFormat: C.TEXTUREFORMAT_RGBA };
  const types = Object.fromEntries(
    [G.POSITION_TEXTURE_TYPE, G.VELOCITY_LINEAR_TEXTURE_TYPE, G.NORMAL_TEXTURE_TYPE].map((type) => [type, kind]));
  const buffer = scene.enableGeometryBufferRenderer({ width, height }, C.TEXTUREFORMAT_DEPTH32_FLOAT, types);
  buffer.enablePosition = buffer.enableVelocityLinear = buffer.generateNormalsInWorldSpace = true;
  await scene.whenReadyAsync();

  const read = async (type) => {
    const texture = buffer.getGBuffer().textures[buffer.getTextureIndex(type)];
    const data = await texture.readPixels();
    const out = new Float32Array(width * height * 4); // rows start at the bottom
    for (let row = 0; row < height; row++)
      out.set(data.subarray((height - 1 - row) * width * 4, (height - row) * width * 4), row * width * 4);
    return out;
  };
  return {
    async frame({ time_s, jitter_px, camera: pose }) {
      for (const group of scene.animationGroups) group.goToFrame(time_s * 60); // the loader's keys are in 60ths
      if (pose.kind === "orthographic") {
        camera.mode = BABYLON.Camera.ORTHOGRAPHIC_CAMERA;
        [camera.orthoTop, camera.orthoBottom] = [pose.ymag, -pose.ymag];
        [camera.orthoRight, camera.orthoLeft] = [(pose.ymag * width) / height, (-pose.ymag * width) / height];
      }
      camera.unfreezeProjectionMatrix();
      if (jitter_px[0] || jitter_px[1]) {
        const matrix = camera.getProjectionMatrix(true).clone();
        matrix.addAtIndex(8, (2 * jitter_px[0]) / width);
        matrix.addAtIndex(9, (-2 * jitter_px[1]) / height);
        camera.freezeProjectionMatrix(matrix);
      }
      scene.render();
      const names = { velocity: G.VELOCITY_LINEAR_TEXTURE_TYPE, place: G.POSITION_TEXTURE_TYPE, normal: G.NORMAL_TEXTURE_TYPE };
      const arrays = {};
      for (const [name, type] of Object.entries(names)) arrays[name] = { data: await read(type), components: 4 };
      return arrays;
    },
    async close() {
      engine.dispose();
    },
  };
};
