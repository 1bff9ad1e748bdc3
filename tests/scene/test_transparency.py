"""Blended surfaces: how each setting draws them, what a run notes, and shares of the image of what is not simulated."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fixed import fixed_settings
from gltf_files import Gltf

from taubench_gl import evaluate
from taubench_gl.api import pairs
from taubench_gl.effects.path_tracing import left_out
from taubench_gl.evaluation.appearance import transparency_notes
from taubench_gl.frame.materials import with_blend
from taubench_gl.scene import Scene, load_scene
from taubench_gl.scene.builder import SceneBuilder, quad

SIZE = (160, 90)
SMALL = {"size": "160x90", "columns": "frustum,position,normal", "camera": "0"}
HALF = 4 * np.tan(0.35)  # half the height of the view at the distance of the pane


def pane(
    folder: Path, alpha: float, *, moving: bool = False, morph: bool = False, width: float = 20.0, **material: object
) -> Path:
    """A pane of glass ``width`` high and wide, 4 m in front of the camera; with ``morph`` it has a morph target."""
    gltf = Gltf()
    x = width / 2
    corners = np.float32([[-x, -x, 0], [x, -x, 0], [x, x, 0], [-x, x, 0]])
    gltf.node(mesh=gltf.mesh(corners, [0, 1, 2, 0, 2, 3]), name="pane")
    primitive = gltf.json["meshes"][0]["primitives"][0]
    primitive["material"] = 0
    if morph:
        primitive["targets"] = [{"POSITION": gltf.accessor(np.zeros((4, 3)))}]
    color = {"baseColorFactor": [1, 1, 1, alpha]}
    gltf.add("materials", {"name": "Glass", "alphaMode": "BLEND", "pbrMetallicRoughness": color, **material})
    gltf.json["extensionsUsed"] = list(material.get("extensions", {})) or ["KHR_texture_transform"]
    gltf.add("cameras", {"type": "perspective", "perspective": {"yfov": 0.7, "znear": 0.1}})
    node = gltf.node(camera=0, translation=[0, 0, 4])
    end = [0.05, 0.02, 4] if moving else [0, 0, 4]
    gltf.animation({"node": node, "path": "translation"}, [0, 1], [[0, 0, 4], end])
    return gltf.save(folder)


def covered(path: Path, blend: str) -> np.ndarray:
    """Which pixels of the last of two frames show a surface."""
    return last_channel(path, "ids", columns="position", blend=blend)[..., 0] > 0


def last_channel(scene: Path | Scene, name: str, **options: object) -> np.ndarray:
    for pair in pairs(scene, size="160x90", camera="0", frames="0:2", channels=(name,), **options):
        found = pair.read(name)
    return found


@pytest.mark.parametrize("alpha, share", [(0.3, 0.0), (0.5, 1.0), (0.8, 1.0)])
def test_cutoff(tmp_path: Path, alpha: float, share: float) -> None:
    assert covered(pane(tmp_path, alpha), "cutoff").mean() == share


@pytest.mark.parametrize("alpha", [0.0, 0.3])
def test_opaque(tmp_path: Path, alpha: float) -> None:
    assert covered(pane(tmp_path, alpha), "opaque").all()


@pytest.mark.parametrize("morph", [False, True], ids=["rigid", "posed"])
@pytest.mark.parametrize("alpha", [0.0, 0.2, 0.5, 0.9, 1.0])
def test_stochastic_coverage_is_alpha(tmp_path: Path, alpha: float, morph: bool) -> None:
    """A cell of the hash is about a pixel: 14,400 trials have a standard deviation of 0.4 percentage points."""
    found = covered(pane(tmp_path, alpha, morph=morph), "stochastic").mean()
    assert found == pytest.approx(alpha, abs=0.025 if 0 < alpha < 1 else 0.0)


@pytest.mark.parametrize("morph", [False, True], ids=["rigid", "posed"])
def test_stochastic_still_pairs_are_equal(tmp_path: Path, morph: bool) -> None:
    run = evaluate(pane(tmp_path, 0.4, morph=morph), frames="0:4", blend="stochastic", **SMALL)
    for column in ("frustum", "position", "normal"):
        assert run.summary["discard"][column]["max_percent"] == 0


def test_stochastic_noise_follows_the_surface(tmp_path: Path) -> None:
    """Under a slow camera fewer pixels change than the 2 a (1 - a) of independent thresholds."""
    run = evaluate(pane(tmp_path, 0.5, moving=True), frames="0:4", blend="stochastic", **SMALL)
    assert 0 < run.summary["discard"]["position"]["mean_percent"] < 25


def test_stochastic_shadows() -> None:
    """The shadow of a half-transparent pane lets through about half of the light."""
    b = SceneBuilder()
    glass = b.material(alpha_mode="BLEND", double_sided=True, base_color=(1.0, 1.0, 1.0, 0.5))
    b.node(mesh=b.mesh(quad(4.0, 4.0)))
    b.node(mesh=b.mesh(quad(4.0, 4.0, material=glass)), translation=(0.0, 0.0, 3.0))
    b.light(kind="directional")
    camera = b.camera(translation=(0.0, 0.0, 2.0), yfov=0.7, znear=0.1)
    b.animate(camera, "translation", [0.0, 1.0], [(0.0, 0.0, 2.0)] * 2)
    scene, fixed = b.build(), {"columns": "direct", "light_unit": "candela", "exposure": 1.0}

    def mean(**options: object) -> float:
        return float(last_channel(scene, "direct", **fixed, **options)[..., 0].mean())

    lit = mean(blend="stochastic", shadow_lights=0)
    assert mean(blend="opaque") == 0 and lit > 0
    assert mean(blend="stochastic") == pytest.approx(0.5 * lit, rel=0.05)


# Notes


def note_of(run, name: str) -> str:
    (found,) = [note for note in run.summary["notes"] if name in note]
    return found


def test_note_of_faint_surfaces(tmp_path: Path) -> None:
    """A pane of a quarter of the image: named, counted and measured."""
    run = evaluate(pane(tmp_path, 0.3, width=HALF), frames="0:3", **SMALL)
    share = 100 * (HALF / 2) ** 2 / (HALF**2 * 16 / 9)
    text = note_of(run, "Glass")
    assert "--blend" in text and "0, 1, 2" in text
    assert abs(float(text.split(" %")[0].split()[-1]) - share) < 0.6


@pytest.mark.parametrize("alpha", [0.5, 0.9])
def test_no_note_where_nothing_is_faint(tmp_path: Path, alpha: float) -> None:
    run = evaluate(pane(tmp_path, alpha), frames="0:2", **SMALL)
    assert not [note for note in run.summary["notes"] if "Glass" in note]


def test_note_of_an_extension_has_its_share(tmp_path: Path) -> None:
    path = pane(tmp_path, 1.0, width=HALF, extensions={"KHR_materials_transmission": {"transmissionFactor": 1}})
    run = evaluate(path, frames="0:2", **SMALL)
    text = note_of(run, "KHR_materials_transmission")
    assert "1 of 1 objects" in text and "Glass" in text and " % of pixels" in text
    scene = load_scene(path)
    (note,) = left_out(scene, fixed_settings(light="auto"))
    assert not scene.notes and (note.kind, note.count, note.materials) == ("glass", 1, frozenset({0}))
    assert not left_out(scene, fixed_settings(light="path-traced"))


def test_required_appearance_extension(tmp_path: Path) -> None:
    """Read with a note by default; strictly refused."""
    from gltf_builders import refuse

    gltf = Gltf()
    gltf.node(mesh=gltf.mesh())
    gltf.json["extensionsUsed"] = gltf.json["extensionsRequired"] = ["KHR_materials_clearcoat"]
    (note,) = load_scene(gltf.save(tmp_path)).notes
    assert note.kind == "extension" and "clearcoat" in note.message
    refuse(gltf.save(tmp_path), "/extensionsRequired/0")


def test_inspect_knows_the_materials_own_alpha(tmp_path: Path) -> None:
    (text,) = transparency_notes(load_scene(pane(tmp_path, 0.3)), "cutoff")
    assert "Glass" in text and " %" not in text
    assert not transparency_notes(load_scene(pane(tmp_path, 0.6)), "cutoff")


def test_scenes_without_blended_materials_are_unchanged(tmp_path: Path) -> None:
    scene = load_scene(pane(tmp_path, 0.3, alphaMode="MASK"))
    assert all(with_blend(scene, blend) is scene for blend in ("cutoff", "opaque", "stochastic"))
