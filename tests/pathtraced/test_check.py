"""Wrong conventions made from our own export, alone and in pairs: each is named, or those that are equivalent to it."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import pytest
from fixed import fixed_settings
from pathtraced.faults import INJECTED, JITTER, MISTAKES, Corrupted, horizontal
from repeated import few

from taubench_gl.animation import choose_camera
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.cameras import FittedCamera, SceneCamera, SidecarCamera
from taubench_gl.pathtraced.check import SAME, check_sequence
from taubench_gl.pathtraced.check_vectors import CLASSES
from taubench_gl.pathtraced.evaluation import plan_sequence
from taubench_gl.pathtraced.exr import read_exr, write_exr
from taubench_gl.pathtraced.passes import PRESETS
from taubench_gl.pathtraced.readings import GEOMETRY, MOTION
from taubench_gl.pathtraced.scene_truth import render_truth
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene import load_scene

SIZE = np.array([96, 54])
FIRST, LAST = 40, 45


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Six frames of the demo: motion, positions relative to the camera, planar depth, and the camera."""
    out = tmp_path_factory.mktemp("frames")
    settings = fixed_settings(width=int(SIZE[0]), height=int(SIZE[1]), frames=(FIRST, LAST + 1), light="raster")
    export_scene(ASSETS / "demo.glb", out, settings, ExportOptions("exr", ("gbuffer", "prev_position", "flow")))
    opened = plan_sequence(f"exr:{out}", fixed_settings(), PathTracedOptions())
    frames = {n: opened.sequence.read(n) for n in opened.sequence.frames}
    return opened.sequence, frames, json.loads((out / "camera.json").read_text())


def matrices_of(camera):
    """Frame -> world_from_view (4, 4) of a camera file."""
    return {int(n): np.array(entry["world_from_view"]) for n, entry in camera["frames"].items()}


@pytest.fixture(scope="module")
def given(exported):
    """The camera of the export, as its file says."""
    return SidecarCamera(exported[0].path / "camera.json")


def scene_camera():
    """The camera of the scene, and the settings of its frames."""
    settings, scene = fixed_settings(width=int(SIZE[0]), height=int(SIZE[1])), load_scene(ASSETS / "demo.glb")
    track = choose_camera(scene, settings.sequence.camera, tuple(SIZE))
    return SceneCamera(scene, track, settings.sequence.fps), settings


def checked(exported, tmp_path, *names, keep=None, pairs=1, first=41, drop=()):
    """The check of the export with mistakes; ``keep``: the files that are left."""
    sequence, frames, camera = exported
    matrices = matrices_of(camera)
    yfov = camera["frames"]["40"]["yfov"]
    for name in sorted(names, key=list(MISTAKES).index):
        if name == "fov":
            yfov = horizontal(yfov, SIZE)
        else:
            frames, matrices = MISTAKES[name][0](frames, matrices, sequence.mapping)
    frames = {n: replace(f, **dict.fromkeys(drop)) for n, f in frames.items() if keep is None or n in keep}
    lens = {"kind": "perspective", "yfov": yfov, "znear": 0.1, "zfar": 100.0}
    entries = {str(n): lens | {"world_from_view": m.tolist()} for n, m in matrices.items()}
    file = tmp_path / "camera.json"
    file.write_text(json.dumps({"schema": camera["schema"], "frames": entries}))
    return check_sequence(Corrupted(sequence, frames), SidecarCamera(file), [n for n in frames if n >= first], pairs)


def wrong(check):
    return {v.convention: v.value for v in check.wrong}


def test_the_export_is_as_its_mapping_says(exported, tmp_path):
    check = checked(exported, tmp_path, pairs=4)
    assert not check.wrong and not check.reading.values and check.basis == "previous positions"
    for name in (*GEOMETRY, *MOTION, "camera", "centers", "normals", "jitter", "cuts"):
        assert check[name].status == "ok", check[name]
    assert all(pair.as_read == pair.explained > 0.99 and pair.expected_px > 0.5 for pair in check.pairs)
    assert check.answer == "right" and [c.name for c in check.classes] == ["still surfaces", "moving surfaces", "sky"]


PAIRS = (
    ("sign", "uv"), ("y up", "clip space"), ("exchanged", "half"), ("jitter", "sign"), ("rows", "y up"), ("z", "sign"),
    ("y-left", "double"), ("centimeters", "sign"), ("world", "uv"), ("columns", "y up"), ("inverse", "files backwards"),
    ("OpenCV", "exchanged"), ("fov", "rows"), ("camera ahead", "x"), ("files backwards", "clip space"),
    ("camera backwards", "z-left"), ("distance", "columns"), ("reversed z", "all backwards"), ("view", "z"),
    ("depth unit", "from 0.5"),
)  # fmt: skip


