"""Data of learning: files of the formats nss and noisebase against closed forms, and what ``inspect`` finds in them."""

from __future__ import annotations

import json
import shutil
import zipfile

import numpy as np
import pytest
from export_tools import DEMO
from learning_scenes import NEAR, STEPS, WALL, YFOV, moving, pose, previous_pixels, read_safetensors, settings

from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.export.run import export_scene
from taubench_gl.export.sequence_check import inspect_export
from taubench_gl.export.sequences import rgbe
from taubench_gl.option_groups import ExportOptions, TrainingOptions

LIGHT = {
    "nss": TrainingOptions(input="jittered+upscale@2", reference="max", reference_samples=4),
    "noisebase": TrainingOptions(input="path-traced@1", seeds=2, reference="path-traced@8"),
}
SIZES = {"nss": {"pan": (64, 36), "turn": (66, 38), "dolly": (64, 36)},
         "noisebase": {"pan": (48, 33), "turn": (45, 32), "dolly": (48, 32)}}  # fmt: skip
EXPOSURE = 0.5
TRACED = {"light": "auto", "indirect": "auto", "bounces": 2}


def export(out, format, scene, size, light=None, **more):
    more = {"exposure": EXPOSURE, **(TRACED if format == "noisebase" else {}), **more}
    return export_scene(scene, out, settings(size, **more), ExportOptions(format, training=light or LIGHT[format]))


@pytest.fixture(scope="module")
def exports(tmp_path_factory):
    """exports(format, kind) -> the folder of an export of five frames, made once."""
    made = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TAUBENCH_CACHE", str(tmp_path_factory.mktemp("cache")))

        def of(format, kind):
            if (format, kind) not in made:
                made[format, kind] = tmp_path_factory.mktemp("exports") / f"{format}-{kind}"
                export(made[format, kind], format, moving(kind), SIZES[format][kind])
            return made[format, kind]

        yield of


def tensors(folder):
    (path,) = folder.glob("*.safetensors")
    return read_safetensors(path)


def zipped(path):
    """Arrays and attributes of a file of Zarr v2, by its description: raw chunks, one per frame."""
    with zipfile.ZipFile(path) as file:
        assert json.loads(file.read(".zgroup")) == {"zarr_format": 2} and len(set(file.namelist())) == len(
            file.namelist()
        )
        out = {}
        for name in (n.removesuffix("/.zarray") for n in file.namelist() if n.endswith("/.zarray")):
            about = json.loads(file.read(f"{name}/.zarray"))
            rest = about["shape"][1:]
            chunks = [file.read(f"{name}/{n}{'.0' * len(rest)}") for n in range(about["shape"][0])]
            out[name] = np.stack([np.frombuffer(chunk, about["dtype"]).reshape(rest) for chunk in chunks])
        return out, json.loads(file.read(".zattrs"))


