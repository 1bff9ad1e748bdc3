"""Maps of an environment image, as passes declare them and as textures."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

import numpy as np

from taubench_gl.effects.lighting import Environment
from taubench_gl.gpu.declare import ComputePass, Resource
from taubench_gl.metrics.environment import (
    LOBE_HEIGHT,
    LOBE_LEVELS,
    SEEN_HEIGHT,
    EnvironmentMaps,
    environment_maps,
    seen_map,
)
from taubench_gl.scene.environment import EnvironmentImage, read_environment

Array = np.ndarray

MAP, LOBES = "environment_map", "environment_lobes"
"""Textures: the radiance itself; irradiance and prefiltered radiance, one map after another."""


def image_of(environment: Environment) -> EnvironmentImage:
    """The image of an environment of kind ``image``.  Raises SettingsError."""
    return read_environment(environment.path)


def maps_of(environment: Environment) -> EnvironmentMaps:
    """The maps of an environment of kind ``image``, computed once while its file does not change."""
    image = image_of(environment)
    return _maps(image.path, image.sha256)


def seen_of(environment: Environment) -> Array:
    """The map of an environment of kind ``image`` as it is seen, (h, 2 h, 3) float64."""
    image = image_of(environment)
    return _seen(image.path, image.sha256)


@lru_cache(maxsize=2)
def _seen(path: Path, sha256: str) -> Array:
    return seen_map(read_environment(path).radiance)


@lru_cache(maxsize=2)
def _maps(path: Path, sha256: str) -> EnvironmentMaps:
    return environment_maps(read_environment(path).radiance)


def declare_environment(p: ComputePass, environment: Environment, *, lobes: bool, owned: bool) -> ComputePass:
    """Give ``p`` the maps: of the environment as it is seen, with ``lobes`` also those that surfaces reflect.

    ``owned``: the pass allocates them.  Nothing where the environment is no image.
    """
    if environment.kind != "image":
        return p
    p.define(ENVIRONMENT_IMAGE=True, ENVIRONMENT_LOBES=lobes)
    p.texture(MAP, filled=True)
    if lobes:
        p.texture(LOBES, filled=True)
        p.glsl(f"const int LOBE_HEIGHT = {LOBE_HEIGHT}, LOBE_LEVELS = {LOBE_LEVELS};")
    if owned:
        height = min(image_of(environment).size[1], SEEN_HEIGHT)
        p.allocate(Resource.texture(MAP, (2 * height, height), label="environment"))
        if lobes:
            rows = LOBE_HEIGHT * (LOBE_LEVELS + 1)
            p.allocate(Resource.texture(LOBES, (2 * LOBE_HEIGHT, rows), label="environment"))
    return p


def texels(environment: Environment, name: str) -> Array:
    """Contents of a texture, MAP or LOBES: (h, w, 4) float32."""
    if name == MAP:
        return _rgba(seen_of(environment))
    return _rgba(maps_of(environment).lobes.reshape(-1, 2 * LOBE_HEIGHT, 3))


def _rgba(rgb: Array) -> Array:
    out = np.ones((*rgb.shape[:2], 4), dtype=np.float32)
    out[..., :3] = rgb
    return out
