"""Sample-count series: discovery, order, reference, noise floor, and points of a cost study."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from taubench_gl.cost import cost
from taubench_gl.errors import PathTracedError
from taubench_gl.pathtraced.compare import noise_floor_percent
from taubench_gl.pathtraced.series import find_series
from taubench_gl.settings import Settings

STORED = Path(__file__).resolve().parent / "references" / "rigid"


def make_render(folder: Path, samples: int, seed: int = 0, seconds: float = 0.5) -> Path:
    """The stored render under other names, with the provenance that 'reference render' writes."""
    shutil.copytree(STORED, folder)
    settings = {"samples": samples, "seed": seed, "bounces": 4, "crisp": True, "fps": 12.0}
    times = {str(20 + i): seconds * samples * (1 + 0.1 * i) for i in range(2)}
    record = {"job": "x", "settings": settings, "lighting": {"light_unit": "candela"}, "frame_seconds": times,
              "clock": "a wall clock", "cores": 2}  # fmt: skip
    (folder / "provenance.json").write_text(json.dumps(record))
    return folder


def test_a_study_takes_the_light_unit_of_its_renders(tmp_path):
    auto = Settings(light_unit="auto", environment="auto", exposure="auto")
    make_render(tmp_path / "r4", 4)
    found = find_series(f"exr:{tmp_path}").settings(auto).lighting
    assert (found.light_unit, found.environment, found.exposure) == ("candela", "auto", "auto")
    record = json.loads((tmp_path / "r4" / "provenance.json").read_text())
    record["lighting"] = {"light_unit": "watt", "environment": [0.1, 0.2, 0.3], "exposure": 0.5}
    (tmp_path / "r4" / "provenance.json").write_text(json.dumps(record))
    found = find_series(f"exr:{tmp_path}").settings(auto).lighting
    assert (found.light_unit, found.environment) == ("watt", (0.1, 0.2, 0.3))
    assert find_series(f"exr:{tmp_path}").settings(Settings(light_unit="candela")).lighting.light_unit == "candela"


@pytest.fixture
def renders_folder(tmp_path):
    for samples, seed in ((16, 0), (1, 0), (4, 0), (16, 3)):
        make_render(tmp_path / f"r{samples}_{seed}", samples, seed)
    return tmp_path


def test_the_render_with_most_samples_is_the_reference(renders_folder):
    series = find_series(f"exr:{renders_folder}")
    assert [r.samples for r in series.renders] == [1, 4, 16]
    assert series.reference.samples == 16 and series.reference.seed == 0
    assert series.second.seed == 3
    assert series.frames == range(20, 22)
    assert series.renders[0].frame_ms == pytest.approx((500.0, 550.0))
    base = series.settings(Settings(width=999, textures="mipmapped"))
    assert (base.sequence.width, base.sequence.height) == series.reference.sequence.size
    assert (base.sequence.fps, base.sequence.frames, base.sequence.textures) == (12.0, (20, 22), "finest")


def test_a_render_is_evaluated_with_its_noise_floor_and_channels(renders_folder):
    series = find_series(f"exr:{renders_folder}")
    settings = series.settings(Settings(pairs="every:2", samples_per_pixel=4))
    run = series.reference.evaluate(settings, series.second)
    assert run.summary["discard"]["position"]["mean_percent"] is not None and len(run.frames) == 1
    assert all(value in (0.0, None) for value in noise_floor_percent(run.summary).values()), (
        "the two seeds are the same files here"
    )
    light = series.renders[0].light(settings, 21)
    assert set(light) == {20, 21} and all(image.shape[2] == 3 for pair in light.values() for image in pair)


def test_a_single_render_is_a_series(tmp_path):
    series = find_series(f"exr:{make_render(tmp_path / 'one', 8)}")
    assert [r.samples for r in series.renders] == [8] and series.second is None


def test_folders_without_recorded_renders_are_refused(tmp_path):
    for where in (tmp_path / "nowhere", tmp_path):
        with pytest.raises(PathTracedError) as error:
            find_series(f"exr:{where}")
        assert error.value.where == str(where)
    (make_render(tmp_path / "a", 4) / "provenance.json").unlink()
    with pytest.raises(PathTracedError) as error:
        find_series(f"exr:{tmp_path}")
    assert error.value.where == str(tmp_path / "a")


@pytest.mark.usefixtures("plots")
def test_renders_are_points_of_a_cost_study(renders_folder, data, tmp_path):
    scene = data / "khronos" / "BoxAnimated" / "BoxAnimated.glb"
    study = cost(
        scene, out=tmp_path / "study", reference=f"exr:{renders_folder}", columns=("position", "normal"), repeats=3,
        parameters=("storage",),
    )  # fmt: skip
    study.save()
    renders = [p for p in study.points if p.role == "render"]
    assert [p.name for p in renders] == ["1 spp, path-traced", "4 spp, path-traced", "16 spp, path-traced"]
    for p, samples in zip(renders, (1, 4, 16), strict=True):
        assert p.error("position") == 0.0 and p.time.median == pytest.approx(525.0 * samples)
    assert study.floor() == 0.0 and study.about["reference"]["samples"] == 16
    values = json.loads((tmp_path / "study" / "study.json").read_text())
    assert values["fronts"]["overall"] == [p.name for p in study.front()]
    assert (tmp_path / "study" / "front.png").stat().st_size > 5000
    assert renders[0].label in (tmp_path / "study" / "study.html").read_text()