@pytest.mark.parametrize("names", [*((name,) for name in MISTAKES), *PAIRS], ids=" and ".join)
def test_mistakes_are_named(exported, tmp_path, names):
    check = checked(exported, tmp_path, *names)
    assert wrong(check) == {key: value for name in names for key, value in MISTAKES[name][1].items()}
    for verdict in [v for v in check.wrong if v.convention != "normals"]:
        assert verdict.explained > 0.8
        assert len(names) == 2 or (verdict.explained - verdict.as_read > SAME and not verdict.equivalent)


def test_equivalent_mistakes_are_named_together(exported, tmp_path):
    """In view space the camera of the file does not place the points: motion alone shows its number, hardly."""
    check = checked(exported, tmp_path, "view", "files backwards")
    order = check["order"]
    assert order.status == "wrong" and check["positions"].value == "view"
    assert order.value == "files backwards" or any("files are numbered backwards" in text for text in order.equivalent)


def test_what_one_camera_position_cannot_show_is_not_checked(exported, tmp_path):
    """Positions relative to the camera have no unit without motion, and a matrix shows no translation."""
    check = checked(exported, tmp_path, keep=(41,), drop=("motion", "prev_position"))
    assert not check.wrong and not check.pairs
    assert check["meters"].status == check["matrix"].status == "not checked"
    assert len(check["meters"].equivalent) == 8 and check["up"].status == check["lens"].status == "ok"


def test_depth_replaces_positions(exported, tmp_path):
    drop = ("position", "prev_position")
    assert not checked(exported, tmp_path, drop=drop).wrong
    check = checked(exported, tmp_path, "distance", "sign", drop=drop)
    assert wrong(check) == {"depth": "distance", "direction": "current-previous"}


def test_jitter_left_in_the_motion_is_measured(exported, tmp_path):
    check = checked(exported, tmp_path, "jitter", "sign", pairs=2)
    for pair in check.pairs:
        expected = np.subtract(*(JITTER[n % len(JITTER)] for n in (pair.frame - 1, pair.frame)))
        np.testing.assert_allclose(pair.jitter_px, expected, atol=0.02)


def test_a_cut_is_named_with_its_frame(exported, tmp_path):
    """Frames 42 and 43 are left out: motion into 44 is that of 43."""
    sequence, frames, camera = exported
    numbers = {40: 40, 41: 41, 42: 44, 43: 45}
    entries = {str(n): camera["frames"][str(at)] for n, at in numbers.items()}
    short = sequence, {n: frames[at] for n, at in numbers.items()}, camera | {"frames": entries}
    check = checked(short, tmp_path, pairs=4, first=40, drop=("prev_position",))
    assert wrong(check) == {"cuts": "42"}
    assert [pair.explained > 0.5 for pair in check.pairs] == [True, False, True]


def test_motion_of_the_sky(exported, tmp_path):
    """Zero or NaN: the sky has no vectors, which is not wrong; other vectors are."""
    sequence, frames, camera = exported
    for value, answer in ((0, "absent"), (np.nan, "absent"), (9, "wrong")):
        given = {n: replace(f, motion=np.where(f.sky[..., None], value, f.motion)) for n, f in frames.items()}
        check = checked((sequence, given, camera), tmp_path)
        assert check.of("sky").answer == answer and not check.wrong
        assert check.answer == ("wrong" if value == 9 else "right")


def test_positions_of_other_pixel_centers(exported, tmp_path):
    sequence, frames, camera = exported
    moved = {}
    for n, f in frames.items():  # planar depth, half a pixel to the right
        per_pixel = 2 * np.tan(camera["frames"]["40"]["yfov"] / 2) / SIZE[1]
        right = np.array(camera["frames"][str(n)]["world_from_view"])[:3, 0]
        moved[n] = replace(f, position=(f.position + 0.5 * per_pixel * f.depth[..., None] * right).astype(np.float32))
    verdict = checked((sequence, moved, camera), tmp_path, drop=("prev_position",))["centers"]
    assert verdict.status == "wrong"
    np.testing.assert_allclose([float(v) for v in verdict.value.split(",")], [0.5, 0], atol=0.01)


def test_an_unrelated_camera_is_wrong(exported, tmp_path):
    sequence, frames, camera = exported
    turn = np.array([[0, 0.6, 0.8], [1, 0, 0], [0, 0.8, -0.6]])
    entries = {n: e | {"world_from_view": np.block([[turn, np.ones((3, 1))], [0, 0, 0, 1]]).tolist()}
               for n, e in camera["frames"].items()}  # fmt: skip
    check = checked((sequence, frames, camera | {"frames": entries}), tmp_path)
    assert wrong(check) == {"camera": ""} and check["direction"].status == "not checked"


