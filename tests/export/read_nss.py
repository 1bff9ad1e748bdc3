"""Reads folders of format nss with the data set of ng-model-gym, in its own environment, and prints JSON.

python read_nss.py FOLDER ...
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from types import SimpleNamespace

import torch
from ng_model_gym.core.data.data_utils import DataLoaderMode, ToneMapperMode
from ng_model_gym.core.model.layers.dense_warp import DenseWarp
from ng_model_gym.usecases.nss.data.dataset import NSSDataset

WINDOW = 3


def psnr(one: torch.Tensor, other: torch.Tensor) -> float:
    return float(-10 * torch.log10(((one - other) ** 2).mean()))


def read(folder: Path) -> dict:
    path = SimpleNamespace(train=folder, validation=folder, test=folder)
    data = SimpleNamespace(path=path, gt_augmentation=False, exposure=None, tonemapper=ToneMapperMode.KARIS)
    config = SimpleNamespace(dataset=data, model=SimpleNamespace(recurrent_samples=WINDOW))
    dataset = NSSDataset(config, DataLoaderMode.TRAIN)
    inputs, truth = dataset[0]
    warped, unwarped, swapped = [], [], []
    for frame in range(1, WINDOW):
        now, before, motion = truth[frame][None], truth[frame - 1][None], inputs["motion"][frame][None]
        warped.append(psnr(now, DenseWarp()([before, motion])))
        swapped.append(psnr(now, DenseWarp()([before, motion.flip(1)])))
        unwarped.append(psnr(now, before))
    health = None
    try:
        dataset.health_check(torch.utils.data.DataLoader(dataset, batch_size=1))
    except AssertionError as error:
        health = str(error)
    return {
        "windows": [[start, stop] for _, start, stop in dataset.frame_indexes],
        "shapes": {name: list(values.shape) for name, values in inputs.items()} | {"truth": list(truth.shape)},
        "health": health, "warped": warped, "unwarped": unwarped, "swapped": swapped,
        "light": float(inputs["colour_linear"].mean() / inputs["ground_truth_linear"].mean()),
        "exposure": float(inputs["exposure"].mean()),
    }  # fmt: skip


print(json.dumps([read(Path(folder)) for folder in sys.argv[1:]]))
