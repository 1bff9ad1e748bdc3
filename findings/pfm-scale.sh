#!/usr/bin/env bash
# PFM: the third line is a scale whose sign is the byte order; OpenCV divides by it, imageio returns 8-bit integers.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install imageio==2.38.1 opencv-python-headless==5.0.0.93 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import cv2
import imageio.v3 as iio
import numpy as np

pixels = np.broadcast_to(np.float32([1, 2, 3]), (2, 3, 3))
with open("color.pfm", "wb") as file:
    file.write(b"PF\n3 2\n-2.0\n" + pixels[::-1].tobytes())
opencv = cv2.imread("color.pfm", cv2.IMREAD_UNCHANGED)[0, 0]
other = iio.imread("color.pfm", plugin="opencv")
print(f"stored R, G, B 1, 2, 3 with scale 2; OpenCV {opencv.tolist()}, imageio by OpenCV {other[0, 0].tolist()} ({other.dtype})")
raise SystemExit(not (opencv.tolist() == [1.5, 1.0, 0.5] and other.dtype == np.uint8))
PYTHON
