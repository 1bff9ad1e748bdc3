"""Stored Cycles renders of the scenes of tools/light_transport_scenes.py, and the statistics of their seeds.

Per scene: NAME.glb (and NAME.exr, the environment), NAME/frame_NNNN.exr with direct and indirect radiance (half) and
planar depth (float), means over all seeds, NAME/camera.json, and NAME/blocks.npz with the means of 4x4 pixels of the
second frame: ``mean`` over the seeds and unbiased ``variance`` of one seed, (k, h / 4, w / 4, 3), order KINDS, or
GLASS_KINDS of scenes with glass.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from fixed import fixed_settings
from references.significance import Estimate

from taubench_gl.lobes import SCENE_LOBES
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.run import Run
from taubench_gl.settings import Settings

FOLDER = Path(__file__).parent / "light_transport"
MAPPING = FOLDER / "mapping.toml"
BLOCKS_FILE, SCENES_FILE = "blocks.npz", "scenes.json"
SIZE, FPS, FRAMES = (96, 56), 24.0, range(5, 7)
SEEDS, BOUNCES, BLOCK = range(1, 17), 12, 4
LOBES = ("diffuse_direct", "glossy_direct", "diffuse_indirect", "glossy_indirect")
KINDS = (*LOBES, "direct", "indirect")
GLASS = ("glass_ball", "glass_panes", "rough_glass", "amber")
GLASS_SEEDS = range(1, 9)
GLASS_LOBES = tuple(f"{lobe}_{bounce}" for bounce in ("direct", "indirect") for lobe in SCENE_LOBES)
GLASS_KINDS = (*GLASS_LOBES, "direct", "indirect")
COLUMNS = ("frustum", "position", "direct", "indirect")


@dataclass(frozen=True)
class Reference:
    """Cycles' renders of one scene."""

    name: str
    environment: str | tuple[float, float, float]  # value of the setting
    samples: int  # per pixel and seed

    @property
    def scene(self) -> Path:
        return FOLDER / f"{self.name}.glb"

    @property
    def frames(self) -> Path:
        return FOLDER / self.name

    @property
    def kinds(self) -> tuple[str, ...]:
        """What the blocks are of."""
        return GLASS_KINDS if self.name in GLASS else KINDS

    def blocks(self) -> Estimate:
        """Mean radiance of blocks, (kind, row, column, rgb), order ``kinds``; row 0 is the top."""
        with np.load(self.frames / BLOCKS_FILE) as file:
            return Estimate(file["mean"].astype(np.float64), file["variance"].astype(np.float64), int(file["count"]))

    def settings(self, **values) -> Settings:
        """Settings of a run with the camera and frames of the renders, in their units."""
        fixed = {
            "size": SIZE, "fps": FPS, "frames": (FRAMES[0], FRAMES[-1] + 1), "columns": COLUMNS, "textures": "finest",
            "light_unit": "watt", "exposure": 1.0, "environment": self.environment,
        }  # fmt: skip
        return fixed_settings(**(fixed | values))

    def evaluate(self) -> Run:
        """Columns of the stored pair."""
        options = PathTracedOptions(camera_file=self.frames / "camera.json", mapping=MAPPING)
        return evaluate_path_traced(f"exr:{self.frames}", fixed_settings(columns=COLUMNS), options)


def references() -> dict[str, Reference]:
    """Every stored scene, by name."""
    out = {}
    for name, values in json.loads((FOLDER / SCENES_FILE).read_text()).items():
        environment = values["environment"]
        if environment == "image":
            environment = str(FOLDER / f"{name}.exr")
        environment = tuple(environment) if isinstance(environment, list) else environment
        out[name] = Reference(name, environment, values["samples"])
    return out
