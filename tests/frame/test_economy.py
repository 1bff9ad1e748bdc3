"""What is left out, kept or put off to save time changes no bit of the result and does not grow with the frames."""

from __future__ import annotations

import gc
import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings
from frame_tools import THRESHOLDS, FormulaCamera, make_scene, quad, rotation_about

from taubench_gl.animation import choose_camera
from taubench_gl.animation.pairs import reprojection
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.frame import occlusion
from taubench_gl.frame.draw_bounds import in_view
from taubench_gl.frame.geometry import build_geometry
from taubench_gl.frame.passes import gbuffer
from taubench_gl.frame.passes.masks import MaskOptions, MaskPass
from taubench_gl.frame.renderer import Renderer
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.passes import GpuContext
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Camera, Channel, Scene

SIZE = (96, 54)
CHANNELS = ("position", "normal", "prev_position", "ids")
LENS = Camera(yfov=0.8, znear=0.1, zfar=40.0)
SCENES = ("khronos/CesiumMan/CesiumMan.glb", "sponza/Sponza.gltf", "khronos/CesiumMilkTruck/CesiumMilkTruck.glb")


def bits(renderer: Renderer) -> dict[str, bytes]:
    return {name: renderer.read(name).tobytes() for name in renderer.channels}


def circling(center, radius: float) -> FormulaCamera:
    """Turns on the spot, beside what it saw first: draws come into view and leave it."""
    return FormulaCamera(LENS, lambda t: (np.add(center, [0.0, 0.0, radius]), rotation_about("y", 300.0 * t)))


def field() -> Scene:
    """Nine tiles around the origin; the first one climbs."""
    tiles = [quad([x - 0.5, -1, z - 0.5], [1, 0, 0], [0, 1.5, 0]) for x in (-3, 0, 3) for z in (-3, 0, 3)]
    times, values = np.array([0.0, 1.0], np.float32), np.array([[0, 0, 0], [0, 1, 0]], np.float32)
    return make_scene(*tiles, channels=(Channel("node", 1, "translation", "LINEAR", times, values),))


@pytest.mark.parametrize("perspective", [True, False])
def test_no_sphere_that_reaches_into_the_picture_is_left_out(perspective: bool) -> None:
    """Points drawn at random within spheres: where the float64 projection sees one, the sphere must be kept."""
    random = np.random.default_rng(5)
    kept = 0
    for _ in range(40):
        turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
        lens = LENS if perspective else replace(LENS, kind="orthographic", ymag=2.0)
        view = FormulaCamera(lens, lambda t, r=turn: (np.zeros(3), r * np.linalg.det(r))).view_at(
            type("State", (), {"time": 0.0})
        )
        clip = view.clip_from_relative(*SIZE)
        centers = random.normal(size=(200, 3)) * 8.0
        radii = random.uniform(0.05, 3.0, size=200)
        seen = in_view(clip, centers, radii, np.zeros(200))
        way = random.normal(size=(200, 300, 3))
        way *= (random.uniform(0, 1, size=(200, 300, 1)) ** (1 / 3)) / np.linalg.norm(way, axis=-1, keepdims=True)
        points = np.concatenate([centers[:, None] + radii[:, None, None] * way, np.ones((200, 300, 1))], axis=-1)
        x, y, z, w = np.moveaxis(points @ clip.T, -1, 0)
        visible = ((abs(x) <= w) & (abs(y) <= w) & (z >= 0) & (z <= w)).any(axis=1)
        assert not (visible & ~seen).any()
        kept += seen.sum()
    assert kept < 0.8 * 40 * 200  # and most of what lies elsewhere is left out


def test_bounds_that_are_not_finite_are_kept() -> None:
    clip = FormulaCamera(LENS, lambda t: (np.zeros(3), np.eye(3))).view_at(type("S", (), {"time": 0.0}))
    centers = np.array([[np.nan, 0, 0], [0, 0, 50.0], [0, 0, 50.0]])
    assert in_view(clip.clip_from_relative(*SIZE), centers, np.array([1.0, np.inf, 1.0]), np.zeros(3)).tolist() == [
        True, True, False,
    ]  # fmt: skip


