#!/usr/bin/env bash
# Spherical interpolation of rotations: q and -q are one rotation, and the arc between two rotations is the shorter one.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install pyrr==0.10.3 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import warnings

import numpy as np
from pyrr import quaternion

warnings.simplefilter("ignore")
start, end = quaternion.create_from_z_rotation(0.0), quaternion.create_from_z_rotation(0.2)
same = quaternion.slerp(start, -start, 0.5)
half = quaternion.slerp(start, -end, 0.5)
degrees = 2.0 * np.degrees(np.arccos(abs(half @ start)))
print(f"pyrr 0.10.3: halfway from q to -q {same.tolist()}; halfway to a rotation by 11.46 degrees, as -q: {degrees:.2f}")
raise SystemExit(not (np.isnan(same).all() and 174.0 < degrees < 174.5))
PYTHON
