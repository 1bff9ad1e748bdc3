"""Path-traced rungs: found, ordered, and turned into reference, floor and points."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from taubench_gl.cost import cost
from taubench_gl.cost.errors import feature_frames, from_run
from taubench_gl.cost.rungs import find_ladder, fitting, floor_of, run_rung, rung_channels
from taubench_gl.errors import PathTracedError
from taubench_gl.settings import Settings

STORED = Path(__file__).resolve().parents[1] / "pathtraced" / "references" / "rigid"


def make_rung(folder: Path, samples: int, seed: int = 0, seconds: float = 0.5) -> Path:
    """The stored render under other names, with the provenance that 'reference render' writes."""
    shutil.copytree(STORED, folder)
    settings = {"samples": samples, "seed": seed, "bounces": 4, "crisp": True, "fps": 12.0}
    times = {str(20 + i): seconds * samples * (1 + 0.1 * i) for i in range(2)}
    told = {"job": "x", "settings": settings, "frame_seconds": times, "clock": "a wall clock", "cores": 2}
    (folder / "provenance.json").write_text(json.dumps(told))
    return folder


@pytest.fixture
def ladder_folder(tmp_path):
    for samples, seed in ((16, 0), (1, 0), (4, 0), (16, 3)):
        make_rung(tmp_path / f"r{samples}_{seed}", samples, seed)
    return tmp_path


def test_the_most_samples_are_the_reference_and_its_twin_the_floor(ladder_folder):
    ladder = find_ladder(f"exr:{ladder_folder}")
    assert [r.samples for r in ladder.rungs] == [1, 4, 16]
    assert ladder.reference.samples == 16 and ladder.reference.seed == 0
    assert ladder.second.seed == 3
    assert ladder.frames == range(20, 22)
    assert ladder.rungs[0].frame_ms == pytest.approx((500.0, 550.0))
    base = fitting(Settings.of(width=999, textures="mipmapped"), ladder)
    assert (base.sequence.width, base.sequence.height) == ladder.reference.sequence.size
    assert (base.sequence.fps, base.sequence.frames, base.sequence.textures) == (12.0, (20, 22), "finest")


def test_rungs_are_measured_like_everything_else(ladder_folder):
    ladder = find_ladder(f"exr:{ladder_folder}")
    settings = fitting(Settings.of(pairs="every:2", samples_per_pixel=4), ladder)
    run = run_rung(ladder.reference, settings, ladder.second)
    found = from_run(run)
    assert found["columns"]["position"]["percent"] is not None and len(found["columns"]["position"]["pairs"]) == 1
    assert all(value in (0.0, None) for value in floor_of(run).values()), "the two seeds are the same files here"
    channels = rung_channels(ladder.rungs[0], settings, feature_frames(ladder.frames))
    assert list(channels) == [21] and {"position", "normal", "motion"} <= channels[21].keys()


def test_a_single_render_is_a_ladder_of_one(tmp_path):
    ladder = find_ladder(f"exr:{make_rung(tmp_path / 'one', 8)}")
    assert [r.samples for r in ladder.rungs] == [8] and ladder.second is None


def test_what_is_no_ladder_is_said(tmp_path):
    with pytest.raises(PathTracedError, match="is no folder"):
        find_ladder(f"exr:{tmp_path / 'nowhere'}")
    with pytest.raises(PathTracedError, match="holds no renders"):
        find_ladder(f"exr:{tmp_path}")
    (make_rung(tmp_path / "a", 4) / "provenance.json").unlink()
    with pytest.raises(PathTracedError, match="does not say how it was rendered"):
        find_ladder(f"exr:{tmp_path}")


def test_rungs_stand_on_the_plot_of_a_study(ladder_folder, data, tmp_path):
    scene = data / "khronos" / "BoxAnimated" / "BoxAnimated.glb"
    study = cost(
        scene, out=tmp_path / "study", reference=f"exr:{ladder_folder}", columns=("position", "normal"), repeats=3,
        knobs=("samples_per_pixel",),
    )  # fmt: skip
    study.save()
    rungs = [p for p in study.points if p.role == "rung"]
    assert [p.choice["spp"] for p in rungs] == [1, 4, 16]
    for p in rungs:
        assert p.error("position") == 0.0 and p.time.median == pytest.approx(525.0 * p.choice["spp"])
    front = study.front("all")
    assert front[-1] is rungs[0], "two frames have no spread: of equally exact renders the first"
    values = json.loads((tmp_path / "study" / "study.json").read_text())
    assert values["fronts"]["all"] == [p.name for p in front]
    assert (tmp_path / "study" / "front_all.png").stat().st_size > 5000
    assert rungs[0].label in (tmp_path / "study" / "study.html").read_text()
