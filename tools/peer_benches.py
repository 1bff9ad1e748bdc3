"""Benchmarks of other programs: a frame of pyrender, and reading a file with trimesh and pygltflib."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from benches import (
    EIGHT,
    FPS,
    Claim,
    Options,
    Result,
    Stopwatch,
    bench,
    missing,
    quick,
    ratios,
    real_scene,
    row,
    unmeasured,
)
from mask_benches import Walk
from peers import Peer

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.evaluation import ChannelPair
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu
from taubench_gl.scene import load_scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

PYRENDER, OURS, MASKED, READ = (
    "pyrender: color and depth, read back",
    f"ours: {len(EIGHT)} channels",
    f"ours: {len(EIGHT)} channels, masks and counts",
    "ours: the same, color and position read back",
)
CLAIMS = {
    OURS: "a geometry frame, relative to pyrender's color and depth",
    MASKED: "a geometry frame with masks and counts, relative to the same",
}
FRAMES = 7


def matrix_of(view: View) -> np.ndarray:
    """world_from_view (4, 4)."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = view.world_from_view, view.position
    return out


@quick
@bench
def pyrender(gpu: Gpu, options: Options) -> Result:
    """A camera path through Sponza: geometry frames of this package and of pyrender, same driver, interleaved."""
    path = real_scene("sponza/Sponza.gltf")
    title = f"A frame of {path.name} and of pyrender, {options.size_text}"
    peer = Peer.start("pyrender_frames.py", str(path), *map(str, options.size))
    if peer.missing is not None:
        claims = tuple(unmeasured(what, "<=", 0.3, "no pyrender") for what in CLAIMS.values())
        return Result(title, [missing(PYRENDER, peer.missing)], [], claims=claims)
    scene, camera = load_scene(path), Walk()
    owner = GpuOwner(gpu)
    renderer = owner.own(Renderer(owner.context, scene, camera, options.size, EIGHT))
    evaluator = owner.open_evaluator(ChannelPair(options.size), Settings(**FIXED_LIGHTING))
    watch, covered = Stopwatch(gpu), []

    def masked(frame: int) -> None:
        renderer.draw(frame / FPS, (frame - 1) / FPS)
        pair = reprojection(renderer.view(frame / FPS)[1], renderer.view((frame - 1) / FPS)[1], *options.size)
        history = renderer.history
        evaluator.submit(pair, current=history.current.textures, previous=history.previous.textures)
        evaluator.read()

    def read(frame: int) -> None:
        masked(frame)
        renderer.read("base_color")
        renderer.read("position")

    lens = {"yfov": camera.lens.yfov, "znear": camera.lens.znear, "zfar": camera.lens.zfar}
    for frame in range(FRAMES * options.repeats + 1):
        step = frame % FRAMES
        answer = peer.ask(world_from_view=matrix_of(renderer.view(step / FPS)[1]), **lens)
        watch.samples[PYRENDER].append(answer["ms"])
        watch.time(OURS, lambda f=step: renderer.draw(f / FPS, (f - 1) / FPS))
        watch.time(MASKED, lambda f=step: masked(f))
        watch.time(READ, lambda f=step: read(f))
        covered.append((answer["covered"], float((renderer.read("position")[..., 3] > 0).mean())))
    rows = [row(name, watch.samples[name][1:]) for name in (PYRENDER, OURS, MASKED, READ)]
    theirs, mine = 100 * np.mean(covered, axis=0)
    owner.release()
    peer.close()
    triangles = sum(len(p.triangles) for m in scene.meshes for p in m.primitives)
    notes = [
        f"{triangles} triangles; geometry only (pyrender: ambient light, no shadows; ours: no light)",
        f"pixels that show a surface: pyrender {theirs:.2f} %, ours {mine:.2f} %",
    ]
    samples = {name: watch.samples[name][1:] for name in (PYRENDER, *CLAIMS)}
    claims = [Claim(what, "<=", 0.3, *ratios(samples[name], samples[PYRENDER])) for name, what in CLAIMS.items()]
    return Result(title, rows, notes, unit="x pyrender", claims=tuple(claims))


@quick
@bench
def load(gpu: Gpu, options: Options) -> Result:
    """Import and read a scene in a new process: this package, trimesh and pygltflib."""
    path = real_scene("sponza/Sponza.gltf")
    samples: dict[str, list[float]] = defaultdict(list)
    reasons: dict[str, str] = {}
    for _ in range(options.repeats + 1):
        for who in ("ours", "trimesh", "pygltflib", "json"):
            peer = Peer.start("load_scene.py", who, str(path))
            if peer.missing is not None:
                reasons[who] = peer.missing
                continue
            for name, ms in peer.hello.items():
                samples[f"{who} {name}"].append(ms)
            peer.close()
    what = {
        "import_ms": "import",
        "load_ms": "read",
        "first_ms": "process start to first counts, 64x36",
    }
    order = [k for k in ("ours load_ms", "ours import_ms", "ours first_ms", *samples) if k in samples]
    rows = [
        row(f"{key.split()[0]}: {what[key.split()[1]]}", samples[key][1:], _did(key)) for key in dict.fromkeys(order)
    ]
    rows += [missing(who, reason) for who, reason in reasons.items()]
    notes = [f"{path.name}; one process per sample; without the first round (cold file cache)"]
    return Result("Start-up and reading a file", rows, notes, unit="x ours")


def _did(key: str) -> str:
    """The work included in a measurement."""
    return {
        "ours load_ms": "JSON, buffers, every rule checked",
        "trimesh load_ms": "JSON, buffers, images decoded",
        "pygltflib load_ms": "JSON into objects",
        "json load_ms": "JSON alone",
    }.get(key, "")
