"""Names of screenshots, and clips as mp4."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write, new_partial

Array = np.ndarray
NO_VIDEO = "clips need imageio-ffmpeg: pip install 'taubench-gl[reuse]'"


def free_name(folder: Path, stem: str, suffix: str) -> Path:
    """``stem-1.png``, ``stem-2.png``, ...: the first name that is free."""
    number = 1
    while (folder / f"{stem}-{number}{suffix}").exists():
        number += 1
    return folder / f"{stem}-{number}{suffix}"


class Clip:
    """An mp4 at a constant frame rate.  Odd sizes lose their last row or column (yuv420)."""

    def __init__(self, path: Path, size: tuple[int, int], fps: float):
        try:
            import imageio_ffmpeg
        except ImportError:
            raise OutputError(NO_VIDEO) from None
        self.path, self.frames = path, 0
        self._partial = new_partial(path, path.suffix)
        self._even = (size[0] // 2 * 2, size[1] // 2 * 2)
        if min(self._even) < 2:
            raise OutputError("the image is too small for a clip")
        try:
            self._partial.touch()
        except OSError as error:
            raise cannot_write(path, error) from None
        self._writer: Any = imageio_ffmpeg.write_frames(
            str(self._partial), self._even, fps=fps, macro_block_size=1, quality=8, ffmpeg_log_level="error"
        )
        self._writer.send(None)

    def add(self, image: Array) -> None:
        """(h, w, 3) uint8."""
        width, height = self._even
        try:
            self._writer.send(np.ascontiguousarray(image[:height, :width]))
        except (OSError, RuntimeError) as error:
            raise OutputError(f"recording failed: {str(error).splitlines()[0]}", where=str(self.path)) from None
        self.frames += 1

    def close(self) -> None:
        """Finish the file; a clip without frames leaves no file."""
        self._writer.close()
        if self.frames:
            try:
                os.replace(self._partial, self.path)
            except OSError as error:
                raise cannot_write(self.path, error) from None
        else:
            self._partial.unlink(missing_ok=True)