# ------------------------------------------------------------------------------------------------------ what is written
@pytest.mark.parametrize("kind", STEPS)
def test_nss_is_in_the_conventions_of_its_reader(exports, kind):
    found, text = tensors(exports("nss", kind))
    (width, height), count = SIZES["nss"][kind], 5
    small = (width // 2, height // 2)
    assert text["Length"] == "5" and "natural logarithm" in text["conventions"]
    shapes = {"colour_linear": (3, *small[::-1]), "ground_truth_linear": (3, height, width), "depth": (1, *small[::-1]),
              "motion": (2, height, width), "motion_lr": (2, *small[::-1]), "jitter": (2,), "exposure": (1,),
              "depth_params": (4,), "render_size": (2,), "camera_cut": (1,), "zNear": (1,)}  # fmt: skip
    assert {name: found[name].shape for name in shapes} == {name: (count, *shape) for name, shape in shapes.items()}
    assert found["camera_cut"][:, 0].tolist() == [True, False, False, False, False]
    assert found["exposure"].tolist() == [[0.0]] * 5 and found["render_size"][0].tolist() == list(small[::-1])
    params = found["depth_params"][0]
    np.testing.assert_allclose(params, [1.0, -0.1, np.tan(YFOV / 2) * width / height, np.tan(YFOV / 2)], rtol=1e-6)
    assert (np.abs(found["jitter"]) <= 0.5).all() and len(np.unique(found["jitter"], axis=0)) == 5
    for frame in range(1, 5):
        device = found["depth"][frame, 0].astype(np.float64)
        sky = device == 1.0
        planar = np.where(sky, 0.0, params[1] / np.where(sky, 1.0, device - params[0]))
        jitter = found["jitter"][frame][::-1]
        if kind != "turn":  # planes parallel to the image
            moved = -frame * STEPS[kind][2]
            near, far = (np.isclose(planar, d - moved, rtol=1e-4) for d in (NEAR, WALL))
            assert (near | far | sky).all() and near.any() and far.any()
        expected = previous_pixels(kind, frame, small, planar, jitter)
        np.testing.assert_allclose(-found["motion_lr"][frame][::-1], np.moveaxis(expected, -1, 0), atol=2e-3)
        # The wall alone, whose depth is known, at the target's pixel centers.
        motion = np.moveaxis(-found["motion"][frame][::-1], 0, -1)
        if kind != "turn":
            wall = previous_pixels(kind, frame, (width, height), np.full((height, width), WALL - moved))
            assert np.isclose(motion, wall, atol=2e-3).all(axis=-1).mean() > 0.3
        assert np.isfinite(motion).all()


@pytest.mark.parametrize("kind", STEPS)
def test_noisebase_is_in_the_conventions_of_its_reader(exports, kind):
    found, text = zipped(exports("noisebase", kind) / "scene0000.zip")
    width, height = SIZES["noisebase"][kind]
    assert "row vectors" in text["conventions"]
    image = (5, 3, height, width)
    shapes = {"color": (5, 4, *image[2:], 2), "reference": image, "exposure": (5, 2), "crop_offset": (5, 2)}
    shapes |= dict.fromkeys(("position", "motion", "normal", "diffuse"), (*image, 2))
    shapes |= dict.fromkeys(("camera_position", "camera_target", "camera_up"), (5, 3)) | {"proj_mat": (5, 4, 4)}
    assert {name: found[name].shape for name in shapes} == shapes
    types = {"color": "u1", "normal": "f2", "diffuse": "f2", "position": "f4", "motion": "f4", "crop_offset": "i4"}
    assert {name: found[name].dtype for name in types} == {name: np.dtype(kind) for name, kind in types.items()}
    y, x = np.mgrid[:height, :width]
    for frame in range(1, 5):
        place, rotation = pose(kind, frame)
        np.testing.assert_allclose(found["camera_position"][frame], place, atol=1e-6)
        forward = found["camera_target"][frame] - found["camera_position"][frame]
        np.testing.assert_allclose(forward / np.linalg.norm(forward), -rotation[:, 2], atol=1e-6)
        position = np.moveaxis(found["position"][frame, ..., 0], 0, -1).astype(np.float64)
        view = (position - place) @ rotation * [1, 1, -1]
        clip = np.concatenate([view, np.ones_like(view[..., :1])], -1) @ found["proj_mat"][frame].T.astype(np.float64)
        pixel = (clip[..., :2] / clip[..., 3:] * [0.5, -0.5] + 0.5) * [width, height] - 0.5
        np.testing.assert_allclose(pixel, np.stack([x, y], -1), atol=2e-3)
        again = np.concatenate([position, np.ones_like(view[..., :1])], -1) @ found["view_proj_mat"][frame]
        np.testing.assert_allclose(again / again[..., 3:], clip / clip[..., 3:], atol=1e-4)
        sky = np.linalg.norm(position, axis=-1) > 1e4
        before = pose(kind, frame - 1)[0]
        np.testing.assert_allclose(
            np.moveaxis(found["motion"][frame, ..., 0], 0, -1), np.where(sky[..., None], before - place, 0.0), atol=1e-2
        )
        still = found["motion"][frame, ..., 0][:, ~sky]
        assert np.abs(still).max() < 1e-5 and sky.any()
        assert np.isclose(position[~sky][:, 2:], [[-NEAR, -WALL]], atol=1e-4).any(axis=-1).all()
    np.testing.assert_array_equal(found["position"][..., 0], found["position"][..., 1])
    assert not np.array_equal(found["color"][..., 0], found["color"][..., 1])


def test_light_is_exposed_and_colors_are_within_a_step_of_the_reference(exports):
    found, _ = zipped(exports("noisebase", "pan") / "scene0000.zip")
    low, high = (found["exposure"][:, k, None, None, None, None] for k in (0, 1))
    light = found["color"][:, :3] / 255 * np.exp((found["color"][:, 3:] + 1.0) / 256 * (high - low) + low)
    assert light.mean() == pytest.approx(found["reference"].mean(), rel=0.05)
    nss, _ = tensors(exports("nss", "pan"))
    assert nss["colour_linear"].mean() == pytest.approx(nss["ground_truth_linear"].mean(), rel=0.05)


def test_rgbe_is_within_its_steps():
    rng = np.random.default_rng(0)
    light = np.exp(rng.uniform(-8, 4, (3, 6, 7, 2))).astype(np.float32)
    light[:, 0, 0] = 0.0
    stored, (low, high) = rgbe(light)
    scale = np.exp((stored[3] + 1.0) / 256 * (high - low) + low)
    assert (np.abs(stored[:3] / 255 * scale - light) <= 0.51 / 255 * scale + 1e-12).all()
    assert rgbe(np.zeros((3, 2, 2, 1), np.float32))[0][:3].max() == 0


# ---------------------------------------------------------------------------------------------------------------- cuts
def test_cuts_flag_frames_and_part_files(tmp_path, monkeypatch):
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))
    scene = moving("pan", cut_at=5)
    light = TrainingOptions(input="jittered", reference="max", reference_samples=1)
    export(tmp_path / "nss", "nss", scene, (32, 18), light, frames=(0, 9))
    found, _ = tensors(tmp_path / "nss")
    assert np.flatnonzero(found["camera_cut"]).tolist() == [0, 5]
    light = TrainingOptions(input="path-traced@1", reference="path-traced@1")
    export(tmp_path / "noisebase", "noisebase", scene, (16, 16), light, frames=(0, 9))
    files = sorted((tmp_path / "noisebase").glob("*.zip"))
    assert [len(zipped(path)[0]["position"]) for path in files] == [5, 4]
    np.testing.assert_allclose(zipped(files[1])[0]["camera_position"][0], pose("pan", 5)[0] + [9, 0, 0], atol=1e-5)
    for folder in ("nss", "noisebase"):
        checks = inspect_export(tmp_path / folder)["checks"]
        assert not any(text.startswith("wrong") for text in checks.values()), checks


