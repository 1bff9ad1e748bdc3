"""The rejection that the program of path-traced files made itself, as a test beside those that are computed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.errors import SettingsError
from taubench_gl.option_groups import PathTracedOptions
from taubench_gl.pathtraced.cameras import PathTracedCamera, checked_view
from taubench_gl.pathtraced.evaluation import plan_sequence
from taubench_gl.pathtraced.passes import NAME_IT
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.reject.contract import RejectionTest
from taubench_gl.settings import Settings

Array = np.ndarray
PASSES = ("rejected", "history_weight")
"""Passes that say what became of history, of which the first that the files have is read."""

REJECTED = 0.999
"""History is rejected where 1 less its weight is above this: only a weight of 0 is."""


@dataclass(frozen=True, slots=True)
class FileRejection:
    """Files ``exr:DIR`` with a pass of PASSES, and the frames of their scene that they show."""

    sequence: PathTracedSequence
    camera: PathTracedCamera
    offset: int  # the frame of the scene that a file shows, less its number
    settings: Settings  # with the size and the frames of the files
    test: RejectionTest

    @classmethod
    def open(cls, spec: str | Path, settings: Settings, options: PathTracedOptions) -> FileRejection:
        """Open the files; ``options`` name their scene file.  Raises TaubenchError, also for files without a pass."""
        if options.scene_file is None:
            hint = "give --scene-file: visibility is traced in the scene of the frames"
            raise SettingsError("the scene of the frames is unknown", where=str(spec), hint=hint)
        plan = plan_sequence(spec, settings, options)
        plan.sequence.require_centered()
        name = next((name for name in PASSES if name in plan.sequence.index), None)
        if name is None:
            message = f"the files have no pass {' or '.join(PASSES)}"
            raise SettingsError(message, where=str(spec), hint=NAME_IT)
        numbers = plan.frames
        plan.camera.place(numbers[0], plan.sequence.read(numbers[0], geometry=False))
        offset = plan.camera.offset
        title = f"the files' own rejection, pass {plan.sequence.mapping.file_name(name)}"
        test = RejectionTest("files", title, "geometry", "1 - weight of history", REJECTED)
        chosen = plan.settings.replace(frames=(numbers[0] + offset, numbers[-1] + 1 + offset))
        return cls(plan.sequence, plan.camera, offset, chosen, test)

    def difference(self, frame: int) -> Array:
        """1 less the weight of history in ``frame`` of the scene, (h, w) float32, row 0 at the top; NaN: not known.

        Raises PathTracedError if the scene's camera did not render the file.
        """
        passes = self.sequence.read(frame - self.offset, geometry=False)
        checked_view(self.camera, frame - self.offset, passes)
        return np.maximum(np.float32(1) - passes.kept, np.float32(0))
