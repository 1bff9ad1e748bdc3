#!/usr/bin/env python3
"""Rewrite tests/goldens, after a visual check: tools/make_goldens.py [NAME ...] [--sheet IMAGE.png]

Goldens are rendered by llvmpipe only; other renderers are refused.  --sheet also writes all images side by side.
"""

from __future__ import annotations

import argparse
import os
import sys
from pathlib import Path

import numpy as np
from PIL import Image

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "frame"))
from golden_cases import CASES, FOLDER, golden_file, render, scene_path  # noqa: E402

from taubench_gl.gpu.context import open_gpu  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", help=f"of {', '.join(CASES)}; default: all")
    parser.add_argument("--sheet", type=Path, help="write all images side by side")
    options = parser.parse_args()
    unknown = set(options.names) - set(CASES)
    if unknown:
        parser.error(f"no case is named {', '.join(sorted(unknown))}")
    data = Path(os.environ.get("TAUBENCH_DATA") or ROOT.parent / "shared" / "data")
    gpu = open_gpu()
    if "llvmpipe" not in gpu.renderer:
        print(f"goldens are rendered by llvmpipe, this is {gpu.renderer}", file=sys.stderr)
        return 2
    FOLDER.mkdir(exist_ok=True)
    sheet = []
    with gpu:
        for name in options.names or CASES:
            images = render(gpu, scene_path(data, name), CASES[name])
            origin = {"renderer": np.array(gpu.renderer), "version": np.array(gpu.version)}
            np.savez_compressed(golden_file(name), **origin, **images)
            print(f"{golden_file(name).relative_to(ROOT)}: {golden_file(name).stat().st_size} bytes")
            normal = np.where(images["depth"][..., None] > 0, images["normal"] + 128.0, 0)
            word = images["mask"].astype(int)
            reasons = np.stack([word & 0b1100000, word & 128, (word & 256) >> 1], axis=-1) * 2.0
            reasons += np.where(images["depth"][..., None] > 0, 60, 0)
            sheet.append(np.hstack([images["base_color"], normal, np.clip(reasons, 0, 255)]).astype(np.uint8))
    if options.sheet:
        half = -(-len(sheet) // 2)
        sheet += [np.zeros_like(sheet[0])] * (2 * half - len(sheet))
        Image.fromarray(np.hstack([np.vstack(sheet[:half]), np.vstack(sheet[half:])])).save(options.sheet)
    return 0


if __name__ == "__main__":
    sys.exit(main())
