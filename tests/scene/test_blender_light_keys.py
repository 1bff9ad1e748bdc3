"""Keys of lights that Blender's glTF exporter writes in other units than the lights themselves.

The numbers are those of files that bpy 4.2.23, 4.5.15 and 5.0.1 wrote (exporter 4.2.83, 4.5.51 and 5.0.21, which agree)
with export_pointer_animation and export_animation_mode SCENE: a point light of 100 W, a spot light of 200 W (size 1.2,
blend 0.25) and a sun of 2 W/m2, strengths keyed to double by frame 5.  ``BLEND`` and ``ANGLE``: of blend and size.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from gltf_builders import LIGHT, pointer
from gltf_files import Gltf

from taubench_gl.scene import load_scene
from taubench_gl.scene.gltf.blender import KEYS_SEEN, KEYS_SINCE
from taubench_gl.scene.model import Scene

POINT, SPOT, SUN = range(3)
TIMES = np.arange(1, 6) / 24
RISE = np.array([1.0, 1.15625, 1.5, 1.84375, 2.0])
STATIC = (5435.141306588225, 10870.28261317645, 1366.0)
INNER, OUTER = 0.45000001788139343, 0.6000000238418579
KEYS = (68300.0 * RISE, 136600.0 * RISE, 2.0 * RISE)
BLEND = np.array([0.25, 0.2890625, 0.375, 0.4609375, 0.5])
ANGLE = np.array([0.6, 0.609375, 0.63, 0.650625, 0.66])
VERSIONS = ["4.2.83", "4.5.51", "5.0.21", "5.3.18"]


def written(version: str = "5.0.21", static=STATIC, keys=KEYS, program: str = "Khronos glTF Blender I/O v") -> Gltf:
    gltf = Gltf()
    gltf.json["asset"]["generator"] = program + version
    cone = {"innerConeAngle": INNER, "outerConeAngle": OUTER}
    kinds = ({"type": "point"}, {"type": "spot", "spot": cone}, {"type": "directional"})
    gltf.extension("KHR_lights_punctual", {"lights": [{"intensity": i} | k for i, k in zip(static, kinds)]})
    gltf.extension("KHR_animation_pointer")
    for light in range(3):
        gltf.node(extensions={"KHR_lights_punctual": {"light": light}})
    for light, values in enumerate(keys):
        gltf.animation(pointer(f"{LIGHT[:-1]}{light}/intensity"), TIMES, values)
    return gltf


def keys_of(scene: Scene, light: int, path: str = "intensity") -> np.ndarray:
    (found,) = [c for c in scene.channels if (c.target, c.index, c.path) == ("light", light, path)]
    return found.values[:, 0]


def counts(scene: Scene) -> dict[str, int]:
    return {note.kind: note.count for note in scene.notes if note.kind}


@pytest.mark.parametrize("version", VERSIONS)
def test_intensities_are_in_the_unit_of_the_light(tmp_path: Path, version: str) -> None:
    scene = load_scene(written(version).save(tmp_path))
    for light, static in enumerate(STATIC):
        np.testing.assert_allclose(keys_of(scene, light), static * RISE, rtol=1e-6)
    assert counts(scene) == {"blender-intensity": 3}


@pytest.mark.parametrize("fields", [{"version": "4.1.63"}, {"program": "another exporter v"}])
def test_other_programs_are_read_as_written(tmp_path: Path, fields: dict) -> None:
    scene = load_scene(written(**fields).save(tmp_path))
    for light, keys in enumerate(KEYS):
        np.testing.assert_allclose(keys_of(scene, light), keys, rtol=1e-6)
    assert counts(scene) == {}


def test_strict_reads_by_the_book(tmp_path: Path) -> None:
    gltf = written()
    gltf.animation(pointer(f"{LIGHT}/spot.outerConeAngle"), TIMES, ANGLE)
    scene = load_scene(gltf.save(tmp_path), strict=True)
    for light, keys in enumerate(KEYS):
        np.testing.assert_allclose(keys_of(scene, light), keys, rtol=1e-6)
    assert counts(scene) == {"not-animated": 1}


FADE = np.linspace(0.0, 1.0, 5)


@pytest.mark.parametrize(("shares", "curve", "factor"), [
    ((0.0,) * 3, FADE, 1.0), ((2.0,) * 3, RISE, 1.0), ((32.0,) * 3, RISE, 32.0),
], ids=["off in the first frame", "written at the last key", "an exposure of 5 stops"])  # fmt: skip
def test_the_static_strength_of_a_light(tmp_path: Path, shares: tuple, curve: np.ndarray, factor: float) -> None:
    """Blender writes the strength of the current frame, and from 4.5 on the light's exposure, which its keys lack."""
    static = tuple(share * i for share, i in zip(shares, STATIC))
    keys = tuple(scale * curve for scale in (68300.0, 136600.0, 2.0))
    scene = load_scene(written(static=static, keys=keys).save(tmp_path))
    for light, strength in enumerate(STATIC):
        np.testing.assert_allclose(keys_of(scene, light), factor * strength * curve, rtol=1e-6)


