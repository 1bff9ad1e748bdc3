"""``evaluate --exact``: counts of channel and masks, a floor whose discards are all misregistration, and the tables."""

from __future__ import annotations

import numpy as np
import pytest
from fixed import fixed_settings
from lamp_scenes import matte_room

from taubench_gl import evaluate
from taubench_gl.conventions import Reason, Visibility
from taubench_gl.errors import SettingsError
from taubench_gl.evaluation import Observers, evaluate_scene
from taubench_gl.evaluation.exact import Reasons, misregistered
from taubench_gl.metrics.exact_rates import CLASSES, exact_summary
from taubench_gl.paths import ASSETS
from taubench_gl.run import load_run
from taubench_gl.run_schema import EXACT_COLUMNS, FRAME_COLUMNS
from taubench_gl.scene.builder import SceneBuilder, quad, turn_x
from taubench_gl.selftest.scenes import sky_file
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = ASSETS / "demo.glb"
OWN = {"columns": ("frustum", "position", "normal"), "reprojection": "motion"}


def settings(**more) -> Settings:
    return fixed_settings(**({"width": 64, "height": 36} | OWN | more))


def floor():
    """A floor that nothing hides, seen at a grazing angle by a camera that moves forward."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(quad(400.0, 400.0)), rotation=turn_x(-90.0))
    camera = b.camera(translation=(0.0, 1.0, 0.0), yfov=1.0, znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 1.0, 0.0), (0.0, 1.0, -10.0)])
    return b.build()


def test_all_discards_of_an_open_floor_are_misregistration():
    run = evaluate_scene(floor(), settings(fps=24.0, frames=(0, 4), exact=True))
    exact, discard = run.summary["exact"], run.summary["discard"]
    assert discard["position"]["mean_percent"] > 1.0  # half a pixel is more than the threshold far away
    # Sky on floor at the horizon is a position discard of a visible point too: nothing is ever before anything.
    assert exact["occluded"]["mean_percent"] < 0.5 and exact["new"]["mean_percent"] == 0.0
    assert exact["misregistered"]["position"]["share_percent"] > 97.0
    assert exact["visible"]["mean_percent"] + exact["outside"]["mean_percent"] + exact["behind"][
        "mean_percent"
    ] == pytest.approx(100.0 - exact["occluded"]["mean_percent"])


def test_columns_are_counts_of_channel_and_mask(tmp_path):
    seen = []

    def on_pair(pair):
        seen.append((pair.mask.copy(), pair.read("prev_visibility")[..., 0].copy(), dict(pair.row)))

    run = evaluate(DEMO, settings(frames=(20, 24)), exact=True, on_pair=on_pair, out=tmp_path)
    assert len(seen) == 3
    for mask, bits, row in seen:
        assert np.isin(bits & ~np.uint32(Visibility.SKY | Visibility.MOVED), list(CLASSES.values())).all()
        assert row["visible"] == np.count_nonzero(bits & Visibility.VISIBLE)
        wrong = ((mask & Reason.POSITION) != 0) & ((bits & Visibility.VISIBLE) != 0)
        assert row["misregistered_position"] == np.count_nonzero(wrong) > 0
    stored = load_run(tmp_path)
    assert [[r[c] for c in EXACT_COLUMNS] for r in stored.frames] == [[r[c] for c in EXACT_COLUMNS] for *_, r in seen]
    exact = run.summary["exact"]
    assert sum(exact[name]["mean_percent"] for name in CLASSES) == pytest.approx(100.0)
    discards = sum(r["position"] for *_, r in seen)
    share = 100.0 * sum(r["misregistered_position"] for *_, r in seen) / discards
    assert exact["misregistered"]["position"]["share_percent"] == pytest.approx(share)
    (table,) = [t for t in stored.tables() if t.number == 4]
    names = [c.name for c in table.columns]
    row = next(r for r in table.rows if "all pixels" in r.label)
    assert row.values[names.index("visible")] == pytest.approx(exact["visible"]["mean_percent"])
    assert all(len(r.values) == len(names) for r in table.rows)
    reasons = stored.tables()[-1]
    (row,) = reasons.rows
    assert reasons.number == "exact reasons" and row.values[0] == pytest.approx(exact["occluded"]["mean_percent"])
    assert row.values[3] is None and row.reasons[3]  # no light was measured


def test_light_of_the_same_points():
    """Diffuse light of a still lamp is that of the point: all discards are misregistration; of a moving one few."""
    chosen = settings(
        columns=("frustum", "color", "position", "normal", "direct"), fps=4.0, frames=(0, 3), shadow_lights=0,
        thresholds={"direct": 0.005, "color": 0.02}, exact=True, exposure=0.1,
    )  # fmt: skip
    still, moving = (
        evaluate_scene(matte_room(to, (0.9, 0.0, 1.2), empty=True), chosen).summary
        for to in ((0.0, 1.0, 0.0), (1.6, 0.0, 0.0))
    )
    assert still["discard"]["direct"]["mean_percent"] > 0.1
    assert still["exact"]["misregistered"]["direct"]["share_percent"] == 100.0
    assert still["exact"]["misregistered"]["color"]["share_percent"] > 99.0
    assert still["exact"]["view_dependent"]["mean_percent"] == 0.0
    assert still["exact"]["brightened"]["mean_percent"] == still["exact"]["darkened"]["mean_percent"] == 0.0
    assert moving["exact"]["brightened"]["mean_percent"] > 10.0 and moving["exact"]["darkened"]["mean_percent"] > 1.0
    assert all(moving["exact"]["misregistered"][name]["share_percent"] < 20.0 for name in ("direct", "color"))
    assert still["exact"]["misregistered"]["indirect"]["mean_percent"] is None


def test_a_direction_keeps_its_sky():
    """Every color discard of a sky beside a turning camera is misregistration: texels are seen between pixels."""
    b, seen = SceneBuilder(), []
    b.node(mesh=b.mesh(quad(1.0, 1.0)), translation=(0.0, 0.0, 50.0))
    b.animate(b.camera(), "rotation", [0.0, 1.0], [turn_x(20.0), turn_x(10.0)])
    own = {"columns": ("frustum", "position", "normal", "color"), "thresholds": {"color": 0.01}}

    def on_pair(pair):
        bits = pair.read("prev_visibility")[..., 0]
        discarded = ((pair.mask & Reason.COLOR) != 0) & ((bits & Visibility.VISIBLE) != 0)
        seen.append((np.count_nonzero(discarded), pair.row["misregistered_color"]))

    with sky_file(np.random.default_rng(3).random((32, 64, 3))) as path:
        chosen = settings(fps=2.0, frames=(0, 3), exact=True, environment=path, **own)
        evaluate_scene(b.build(), chosen, Observers(on_pair=on_pair))
    assert len(seen) == 2 and all(count > 50 and found == count for count, found in seen)


def test_without_exact_nothing_is_added():
    run = evaluate_scene(DEMO, settings(frames=(0, 2)))
    assert "exact" not in run.summary and set(run.frames[0]) == set(FRAME_COLUMNS)
    (table,) = [t for t in run.tables() if t.number == 4]
    assert "visible" not in [c.name for c in table.columns]


def test_a_moving_object_is_not_misregistered_under_camera_reprojection():
    """The motion of the object explains the discard: the previous camera saw the point elsewhere."""
    moved = np.uint32(Visibility.VISIBLE | Visibility.MOVED)
    mask = np.full((1, 2), Reason.POSITION | Reason.NORMAL, dtype=np.uint32)
    bits = np.array([[moved, Visibility.VISIBLE]], dtype=np.uint32)
    found = Reasons(bits, None)
    assert misregistered(mask, found, "position", settings(), "camera").tolist() == [[False, True]]
    assert misregistered(mask, found, "position", settings(), "motion").tolist() == [[True, True]]
    assert misregistered(mask, found, "normal", settings(), "motion").tolist() == [[False, True]]


def test_a_column_that_was_not_measured_is_null():
    run = evaluate_scene(DEMO, settings(frames=(0, 2), columns=("frustum", "position"), exact=True))
    (row,) = run.frames
    assert row["misregistered_normal"] is None and row["missed"] is None and row["visible"] > 0
    unmeasured = dict.fromkeys(("color", "normal", "direct", "indirect"), "not asked for")
    block = exact_summary([row | {"position": 0, "misregistered_position": 0}], unmeasured, "motion")
    assert block["misregistered"]["normal"] == {
        "mean_percent": None, "max_percent": None, "share_percent": None, "reason": "not asked for",
    }  # fmt: skip
    assert block["misregistered"]["position"]["share_percent"] is None and block["missed"]["mean_percent"] is None


@pytest.mark.parametrize("more", [{"storage": "half"}, {"samples_per_pixel": 4}])
def test_settings_without_one_exact_position_are_refused(more):
    with pytest.raises(SettingsError):
        evaluate_scene(DEMO, settings(frames=(0, 2), exact=True, **more))


def test_path_traced_files_have_no_surfaces(tmp_path):
    with pytest.raises(SettingsError):
        evaluate(f"exr:{tmp_path}", exact=True)
