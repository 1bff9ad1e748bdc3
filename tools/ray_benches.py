"""Benchmarks of ray tracing: rays through both levels of the acceleration structure, building and refitting trees."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable

import numpy as np
from benches import Claim, Options, Result, bench, real_scene, row, unmeasured

from taubench_gl.animation import FrameState, View
from taubench_gl.frame.raytracing.attributes import HitAttributes
from taubench_gl.frame.raytracing.structure import SceneStructure
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.declare import WRITE, ComputePass
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.scene.model import Camera, MorphTarget, Primitive, Scene

SIZE = (480, 270)
SAMPLES = 4
TARGETS = {"room": (2.5, 1.8), "Sponza": (0.6, 0.4)}
"""Million rays per CPU-second: the same random numbers in every pixel, and numbers of its own in each."""


class Eye:
    """A camera that stands still."""

    name = "eye"

    def __init__(self, position, target, yfov: float = 1.0):
        z = np.subtract(position, target) / np.linalg.norm(np.subtract(position, target))
        x = np.cross([0.0, 1.0, 0.0], z) / np.linalg.norm(np.cross([0.0, 1.0, 0.0], z))
        self._view = View(np.array(position, float), np.stack([x, np.cross(z, x), z], axis=1), Camera(yfov=yfov))

    def describe(self) -> str:
        return self.name

    def view_at(self, state: FrameState) -> View:
        return self._view


def furnished_room() -> Scene:
    """8,012 triangles: a room of 8 x 4 x 8 m with 20 balls."""
    b, rng = SceneBuilder(), np.random.default_rng(5)
    b.node(mesh=b.mesh(box((4, 2, 4), inside=True)))
    for _ in range(20):
        center = rng.uniform((-3.4, -1.6, -3.4), (3.4, 0.6, 3.4))
        b.node(mesh=b.mesh(_ball(center, rng.uniform(0.25, 0.6))))
    return b.build()


def _ball(center, radius: float) -> Primitive:
    """400 triangles."""
    theta, phi = np.linspace(0, np.pi, 11)[:, None], np.linspace(0, 2 * np.pi, 21)
    p = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta) + 0 * phi, np.sin(theta) * np.sin(phi)], -1)
    i = np.arange(10)[:, None] * 21 + np.arange(20)
    faces = np.stack([i, i + 1, i + 22, i, i + 22, i + 21], -1).reshape(-1, 3)
    return Primitive((center + radius * p.reshape(-1, 3)).astype(np.float32), faces.astype(np.uint32))


class Subject:
    """A scene whose hemisphere and shadow rays are timed."""

    def __init__(self, gpu: Gpu, scene: Scene, camera: Eye, light, *, alpha_test: bool = False):
        self._gpu, self._light = gpu, (*np.subtract(light, camera.view_at(None).position), 0.0)
        self._context = GpuContext(gpu)
        self._renderer = Renderer(self._context, scene, camera, SIZE, {"position", "geometric_normal"})
        self._structure = SceneStructure(self._renderer, alpha_test=alpha_test)
        parts = [self._structure]
        if alpha_test:
            parts.append(HitAttributes(self._renderer))
        self._renderer.draw(0.0, 0.0)
        for part in parts:
            part.update(self._renderer.frame)
        self._out = gpu.ctx.texture(SIZE, 4, dtype="f4")
        self._resources = dict(self._renderer.frame.resources) | {"measured": self._out}
        self._passes = {}
        for pattern in ("fixed", "independent"):
            p = ComputePass("measured rays", ("raytracing/measure.comp.glsl",))
            p.define(INDEPENDENT=pattern == "independent")
            p.texture("position", filled=True).texture("geometric_normal", filled=True)
            p.image("measured_out", access=WRITE, resource="measured")
            for part in parts:
                part.declare(p)
            self._passes[pattern] = self._context.compute(p.dispatch(SIZE, (32, 1)))
        for part in parts:
            self._resources |= part.resources
        self._parts = parts

    def time(self, pattern: str) -> float:
        """CPU milliseconds of a million rays."""
        self._gpu.finish()
        start = self._clock()
        for sample in range(SAMPLES):
            self._passes[pattern].run(None, self._resources, sample_number=sample, light=self._light)
            self._gpu.finish()
        seconds = self._clock() - start
        self._gpu.hazards.publish()
        rays = SAMPLES * float(np.frombuffer(self._out.read(), np.float32).reshape(-1, 4)[:, 3].sum())
        return 1e9 * seconds / rays

    def _clock(self) -> float:
        return time.process_time() if self._gpu.software else time.perf_counter()

    @property
    def unfinished(self) -> int:
        return self._structure.unfinished_rays

    def release(self) -> None:
        for part in (*self._parts, self._renderer, self._context):
            part.release()
        self._gpu.collect()


@bench
def rays(gpu: Gpu, options: Options) -> Result:
    """A closest-hit ray and a shadow ray at each of 4 hemisphere samples a pixel, through both levels."""
    room = furnished_room()
    subjects = {"room": Subject(gpu, room, Eye((3.2, 1.2, 3.2), (0, -0.3, 0), 1.1), (0.0, 1.5, 0.0))}
    path = real_scene("sponza/Sponza.gltf")
    notes = [f"{SIZE[0]}x{SIZE[1]}; room: 8,012 triangles; CPU milliseconds of a million rays"]
    if path.name.startswith("Sponza"):
        sponza, eye, light = load_scene(path), Eye((9, 3, 0.5), (0, 2, 0)), (0.0, 6.0, 0.0)
        subjects["Sponza"] = Subject(gpu, sponza, eye, light)
        subjects["Sponza, alpha tested"] = Subject(gpu, sponza, eye, light, alpha_test=True)
    samples = defaultdict(list)
    for number in range(1 + options.repeats):
        for name, subject in subjects.items():
            for pattern in ("fixed", "independent"):
                value = subject.time(pattern)
                if number:  # the first round compiles
                    samples[name, pattern].append(value)
    rows = [row(f"{name}, {pattern}", values) for (name, pattern), values in samples.items()]
    claims = []
    for name, targets in TARGETS.items():
        for pattern, target in zip(("fixed", "independent"), targets, strict=True):
            what, unit = f"rays in {name}, {pattern} numbers", "million a CPU-second"
            rates = [1e3 / value for value in samples.get((name, pattern), ())]
            if rates and gpu.software:
                low, high = np.percentile(rates, [10, 90])
                claims.append(Claim(what, ">=", target, float(np.median(rates)), float(low), float(high), unit))
            else:
                claims.append(unmeasured(what, ">=", target, "the scene is missing, or this is no CPU", unit))
    notes += [f"{name}: {s.unfinished} rays left without an end" for name, s in subjects.items() if s.unfinished]
    for subject in subjects.values():
        subject.release()
    return Result("Rays", rows, notes, claims=tuple(claims))


def bending_sheet(n: int = 224) -> Scene:
    """2 n^2 triangles that a morph target bends."""
    x, y = np.meshgrid(np.linspace(-1, 1, n + 1), np.linspace(-1, 1, n + 1))
    p = np.stack([x, y, 0.1 * np.sin(7 * x) * np.cos(5 * y) - 2], -1).reshape(-1, 3).astype(np.float32)
    i = np.arange(n)[:, None] * (n + 1) + np.arange(n)
    faces = np.stack([i, i + 1, i + n + 2, i, i + n + 2, i + n + 1], -1).reshape(-1, 3).astype(np.uint32)
    target = MorphTarget((0.3 * np.sin(9 * p[:, :1]) * [0, 0, 1]).astype(np.float32))
    b = SceneBuilder()
    node = b.node(
        mesh=b.mesh(Primitive(p, faces, normals=np.tile(np.float32([0, 0, 1]), (len(p), 1)), targets=(target,)))
    )
    b.animate(node, "weights", (0.0, 1.0), [[0.0], [1.0]])
    return b.build()


def moving_quads(count: int = 10_000) -> Scene:
    """Draws of one quad that all move with their parent."""
    quad = Primitive(np.float32([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]), np.uint32([[0, 1, 2], [0, 2, 3]]))
    b = SceneBuilder()
    parent, mesh = b.node(), b.mesh(quad)
    for i in range(count):
        b.node(parent, mesh=mesh, translation=(1.5 * (i % 100), 1.5 * (i // 100), -50.0))
    b.animate(parent, "translation", (0.0, 1.0), [[0.0, 0, 0], [0, 0, -9.0]])
    return b.build()


@bench
def ray_trees(gpu: Gpu, options: Options) -> Result:
    """Building Sponza's tree, refitting 100,000 triangles, placing 10,000 instances: CPU time."""
    from taubench_gl.frame.raytracing.bvh import build

    rng = np.random.default_rng(1)
    low = rng.random((262_144, 3))
    build(low[:100], low[:100])  # compiles, or loads what was compiled
    samples: dict[str, list[float]] = defaultdict(list)

    def timed(name: str, work: Callable[[], object]) -> None:
        gpu.finish()
        start = time.process_time()
        work()
        gpu.finish()
        samples[name].append(1e3 * (time.process_time() - start))

    path = real_scene("sponza/Sponza.gltf")
    known = path.name.startswith("Sponza")
    if known:
        context = GpuContext(gpu)
        renderer = Renderer(context, load_scene(path), Eye((9, 3, 0.5), (0, 2, 0)), (8, 8), {"position"})
        for _ in range(1 + options.repeats):
            timed("Sponza: structure of 262,267 triangles", lambda r=renderer: SceneStructure(r).release())
        renderer.release()
    for name, scene in (
        ("100,352 deforming triangles: update", bending_sheet()),
        ("10,000 moving instances: update", moving_quads()),
    ):
        context = GpuContext(gpu)
        renderer = Renderer(context, scene, Eye((0, 0, 1), (0, 0, 0)), (8, 8), {"position"})
        structure = SceneStructure(renderer)
        for number in range(2 + options.repeats):
            renderer.draw(0.1 * number, 0.0)
            timed(name, lambda s=structure, r=renderer: s.update(r.frame))
        for item in (structure, renderer, context):
            item.release()
    rows = [row(name, values[1:]) for name, values in samples.items()]
    claims = []
    limits = {"Sponza": 1000.0, "100,352": 30.0}
    for name, limit in limits.items():
        measured = next((r for r in rows if r.what.startswith(name)), None)
        if measured is None or not gpu.software:
            claims.append(unmeasured(name, "<=", limit, "the scene is missing, or this is no CPU", "ms"))
        else:
            claims.append(
                Claim(measured.what, "<=", limit, measured.median_ms, measured.low_ms, measured.high_ms, "ms of CPU")
            )
    gpu.collect()
    return Result("Trees of the acceleration structure", rows, ["CPU milliseconds"], claims=tuple(claims))
