#!/usr/bin/env bash
# A KITTI flow file is a 16-bit RGB PNG, flow = (value - 32768) / 64: Pillow and imageio read its upper 8 bits.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install Pillow==13.0.0 imageio==2.38.1 opencv-python-headless==5.0.0.93 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import cv2
import imageio.v3 as iio
import numpy as np
from PIL import Image

flow = np.array([3.0, -2.0])  # pixels
stored = np.zeros((4, 5, 3), np.uint16)
stored[..., :2], stored[..., 2] = flow * 64 + 32768, 1  # R, G, B
cv2.imwrite("flow.png", stored[..., ::-1])
read = {
    "OpenCV": cv2.imread("flow.png", cv2.IMREAD_UNCHANGED)[..., ::-1],
    "Pillow": np.array(Image.open("flow.png")),
    "imageio": iio.imread("flow.png"),
}
for name, pixels in read.items():
    print(f"{name}: {pixels.dtype}, first pixel {pixels[0, 0].tolist()}; stored {stored[0, 0].tolist()}")
same = np.array_equal(read["OpenCV"], stored)
halved = all(read[n].dtype == np.uint8 and np.array_equal(read[n], stored >> 8) for n in ("Pillow", "imageio"))
raise SystemExit(not (same and halved))
PYTHON
