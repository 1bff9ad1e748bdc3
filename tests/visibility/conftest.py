"""Helpers of other folders that these tests share."""

import sys
from pathlib import Path

for folder in ("frame", "raytracing"):
    sys.path.append(str(Path(__file__).parents[1] / folder))  # frame_tools, ray_caster, ray_tools
