"""``taubench-gl paper`` with a small scene in place of a dataset and of a stand-in, at 32x18."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from click.testing import CliRunner
from fixed import fixed_settings

from taubench_gl.apps.cli import cli
from taubench_gl.benchmark import scenes as benchmark_scenes
from taubench_gl.conventions import Reason
from taubench_gl.datasets.gltf_from_scene import write_scene
from taubench_gl.datasets.registry import Entry, load_registry
from taubench_gl.datasets.scene_cache import CachedScene
from taubench_gl.datasets.stand_ins import STAND_INS
from taubench_gl.errors import DatasetError, SettingsError
from taubench_gl.evaluation import evaluate_scene
from taubench_gl.paper import figures, scenes
from taubench_gl.paper.figures import panel_size, telling_pair
from taubench_gl.paper.scenes import DATASET, STAND_IN, find_scenes
from taubench_gl.paper.study import PaperOptions, plan
from taubench_gl.paths import ASSETS
from taubench_gl.report.paper import paper_numbers
from taubench_gl.scene import load_scene
from taubench_gl.scene.builder import SceneBuilder, box, turn_y
from taubench_gl.settings import Settings

pytestmark = pytest.mark.usefixtures("coarse_light")

DEMO = ASSETS / "demo.glb"
SMALL = ("--size", "32x18", "--quick")


def room():
    """A box that moves in a room with a lamp, and a camera that walks and turns, for a second."""
    b = SceneBuilder()
    b.node(mesh=b.mesh(box((4.0, 2.0, 4.0), inside=True)))
    b.animate(
        b.node(mesh=b.mesh(box((0.5, 0.5, 0.5)))), "translation", [0.0, 1.0], [(-1.5, -0.5, -1.0), (1.5, 0.2, -1.5)]
    )
    b.light(translation=(1.0, 1.5, 0.0), intensity=30.0)
    camera = b.camera(yfov=np.radians(70.0), znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 2.0), (0.5, 0.1, 1.5)])
    b.animate(camera, "rotation", [0.0, 1.0], [turn_y(-8.0), turn_y(12.0)])
    return b.build()


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory):
    """A cache with one dataset, a stand-in that takes no time, and small figures with few panels."""

    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TAUBENCH_CACHE", str(folder))
        write_scene(room(), folder / "room.glb")
        for name in STAND_INS:
            patch.setitem(benchmark_scenes.SHIPPED, name, folder / "room.glb")
        patch.setattr(figures, "SIZE", (32, 18))
        patch.setattr(figures, "TURNS", {"yaw": figures.TURNS["yaw"]})
        patch.setattr(figures, "COLUMNS", {name: figures.COLUMNS[name] for name in ("normal", "direct")})
        install("eternal-valley-vr", folder)
        yield folder


def install(name, cache):
    """Put the room into the cache as a dataset of the paper."""
    return CachedScene(name, load_registry()[name], cache).take(cache / "room.glb")


def resolved(text):
    from taubench_gl.apps.named_scenes import resolve

    return resolve(text)


def run(*arguments):
    return CliRunner().invoke(cli, ["paper", *map(str, arguments)])


def test_datasets_come_before_stand_ins():
    found = find_scenes((), resolved)
    assert {scene.name: scene.kind for scene in found.scenes} == {
        "eternal-valley-fps": STAND_IN, "eternal-valley-vr": DATASET,
    }  # fmt: skip
    assert set(found.missing) == {"bistro-interior", "bistro-exterior", "emerald-square", "toasters"}
    fps, vr = found.scenes
    assert vr.fitted == frozenset() and "counts" in fps.fitted
    assert vr.settings["fps"] == 24.0 and vr.camera_settings["fps"] == 60.0
    assert vr.settings["exposure"] == 1.0 and "exposure" not in fps.settings
    jobs = plan(found.scenes, PaperOptions(lights=("raster", "path-traced"), spp=3))
    assert list(jobs[0].images) == ["raster", "raster, 60 fps", "path-traced", "path-traced, 60 fps"]
    assert [job.settings.sequence.fps for job in jobs[0].parts.values()] == [60.0, 24.0, 60.0, 24.0, 60.0]
    assert jobs[0].images["path-traced"].settings.lighting.spp == 3
    assert len({job.id for scene in jobs for job in scene.parts.values()}) == 10
    assert list(plan(found.scenes, PaperOptions(fps=(60.0,)))[0].images) == ["auto, 60 fps"]


def test_a_named_scene_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(DatasetError, match="bistro-interior"):
        find_scenes(("BistroInterior",), resolved)
    with pytest.raises(DatasetError, match="no scene is named"):
        find_scenes(("bart-kitchen",), resolved)
    assert isinstance(run("bistro-interior", "--out", tmp_path / "out").exception, DatasetError)


@pytest.fixture(scope="module")
def finished(cache, tmp_path_factory):
    out = tmp_path_factory.mktemp("paper") / "out"
    done = run("--out", out, *SMALL, "--light", "raster", "--lobe", "diffuse")
    assert done.exit_code == 0, done.output
    return out, done


def test_everything_from_one_command(finished, cache):
    out, _ = finished
    file = cache / "room.glb"
    values = json.loads((out / "paper.json").read_text())
    fps, vr = values["scenes"]
    assert (fps["kind"], vr["kind"]) == (STAND_IN, DATASET)
    for scene in (fps, vr):  # both are the room
        assert scene["camera_fps"] == 60.0 and scene["images"]["raster"]["settings"]["fps"] == 24.0
        assert scene["images"]["raster"]["lobes"]["diffuse"]["direct"]["mean_percent"] >= 0.0
    settings = Settings(
        width=32, height=18, pairs="strata:4", light="raster", exposure=1.0, columns=("frustum", "normal")
    )
    once = evaluate_scene(file, settings)
    for name in ("frustum", "normal"):
        assert vr["images"]["raster"]["discard"][name] == once.summary["discard"][name]
    whole = evaluate_scene(file, Settings(width=32, height=18, fps=60.0, columns=("frustum",), pairs="all"))
    assert vr["position"]["mean"] == whole.summary["camera"]["position"]["mean"]
    assert vr["camera_samples"] == whole.summary["pairs"]
    assert vr["census"]["dynamic_point_lights"] == whole.summary["census"]["dynamic_point_lights"]
    residuals = values["thresholds"]["normal"]["residuals"]
    assert list(residuals) == ["eternal-valley-vr"]
    page = (out / "paper.html").read_text()
    assert page.count("data:image/png") == 4 and "http" not in page.partition("<main")[2].replace("http://www.w3", "")


WRONG = [{"fps": rates} for rates in ((), (0.0,), (24.0, 24.0), (float("inf"),))] + [{"spp": 8}, {"lights": ("sun",)}]


@pytest.mark.parametrize("options", WRONG)
def test_wrong_options_are_refused(options):
    """Rates of Table 4 are different numbers; samples per pixel are of path-traced light."""
    with pytest.raises(SettingsError):
        PaperOptions(**options)


def test_table_4_has_both_rates_and_intervals_within_0_and_100_percent(finished):
    """The ends of every interval hold its estimate, and lie within what a share can be."""
    out, _ = finished
    values = json.loads((out / "paper.json").read_text())
    for scene in values["scenes"]:
        assert [scene["images"][name]["settings"]["fps"] for name in ("raster", "raster, 60 fps")] == [24.0, 60.0]
        for image in scene["images"].values():
            for column in image["sampling"]["columns"].values():
                low, high = column["interval95_percent"]
                assert 0.0 <= low <= column["mean_percent"] <= high <= 100.0
    rows = {}
    for line in (out / "tables.md").read_text().split("Table 4")[1].splitlines():
        if line.startswith("| "):
            label, *cells = (cell.strip() for cell in line.strip("|").split("|"))
            rows.setdefault(label, cells)
    label = "Eternal Valley VR, dataset, raster, 60 fps"
    ours, low, high = (rows[f"{label}{end}"] for end in ("", ", 95 % from", ", 95 % to"))
    assert ours[6:8] == low[6:8] == high[6:8] == ["60", "8"], ours
    low, ours, high = ([float(cell.removeprefix("&lt;")) for cell in row[:4]] for row in (low, ours, high))
    assert all(0 <= a <= b <= c <= 100 for a, b, c in zip(low, ours, high))


def test_figure_2_keeps_misregistration_apart():
    """Discards whose point the previous camera saw at rest have a color of their own, in no other reason's pixels."""
    camera = figures.camera_of_run(scene := load_scene(DEMO), Settings().sequence)
    settings = fixed_settings(width=32, height=18, light="raster", exposure=1.0, frames=(30, 32), reprojection="motion",
                        columns=("frustum", "position", "color"))  # fmt: skip
    shown, _ = figures._pair(scene, settings, camera, column="position")
    exact = evaluate_scene(DEMO, settings.replace(exact=True)).frames[0]
    assert shown.wrong.sum() == exact["misregistered_position"] > 0
    assert ((shown.mask[shown.wrong] & Reason.POSITION) != 0).all()
    reasons = (Reason.DISOCCLUDED, Reason.OCCLUDING)
    image, plain = figures._mask_image(shown, reasons), figures.overlay(shown.mask, shown.now, *reasons)
    np.testing.assert_array_equal(image[~shown.wrong], plain[~shown.wrong])
    assert (image[shown.wrong] != plain[shown.wrong]).any(axis=-1).all()
    assert figures._pair(scene, settings, camera, column="direct")[0].wrong is None