def two_renderers(gpu: Gpu, scene: Scene | Path) -> tuple[Renderer, Renderer]:
    """Of a scene, or of a file, with a camera that turns in its middle."""
    scene = load_scene(scene) if isinstance(scene, Path) else scene
    middle = np.concatenate([p.positions for m in scene.meshes for p in m.primitives]).mean(axis=0)
    one, other = (Renderer(GpuContext(gpu), scene, circling(middle, 0.1), SIZE, CHANNELS) for _ in range(2))
    return one, other


@pytest.mark.parametrize("name", ["field", *SCENES])
def test_what_the_camera_cannot_see_changes_no_pixel(gpu: Gpu, name: str, request) -> None:
    culled, whole = two_renderers(gpu, field() if name == "field" else request.getfixturevalue("data") / name)
    whole._seen = lambda view, placement: np.ones(len(whole.draws), dtype=bool)
    left_out = 0
    for frame in range(8):
        for renderer in (culled, whole):
            renderer.draw(frame / 8, (frame - 1) / 8)
        assert bits(culled) == bits(whole)
        left_out += int(whole.buffers.shown.sum() - culled.buffers.shown.sum())
    assert left_out > 0 or name not in ("field", "sponza/Sponza.gltf")
    for renderer in (culled, whole):
        renderer.release()


def walls() -> Scene:
    """Rows of walls one behind the other, twice in the same places."""
    rows = [quad([x - 1, -1, z], [1.9, 0, 0.1], [0, 2, 0]) for z in range(-1, -30, -2) for x in range(-9, 10, 2)]
    return make_scene(*rows, *rows)


@pytest.mark.parametrize("name", ["walls", *SCENES])
def test_what_is_hidden_changes_no_pixel(gpu: Gpu, name: str, request, monkeypatch) -> None:
    """All channels and the count of hidden backs are those of the whole scene; of equal surfaces the same one is
    seen.
    """
    monkeypatch.setattr(gbuffer, "PIXELS_PER_TRIANGLE", 1 << 40)  # no depth pre-pass
    part, whole = two_renderers(gpu, walls() if name == "walls" else request.getfixturevalue("data") / name)
    left_out = 0
    for frame in range(8):
        for renderer, least in ((part, 0), (whole, 1 << 40)):
            monkeypatch.setattr(occlusion, "LARGE", least)
            renderer.draw(frame / 8, (frame - 1) / 8)
        assert bits(part) == bits(whole)
        left_out += int(whole.buffers.shown.sum() - part.buffers.shown.sum())
        assert part.hidden_backs() == whole.hidden_backs()
    assert left_out > 0 or name != "walls"
    for renderer in (part, whole):
        renderer.release()


def test_frames_out_of_order_have_the_same_bits(gpu: Gpu, data: Path) -> None:
    """Poses are cached by their time: no result depends on earlier calls."""
    scene = load_scene(data / SCENES[0])
    camera = choose_camera(scene)

    def drawn(renderer: Renderer, frame: int) -> dict[str, bytes]:
        renderer.draw(frame / 24, (frame - 1) / 24)
        return bits(renderer)

    frames = list(range(7))
    renderer = Renderer(GpuContext(gpu), scene, camera, SIZE, CHANNELS)
    in_order = {frame: drawn(renderer, frame) for frame in frames}
    assert len({tuple(b.values()) for b in in_order.values()}) == len(frames)
    for frame in (3, 3, 1, 6, 2, 5, 4, 0, 1):
        assert drawn(renderer, frame) == in_order[frame]
    renderer.release()
    for frame in (4, 2):
        alone = Renderer(GpuContext(gpu), scene, camera, SIZE, CHANNELS)
        assert drawn(alone, frame) == in_order[frame]
        alone.release()


def test_kept_poses_cannot_be_changed_from_outside(gpu: Gpu) -> None:
    renderer = Renderer(GpuContext(gpu), field(), circling((0, 0, 0), 0.2), SIZE, CHANNELS)
    state, _ = renderer.view(0.5)
    with pytest.raises(ValueError, match="read-only"):
        state.world[0] = 0.0
    assert renderer.view(0.5)[0] is state
    renderer.release()


