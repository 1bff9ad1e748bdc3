"""``evaluate``, ``pairs`` and ``Run`` on the built-in demo scene; the examples of docs/api.md."""

from __future__ import annotations

import contextlib
import io
import json
import re
import shutil
import sys

import numpy as np
import pytest

import taubench_gl as tb
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.gpu.context import open_gpu
from taubench_gl.paths import ASSETS
from taubench_gl.run_schema import FRAME_COLUMNS

pytestmark = pytest.mark.usefixtures("coarse_light", "coarse_metering")

DEMO = ASSETS / "demo.glb"
SMALL = {"width": 96, "height": 54, "frames": (0, 4), "indirect": "none"}
GEOMETRY = {"size": "96x54", "frames": range(4), "columns": "frustum,position,normal"}
DOCS = ASSETS.parent / "docs"


@pytest.fixture(scope="module")
def stored(tmp_path_factory):
    return tb.evaluate(DEMO, out=tmp_path_factory.mktemp("stored"), save=("masks", "channels"), **SMALL)


def test_output_folder_holds_every_file(stored):
    names = {str(p.relative_to(stored.out)) for p in stored.out.rglob("*") if p.is_file()}
    assert {"summary.json", "frames.csv", "mask.png", "tables.md", "thresholds.png", "frames.svg"} <= names
    assert {f"masks/mask_0000{i}.png" for i in (1, 2, 3)} <= names
    with np.load(stored.out / "channels/channels_00002.npz") as saved:
        assert saved["position"].shape == (54, 96, 4) and saved["mask"].shape == (54, 96)
    again = tb.load_run(stored.out)
    assert again.summary == json.loads(json.dumps(stored.summary)) and len(again.frames) == 3


def test_options_replace_settings_and_results_without_an_output_folder_are_the_same(stored):
    run = tb.evaluate(DEMO, tb.Settings(**SMALL | {"frames": (0, 2)}), frames=SMALL["frames"])
    assert run.summary["discard"] == stored.summary["discard"] and run.frames == stored.frames


@pytest.mark.parametrize("frames", ["0:3", range(3), slice(0, 3), (0, 3), [0, 3]])
def test_options_are_those_of_the_command_line(frames):
    options = {"size": "32x18", "frames": frames, "thresholds": "normal=0.5", "columns": ["frustum", "normal"]}
    (settings,) = {str(pair.settings) for pair in tb.pairs(DEMO, camera="walk", **options)}
    same = {"size": (32, 18), "frames": (0, 3), "thresholds": {"normal": 0.5}, "columns": "frustum,normal"}
    (expected,) = {str(pair.settings) for pair in tb.pairs(DEMO, camera="walk", **same)}
    assert settings == expected


@pytest.mark.parametrize(
    ("arguments", "setting"),
    [
        ({"save": ("masks",)}, None), ({"save": ("all",), "out": "x"}, None), ({"hue": 1}, "hue"),
        ({"on_pair": 3}, None), ({"progress": 3}, None), ({"out": 3}, None), ({"save": 3}, None),
    ],
)  # fmt: skip
def test_wrong_argument_is_a_settings_error(arguments, setting):
    with pytest.raises(SettingsError) as caught:
        tb.evaluate(DEMO, **SMALL, **arguments)
    assert caught.value.setting == setting


@pytest.mark.parametrize("function", [tb.evaluate, tb.pairs])
@pytest.mark.parametrize(
    "arguments",
    [
        {"scene": 3}, {"scene": "nothing.glb"}, {"settings": "96x54"}, {"size": "96"}, {"frames": range(5, 5)},
        {"frames": range(100, 200)}, {"animation": "fly"}, {"scene": DEMO, "settings": tb.Settings(scene=7)},
        {"frames": range(0, 9, 2)}, {"columns": "positon"}, {"camera": "nobody"}, {"camera_file": "camera.json"},
        {"scene": "exr:nothing", "size": "3x3"}, {"scene": "exr:nothing", "lobes": "difuse"}, {"path_traced": 3},
    ],
)  # fmt: skip
def test_wrong_value_is_one_line(function, arguments):
    with pytest.raises(tb.TaubenchError) as caught:
        function(**({"scene": DEMO} | arguments))
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 250


@pytest.mark.parametrize(
    ("function", "arguments", "near"),
    [
        (tb.evaluate, {"widht": 3}, "width"),
        (tb.evaluate, {"on_pairs": print}, "on_pair"),
        (tb.evaluate, {"save": "mask", "out": "x"}, "masks"),
        (tb.evaluate, {"camera_files": "x"}, "camera_file"),
        (tb.pairs, {"siez": "3x3"}, "size"),
        (tb.pairs, {"channels": "base_colr"}, "base_color"),
    ],
)
def test_wrong_name_answers_with_the_nearest(function, arguments, near):
    with pytest.raises(SettingsError) as caught:
        function(DEMO, **arguments)
    assert caught.value.hint == f"did you mean {near}?"


# tb.pairs


def test_pairs_are_those_of_the_evaluation(stored):
    pairs = list(tb.pairs(DEMO, **SMALL))
    assert [pair.frame for pair in pairs] == [1, 2, 3]
    for pair, row in zip(pairs, stored.frames, strict=True):
        assert pair.row == {name: value for name, value in row.items() if name != "camera_cut"}
        assert pair.mask.dtype == np.uint32 and pair.mask.shape == (54, 96)
        assert pair.motion.dtype == np.float32 and pair.motion.shape == (54, 96, 2)
        assert pair.color.dtype == np.float32 and pair.color.shape == (54, 96, 3)
        assert 0 < pair.color.max() <= 1 and pair.settings.lighting.resolved
        for name in ("position", "normal", "direct", "color"):
            assert np.count_nonzero(pair.mask & tb.Reason[name.upper()]) == row[name]


