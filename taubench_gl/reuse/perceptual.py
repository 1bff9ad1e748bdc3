"""Perceptual measures of other packages: LPIPS per image, ColorVideoVDP per sequence.

Neither is installed by default, and nothing is downloaded: a measure whose package or weights are missing is refused in
one line before anything is rendered.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.errors import SettingsError

Array = np.ndarray

ALEXNET = "alexnet-owt-7be5be79.pth"
"""Weights of torchvision's AlexNet, which LPIPS needs and its package does not contain."""

LPIPS_SIDE = 32
"""Smallest side of an image for LPIPS: AlexNet halves it five times."""

DISPLAY = "standard_fhd"
"""ColorVideoVDP's display: 24 inch, 1920 x 1080, 200 cd/m2, seen from 0.6 m, its own name."""


@dataclass(frozen=True, slots=True)
class Perceptual:
    """Functions of two images (h, w, 3), or sequences (n, h, w, 3) uint8, display colors; None: not requested."""

    lpips: Callable[[Array, Array], float | None] | None = None
    cvvdp: Callable[[Array, Array], float] | None = None


def open_perceptual(metrics: Collection[str], fps: float) -> Perceptual:
    """The functions for ``metrics`` of option_groups.METRICS.  Raises SettingsError, one line, for what is missing."""
    return Perceptual(
        _open("lpips", "lpips", _lpips) if "lpips" in metrics else None,
        _open("cvvdp", "pycvvdp", lambda: _cvvdp(fps)) if "cvvdp" in metrics else None,
    )


def _open(metric: str, module: str, make: Callable[[], Any]) -> Any:
    if find_spec(module) is None or find_spec("torch") is None:
        hint = "pip install 'taubench-gl[perceptual]', or choose other --metrics"
        raise SettingsError(f"metric {metric} needs the packages {metric} and torch", hint=hint)
    try:
        with _silence():
            return make()
    except SettingsError:
        raise
    except Exception as error:  # a broken installation of another package can raise anything
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise SettingsError(f"metric {metric} cannot be used: {reason}", hint="choose other --metrics") from error


@contextmanager
def _silence() -> Any:
    """Discard what LPIPS and ColorVideoVDP print and warn while they load."""
    with warnings.catch_warnings(), redirect_stdout(StringIO()):
        warnings.simplefilter("ignore")
        yield


def _lpips() -> Callable[[Array, Array], float | None]:
    import torch

    weights = Path(torch.hub.get_dir()) / "checkpoints" / ALEXNET
    if not weights.is_file():
        raise SettingsError(
            f"metric lpips needs the AlexNet weights {ALEXNET}, and nothing is downloaded",
            hint="put the file into the folder checkpoints of torch.hub (TORCH_HOME), or choose other --metrics",
        )
    import lpips

    network = lpips.LPIPS(net="alex", verbose=False).eval()

    def measure(shown: Array, reference: Array) -> float | None:
        if min(shown.shape[:2]) < LPIPS_SIDE:
            return None
        images = (
            torch.from_numpy(np.ascontiguousarray(x, np.float32)).permute(2, 0, 1)[None] for x in (shown, reference)
        )
        with torch.no_grad():
            return float(network(*images, normalize=True))

    return measure


def _cvvdp(fps: float) -> Callable[[Array, Array], float]:
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # its parameters are in the package
    import pycvvdp

    metric = pycvvdp.cvvdp(display_name=DISPLAY, quiet=True)

    def measure(shown: Array, reference: Array) -> float:
        with _silence():
            quality, _ = metric.predict(shown, reference, dim_order="FHWC", frames_per_second=fps)
        return float(quality)

    return measure


def to_8_bit(colors: Array) -> Array:
    """Display colors in [0, 1] as uint8, as a display gets them."""
    return (255.0 * np.clip(colors, 0.0, 1.0) + 0.5).astype(np.uint8)
