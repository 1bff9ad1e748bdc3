"""The rejection that frames of another program have, against exact visibility of their scene."""

from __future__ import annotations

import numpy as np
import pytest
from click.testing import CliRunner
from fixed import fixed_settings

from taubench_gl.apps.cli import cli
from taubench_gl.conventions import Visibility
from taubench_gl.errors import PathTracedError, SettingsError
from taubench_gl.evaluation import open_session
from taubench_gl.evaluation.exact import exact_channels
from taubench_gl.evaluation.session import Readback
from taubench_gl.frame.passes.visibility import CHANNEL
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.exr import write_exr
from taubench_gl.reject.evaluate import evaluate_tests
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO, SIZE, FRAMES = ASSETS / "demo.glb", (64, 36), range(20, 24)
POSITIVE = Visibility.OCCLUDED | Visibility.NEW


def settings(**more) -> Settings:
    own = {"width": SIZE[0], "height": SIZE[1], "shadow_size": 64, "indirect": "none", "light": "raster"}
    return fixed_settings(**(own | more))


@pytest.fixture(scope="module")
def visibility():
    """Frame -> bits of exact visibility (h, w), and world positions (h, w, 3) with NaN for the sky."""
    chosen = settings(frames=(FRAMES[0] - 1, FRAMES[-1] + 1), reprojection="motion", columns=("frustum", "position"))
    out = {}
    with open_session(DEMO, chosen, Readback(images=True, channels=exact_channels())) as session:
        for pair in session.pairs():
            position = pair.read("position")
            world = position[..., :3] + pair.view.position
            world[position[..., 3] <= 0] = np.nan
            out[pair.frame] = pair.read(CHANNEL)[..., 0], world
    return out


def written(folder, visibility, planes):
    """Files numbered from 1, as programs do that count so; ``planes`` makes the passes of the bits of a frame."""
    for number, frame in enumerate(FRAMES, FRAMES[0] + 1):
        bits, world = visibility[frame]
        position = {f"Position.{c}": world[..., i].astype(np.float32) for i, c in enumerate("XYZ")}
        write_exr(folder / f"f_{number:04d}.exr", position | planes(bits))
    mapping = folder / "m.toml"
    mapping.write_text('up = "y"\n[passes]\nposition = "Position"\nrejected = "Reject"\nhistory_weight = "Weight"\n')
    return {"mapping": mapping, "scene_file": DEMO}


def scored(folder, options, **more):
    chosen = PathTracedOptions(**options)
    return evaluate_tests(f"exr:{folder}", ["object_id"], settings(**more), files=chosen).summary


def rejected(bits, which):
    return {"Reject.Y": ((bits & which) != 0).astype(np.float32)}


def test_exact_rejection_has_no_error(tmp_path, visibility):
    summary = scored(tmp_path, written(tmp_path, visibility, lambda bits: rejected(bits, POSITIVE)))
    assert list(summary["tests"]) == ["object_id", "files"] and summary["pairs"] == len(FRAMES) - 2
    assert (summary["settings"]["first_frame"], summary["settings"]["last_frame"]) == (FRAMES[0], FRAMES[-1])
    block = summary["tests"]["files"]["scores"]["visibility"]
    assert block["precision"] == block["recall"] == 1.0 and block["true_positive"] > 20
    assert summary["tests"]["files"]["milliseconds"] is None
    reasons = summary["tests"]["files"]["strata"]["reason"]
    assert sum(r["pixels"] for r in reasons.values()) == summary["pixels"]["surface"]
    assert all(r["false_positive"] == r["false_negative"] == 0 for r in reasons.values())


def test_a_weight_of_history_and_its_errors_by_reason(tmp_path, visibility):
    """All but the occluded pixels are kept, by half: every new pixel is missed, and nothing else."""

    def weights(bits):
        return {"Weight.Y": np.where((bits & Visibility.OCCLUDED) != 0, 0.0, 0.5).astype(np.float32)}

    summary = scored(tmp_path, written(tmp_path, visibility, weights))
    reasons = summary["tests"]["files"]["strata"]["reason"]
    assert reasons["occluded"]["recall"] == 1.0 and reasons["occluded"]["pixels"] > 0
    assert reasons["unchanged"]["false_positive"] == 0
    assert reasons["new"]["false_negative"] == reasons["new"]["pixels"]


def test_pixels_of_unknown_history_are_left_out(tmp_path, visibility):
    def partly(bits):
        plane = rejected(bits, POSITIVE)["Reject.Y"]
        plane[:18] = np.nan
        return {"Reject.Y": plane}

    summary = scored(tmp_path, written(tmp_path, visibility, partly))
    reasons = summary["tests"]["files"]["strata"]["reason"]
    assert 0 < sum(r["pixels"] for r in reasons.values()) < summary["pixels"]["surface"]
    assert all(r["false_positive"] == r["false_negative"] == 0 for r in reasons.values())


def test_errors_of_a_user(tmp_path, visibility):
    options = written(tmp_path, visibility, lambda bits: {})
    with pytest.raises(SettingsError, match="rejected or history_weight"):
        scored(tmp_path, options)
    options = written(tmp_path, visibility, lambda bits: rejected(bits, POSITIVE))
    with pytest.raises(SettingsError, match="scene"):
        scored(tmp_path, options | {"scene_file": None})
    shifted = tmp_path / "shifted.toml"
    shifted.write_text("principal_point = [0, 1]\n" + options["mapping"].read_text())
    with pytest.raises(PathTracedError, match="shifts"):
        scored(tmp_path, options | {"mapping": shifted})
    with pytest.raises(PathTracedError, match="frame"):  # the scene's camera at another rate
        scored(tmp_path, options, fps=10.0)


def test_the_command(tmp_path, visibility):
    options = written(tmp_path, visibility, lambda bits: rejected(bits, Visibility.OCCLUDED))
    arguments = ["reject", "evaluate", f"exr:{tmp_path}", "--scene-file", str(DEMO), "--mapping", options["mapping"]]
    result = CliRunner().invoke(cli, [*map(str, arguments), "--tests", "position", "--out", str(tmp_path / "out")])
    assert result.exit_code == 0, result.output
    assert "files" in result.output and (tmp_path / "out" / "reject.json").is_file()