# ------------------------------------------------------------------------------------------------------ resume, errors
def test_a_killed_export_continues(tmp_path):
    scene, light = moving("pan"), TrainingOptions(input="jittered+upscale@2", reference="max", reference_samples=1)

    class Killed(Exception):
        pass

    def kill(progress):
        if progress.done == 1:
            raise Killed

    options = ExportOptions("nss", training=light)
    chosen = settings((32, 18), exposure=1.0, frames=(0, 3))
    with pytest.raises(Killed):
        export_scene(scene, tmp_path / "a", chosen, options, progress=kill)
    assert len(list((tmp_path / "a").glob("frame_*.npz"))) == 1 and not list((tmp_path / "a").glob("*.safetensors"))
    with pytest.raises(OutputError):
        export_scene(scene, tmp_path / "a", chosen.replace(exposure=2.0), options)
    with pytest.raises(OutputError):
        inspect_export(tmp_path / "a")
    done = export_scene(scene, tmp_path / "a", chosen, options)
    assert (done.written, done.kept) == (2, 1)
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == [
        "camera.json",
        "export.json",
        f"{scene.name}.safetensors",
    ]
    assert export_scene(scene, tmp_path / "a", chosen, options).written == 0
    export_scene(scene, tmp_path / "b", chosen, options)
    (one,), (other,) = ((tmp_path / name).glob("*.safetensors") for name in "ab")
    assert one.read_bytes() == other.read_bytes()
    again = export_scene(scene, tmp_path / "a", chosen.replace(exposure=2.0), options, overwrite=True)
    assert again.written == 3 and one.read_bytes() != other.read_bytes()


@pytest.mark.parametrize(
    ("format", "light", "more"),
    [
        ("nss", TrainingOptions(), {}),
        ("nss", TrainingOptions(input="jittered+upscale@2"), {}),
        ("noisebase", TrainingOptions(reference="max"), {}),
        ("noisebase", LIGHT["nss"], {}),  # two sizes
        ("nss", LIGHT["nss"], {"width": 33}),  # no whole number
        ("nss", LIGHT["nss"], {"history": "eye"}),
    ],
)
def test_what_these_formats_do_not_have(tmp_path, format, light, more):
    with pytest.raises(SettingsError):
        export_scene(moving("pan"), tmp_path, settings((32, 18)).replace(**more), ExportOptions(format, training=light))
    assert not list(tmp_path.glob("*.safetensors")) and not list(tmp_path.glob("*.zip"))


def test_the_command_writes_them(taubench, tmp_path, fixed_light):
    common = ("--size", "32x18", "--frames", "0:3", "--indirect", "none")
    light = ("--input", "jittered+upscale@2", "--reference", "max", "--reference-samples", "1")
    code, _, err = taubench("export", DEMO, "--out", tmp_path / "nss", "--format", "nss", *light, *common)
    assert code == 0, err
    found, text = tensors(tmp_path / "nss")
    assert found["colour_linear"].shape == (3, 3, 9, 16) and text["Length"] == "3"
    assert taubench("inspect", tmp_path / "nss")[0] == 0
    code, _, err = taubench(
        "export", DEMO, "--out", tmp_path / "npz", "--format", "npz", "--channels", "depth", *common
    )
    assert code == 0, err
    code, _, err = taubench("inspect", tmp_path / "npz")
    assert code == 2 and "npz" in err
    code, _, err = taubench("export", DEMO, "--out", tmp_path / "no", "--format", "noisebase", *common)
    assert code == 2 and "--reference" in err and not (tmp_path / "no").exists()


