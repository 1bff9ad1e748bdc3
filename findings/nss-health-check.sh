#!/usr/bin/env bash
# The check of motion and jitter before training: with the exposure of the program's own template, jitter of 0 passes.
# Installs about 7 GB.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install ng-model-gym==0.4.0 || exit 2
cd "$folder" && "$folder/venv/bin/python" - 2> log.txt <<'PYTHON' || { code=$?; tail -3 log.txt; exit $code; }
import json
import logging
from importlib.resources import files
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import torch
from ng_model_gym.core.data.data_utils import DataLoaderMode, ToneMapperMode
from ng_model_gym.usecases.nss.data.dataset import NSSDataset
from safetensors.numpy import save_file

logging.disable(logging.CRITICAL)
WIDTH, HEIGHT, FRAMES = 64, 48, 6
STEP = np.array([1.3, 2.1])  # y, x: the image moves by this in a frame, pixels of the target
JITTER = np.random.default_rng(0).uniform(-0.5, 0.5, (FRAMES, 2)).astype(np.float32)  # y, x, pixels of the input


def image(width, height, scale, offset, frame):
    """Smooth light at pixel i + offset of an image that is ``scale`` times smaller than the target."""
    y, x = np.mgrid[:height, :width].astype(float)
    y, x = (((v + o + 0.5) * scale - 0.5) - s * frame for v, o, s in zip((y, x), offset, STEP))
    waves = ((0.31, 0.12, 0.3), (0.17, -0.23, 1.0), (-0.05, 0.41, 2.0), (0.6, 0.33, 0.5))
    shade = sum(np.sin(a * x + b * y + c) for a, b, c in waves)
    return np.stack([0.25 + 0.05 * shade, 0.2 + 0.04 * shade, 0.15 + 0.03 * shade]).astype(np.float32)


def passes(exposure, **changes):
    """Whether the health check passes a sequence with ``changes`` (exposure: None: of the file, exp(0))."""
    tensors = {
        "ground_truth_linear": np.stack([image(WIDTH, HEIGHT, 1, (0, 0), n) for n in range(FRAMES)]),
        "colour_linear": np.stack([image(WIDTH // 2, HEIGHT // 2, 2, JITTER[n], n) for n in range(FRAMES)]),
        "motion": np.tile(STEP[:, None, None].astype(np.float32), (FRAMES, 1, HEIGHT, WIDTH)),
        "jitter": JITTER[..., None, None],
        "exposure": np.zeros((FRAMES, 1), np.float32),
    } | changes
    Path("data").mkdir(exist_ok=True)
    save_file(tensors, "data/a.safetensors", {"Length": str(FRAMES)})
    options = SimpleNamespace(path=SimpleNamespace(train=Path("data")), gt_augmentation=False, exposure=exposure,
                              tonemapper=ToneMapperMode.REINHARD)  # fmt: skip
    model = SimpleNamespace(recurrent_samples=FRAMES)
    data = NSSDataset(SimpleNamespace(dataset=options, model=model), DataLoaderMode.TRAIN)
    try:
        data.health_check(torch.utils.data.DataLoader(data, batch_size=1))
    except AssertionError:
        return False
    return True


template = json.loads(files("ng_model_gym.usecases.nss.configs").joinpath("nss_v1_template.json").read_text())
exposure = float(template["dataset"]["exposure"])
still, half = 0 * JITTER[..., None, None], np.tile(STEP[:, None, None].astype(np.float32) / 2, (FRAMES, 1, HEIGHT, WIDTH))
rows = {"right": {}, "jitter 0": {"jitter": still}, "motion halved": {"motion": half}}
found = {name: (passes(None, **changes), passes(exposure, **changes)) for name, changes in rows.items()}
for name, (own, of_template) in found.items():
    print(f"ng-model-gym 0.4.0, {name}: passes {own} (exposure of the file), {of_template} (template, {exposure:g})")
raise SystemExit(found != {"right": (True, True), "jitter 0": (False, True), "motion halved": (True, True)})
PYTHON
