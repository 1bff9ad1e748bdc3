"""Scenes of lamps, and methods that sample them run with many seeds at once."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from reuse_scenes import settings as small_settings

from taubench_gl.animation import Poser, choose_camera
from taubench_gl.evaluation import resolve_lighting
from taubench_gl.reuse.contract import Method
from taubench_gl.reuse.frame import FrameInputs, read_result
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.scene.model import Scene

Array = np.ndarray
SIZE = (16, 12)
FPS = 24.0
LAMPS = 12


def lamps(
    *,
    positions: Sequence[Sequence[float]] | None = None,
    colors: Sequence[Sequence[float]] | None = None,
    moving: Sequence[float] | None = None,
    switched: Sequence[tuple[int, Sequence[int]]] = (),
    camera_speed: float = 0.0,
    occluder: bool = False,
    glossy: bool = False,
) -> Scene:
    """A floor and a wall below LAMPS point lights.

    ``moving``: velocity of the first lamp, m/s; ``switched``: lamps and the frames between which each is on;
    ``occluder``: a plate between lamps and floor.
    """
    b = SceneBuilder()
    gray = b.material(
        base_color=(0.7, 0.6, 0.5, 1.0), metallic=0.0, roughness=0.4 if glossy else 1.0, specular=float(glossy)
    )
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), rotation=turn_x(-90.0))
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=gray)), translation=(0.0, 0.0, -3.0))
    plate = quad(0.9, 0.9, material=gray)
    b.node(mesh=b.mesh(plate), translation=(0.2, 0.7 if occluder else -3.0, -0.6), rotation=turn_x(-70.0))
    rng = np.random.default_rng(5)
    spread = np.stack([rng.uniform(-2, 2, LAMPS), rng.uniform(0.8, 2.2, LAMPS), rng.uniform(-2, 1, LAMPS)], axis=-1)
    power = 0.2 + 4.0 * rng.random(LAMPS) ** 4
    on = dict(switched)
    for i in range(LAMPS):
        at = spread[i] if positions is None else positions[i % len(positions)]
        color = (1.0, 0.9, 0.8) if colors is None else colors[i % len(colors)]
        lamp = b.light(translation=tuple(at), intensity=float(power[i]), color=tuple(color))
        if moving is not None and i == 0:
            b.animate(lamp, "translation", [0.0, 1.0], [at, np.add(at, moving)])
        if i in on:
            first, last = on[i]
            times = [0.0, (first - 0.5) / FPS, (last + 0.5) / FPS]
            b.animate(lamp, "scale", times, [(0.0,) * 3, (1.0,) * 3, (0.0,) * 3], "STEP")
    camera = b.camera(translation=(0.0, 1.5, 3.0), rotation=turn_x(-15.0), yfov=np.radians(55.0), znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 1.5, 3.0), (camera_speed, 1.5, 3.0)])
    return b.build()


def triangles_of(scene: Scene, view) -> Array:
    """All triangles (T, 3, 3) of a scene whose meshes do not move, relative to the camera of ``view``."""
    world, out = Poser(scene).sample(0.0).world, []
    for node, mesh in enumerate(scene.nodes.mesh.tolist()):
        for primitive in scene.meshes[mesh].primitives if mesh >= 0 else ():
            corners = primitive.positions.astype(np.float64)[primitive.triangles]
            out.append(corners @ world[node, :3, :3].T + world[node, :3, 3])
    return np.concatenate(out) - view.position


@contextlib.contextmanager
def opened(gpu, scene: Scene, reads, *, kind: str = "path-traced@1", size=SIZE, **changes) -> Iterator[RasterInputs]:
    """Inputs of ``scene`` without indirect light."""
    given = {"width": size[0], "height": size[1], "light": "auto", "bounces": 1, "exposure": 1.0} | changes
    made = resolve_lighting(scene, small_settings(**given)).settings
    request = FrameRequest(gpu, scene, choose_camera(scene), made, parse_input(kind))
    with RasterInputs(request, (*reads, "radiance")) as inputs:
        yield inputs


class Seeds:
    """One method run with many seeds over the same frames: its histories are kept apart."""

    def __init__(self, runner: MethodRunner, seeds: Sequence[int]):
        self._runner, self._seeds = runner, seeds
        self._kept: dict[int, dict[str, bytes]] = {}

    def step(self, frame: FrameInputs) -> Array:
        """Direct light of the frame by every seed, (seeds, h, w, 3) float64."""
        before, steps, out = self._runner._backend._before, self._runner._steps, []
        for seed in self._seeds:
            for name, data in self._kept.get(seed, {}).items():
                before[name].write(data)
            frame.light.reseed(seed)
            self._runner._steps = steps
            out.append(read_result(self._runner.step(frame))[..., :3])
            self._kept[seed] = {name: stored.read() for name, stored in before.items()}
        return np.stack(out).astype(np.float64)


def run_seeds(gpu, scene: Scene, method: Method, frames: int, seeds: Sequence[int], settings=None, **how):
    """Results of the last frame by every seed, its surfaces, rows of lights, and triangles."""
    with opened(gpu, scene, method.reads, **how) as inputs, MethodRunner(gpu, method, inputs.size, settings) as runner:
        many = Seeds(runner, seeds)
        for number in range(frames):
            frame = inputs.advance(number)
            result = many.step(frame)
        return result, frame.light.surfaces().copy(), frame.light.lights.copy(), triangles_of(scene, frame.view)


def t_values(results: Array, exact: Array) -> Array:
    """Student's t of the mean over seeds of each quarter of the image and color, against ``exact`` (h, w, 3)."""
    h, w = exact.shape[:2]
    parts = [(slice(i * h // 2, (i + 1) * h // 2), slice(j * w // 2, (j + 1) * w // 2)) for i in (0, 1) for j in (0, 1)]
    off = np.stack([(results - exact)[:, rows, columns].mean(axis=(1, 2)) for rows, columns in parts], axis=1)
    return off.mean(axis=0) / (off.std(axis=0, ddof=1) / np.sqrt(len(off)))


SCENES = {
    "many lamps": lamps,
    "occluder": partial(lamps, occluder=True),
    "moving lamp": partial(lamps, moving=(20.0, 0.0, 0.0), occluder=True),
    "born and killed": partial(lamps, switched=((0, (0, 1)), (1, (2, 9)), (2, (3, 9)))),
    "two colors": partial(lamps, colors=((1.0, 0.1, 0.1), (0.1, 0.2, 1.0))),
    "moving camera": partial(lamps, camera_speed=6.0, occluder=True),
}
"""Lamps with closed forms of their direct light, by what is hard about them."""
