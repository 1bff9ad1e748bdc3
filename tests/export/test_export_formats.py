"""Exported files, read by independent readers, equal the rendered arrays bit for bit."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import OpenEXR
import pytest
from export_tools import DEMO, HEIGHT, RASTERIZED, WIDTH, export, same, settings, spoiled
from PIL import Image

from taubench_gl.conventions import Reason
from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.export.channels import EXPORTS, stored_as
from taubench_gl.export.formats import ExportSpec, ExrWriter, NpzWriter, ZarrWriter
from taubench_gl.export.sintel import SintelWriter, flo_bytes, masks_of
from taubench_gl.pathtraced.cameras import SceneCamera, SidecarCamera
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced, plan_sequence
from taubench_gl.pathtraced.exr import write_exr
from taubench_gl.pathtraced.passes import load_mapping
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.run_schema import COUNT_COLUMNS
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

NAMES = tuple(RASTERIZED)


def spec(frames, names=NAMES, precision="native") -> ExportSpec:
    return ExportSpec("demo", (WIDTH, HEIGHT), 24.0, range(min(frames), max(frames) + 1), names, precision)


def read_exr(path) -> tuple[dict[str, np.ndarray], dict]:
    file = OpenEXR.File(str(path), separate_channels=True)
    return {name: channel.pixels for name, channel in file.channels().items()}, file.header()


@pytest.mark.parametrize("precision", ["native", "float", "half"])
def test_exr(frames, tmp_path, precision):
    writer = ExrWriter(tmp_path, spec(frames, precision=precision))
    frame = spoiled(frames[9])
    writer.write(frame)
    assert writer.done(9) and not writer.done(8)
    planes, header = read_exr(writer.path(9))
    assert set(planes) == {exr for info in RASTERIZED.values() for exr in info.exr}
    for name, info in RASTERIZED.items():
        with np.errstate(over="ignore"):
            expected = frame.channels[name].astype(stored_as(info, precision))
        for i, exr in enumerate(info.exr):
            same(planes[exr], expected[..., i])
    if precision != "half":  # lossless: channels with 16 bits in the file have 16 bits on the GPU
        for name, info in RASTERIZED.items():
            back = np.stack([planes[exr] for exr in info.exr], axis=-1).astype(frame.channels[name].dtype)
            assert np.array_equal(back, frame.channels[name], equal_nan=frame.channels[name].dtype.kind == "f")
    for key, name in (("worldFromView", "world_from_view"), ("clipFromView", "clip_from_view"),
                      ("intrinsics", "intrinsics"), ("jitterPx", "jitter_px")):  # fmt: skip
        same(np.asarray(header[f"taubench.{key}"]), frame.camera[name])
    # The attribute of OpenEXR acts on row vectors: world points -> camera space.
    point = np.append(frame.view.position - 2 * frame.view.world_from_view[:, 2], 1.0)
    np.testing.assert_allclose(point @ header["worldToCamera"], [0, 0, -2, 1], atol=1e-5)


def test_npz(frames, tmp_path):
    writer = NpzWriter(tmp_path, spec(frames))
    frame = spoiled(frames[9])
    writer.write(frame)
    with np.load(writer.path(9)) as file:
        for name in NAMES:
            same(file[name], frame.channels[name])
        for name, values in frame.camera.items():
            same(file[name], values)
        assert file["frame"] == 9 and file["time_s"] == 9 / 24


def test_zarr(frames, tmp_path):
    zarr = pytest.importorskip("zarr")
    writer = ZarrWriter(tmp_path, spec(frames))
    writer.prepare()
    frame = spoiled(frames[9])
    writer.write(frame)
    writer.prepare()  # as in a resumed export: existing files stay
    assert [writer.done(n) for n in (8, 9, 10)] == [False, True, False]
    group = zarr.open_group(tmp_path / "frames.zarr", mode="r")
    assert group.metadata.zarr_format == 3
    for name in NAMES:
        same(group[name][1], frame.channels[name])
        assert group[name].chunks == (1, HEIGHT, WIDTH, EXPORTS[name].components)
        if group[name].dtype.kind == "f":
            assert np.isnan(group[name][0]).all()  # not written
    for name, values in frame.camera.items():
        same(group[name][1], values)
    assert group["written"][:].tolist() == [False, True, False] and group["frame"][:].tolist() == [8, 9, 10]
    cut = next(p for p in (tmp_path / "frames.zarr" / "written").rglob("*") if p.is_file() and p.name != "zarr.json")
    cut.write_bytes(b"")
    assert not writer.done(9)


# ----------------------------------------------------- readers of the Sintel formats, written from their description
def read_flo(data: bytes) -> np.ndarray:
    """Baker et al., IJCV 2011: 4 bytes "PIEH", int32 width, int32 height, then u, v of row 0, left to right."""
    assert data[:4] == b"PIEH"
    width, height = np.frombuffer(data, "<i4", 2, 4)
    values = np.frombuffer(data, "<f4", -1, 12)
    assert values.size == 2 * width * height
    return values.reshape(height, width, 2)


def read_dpt(data: bytes) -> np.ndarray:
    assert np.frombuffer(data, "<f4", 1)[0] == np.float32(202021.25)
    width, height = np.frombuffer(data, "<i4", 2, 4)
    return np.frombuffer(data, "<f4", width * height, 8 + 4).reshape(height, width)


def read_cam(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    assert data[:4] == b"PIEH" and len(data) == 4 + 8 * (9 + 12)
    return np.frombuffer(data, "<f8", 9, 4).reshape(3, 3), np.frombuffer(data, "<f8", 12, 4 + 72).reshape(3, 4)


def test_published_flow_file_is_read_and_written_unchanged(data):
    published = (data / "flow" / "sintel_0001.flo").read_bytes()
    flow = read_flo(published)
    assert flow.shape == (436, 1024, 2) and np.isfinite(flow).all()
    assert flo_bytes(flow) == published


def test_sintel(frames, tmp_path):
    names = ("depth", "motion_forward", "mask_forward", "color")
    writer = SintelWriter(tmp_path, spec(frames, names))
    writer.prepare()
    partly = frames[8].channels["motion_forward"].copy()
    partly[3, 5] = [np.nan, 1.0]
    frames = frames | {8: replace(frames[8], channels=frames[8].channels | {"motion_forward": partly})}
    for frame in frames.values():
        writer.write(frame)
    assert all(writer.done(n) for n in frames)
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "camdata_left", "clean", "depth", "flow", "invalid", "occlusions"
    ]  # fmt: skip
    # Two flows between three frames.
    assert sorted(p.name for p in (tmp_path / "flow" / "demo").iterdir()) == ["frame_0009.flo", "frame_0010.flo"]
    frame = frames[8]

    def read(kind: str, suffix: str) -> bytes:
        return (tmp_path / kind / "demo" / f"frame_0009{suffix}").read_bytes()

    flow, motion = read_flo(read("flow", ".flo")), frame.channels["motion_forward"]
    finite = np.isfinite(motion).all(axis=-1)
    same(flow[finite], motion[finite])
    assert (np.abs(flow[~finite]) > 1e9).all()
    depth, ours = read_dpt(read("depth", ".dpt")), frame.channels["depth"][..., 0]
    same(depth[ours > 0], ours[ours > 0])
    assert (depth[ours == 0] == 1e10).all()
    clean = np.asarray(Image.open(tmp_path / "clean" / "demo" / "frame_0009.png"))
    assert clean.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(clean / 255 - np.clip(frame.channels["color"], 0, 1)).max() <= 0.5 / 255 + 1e-6


def test_sintel_cameras_and_flow_agree(frames, tmp_path):
    """Depth and two cameras determine the flow of static surfaces: x' = M' N' X, from the files alone."""
    writer = SintelWriter(tmp_path, spec(frames, ("depth", "motion_forward", "mask_forward")))
    for frame in frames.values():
        writer.write(frame)
    (m, n), (m2, n2) = (
        read_cam((tmp_path / "camdata_left" / "demo" / f"frame_{i:04d}.cam").read_bytes()) for i in (9, 10)
    )
    depth = read_dpt((tmp_path / "depth" / "demo" / "frame_0009.dpt").read_bytes())
    flow = read_flo((tmp_path / "flow" / "demo" / "frame_0009.flo").read_bytes())
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(m).T
    world = (rays * depth[..., None] - n[:, 3]) @ n[:, :3]
    there = (world @ n2[:, :3].T + n2[:, 3]) @ m2.T
    expected = there[..., :2] / there[..., 2:] - np.stack([x, y], axis=-1)
    error = np.abs(flow - expected).max(axis=-1)
    assert np.median(error) < 1e-3 and (error < 0.01).mean() > 0.5  # the rest are moving objects


