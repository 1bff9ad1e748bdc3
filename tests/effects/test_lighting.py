"""Light unit and environment: what ``auto`` stands for."""

from __future__ import annotations

import dataclasses

import pytest

from taubench_gl.effects.lighting import (
    as_rendered,
    environment_for,
    environment_of,
    light_unit_in,
    light_unit_of,
    own_light,
    without_auto,
)
from taubench_gl.scene.builder import SceneBuilder, box
from taubench_gl.settings import FIXED_LIGHTING, Settings

AUTO = dict.fromkeys(FIXED_LIGHTING, "auto")


def scene(generator: str = "", *, lights: int = 0, image_based: bool = False, drawn: bool = True, **material):
    b = SceneBuilder()
    one = b.material(**material)
    other = b.material()
    b.node(mesh=b.mesh(box(material=one if drawn else other)))
    for _ in range(lights):
        b.light(kind="point", intensity=5.0)
    return dataclasses.replace(b.build(), generator=generator, image_based_light=image_based)


@pytest.mark.parametrize(
    ("generator", "unit"),
    [
        ("Khronos glTF Blender I/O v3.6.28", "watt"),
        ("Khronos glTF Blender I/O v4.5.51", "watt"),
        ("Khronos glTF Blender I/O v10.0.1", "watt"),
        ("Khronos glTF Blender I/O v3.4.50", "watt"),
        ("Khronos glTF Blender I/O v3.3.27", "candela"),
        ("Khronos glTF Blender I/O v0.9.36", "candela"),
        ("Khronos Blender glTF 2.0 exporter", "candela"),
        ("Khronos glTF Blender I/O", "candela"),
        ("my Khronos glTF Blender I/O v4.5.51", "candela"),
        ("UnityGLTF", "candela"),
        ("", "candela"),
    ],
)
def test_light_unit_of_the_generator(generator, unit):
    made = scene(generator)
    assert light_unit_of(made).value == without_auto(made, Settings(**AUTO)).lighting.light_unit == unit
    for given in ("watt", "candela"):
        assert without_auto(made, Settings(light_unit=given)).lighting.light_unit == given


@pytest.mark.parametrize(
    ("content", "environment"),
    [
        ({}, "default"),
        ({"lights": 1}, "none"),
        ({"image_based": True}, "none"),
        ({"emissive": (1.0, 0.5, 0.2)}, "default"),
        ({"emissive": (5.0, 2.5, 1.0), "emissive_strength": 5.0}, "none"),
        ({"emissive": (0.5, 0.1, 0.1), "emissive_strength": 5.0}, "none"),
        ({"emissive": (0.0, 0.0, 0.0), "emissive_strength": 5.0}, "default"),
        ({"emissive": (5.0, 2.5, 1.0), "emissive_strength": 5.0, "drawn": False}, "default"),
        ({"unlit": True}, "default"),
    ],
)
def test_environment_of_files_with_and_without_light(content, environment):
    assert environment_for(scene(**content)).value == environment
    assert (own_light(scene(**content)) is None) == (environment == "default")


@pytest.mark.parametrize("value", ["none", "default", (0.1, 0.2, 0.3), "room.hdr"])
def test_a_given_environment_stays(value):
    assert without_auto(scene(), Settings(environment=value)).lighting.environment == value


def test_environment_records():
    kinds = {"none": "none", "default": "default", "room.exr": "image", (0.0, 0.5, 1.0): "uniform"}
    for value, kind in kinds.items():
        found = environment_of(Settings(environment=value))
        assert found.kind == kind and found.reason and found.shines == (kind != "none")
    assert environment_of(Settings(environment=(0.0, 0.5, 1.0))).radiance == (0.0, 0.5, 1.0)
    assert not environment_of(Settings(environment=(0.0, 0.0, 0.0))).shines


def test_unresolved_settings_are_an_error_below_the_entry_points():
    for read in (environment_of, light_unit_in, lambda s: s.lighting.exposure_factor):
        with pytest.raises(ValueError, match="resolve_lighting"):
            read(Settings(**AUTO))
    assert not Settings(**AUTO).lighting.resolved and Settings(**FIXED_LIGHTING).lighting.resolved


def test_path_traced_files_are_taken_as_they_were_rendered():
    assert as_rendered(Settings(**AUTO)) == Settings(**FIXED_LIGHTING, pairs="all")
    assert as_rendered(Settings(**AUTO | {"exposure": 2.0})).lighting.exposure == 2.0
