"""A sequence that Blender rendered (Cycles, 1024 samples, direct light) as a method, beside methods of one sample.

Direct light of point lights alone: the path tracer samples every light, so that its reference has no noise.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from fixed import fixed_settings

from taubench_gl.reuse.evaluate import evaluate_methods

pytestmark = pytest.mark.usefixtures("fixed_light")

STORED = Path(__file__).parents[1] / "pathtraced" / "blender_lights"
MAPPING = """[passes]
combined = "Direct"
"""


@pytest.fixture(scope="module")
def means(tmp_path_factory):
    """Means of each method over frames 2 to 5, and of the sequence one frame late, against path-traced references."""
    folder = tmp_path_factory.mktemp("blender")
    (folder / "cycles.toml").write_text(MAPPING)
    renders = f"exr:{STORED / 'room'}@mapping={folder / 'cycles.toml'}"
    auto = dict.fromkeys(("light_unit", "exposure", "environment", "light"), "auto")
    given = {"width": 96, "height": 54, "reprojection": "motion", "bounces": 1, "indirect": "none"}
    settings = fixed_settings(frames=(1, 6), **given, **auto)
    methods = ["none", "accumulate", f"{renders}@label=Cycles"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TAUBENCH_CACHE", str(folder / "cache"))
        kinds = {"input": "noisy", "reference": "path-traced@4", "metrics": ("psnr", "relmse")}
        whole = evaluate_methods(STORED / "room.glb", methods, settings, **kinds)
        late = evaluate_methods(
            STORED / "room.glb", [f"{renders}@label=late@offset=-1"], settings.replace(frames=(2, 6)), **kinds
        )
    assert not whole.failed and not late.failed
    return {label: m["mean"] for done in (whole, late) for label, m in done.summary["methods"].items()}


def test_a_converged_sequence_is_better_than_methods_of_one_sample(means):
    assert means["none"]["psnr_db"] < means["accumulate"]["psnr_db"] < means["Cycles"]["psnr_db"] - 3.0
    assert means["Cycles"]["relmse"] < 0.1 * means["none"]["relmse"]


def test_another_frame_is_an_error(means):
    assert means["late"]["psnr_db"] < means["Cycles"]["psnr_db"] - 3.0