def test_occlusions_and_invalid(frames, tmp_path):
    """Occluded points lie behind the surface that the next frame shows; invalid points lie outside the next frame."""
    for number in (8, 9):
        frame, after = frames[number], frames[number + 1]
        hidden, invalid = masks_of(frame.channels["mask_forward"][..., 0])
        assert not (hidden & invalid).any() and hidden.any() and invalid.any()
        y, x = np.mgrid[:HEIGHT, :WIDTH]
        at = np.stack([x, y], axis=-1) + frame.channels["motion_forward"]
        inside = ((at > -0.01) & (at < [WIDTH - 0.99, HEIGHT - 0.99])).all(axis=-1)
        assert np.array_equal(inside, ~invalid)
        to = np.rint(np.clip(at[hidden], 0, [WIDTH - 1, HEIGHT - 1])).astype(int)
        shown = np.linalg.norm(after.channels["position"][to[:, 1], to[:, 0]], axis=-1)
        own = np.linalg.norm(frame.channels["position"][hidden], axis=-1)
        shown, own = (np.where(d > 0, d, np.inf) for d in (shown, own))  # sky
        assert np.mean(shown < own + 0.1) > 0.9
    words = np.array([0, Reason.DISOCCLUDED, Reason.OUTSIDE, Reason.OUTSIDE | Reason.DISOCCLUDED, Reason.FIRST])
    assert [m.tolist() for m in masks_of(words)] == [[False, True, False, False, False], [False] * 2 + [True] * 3]