# ------------------------------------------------------------------------------------------------------------- inspect
@pytest.mark.parametrize("format", SIZES)
@pytest.mark.parametrize("kind", STEPS)
def test_inspect_finds_nothing_wrong(exports, taubench, format, kind):
    code, out, _ = taubench("inspect", exports(format, kind))
    assert code == 0 and format in out
    found = json.loads(taubench("inspect", exports(format, kind), "--json")[1])
    moved, before = found["psnr_db"]["frame_before_moved"], found["psnr_db"]["frame_before"]
    assert moved > before + 3.0
    right = {check for check, text in found["checks"].items() if text.startswith("right")}
    expected = {"motion", "motion_lr", "jitter", "exposure"} if format == "nss" else {"position", "exposure"}
    assert expected <= right and ("depth" in right) == (format == "nss" and kind != "turn")


def planted(folder, out, changes):
    """A copy of an export of format nss with changed tensors."""
    shutil.copytree(folder, out)
    (path,) = out.glob("*.safetensors")
    data = bytearray(path.read_bytes())
    size = 8 + int.from_bytes(data[:8], "little")
    header, (found, _) = json.loads(data[8:size]), read_safetensors(path)
    for name, change in changes.items():
        first, last = (size + n for n in header[name]["data_offsets"])
        data[first:last] = np.ascontiguousarray(change(found[name]), dtype=found[name].dtype).tobytes()
    path.write_bytes(data)
    return out


FAULTS = {
    "sign": ("motion", {"motion": lambda v: -v}),
    "order": ("motion", {"motion": lambda v: v[:, ::-1]}),
    "sign of the input": ("motion_lr", {"motion_lr": lambda v: -v}),
    "order of the input": ("motion_lr", {"motion_lr": lambda v: v[:, ::-1]}),
    "jitter sign": ("jitter", {"jitter": lambda v: -v}),
    "jitter order": ("jitter", {"jitter": lambda v: v[:, ::-1]}),
    "exposure of one image": ("exposure", {"colour_linear": lambda v: v / EXPOSURE}),
    "exposure twice": ("exposure", {"exposure": lambda v: v + np.log(EXPOSURE)}),
    "depth": ("depth", {"depth": lambda v: 1 - v}),
    "not finite": ("depth", {"depth": lambda v: np.where(v == 1, np.inf, v)}),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("kind", STEPS)
def test_inspect_finds_planted_faults(exports, taubench, tmp_path, kind, fault):
    check, changes = FAULTS[fault]
    found = planted(exports("nss", kind), tmp_path / "out", changes)
    code, out, _ = taubench("inspect", found, "--json")
    checks = json.loads(out)["checks"]
    if fault == "depth" and kind == "turn":  # depth has no effect on the motion of a camera that turns
        assert code == 0 and checks["depth"].startswith("not clear")
    else:
        assert code == 1 and checks[check].startswith("wrong"), checks
        assert [name for name, text in checks.items() if text.startswith("wrong")] == [check]


ZIP_FAULTS = {
    "relative positions": ("position", "position", lambda v, all: v - all["camera_position"][:, :, None, None, None]),
    "rows": ("position", "position", lambda v, all: v[:, :, ::-1]),
    "order": ("position", "position", lambda v, all: v[:, [0, 2, 1]]),
    "exposure": ("exposure", "exposure", lambda v, all: v / np.log(2)),
    "color": ("exposure", "reference", lambda v, all: v / EXPOSURE),
}


@pytest.mark.parametrize("fault", ZIP_FAULTS)
def test_inspect_finds_planted_faults_of_noisebase(exports, tmp_path, fault):
    check, name, change = ZIP_FAULTS[fault]
    shutil.copytree(exports("noisebase", "pan"), tmp_path / "out")
    path = tmp_path / "out" / "scene0000.zip"
    arrays, _ = zipped(path)
    wrong = change(arrays[name], arrays).astype(arrays[name].dtype)
    with zipfile.ZipFile(path) as file:
        entries = {entry: file.read(entry) for entry in file.namelist()}
    with zipfile.ZipFile(path, "w") as file:
        for entry, data in entries.items():
            number = entry.removeprefix(f"{name}/").partition(".")[0]
            file.writestr(entry, wrong[int(number)].tobytes() if entry.startswith(f"{name}/") and number else data)
    assert inspect_export(tmp_path / "out")["checks"][check].startswith("wrong")


def test_damaged_files_are_one_line(exports, taubench, tmp_path):
    for format, name in (("nss", "*.safetensors"), ("noisebase", "*.zip")):
        for cut in (4, 300, -200):
            out = shutil.copytree(exports(format, "pan"), tmp_path / f"{format}{cut}")
            (path,) = out.glob(name)
            path.write_bytes(path.read_bytes()[:cut])
            code, _, err = taubench("inspect", out)
            assert code == 2 and "damaged" in err and len(err.strip().splitlines()) == 1
