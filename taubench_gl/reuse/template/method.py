"""A reuse method in Python: arrays in, an image out.  docs/reuse.md documents the frame."""

import numpy as np

from taubench_gl.conventions import NOT_COMPARABLE, Reason

DISCARD = np.uint32(NOT_COMPARABLE | Reason.POSITION | Reason.NORMAL)  # geometric reasons to discard history


class Method:
    title = "Exponential accumulation"
    cite = ("Yang, Liu, Salvi 2020, A Survey of Temporal Antialiasing Techniques, Eq. (1)",)
    reads = ("radiance", "motion", "mask")
    reports = ("reprojected_history",)  # for the bound: the best blend of this history with the new frame
    settings = {  # noqa: RUF012
        "alpha": {"default": 0.1, "min": 0.01, "max": 1.0, "scale": "log", "doc": "weight of the new frame"},
    }

    def __init__(self, size, settings):
        """``size`` (width, height); ``settings`` name -> value.  Created again after a cut."""
        self.alpha = settings["alpha"]
        self.accumulated = None

    def step(self, frame):
        """``frame``: arrays (height, width, components), row 0 at the top, and numbers.  -> images by name."""
        color = frame["radiance"][..., :3].copy()
        history = np.zeros(color.shape[:2], dtype=np.float32)  # weight of history in the result
        past = np.zeros((*history.shape, 4), dtype=np.float32)  # history as it is fetched; last: 1 where there is some
        if self.accumulated is not None:
            rows, columns = np.indices(history.shape)
            at = np.rint(np.stack([columns, rows], axis=-1) + frame["motion"])  # previous position, in pixels
            height, width = history.shape
            good = ((frame["mask"][..., 0] & DISCARD) == 0) & np.all((at >= 0) & (at < [width, height]), axis=-1)
            x, y = np.where(good[..., None], at, 0).astype(int).transpose(2, 0, 1)
            past[good, :3], past[good, 3] = self.accumulated[y, x][good], 1.0
            color = np.where(good[..., None], self.alpha * color + (1 - self.alpha) * past[..., :3], color)
            history[good] = 1 - self.alpha
        self.accumulated = color
        return {"result": np.concatenate([color, history[..., None]], axis=-1), "reprojected_history": past}