def test_rows_are_beside_the_papers_with_the_difference(finished):
    out, _ = finished
    lines = [line.split("|") for line in (out / "tables.md").read_text().splitlines() if line.startswith("| ")]
    labels = [line[1].strip() for line in lines]
    for row, kind in (("Eternal Valley FPS", STAND_IN), ("Eternal Valley VR", DATASET)):
        assert f"{row}, {kind}" in labels and f"{row}, {kind}, raster" in labels and f"{row} (paper)" in labels
    at = labels.index("Eternal Valley VR, dataset")
    ours, theirs, difference = ([int(cell) for cell in line[2:6]] for line in lines[at : at + 3])
    assert theirs == [491, 34, 63, 626]
    assert difference == [a - b for a, b in zip(ours, theirs)]
    marked = {label for label, line in zip(labels, lines) if any("¹" in cell or "²" in cell for cell in line[2:])}
    assert {"Eternal Valley FPS, stand-in", "Eternal Valley FPS, stand-in, raster"} <= marked
    assert not {"Eternal Valley VR, dataset", "Eternal Valley VR, dataset, raster"} & marked


def test_the_latex_file_is_well_formed(finished):
    """Environments and braces nest, every row has the cells of its table, and no special character is bare."""
    out, _ = finished
    text = (out / "paper.tex").read_text()
    stack = []
    for kind, name in re.findall(r"\\(begin|end)\{(\w+)\}", text):
        assert kind == "begin" or stack[-1] == name
        stack = [*stack, name] if kind == "begin" else stack[:-1]
    assert not stack and text.rstrip().endswith(r"\end{document}") and text.isascii()
    plain = re.sub(r"\\.", "", text.replace("\\\\", ""))
    assert plain.count("{") == plain.count("}")
    tables = re.findall(r"\\begin\{tabular\}\{(\w+)\}(.*?)\\end\{tabular\}", text, re.S)
    assert len(tables) == text.count(r"\begin{table}") == 6
    for columns, body in tables:
        rows = [line for line in body.splitlines() if line.endswith(r"\\")]
        assert rows and all(len(re.findall(r"(?<!\\)&", line)) == len(columns) - 1 for line in rows)
        assert not re.findall(r"(?<!\\)[#%_^]", body.replace("$^2$", ""))
    assert all((out / file).is_file() for file in re.findall(r"\\includegraphics\[.*?\]\{(.*?)\}", text))


