#!/usr/bin/env bash
# FLIP of 8-bit images: values are not scaled to 0..1, so every pair of values of 1 or more is equal.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install flip-evaluator==1.7 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import flip_evaluator
import numpy as np

dark, light = np.full((32, 32, 3), 10, np.uint8), np.full((32, 32, 3), 250, np.uint8)
integers = float(flip_evaluator.evaluate(dark, light, "LDR")[1])
floats = float(flip_evaluator.evaluate(dark / 255.0, light / 255.0, "LDR")[1])
print(f"flip-evaluator 1.7: mean FLIP of 10 and 250 of 255 as uint8 {integers}, as float in 0..1 {floats:.3f}")
raise SystemExit(not (integers == 0.0 and 0.9 < floats < 1.0))
PYTHON