# Faults of the vectors


FOUND = {  # fault -> what names it: faults of a class, or conventions with their values
    "object motion missing": {"still"}, "halved": {"half"}, "zero": {"zero"}, "random": {"random"},
    "one frame late": {"late", "ahead"}, "previous frame's camera": {"camera late", "ahead"}, "constant": {"constant"},
    "object motion halved": {"half"},
}  # fmt: skip


TRUTHS = ("previous positions", "scene", "positions", "depth")


@pytest.mark.parametrize(
    ("fault", "truth"), few([(f, TRUTHS[(i + k) % 4]) for k in range(4) for i, f in enumerate(INJECTED)], len(INJECTED))
)
def test_faults_of_vectors_are_named_or_not_judged(exported, given, rendered, fault, truth):
    """Where the motion of every surface is known each fault is named; positions show the camera's motion only."""
    sequence, frames, _ = exported
    frames = INJECTED[fault](frames, given.file.views)
    if truth != "previous positions":
        lost = ("prev_position",) if truth != "depth" else ("prev_position", "position")
        frames = {n: replace(f, **dict.fromkeys(lost)) for n, f in frames.items()}
    of_scene = (lambda numbers: {n: rendered[n] for n in numbers}) if truth == "scene" else None
    check = check_sequence(Corrupted(sequence, frames), given, range(FIRST, LAST + 1), 5, of_scene)
    named = {v.fault for v in check.classes if v.fault} | {v.value for v in check.wrong}
    if truth in ("positions", "depth") and fault.startswith("object"):
        assert check.answer == "not judged" and not named and check.of("still surfaces").answer == "right"
    else:
        assert check.answer == "wrong" and named and named <= FOUND[fault], check.classes


@pytest.mark.parametrize("names", [(), ("view",), ("z", "sign"), ("rows",), ("files backwards",)], ids=" and ".join)
def test_mistakes_are_named_where_files_count_from_one(exported, names):
    """The scene's camera is placed in time, one frame before the numbers of the files, beside other mistakes."""
    sequence, frames, camera = exported
    matrices = matrices_of(camera)
    for name in names:
        frames, matrices = MISTAKES[name][0](frames, matrices, sequence.mapping)
    frames = {n + 1: replace(f, prev_position=None) for n, f in frames.items()}
    given, settings = scene_camera()
    counted = replace(sequence, files={n + 1: path for n, path in sequence.files.items()})
    check = check_sequence(
        Corrupted(counted, frames), given, list(frames)[1:4], 2, lambda numbers: render_truth(given, settings, numbers)
    )
    assert given.offset == -1
    assert wrong(check) == {key: value for name in names for key, value in MISTAKES[name][1].items()}
    if names != ("files backwards",):
        assert {c.name: c.answer for c in check.classes} == dict.fromkeys(CLASSES, "right")


@pytest.fixture(scope="module")
def rendered():
    """The truth of the exported frames, from their scene."""
    return render_truth(*scene_camera(), range(FIRST, LAST + 1))


# Without a camera


def test_a_fitted_camera_shows_rows_but_no_axes(exported, tmp_path):
    sequence, frames, camera = exported
    mapping = msgspec.structs.replace(sequence.mapping, positions="world")
    matrices = matrices_of(camera)
    frames, _ = MISTAKES["world"][0](frames, matrices, sequence.mapping)
    frames = {n: replace(f, relative=False, prev_position=None) for n, f in frames.items() if n in (40, 41)}
    for name, expected in (("", {}), ("rows", {"rows": "bottom first"})):
        given = MISTAKES[name][0](frames, matrices, sequence.mapping)[0] if name else frames
        check = check_sequence(Corrupted(sequence, given, mapping=mapping), FittedCamera())
        assert wrong(check) == expected and check["up"].status == check["meters"].status == "not checked"
        assert check["direction"].status == "ok"
        assert bool(check["rows"].equivalent) == bool(name)  # a mirrored world looks the same


@pytest.mark.parametrize("fault", [None, "sign", "zero"])
def test_vectors_alone_are_judged_by_the_scene(exported, given, rendered, fault):
    sequence, frames, _ = exported
    if fault in INJECTED:
        frames = INJECTED[fault](frames, given.file.views)
    elif fault is not None:
        frames = MISTAKES[fault][0](frames, None, sequence.mapping)[0]
    frames = {n: replace(f, position=None, depth=None, prev_position=None, sky=0 * f.sky) for n, f in frames.items()}
    for truth in (None, lambda numbers: {n: rendered[n] for n in numbers}):
        check = check_sequence(Corrupted(sequence, frames), given, range(FIRST, LAST + 1), 5, truth)
        assert check["rows"].status == "not checked"
        if truth is None:
            assert check.answer == "not judged" and not check.wrong
        else:
            assert check.answer == ("right" if fault is None else "wrong")
            assert wrong(check) == ({"direction": "current-previous"} if fault == "sign" else {})
            assert [c.name for c in check.classes] == ["still surfaces", "moving surfaces", "sky"]


