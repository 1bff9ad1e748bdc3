"""Videos of images: the one place that runs ffmpeg."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from taubench_gl.errors import OutputError
from taubench_gl.outputs import cannot_write, new_partial, put_in_place

Array = np.ndarray

CODECS = {"mp4": ("libx264", ["-crf", "18"]), "webm": ("libvpx-vp9", ["-crf", "24", "-b:v", "0"])}
"""Kinds of videos: codec and options of ffmpeg."""


class Video:
    """Encodes images of one size at a constant rate.  The file exists only once it is complete.

    ``kind``: of CODECS; ``frames``: images so far.  As a context manager, an error removes the incomplete file.
    """

    def __init__(self, path: Path, fps: float, kind: str = "mp4"):
        """A video at ``path`` of ``fps`` images per second.  Raises OutputError without the package imageio-ffmpeg."""
        try:
            import imageio_ffmpeg
        except ImportError:
            raise OutputError("a video needs imageio-ffmpeg", hint="pip install 'taubench-gl[reuse]'") from None
        self._ffmpeg, self.path, self._fps, self._kind = imageio_ffmpeg, path, fps, kind
        self.frames = 0
        self._shape: tuple[int, ...] | None = None
        self._partial: Path | None = None
        self._writer: Any = None

    def add(self, image: Array) -> None:
        """Add an image, (h, w, 3) uint8; odd sizes are padded with a black row or column, as 4:2:0 needs.

        Raises OutputError, also for an image of another size than the first.
        """
        if image.shape != (self._shape or image.shape):
            raise OutputError("recording ended: the image has another size", where=str(self.path))
        self._shape = image.shape
        height, width = image.shape[:2]
        image = np.pad(image, ((0, height % 2), (0, width % 2), (0, 0)))
        try:
            if self._writer is None:
                codec, options = CODECS[self._kind]
                self._partial = new_partial(self.path, f".{self._kind}")
                self._writer = self._ffmpeg.write_frames(
                    str(self._partial), image.shape[1::-1], fps=self._fps, codec=codec, macro_block_size=1,
                    output_params=options, ffmpeg_log_level="error",
                )  # fmt: skip
                self._writer.send(None)
            self._writer.send(np.ascontiguousarray(image))
            self.frames += 1
        except OSError as error:
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            raise OutputError(f"the video cannot be written: {reason}", where=str(self.path)) from None

    def close(self) -> Path | None:
        """Finish the file.  -> its path, None without frames.  Raises OutputError."""
        if self._writer is None or self._partial is None:
            return None
        self._writer.close()
        self._writer = None
        try:
            frames_in_file, _ = self._ffmpeg.count_frames_and_secs(str(self._partial))
        except RuntimeError:
            frames_in_file = 0
        if frames_in_file < self.frames:  # the encoder reports no error when the disk is full
            message = f"only {frames_in_file} of {self.frames} frames could be written"
            raise OutputError(message, where=str(self.path))
        try:
            put_in_place(self._partial, self.path)
        except OSError as error:
            raise cannot_write(self.path, error) from None
        return self.path

    def discard(self) -> None:
        """Stop, and remove the incomplete file; nothing happens to a finished one."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None
        if self._partial is not None:
            self._partial.unlink(missing_ok=True)

    def __enter__(self) -> Video:
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.discard()
