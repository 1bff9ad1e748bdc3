"""Motion vectors with mistakes, made from exported frames whose motion is right: each is named, and measured."""

from __future__ import annotations

import json

import numpy as np
import pytest

from taubench_gl.apps import cli
from taubench_gl.errors import PathTracedError
from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.paths import PACKAGE
from taubench_gl.pathtraced.evaluation import PathTracedOptions, open_input
from taubench_gl.pathtraced.exr import read_exr, write_exr
from taubench_gl.pathtraced.motion_check import MAX_MOTION_PX, check_pairs
from taubench_gl.settings import Settings

SIZE = (96, 54)
DEMO = PACKAGE.parent / "assets" / "demo.glb"


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """Three frames of the demo, jittered: motion without jitter, positions of the jittered samples."""
    out = tmp_path_factory.mktemp("frames")
    settings = Settings(width=SIZE[0], height=SIZE[1], frames=(40, 43))
    export_scene(
        DEMO, out, settings, ExportOptions("exr", ("gbuffer", "prev_position", "flow", "color"), jitter="halton")
    )
    return out


def rewritten(exported, folder, change=lambda motion, frame: motion, drop=()):
    """A copy with other motion, without channels that start with ``drop``.  ``change``: of (h, w, 2) px, +y down."""
    folder.mkdir()
    (folder / "camera.json").write_text((exported / "camera.json").read_text())
    for path in sorted(exported.glob("*.exr")):
        image = read_exr(path)
        planes = {name: image.plane(name) for name in image.names if not name.startswith(tuple(drop))}
        motion = np.stack([planes["Motion.X"], planes["Motion.Y"]], axis=-1)
        motion = change(motion, int(path.stem[-5:])).astype(np.float32)
        write_exr(folder / path.name, planes | {"Motion.X": motion[..., 0], "Motion.Y": motion[..., 1]})
    return folder


def check(folder, camera=True):
    camera_file = str(folder / "camera.json") if camera else None
    given = open_input(f"exr:{folder}", Settings(), PathTracedOptions(mapping="taubench", camera_file=camera_file))
    return check_pairs(given.sequence, given.camera, 4)


@pytest.mark.parametrize(
    "drop", [(), ("PrevPosition",), ("PrevPosition", "Position")], ids=["previous", "still", "depth"]
)
def test_right_motion_has_no_fault(exported, tmp_path, drop):
    found = check(rewritten(exported, tmp_path / "f", drop=drop))
    assert list(found) == [41, 42]
    basis = "still surfaces" if drop else "previous positions"
    for verdict in found.values():
        assert verdict.known and verdict.fault == "" and verdict.basis == basis
        assert verdict.error_px <= MAX_MOTION_PX < verdict.next_px and verdict.pixels > 1000


MISTAKES = {
    "sign": (lambda m, f: -m, (-1, -1), "", False),
    "y": (lambda m, f: m * [1, -1], (1, -1), "", False),
    "x": (lambda m, f: m * [-1, 1], (-1, 1), "", False),
    "uv": (lambda m, f: m / SIZE, (1, 1), "uv", False),
    "ndc": (lambda m, f: m / SIZE * 2, (1, 1), "ndc", False),
    "half": (lambda m, f: 0.5 * m, (1, 1), "half", False),
    "double": (lambda m, f: 2 * m, (1, 1), "double", False),
    "exchanged": (lambda m, f: m[..., ::-1], (1, 1), "", True),
    "uv, sign and y": (lambda m, f: m / SIZE * [-1, 1], (-1, 1), "uv", False),
}


@pytest.mark.parametrize("name", MISTAKES)
@pytest.mark.parametrize("drop", [(), ("PrevPosition",)], ids=["previous", "still"])
def test_a_mistake_is_named(exported, tmp_path, name, drop):
    change, signs, unit, exchanged = MISTAKES[name]
    for verdict in check(rewritten(exported, tmp_path / "f", change, drop)).values():
        assert verdict.known and (verdict.best.signs, verdict.best.unit, verdict.best.exchanged) == (
            signs,
            unit,
            exchanged,
        )
        assert verdict.fault and verdict.error_px <= MAX_MOTION_PX < min(verdict.as_is_px, verdict.next_px)


@pytest.mark.parametrize("flip", [1, -1])
def test_jitter_left_in_the_motion_is_measured(exported, tmp_path, flip):
    """The difference of the two offsets, also beside a wrong sign."""
    offsets = {40: (0.31, -0.17), 41: (-0.19, 0.33), 42: (0.07, 0.11)}
    folder = rewritten(
        exported, tmp_path / "f", lambda m, f: flip * (m + np.subtract(offsets.get(f - 1, (0, 0)), offsets[f]))
    )
    for frame, verdict in check(folder).items():
        expected = np.subtract(offsets[frame - 1], offsets[frame])
        assert verdict.jittered and verdict.best.signs == (flip, flip) and "jitter" in verdict.fault
        np.testing.assert_allclose(verdict.jitter_px, expected, atol=max(0.02, verdict.jitter_margin_px))


def test_images_alone_show_a_wrong_sign(exported, tmp_path):
    """Without geometry or a camera; the exported colors are display colors, which is all this needs."""
    for name, change in (("right", lambda m, f: m), ("wrong", lambda m, f: -m)):
        folder = rewritten(exported, tmp_path / name, change, drop=("Position", "PrevPosition"))
        for verdict in check(folder, camera=False).values():
            assert verdict.basis == "images" and verdict.known
            assert bool(verdict.best.text) == (name == "wrong") and (name == "right" or verdict.best.signs == (-1, -1))


def test_a_still_image_shows_no_convention(exported, tmp_path):
    """Most pixels have no motion: the sign of the others cannot be seen in the images."""

    def mostly_still(motion, frame):
        return np.where((np.indices(motion.shape[:2]).sum(axis=0) % 4 == 0)[..., None], motion, 0.0)

    folder = rewritten(exported, tmp_path / "f", mostly_still, drop=("Position", "PrevPosition"))
    assert all(isinstance(verdict, str) for verdict in check(folder, camera=False).values())


def test_random_motion_has_no_verdict(exported, tmp_path):
    rng = np.random.default_rng(1)
    folder = rewritten(exported, tmp_path / "f", lambda m, f: rng.normal(0, 20, m.shape))
    assert all(not verdict.known and verdict.fault == "" for verdict in check(folder).values())


def test_reasons_for_no_verdict(exported, tmp_path):
    folder = rewritten(exported, tmp_path / "f")
    (folder / "frame_00041.exr").unlink()
    with pytest.raises(PathTracedError):
        check(folder)


def test_command_line(exported, tmp_path, capsys):
    wrong = rewritten(exported, tmp_path / "wrong", lambda m, f: -m)
    for folder, code in ((exported, 0), (wrong, 2)):
        command = [
            "reuse",
            "check-motion",
            f"exr:{folder}",
            "--mapping",
            "taubench",
            "--camera-file",
            str(folder / "camera.json"),
        ]
        with pytest.raises(SystemExit) as ended:
            cli.main(command)
        lines = capsys.readouterr().out.splitlines()
        assert ended.value.code == code and len(lines) == 2 and ("current - previous" in lines[0]) == (code == 2)
        with pytest.raises(SystemExit) as ended:
            cli.main([*command, "--json"])
        rows = json.loads(capsys.readouterr().out)
        assert [row["frame"] for row in rows] == [41, 42] and all(bool(row["fault"]) == (code == 2) for row in rows)