def test_row_0_is_at_the_top():
    """The camera of the demo walks: pixels at the top and bottom move to different sides."""
    for pair in tb.pairs(DEMO, size="96x54", frames="0:2", columns="position"):
        position, world_from_view = pair.read("position"), pair.view.world_from_view
        up = position[..., :3] @ world_from_view[:, 1]  # along the camera's up axis
        surface = position[..., 3] > 0
        slope = up[surface] / position[..., 3][surface]
        rows = np.nonzero(surface)[0]
        assert np.corrcoef(rows, slope)[0, 1] < -0.99  # lower rows look further down


def test_color_that_is_not_measured_is_none_with_its_reason():
    (pair,) = tb.pairs(DEMO, size="96x54", frames="0:2", columns="frustum")
    assert pair.color is None and pair.unmeasured["color"]


@pytest.mark.parametrize("pixel", [(96, 0), (0, 54), (-1, 0), (0.5, 0), ("a", 0)])
def test_pixel_outside_the_image_is_an_error(pixel):
    for pair in tb.pairs(DEMO, **GEOMETRY):
        with pytest.raises(SettingsError):
            pair.explain(*pixel)
        with pytest.raises(SettingsError) as caught:
            pair.read("positon")
        assert caught.value.hint == "did you mean position?"
        break


def test_arrays_outlive_the_loop_and_explanations_do_not():
    first, *_ = tb.pairs(DEMO, **GEOMETRY)
    assert first.mask.shape == (54, 96)
    with pytest.raises(tb.TaubenchError):
        first.explain(3, 3)


@pytest.mark.parametrize("how", ["end", "break", "error"])
def test_gpu_is_released_when_the_loop_ends(how, monkeypatch):
    """Every texture, buffer and program of the evaluation is released, and no context stays current."""
    from taubench_gl.frame.sources import RasterSource

    released = []
    release = RasterSource.release
    monkeypatch.setattr(RasterSource, "release", lambda source: (released.append(source), release(source)))
    gpu = open_gpu()
    with contextlib.suppress(ZeroDivisionError):
        for pair in tb.pairs(DEMO, **GEOMETRY):
            assert gpu._entered == 0 and not released and pair.frame > 0
            if how == "break":
                break
            if how == "error":
                _ = 1 / 0
        assert pair.mask.shape == (54, 96)
    assert len(released) == 1 and gpu._entered == 0
    with gpu:
        gpu.check("the loop")


@pytest.fixture(scope="module")
def run():
    return tb.evaluate(DEMO, **GEOMETRY)


def test_loops_and_evaluations_at_once_give_the_same_pairs(run):
    for number, both in enumerate(zip(tb.pairs(DEMO, **GEOMETRY), tb.pairs(DEMO, **GEOMETRY), strict=True)):
        assert np.array_equal(*(pair.mask for pair in both))
        assert number or tb.evaluate(DEMO, **GEOMETRY).frames == run.frames


# Run


def test_plot_is_a_figure_that_notebooks_show(run, tmp_path):
    figure = run.plot()
    names = {line.get_label() for line in figure.axes[0].get_lines()}
    assert {"frustum", "position", "normal"} <= names and "color" not in names
    assert figure._repr_png_().startswith(b"\x89PNG")
    figure.savefig(tmp_path / "frames.png")
    with pytest.raises(OutputError):
        tb.Run(run.summary, []).plot()


def test_pandas_table_has_the_columns_of_frames_csv(run):
    pytest.importorskip("pandas")
    table = run.to_pandas()
    assert list(table) == list(FRAME_COLUMNS) and len(table) == 3
    assert table["position"].tolist() == [row["position"] for row in run.frames]
    assert table["direct"].isna().all() and table["direct"].dtype == float


def test_without_pandas_the_error_names_it(run, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(OutputError) as caught:
        run.to_pandas()
    assert "pandas" in caught.value.hint


def test_html_of_a_run_has_the_headline_tables_and_notes(run):
    from taubench_gl.report.reusable import reusable_sentence

    hostile = tb.Run(run.summary | {"notes": ["<script>"]}, run.frames)
    html = hostile._repr_html_()
    assert reusable_sentence(run.summary).split(";")[0] in html and html.count("<table") >= 4
    assert "<script>" not in html and "&lt;script&gt;" in html


# Documentation


def test_examples_of_the_page_run(tmp_path, monkeypatch):
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    section = re.search(r"## Examples\n(.*?)\n## ", text, re.DOTALL)[1]
    examples = re.findall(r"```python\n(.*?)```", section, re.DOTALL)
    assert len(examples) >= 6
    (tmp_path / "assets").mkdir()
    shutil.copy(DEMO, tmp_path / "assets" / "demo.glb")
    monkeypatch.chdir(tmp_path)
    printed, names = io.StringIO(), {}
    with contextlib.redirect_stdout(printed):
        for example in examples:
            exec(compile(example, "docs/api.md", "exec"), names)
    assert "did you mean width?" in printed.getvalue() and (tmp_path / "frames.png").is_file()


@pytest.mark.long
def test_notebook_runs(tmp_path):
    nbformat, nbclient = pytest.importorskip("nbformat"), pytest.importorskip("nbclient")
    notebook = nbformat.read(DOCS / "notebooks" / "api.ipynb", as_version=4)
    assert all(not cell.get("outputs") for cell in notebook.cells), "stored without outputs"
    client = nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}})
    outputs = [output.get("data", {}) for cell in client.execute().cells for output in cell.get("outputs", [])]
    assert sum("image/png" in data for data in outputs) == 2
    assert sum("text/html" in data for data in outputs) == 2
