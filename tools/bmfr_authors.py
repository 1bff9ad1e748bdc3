"""BMFR by the code of its authors, as a reuse method beside ours: the kernels run in a process of their own.

    taubench-gl reuse evaluate assets/demo.glb --methods bmfr,tools/bmfr_authors.py:AuthorsBmfr

``TAUBENCH_BMFR`` names the folder ``opencl`` of their repository, ``TAUBENCH_OPENCL_PYTHON`` a Python with pyopencl.
"""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

if str(Path(__file__).parent) not in sys.path:
    sys.path.append(str(Path(__file__).parent))

from peers import Peer

Array = np.ndarray

COPIED_INPUT = (
    (r"(__global float\* restrict current_noisy,)(\s+const __global float\* restrict previous_noisy)",
     r"\1 const __global float* restrict new_noisy,\2"),
    (r"(float3 current_color = load_float3\()current_noisy", r"\1new_noisy"),
)  # fmt: skip
"""Replacements in their kernel: the new samples are read from a buffer that nothing writes."""


SAME_BLOCKS = (r"BLOCK_OFFSETS\[frame_number % BLOCK_OFFSETS_COUNT\]", "(int2){16, 16}")
"""Replacement in their kernels: blocks in every frame as with ``bmfr@shift_blocks=false``."""


def their_inputs(frame: dict[str, Any], shift: float = 0.0, sky_distance: float = 30.0) -> dict[str, Array]:
    """The inputs of their program from those of a Python method: images (h, w, 3), row 0 at the bottom.

    ``noisy``: illumination, radiance without emission over ``albedo``; ``normal``, ``position``: world, meters, plus
    ``shift`` along each axis; ``matrix``: clip space of the previous camera from the world, for row vectors;
    ``offset``: the sample in its pixel, in [0, 1), x from the left, y from the top.
    """
    height, width = frame["position"].shape[:2]
    surface = frame["position"][..., 3:] > 0
    pair, view, before = frame["pair"], frame["view"], frame["prev_view"]
    x, up = np.meshgrid(np.arange(width), np.arange(height - 1, -1, -1))
    ray = (pair.sky_origin + x[..., None] * pair.sky_dx + up[..., None] * pair.sky_dy)[..., :3]
    sky = ray * (sky_distance / np.linalg.norm(ray, axis=-1, keepdims=True))
    albedo = np.where(surface, np.maximum(frame["base_color"][..., :3].astype(np.float64), 0.01), 1.0)
    light = frame["radiance"][..., :3] - np.where(surface, frame["exposure"] * frame["emission"][..., :3], 0.0)
    to_previous = np.eye(4)
    to_previous[:3, 3] = -(before.position + shift)
    images = {
        "noisy": light / albedo,
        "albedo": albedo,
        "normal": np.where(surface, frame["normal"][..., :3], 0.0),
        "position": np.where(surface, frame["position"][..., :3], sky) + view.position + shift,
    }
    return {name: np.float32(image[::-1]) for name, image in images.items()} | {
        "matrix": np.float32((frame["prev_clip_from_prev"] @ to_previous).T),
        "offset": np.float32(0.5 + frame["jitter_px"]),
    }


class AuthorsBmfr:
    name = "bmfr_authors"
    title = "BMFR, the authors' OpenCL code"
    cite = "Koskela et al. 2019, Blockwise Multi-Order Feature Regression, ACM TOG 38(5): their published code"
    reads = ("radiance", "position", "normal", "base_color", "emission")
    settings: ClassVar = {
        "position_limit": {"default": 0.1, "min": 0.001, "max": 10.0, "doc": "meters, as in bmfr"},
        "normal_limit": {"default": 1.0, "min": 0.01, "max": 2.0, "doc": "as in bmfr"},
        "taa": {"default": True, "doc": "the image after the temporal anti-aliasing; false: before it"},
        "half_floats": {"default": True, "doc": "features and color of the fit in 16 bits, as published"},
        "shift_blocks": {"default": True, "doc": "the published offsets; false: the blocks of bmfr@shift_blocks=false"},
        "separate_input": {"default": False, "doc": "pixels mirrored at the border read the new samples"},
        "shift": {"default": 0.0, "min": -100.0, "max": 100.0, "doc": "meters added to each world coordinate"},
        "sky_distance": {"default": 30.0, "min": 1.0, "max": 200.0, "doc": "meters; their code has no sky"},
        "group": {"default": 8, "min": 1, "max": 32, "doc": "width and height of work groups"},
    }

    def __init__(self, size, settings):
        self._settings = settings
        group = str(int(settings["group"]))
        request = {
            "defines": {"LOCAL_WIDTH": group, "LOCAL_HEIGHT": group},
            "limits": [settings["position_limit"] ** 2, settings["normal_limit"] ** 2],
            "replace": [*(COPIED_INPUT if settings["separate_input"] else ())],
            "copy": bool(settings["separate_input"]),
        }
        if not settings["half_floats"]:
            request["defines"]["USE_HALF_PRECISION_IN_TMP_DATA"] = "0"
        if not settings["shift_blocks"]:
            request["replace"].append(SAME_BLOCKS)
        python = os.environ.get("TAUBENCH_OPENCL_PYTHON") or sys.executable
        folder = os.environ.get("TAUBENCH_BMFR", "")
        self._peer = Peer.start("bmfr_opencl.py", folder, *map(str, size), json.dumps(request), python=python)
        if self._peer.missing:
            raise RuntimeError(self._peer.missing)

    def step(self, frame):
        images = self._peer.ask(**their_inputs(frame, self._settings["shift"], self._settings["sky_distance"]))
        encoded = images["result" if self._settings["taa"] else "shown"][::-1]
        linear = np.maximum(encoded, 0.0) ** 2.2  # the box of the anti-aliasing, in YCoCg, has negative colors
        surface = frame["position"][..., 3:] > 0
        return linear + np.where(surface, frame["exposure"] * frame["emission"][..., :3], 0.0)


class Surfaces:
    """What each pixel shows, as an image: 0 sky, 1 a still surface, 2 one that moved by more than a millimeter."""

    name = "surfaces"
    reads = ("position", "prev_position")

    def __init__(self, size, settings):
        pass

    def step(self, frame):
        moved = frame["prev_position"][..., :3] - frame["position"][..., :3] - frame["camera_delta"]
        surface = frame["position"][..., 3:] > 0
        kind = np.where(np.linalg.norm(moved, axis=-1, keepdims=True) > 1e-3, 2.0, 1.0)
        return np.where(surface, kind, 0.0) * np.ones(3)
