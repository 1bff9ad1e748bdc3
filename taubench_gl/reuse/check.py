"""``reuse check``: runs a method on a small synthetic sequence; ``reuse new``: writes an example method."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from taubench_gl.animation import choose_camera
from taubench_gl.data_files import read_bytes
from taubench_gl.errors import OutputError
from taubench_gl.gpu.context import Gpu
from taubench_gl.outputs import cannot_write, write_atomically
from taubench_gl.paths import PACKAGE
from taubench_gl.reuse.contract import Method, Value
from taubench_gl.reuse.frame import FrameInputs, read_result
from taubench_gl.reuse.generated import INTERPOLATE
from taubench_gl.reuse.input_kind import parse_input
from taubench_gl.reuse.inputs import FrameRequest, RasterInputs
from taubench_gl.reuse.loading import load_method
from taubench_gl.reuse.runner import MethodRunner
from taubench_gl.reuse.synthetic import FPS, Uploader, camera_at, render_view, synthetic_steps
from taubench_gl.scene.build import NodeList
from taubench_gl.scene.model import Camera, Channel, Light, Material, Mesh, Primitive, Scene
from taubench_gl.settings import Settings

SIZE, FRAMES, CUT_AT, NOISE = (96, 54), 12, 8, 0.3
EVERY = 4
"""Frames from one rendered frame to the next for methods that generate frames, which run at phases 0, 1/4 .. 3/4."""

_TEMPLATE = PACKAGE / "reuse" / "template"


@dataclass(frozen=True, slots=True)
class CheckReport:
    """Result of a test run.  Errors are RMS errors of linear radiance against the noise-free frames.

    ``error_without_reuse``: of the noisy frames themselves, or of the last rendered frame in place of generated ones;
    None for a method that computes its direct light itself.
    """

    method: Method
    frames: int
    size: tuple[int, int]
    error: float
    error_without_reuse: float | None
    reused: float | None  # mean weight of history, None if not reported


def check_method(
    gpu: Gpu, source: str | Path | type | Method, settings: Mapping[str, Value] | None = None
) -> CheckReport:
    """Run a method, as for ``load_method``, over FRAMES noisy frames with a cut; one that generates frames over FRAMES
    rendered ones without noise and those between them, which alone have an error.  Raises MethodError."""
    method = load_method(source)
    squares, plain, reused = [], [], []
    frames = _lit_frames(gpu, method) if method.own_light else _synthetic_frames(gpu, method.generates)
    with MethodRunner(gpu, method, SIZE, settings) as runner, contextlib.closing(frames):
        for frame, shown, clean in frames:
            result = read_result(runner.step(frame))
            reused.append(result[..., 3])
            if frame.phase > 0 or not method.generates:
                squares.append(np.mean((result[..., :3] - clean) ** 2, dtype=np.float64))
                plain += [] if shown is None else [np.mean((shown - clean) ** 2)]
    weight = np.stack(reused)
    return CheckReport(
        method=method,
        frames=len(reused),
        size=SIZE,
        error=float(np.sqrt(np.mean(squares))),
        error_without_reuse=float(np.sqrt(np.mean(plain))) if plain else None,
        reused=None if (weight < 0).all() else float(weight[weight >= 0].mean(dtype=np.float64)),
    )


def _synthetic_frames(gpu: Gpu, generates: str | None) -> Iterator[tuple[FrameInputs, np.ndarray, np.ndarray]]:
    """Inputs, the radiance of the last rendered frame, and clean radiance of each displayed frame."""
    every, noise, cut = (EVERY, 0.0, None) if generates else (1, NOISE, CUT_AT)
    steps = list(synthetic_steps(SIZE, FRAMES, noise=noise, cut_at=cut))
    with Uploader(gpu, SIZE) as uploader:
        for number in range((FRAMES - 1) * every + 1):
            last, part = divmod(number, every)
            frame = uploader.frame(steps[last + (part > 0 and generates == INTERPOLATE)])
            clean, time = steps[last].clean, number / every / FPS
            if part:
                frame = replace(frame, phase=part / every, shown=camera_at(time))
                clean = render_view(frame.shown, time, SIZE)["radiance"]
            yield replace(frame, index=number), steps[last].inputs["radiance"][..., :3], clean


def _lit_frames(gpu: Gpu, method: Method) -> Iterator[tuple[FrameInputs, None, np.ndarray]]:
    """Frames of ``lit_scene``, whose few lights are all computed exactly: their direct light has no noise."""
    scene, (width, height) = lit_scene(), SIZE
    settings = Settings(
        width=width, height=height, light="path-traced", bounces=1, environment="none", light_unit="candela",
        exposure=1.0, reprojection="motion",
    )  # fmt: skip
    request = FrameRequest(gpu, scene, choose_camera(scene), settings, parse_input("path-traced@1+all-lights"))
    with RasterInputs(request, (*method.reads, "radiance"), cuts=(CUT_AT,)) as inputs:
        for number in range(FRAMES):
            frame = inputs.advance(number)
            yield frame, None, read_result(frame.textures["radiance"])[..., :3]


def lit_scene() -> Scene:
    """A floor, a pillar and four lamps, one of which moves and one of which goes out; the camera moves."""
    corners = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], dtype=np.float32)
    triangles = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.uint32)
    plane = Mesh("plane", (Primitive(corners, triangles, 0, normals=np.tile(np.float32([0, 0, 1]), (4, 1))),))
    down, times = (-np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)), np.array([0.0, 1.0])
    nodes = NodeList()
    nodes.add("floor", mesh=0, rotation=down, scale=(4.0, 4.0, 1.0))
    nodes.add("pillar", mesh=0, translation=(0.3, 0.6, -0.5), scale=(0.3, 0.6, 1.0))
    camera = nodes.add("camera", translation=(0.0, 1.2, 3.0), camera=0)
    places = [(-1.5, 1.5, 0.5), (1.5, 1.0, 0.0), (0.0, 2.0, -2.0), (0.5, 0.8, 1.0)]
    lamps = [nodes.add(f"lamp {i}", translation=place, light=i) for i, place in enumerate(places)]
    moves = [(camera, "translation", "LINEAR", [(0.0, 1.2, 3.0), (0.6, 1.2, 3.0)])]
    moves += [(lamps[0], "translation", "LINEAR", [places[0], (1.5, 1.5, 0.5)])]
    moves += [(lamps[3], "scale", "STEP", [(1.0, 1.0, 1.0), (0.0, 0.0, 0.0)])]
    channels = [Channel("node", n, path, mode, times / 4, np.array(rows)) for n, path, mode, rows in moves]
    colors = [(1.0, 0.6, 0.4), (0.4, 0.6, 1.0), (1.0, 1.0, 1.0), (0.3, 1.0, 0.3)]
    return Scene(
        "lamps", nodes.nodes(), (plane,), (Material(base_color=(0.7, 0.7, 0.7, 1.0), metallic=0.0, roughness=0.7),),
        cameras=(Camera(yfov=np.radians(60.0), znear=0.1),),
        lights=tuple(Light(color=color, intensity=2.0 + i) for i, color in enumerate(colors)), channels=tuple(channels),
    )  # fmt: skip


def write_example(path: Path, python: bool = False, samples: bool = False) -> list[Path]:
    """A working method at ``path``: a folder with method.toml and GLSL, or for ``python`` one file.

    ``samples``: a method that computes its direct light itself, from samples of lights and shadow rays.
    -> the files.  Raises OutputError if the path exists or cannot be written.
    """
    path = path.with_name(f"{path.name}.py") if python and path.suffix != ".py" else path
    if path.exists():
        raise OutputError("exists", where=str(path), hint="choose another name")
    folder = "samples/" if samples else ""
    templates = {"method.py": path} if python else {
        f"{folder}{name}": path / name for name in ("method.toml", "reuse.glsl")
    }  # fmt: skip
    new_files: list[Path] = []
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if not python:
            path.mkdir()
        for name, target in templates.items():
            write_atomically(target, read_bytes(_TEMPLATE / name))
            new_files.append(target)
    except (OSError, OutputError) as error:
        for target in new_files:
            target.unlink(missing_ok=True)
        if not python and path.is_dir() and not any(path.iterdir()):
            path.rmdir()
        raise (cannot_write(path, error) if isinstance(error, OSError) else error) from None
    return new_files