def test_a_repeated_command_draws_nothing(finished, monkeypatch):
    out, _ = finished
    before = {path: path.read_bytes() for path in out.rglob("*") if path.is_file()}

    def refuse(*_args, **_more):
        raise AssertionError("a pair was drawn again")

    monkeypatch.setattr("taubench_gl.batch.units.PairsUnit.run", refuse)
    monkeypatch.setattr(figures, "evaluate_scene", refuse)
    again = run("--out", out, *SMALL, "--light", "raster", "--lobe", "diffuse")
    assert again.exit_code == 0, again.output
    assert {path: path.read_bytes() for path in out.rglob("*") if path.is_file()} == before


def test_too_many_workers_are_refused_before_anything_is_made(tmp_path):
    done = run(*SMALL, "--workers", 100000, "--out", tmp_path / "out")
    assert isinstance(done.exception, SettingsError)
    assert not (tmp_path / "out").exists()


def test_panels_of_figures_are_no_larger_than_the_images():
    panels = {"1920x1080": (32, 18), "32x18": (32, 18), "16x9": (16, 9), "72x18": (32, 8)}
    assert {text: panel_size(Settings(size=text)) for text in panels} == panels


def test_the_pair_of_a_figure_is_calm_and_no_cut():
    rows = [
        {"frame": 1, "frustum": 0, "normal": 5, "camera_cut": False},
        {"frame": 2, "frustum": 1, "normal": 9, "camera_cut": True},
        {"frame": 3, "frustum": 2, "normal": 7, "camera_cut": False},
        {"frame": 4, "frustum": 90, "normal": 50, "camera_cut": False},
    ]
    assert telling_pair(rows, "normal") == 3
    assert telling_pair(rows, "direct") is None


def test_the_registry_has_every_row_of_the_paper_and_others_are_left_out():
    entries = load_registry()
    names = {scene["name"] for scene in paper_numbers()["scenes"]}
    own = {"mine": Entry(title="mine", format="gltf", paper="another paper's row")}
    assert {entry.paper for entry in scenes.paper_entries(entries | own).values()} == names


@pytest.mark.long
def test_both_browsers_open_the_page(finished, both_browsers):
    both_browsers(finished[0] / "paper.html", "table tbody th")
