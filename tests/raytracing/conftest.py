"""Helpers of other folders that these tests share."""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "frame"))  # frame_tools
sys.path.append(str(Path(__file__).parents[1] / "light"))  # light_tools, shadow_tools