def test_real_cycles_files_have_no_fault(data):
    check = check_sequence(PathTracedSequence.open(data / "cycles" / "sponza_man"), FittedCamera())
    assert not check.wrong and check["passes"].status == "ok" and check["up"].status == "not checked"
    for name in ("camera", "rows", "order", "depth", *MOTION, "jitter"):
        assert check[name].status == "ok" and (check[name].explained or 1) > 0.9


@pytest.mark.parametrize(
    ("name", "camera"), [("morphed", True), ("skinned_enormous", True), ("open_sky", True), ("morphed", False)]
)
def test_animated_surfaces_are_no_mistake(name, camera):
    """Frames of Cycles in which one object moves and deforms: its motion is neither jitter nor of another unit."""
    folder = Path(__file__).parent / "references" / name
    given = SidecarCamera(folder / "camera.json") if camera else FittedCamera()
    check = check_sequence(PathTracedSequence.open(folder), given)
    assert not check.wrong and check["camera"].status == check["rows"].status == "ok"


def test_missing_passes_and_a_mistake_beside_them(tmp_path):
    """Blender's reference of two frames: no light, a camera that hardly moves, sky without motion."""
    references = Path(__file__).parent / "references" / "rigid"
    sequence = PathTracedSequence.open(references)
    check = check_sequence(sequence, SidecarCamera(references / "camera.json"))
    assert not check.wrong and check["passes"].status == "note" and check["direction"].status == "not checked"
    frames = {n: replace(f, position=100 * f.position) for n in sequence.frames for f in [sequence.read(n)]}
    check = check_sequence(Corrupted(sequence, frames), SidecarCamera(references / "camera.json"))
    assert wrong(check) == {"meters": "0.01"}


# Files and the command line
@pytest.fixture
def run(taubench):
    return partial(taubench, "check")


def test_command_line(exported, tmp_path, run):
    sequence, *_ = exported
    out = tmp_path / "out"
    code, text, _ = run(f"exr:{sequence.path}", "--pairs", 1, "--json", "--out", out)
    values = json.loads((out / "check.json").read_text())
    assert code == 0 and values == json.loads(text)
    assert values["schema"] == "taubench-gl/check/1" and values["wrong"] == [] and len(values["pairs"]) == 1
    assert {f.name for f in out.iterdir()} == {"check.json", "report.html", "motion_error.png", "motion_error.svg"}
    mapping = tmp_path / "wrong.toml"
    preset = (PRESETS / "taubench.toml").read_text()
    mapping.write_text(preset.replace('"previous-current"', '"current-previous"'))
    code, text, _ = run(f"exr:{sequence.path}", "--mapping", mapping, "--pairs", 1)
    assert code == 1 and "motion.direction = 'previous-current'" in text


@pytest.mark.long
def test_both_browsers_open_the_page(exported, tmp_path, run, both_browsers):
    mapping = tmp_path / "mapping.toml"
    mapping.write_text((PRESETS / "taubench.toml").read_text().replace('"previous-current"', '"current-previous"'))
    arguments = (f"exr:{exported[0].path}", "--mapping", mapping, "--pairs", 1, "--out", tmp_path / "out")
    assert run(*arguments)[0] == 1
    both_browsers(tmp_path / "out" / "report.html", "table tbody th")


@pytest.mark.parametrize("case", ["one frame", "no camera", "no motion"])
def test_what_is_missing_in_readable_files_is_not_checked(exported, tmp_path, run, case):
    sequence, *_ = exported
    spec, options = f"exr:{sequence.path}", ["--frames", "40:41"]
    if case != "one frame":
        for n in (40, 41):
            image = read_exr(sequence.path / f"frame_000{n}.exr")
            planes = {name: image.plane(name) for name in image.names if case != "no motion" or "Motion" not in name}
            write_exr(tmp_path / f"f_{n}.exr", planes)
        spec, options = f"exr:{tmp_path}", ["--mapping", "taubench"]
        if case == "no motion":
            options += ["--camera-file", str(sequence.path / "camera.json")]
    ended, text, errors = run(spec, *options, "--json")
    status = {v["convention"]: v["status"] for v in json.loads(text)["verdicts"]}
    assert ended == (0 if case == "no motion" else 3) and not errors and status["direction"] == "not checked"
    assert status["camera"] == ("not checked" if case == "no camera" else "ok")
