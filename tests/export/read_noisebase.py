"""Reads folders of format noisebase with its own loader, in its own environment, and prints JSON.

python read_noisebase.py FOLDER WIDTH HEIGHT FRAMES SAMPLES ...
"""

from __future__ import annotations

import json
import sys

import torch
from noisebase import Noisebase
from noisebase.torch import backproject_pixel_centers


def psnr(one: torch.Tensor, other: torch.Tensor) -> float:
    return float(-10 * torch.log10(((one - other) ** 2).mean()))


def read(folder: str, width: int, height: int, frames: int, samples: int) -> dict:
    source = {"files": "scene{index:04d}.zip", "sequences": 2, "frames_per_sequence": frames, "crop": height,
              "samples": samples, "rendering_width": width, "rendering_height": height}  # fmt: skip
    options = {"src": source, "data_path": folder, "samples": samples, "batch_size": 1, "num_workers": 0,
               "flip_rotate": False, "val_split": 0, "shuffle": False, "stage": "val"}  # fmt: skip
    out, before = {"unmoved": [], "moved": [], "swapped": []}, None
    for data in Noisebase("sampleset_v1", options):  # one batch of sequences is kept for validation: the first
        reference, motion = data["reference"], data["motion"].mean(-1).float()
        for name, vectors in (("unmoved", 0 * motion), ("moved", motion), ("swapped", motion.flip(1))):
            if before is not None:
                offsets = data["crop_offset"], data["prev_camera"]["crop_offset"]
                grid = backproject_pixel_centers(vectors, *offsets, as_grid=True).float()
                warped = torch.nn.functional.grid_sample(before, grid, padding_mode="border", align_corners=False)
                out[name].append(psnr(reference, warped))
        before = reference
    return out | {
        "motion": data["motion"][0, :, :, :, 0].tolist(), "depth": data["depth"][0, 0, :, :, 0].tolist(),
        "light": float(data["color"].mean()), "reference": float(data["reference"].mean()),
        "colors": list(data["color"].shape), "normal": float(data["normal"].norm(dim=1).max()),
    }  # fmt: skip


rows = [sys.argv[k : k + 5] for k in range(1, len(sys.argv), 5)]
print(json.dumps([read(folder, *map(int, numbers)) for folder, *numbers in rows]))