@pytest.mark.parametrize(("mode", "named"), [("camera", True), ("motion", False)])
def test_evaluate_reads_an_export_back(tmp_path, mode, named):
    """``evaluate exr:DIR`` gives the counts of ``evaluate SCENE``: every pixel of every pair, radiance included.

    ``named``: mapping and camera are given; else they are those of the export.
    """
    names = ("gbuffer", "radiance", "prev_position")
    export(tmp_path, "exr", channels=names, frames=(7, 11))
    own = settings(frames=(None, None), reprojection=mode)
    given = {"camera_file": tmp_path / "camera.json", "mapping": "taubench"} if named else {}
    back = evaluate_path_traced(f"exr:{tmp_path}", own, PathTracedOptions(**given))
    once = evaluate_scene(DEMO, settings(frames=(7, 11), reprojection=mode))
    for ours, theirs in zip(back.frames, once.frames, strict=True):
        assert {k: ours[k] for k in COUNT_COLUMNS} == {k: theirs[k] for k in COUNT_COLUMNS}
        assert ours["translation_m"] == pytest.approx(theirs["translation_m"], rel=1e-12)
    # Histograms of distances too: the channels are lossless.
    assert back.summary["curves"] == json.loads(json.dumps(once.summary["curves"]))


def test_mapping_and_camera_of_an_export_are_its_own_unless_others_are_given(tmp_path):
    export(tmp_path, "exr", channels=("gbuffer",), frames=(7, 9), fps=12.0)
    spec, mapping_file = f"exr:{tmp_path}", tmp_path / "own.toml"
    mapping_file.write_text('up = "y"\npositions = "relative"\n[passes]\nposition = "Position"\n')
    found = plan_sequence(spec, Settings(), PathTracedOptions())
    assert found.sequence.mapping == load_mapping("taubench") and found.settings.sequence.fps == 12.0
    assert isinstance(found.camera, SidecarCamera) and list(found.camera.file.views) == [7, 8]
    assert PathTracedSequence.open(spec, mapping="blender").mapping == load_mapping("blender")
    assert set(PathTracedSequence.open(spec, mapping=mapping_file).mapping.passes) == {"position"}
    scene = plan_sequence(spec, Settings(), PathTracedOptions(scene_file=DEMO))
    assert isinstance(scene.camera, SceneCamera)
    (tmp_path / "camera.json").unlink()
    with pytest.raises(PathTracedError) as error:
        evaluate_path_traced(spec)
    assert "--camera-file" in error.value.hint
    # Files of another program beside them make a frame that is no export.
    for path in sorted(tmp_path.glob("frame_*.exr")):
        write_exr(
            path.with_name(path.name.replace("frame", "beauty")), {"A.Combined.R": np.zeros((36, 64), np.float32)}
        )
    assert PathTracedSequence.open(spec).mapping == load_mapping(None)
