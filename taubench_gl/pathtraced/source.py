"""Path-traced files as a Source: the same channels, in the same textures, as the rasterizer's."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.channels import CHANNELS
from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS, LIGHT_FEATURES, OTHERS
from taubench_gl.frame.targets import write_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.color import display_color
from taubench_gl.pathtraced.cameras import PathTracedCamera, check_camera, relative_position
from taubench_gl.pathtraced.passes import PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.settings import Settings

Array = np.ndarray


Follow = Callable[[PathTracedFrame, Array, View, View], Array]
"""Previous positions of a frame's surface points: from its passes, positions (h, w, 4) relative to its camera, its view
and the previous view -> (h, w, 3) relative to the previous camera."""


class PathTracedSource:
    """Uploads the frames of a sequence one after another.  Raises SettingsError for motion without its pass."""

    def __init__(
        self,
        gpu: Gpu,
        sequence: PathTracedSequence,
        camera: PathTracedCamera,
        settings: Settings,
        *,
        lobes: Collection[str] = (),
        keep_frame: bool = False,
        follow: Follow | None = None,
    ):
        """``lobes``: upload these lobes' radiance too.  ``keep_frame``: keep the passes read last as ``frame``.

        ``follow``: with motion reprojection, gives the previous positions that files without such a pass lack.
        """
        self._follow = None if "prev_position" in sequence.index else follow
        self._gpu, self.sequence, self.camera, self._settings = gpu, sequence, camera, settings
        self.size, self.lobes = sequence.size, tuple(lobes)
        self.reprojection = settings.metrics.reprojection
        if self.reprojection == "motion" and "prev_position" not in sequence.index and follow is None:
            raise SettingsError(
                "motion reprojection needs previous positions, which these files do not have",
                hint="use --reprojection camera, or map a pass to prev_position",
            )
        self.missing = sequence.missing(self.lobes)
        self.unmeasured = {c: self.missing[c] for c in COLUMNS if c in self.missing}
        self.unmeasured |= {c: "path-traced images do not have it" for c in OTHERS}
        self.unmeasured |= {c: "not requested" for c in COLUMNS if c not in settings.metrics.columns}
        self.radiance = tuple(c for c in LIGHT_FEATURES if c not in self.unmeasured)
        self.others: tuple[str, ...] = ()
        self.other = "path-traced files are compared by one reprojection"
        self.cuts = False  # images do not show which surfaces have no history
        self.channels = ("position", "normal", *self.radiance)
        if self.reprojection == "motion":
            self.channels += ("prev_position",)
        self.mismatch_px: float | None = None  # of the camera at the first frame; None: no position pass
        self.current_view: View | None = None
        self.previous_view: View | None = None
        self.frame: PathTracedFrame | None = None
        self._keep_frame = keep_frame
        self._arrays: list[dict[str, Array]] = [{}, {}]  # current, previous
        self._textures: list[dict[str, moderngl.Texture]] = [{}, {}]

    def advance(self, frame: int) -> View:
        """Read, convert and upload frame number ``frame``; the current frame becomes the previous one.

        Raises PathTracedError if the files or the camera cannot be used.
        """
        passes = self.sequence.read(frame, self.lobes)
        self.frame = passes if self._keep_frame else None
        if self.current_view is None:
            self.mismatch_px = check_camera(self.camera, frame, passes)
        view = self.camera.view(frame, passes)
        self.previous_view, self.current_view = self.current_view or view, view
        arrays = frame_channels(passes, view, self.previous_view, self._settings)
        if self._follow is not None and self.reprojection == "motion":
            moved = self._follow(passes, arrays["position"], view, self.previous_view)
            arrays["prev_position"] = np.asarray(moved, dtype=np.float32)
        self._arrays.reverse()
        self._textures.reverse()
        self._arrays[0] = arrays
        for name in (*self.channels, *passes.lobes):
            channel = name if name in CHANNELS else "direct"  # lobes have the format of direct
            if name not in self._textures[0]:
                info = CHANNELS[channel]
                self._textures[0][name] = self._gpu.texture(self.size, info.components, info.dtype)
            write_channel(self._textures[0][name], channel, arrays[name])
        return view

    @property
    def current(self) -> Mapping[str, moderngl.Texture]:
        """Channel -> texture of the current frame."""
        return self._textures[0]

    @property
    def previous(self) -> Mapping[str, moderngl.Texture]:
        """Channel -> texture of the previous frame; empty after the first ``advance``."""
        return self._textures[1]

    def read(self, name: str, *, previous: bool = False) -> Array:
        """A channel, (h, w, components) float32, row 0 at the top."""
        values = self._arrays[1 if previous else 0][name]
        out = np.zeros((*values.shape[:2], CHANNELS[name].components), dtype=np.float32)
        out[..., : values.shape[-1]] = values
        return out

    def hidden_backs(self) -> int:
        return 0  # unknown

    def describe(self) -> dict[str, Any]:
        """The summary blocks ``effects`` (none) and ``path_traced``: the source of camera and passes."""
        index = self.sequence.index
        return {
            "effects": {},
            "path_traced": {
                "mapping": self.sequence.mapping.name,
                "layer": index.layer,
                "passes": sorted(name for name in self.sequence.mapping.passes if name in index),
                "camera": self.camera.describe(),
                "camera_mismatch_px": self.mismatch_px,
            },
        }

    def release(self) -> None:
        for textures in self._textures:
            for texture in textures.values():
                texture.release()
            textures.clear()


def frame_channels(frame: PathTracedFrame, view: View, previous: View, settings: Settings) -> dict[str, Array]:
    """Channels of one frame as ``channels`` defines them: position (h, w, 4), others (h, w, 3), float32.

    Positions become camera-relative in float64 and are then rounded to float32.  A surface that is not in front of its
    own camera is an error of the file: its position is NaN, and the masks count it as INVALID.
    """
    position, depth = relative_position(frame, view)
    position = np.concatenate([position, depth[..., None]], axis=-1)
    position[frame.sky] = 0.0
    position[~frame.sky & ~(depth > 0)] = np.nan
    out = {"position": position.astype(np.float32)}
    normal = np.zeros_like(out["position"][..., :3]) if frame.normal is None else frame.normal
    out["normal"] = np.where(frame.sky[..., None], np.float32(0), normal)
    out |= {**frame.radiance, **frame.lobes}  # the mask pass applies the exposure
    if frame.combined is not None:
        color = frame.combined.astype(np.float64)
        if frame.color_encoded:
            color = np.clip(color, 0.0, 1.0)
        else:
            color = display_color(color, settings.lighting.exposure_factor, settings.lighting.tone_map)
        out["color"] = color.astype(np.float32)
    if frame.prev_position is not None:
        origin = 0.0 if frame.relative else previous.position
        out["prev_position"] = (frame.prev_position.astype(np.float64) - origin).astype(np.float32)
    return out