def test_unitless_and_raw_files(tmp_path: Path) -> None:
    """The lighting mode changes what is missing: Unitless has no 683 lm/W, Raw also no 4 pi."""
    watts = (100.0, 200.0, 2.0)
    keys = tuple(w * RISE for w in watts)
    unitless = load_scene(written(static=(100 / (4 * math.pi), 200 / (4 * math.pi), 2.0), keys=keys).save(tmp_path))
    assert counts(unitless) == {"blender-intensity": 2}
    raw = load_scene(written(static=watts, keys=keys).save(tmp_path))
    assert counts(raw) == {}
    for scene in (unitless, raw):
        for light in range(3):
            np.testing.assert_allclose(keys_of(scene, light), scene.lights[light].intensity * RISE, rtol=1e-6)


def test_an_exporter_that_writes_the_right_unit_some_day(tmp_path: Path) -> None:
    keys = tuple(i * RISE for i in STATIC)
    assert KEYS_SINCE < KEYS_SEEN
    later = f"{KEYS_SEEN[0]}.{KEYS_SEEN[1] + 1}.0"
    for static, values in ((STATIC, keys), ((0.0, 0.0, 0.0), tuple(i * FADE for i in STATIC))):
        scene = load_scene(written(later, static, values).save(tmp_path))
        assert counts(scene) == {}
        for light in range(3):
            np.testing.assert_allclose(keys_of(scene, light), values[light], rtol=1e-6)
    scene = load_scene(written(later).save(tmp_path))  # it does not yet
    np.testing.assert_allclose(keys_of(scene, SUN), 1366.0 * RISE, rtol=1e-6)


def test_what_convert_wrote_has_the_right_unit(tmp_path: Path) -> None:
    gltf = written(static=(0.0, 0.0, 0.0), keys=tuple(i * FADE for i in STATIC))
    gltf.json["asset"]["extras"] = {"taubench_gl": {"name": "lamps", "note": "converted from lamps.blend"}}
    scene = load_scene(gltf.save(tmp_path))
    assert keys_of(scene, POINT)[-1] == pytest.approx(STATIC[POINT]) and counts(scene) == {}


@pytest.mark.parametrize(("version", "inner"), [
    ("4.2.83", BLEND), ("5.0.21", BLEND), ("5.2.39", BLEND), ("5.3.18", (1.0 - BLEND) * ANGLE),
])  # fmt: skip
def test_cones(tmp_path: Path, version: str, inner: np.ndarray) -> None:
    """The exporter's pointers have a dot, and until 5.2 the inner angle is the blend."""
    gltf = written(version, keys=())
    gltf.animation(pointer(f"{LIGHT}/spot.innerConeAngle"), TIMES, inner)
    gltf.animation(pointer(f"{LIGHT}/spot.outerConeAngle"), TIMES, ANGLE)
    # One animation for each light, as Blender has it.
    first, second = gltf.json["animations"]
    first["samplers"] += second["samplers"]
    first["channels"].append(second["channels"][0] | {"sampler": 1})
    del gltf.json["animations"][1]
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(keys_of(scene, SPOT, "outer_cone"), ANGLE, rtol=1e-6)
    np.testing.assert_allclose(keys_of(scene, SPOT, "inner_cone"), (1.0 - BLEND) * ANGLE, rtol=1e-6)
    assert counts(scene) == {"blender-cone": 1}


def test_one_part_of_a_cone(tmp_path: Path) -> None:
    """What is constant has no keys: a blend stays the same share of a growing cone, and a size stays as it is."""
    size, blend = (written(keys=()) for _ in range(2))
    size.animation(pointer(f"{LIGHT}/spot.outerConeAngle"), TIMES, ANGLE)
    grows = load_scene(size.save(tmp_path))
    np.testing.assert_allclose(keys_of(grows, SPOT, "inner_cone"), 0.75 * ANGLE, rtol=1e-6)
    np.testing.assert_allclose(keys_of(grows, SPOT, "outer_cone"), ANGLE, rtol=1e-6)
    blend.animation(pointer(f"{LIGHT}/spot.innerConeAngle"), TIMES, BLEND)
    softens = load_scene(blend.save(tmp_path))
    np.testing.assert_allclose(keys_of(softens, SPOT, "inner_cone"), (1.0 - BLEND) * OUTER, rtol=1e-6)
    assert {c.path for c in softens.channels} == {"inner_cone"}


def test_cubic_keys_of_cones_are_read(tmp_path: Path) -> None:
    """Blender writes none; a tool that edits its file may."""
    gltf = written(keys=())
    values = np.stack([0 * BLEND, BLEND, 0 * BLEND], axis=1).reshape(-1)
    gltf.animation(pointer(f"{LIGHT}/spot.innerConeAngle"), TIMES, values, "CUBICSPLINE")
    scene = load_scene(gltf.save(tmp_path))
    np.testing.assert_allclose(keys_of(scene, SPOT, "inner_cone"), (1.0 - BLEND) * OUTER, rtol=1e-6)