def test_equal_lists_of_triangles_are_stored_once_and_every_surface_is_drawn(gpu: Gpu) -> None:
    up = np.tile(np.float32([0, 0, 1]), (4, 1))
    tiles = [quad([x, -0.5, -4], [0.8, 0, 0], [0, 1, 0], normals=up) for x in (-2, -1, 0, 1)]
    shared = make_scene(*(replace(tile, triangles=tiles[0].triangles) for tile in tiles))
    geometry = build_geometry(shared)
    assert len(geometry.fixed.indices) == tiles[0].triangles.size
    assert len(build_geometry(make_scene(*tiles)).fixed.indices) == 4 * tiles[0].triangles.size
    assert len({d.base_vertex for d in geometry.draws}) == 4
    pictures = []
    for scene in (shared, make_scene(*tiles)):
        with Renderer(
            GpuContext(gpu), scene, FormulaCamera(LENS, lambda t: (np.zeros(3), np.eye(3))), SIZE, CHANNELS
        ) as r:
            r.draw(0.0, 0.0)
            pictures.append(bits(r))
            assert set(np.unique(r.read("ids"))) >= {1, 2, 3, 4}
    assert pictures[0] == pictures[1]


def test_rows_are_the_same_at_once_and_late_and_survive_an_interrupt(tmp_path: Path) -> None:
    settings = fixed_settings(width=64, height=36, frames=(0, 7), columns=("frustum", "position", "normal"))
    scene = load_scene(ASSETS / "demo.glb")
    late = evaluate_scene(scene, settings)
    at_once = evaluate_scene(scene, settings, Observers(on_pair=lambda pair: None))
    assert late.frames == at_once.frames and len(late.frames) == 6
    assert late.summary["discard"] == at_once.summary["discard"]

    def stop(progress) -> None:
        if progress.done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        evaluate_scene(scene, settings, Observers(progress=stop), out=tmp_path)
    rows = (tmp_path / "frames.csv").read_text().splitlines()[1:]
    assert [int(row.split(",")[0]) for row in rows] == [1, 2, 3, 4], "counts are read one pair late"


def test_a_long_run_times_a_sample_of_its_passes() -> None:
    class Waits:
        count = 0

        def finish(self) -> None:
            self.count += 1

    gpu = Waits()
    timer = PassTimer(gpu, first=16, every=16)
    for _ in range(100):
        with timer.measure("pass"):
            pass
    taken = 16 + len([call for call in range(16, 100) if call % 16 == 0])
    assert len(timer.samples_ms()["pass"]) == taken and gpu.count == 2 * taken
    assert timer.summary()["samples"] == {"pass": taken}
    assert timer.summary()["passes"]["pass"] >= 0.0


def test_frames_leave_nothing_behind(gpu: Gpu, data: Path) -> None:
    """Neither GL names nor Python memory grow with the number of frames."""
    scene = load_scene(data / SCENES[0])
    renderer = Renderer(GpuContext(gpu), scene, choose_camera(scene), SIZE, CHANNELS)
    context = GpuContext(gpu)
    masks = MaskPass(context, SIZE, MaskOptions("motion"))

    def walk(frames: range) -> None:
        for frame in frames:
            renderer.draw(frame / 24, (frame - 1) / 24)
            pair = reprojection(renderer.view(frame / 24)[1], renderer.view((frame - 1) / 24)[1], *SIZE)
            masks.run(pair, THRESHOLDS, renderer.history.current.textures, renderer.history.previous.textures)
            masks.read()

    def next_names() -> tuple[int, int]:
        """The names GL gives next: Mesa counts up, so any object made in between shows, kept or not."""
        buffer, texture = gpu.ctx.buffer(reserve=4), gpu.ctx.texture((1, 1), 1)
        names = buffer.glo, texture.glo
        for item in (buffer, texture):
            item.release()
        return names

    walk(range(1, 12))
    gc.collect()
    earlier, before = next_names(), next_names()
    tracemalloc.start()
    walk(range(12, 16))
    gc.collect()
    held = tracemalloc.get_traced_memory()[0]
    walk(range(16, 60))
    gc.collect()
    grown = tracemalloc.get_traced_memory()[0] - held
    tracemalloc.stop()
    assert next_names() == tuple(2 * b - a for a, b in zip(earlier, before, strict=True))
    assert grown < 20_000  # bytes, over 44 frames
    for part in (masks, context, renderer):
        part.release()
