"""Path-traced files as a Source: the same channels, in the same textures, as the rasterizer's."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from typing import Any

import moderngl
import numpy as np

from taubench_gl.animation import View
from taubench_gl.channels import CHANNELS
from taubench_gl.conventions import COUNTED
from taubench_gl.errors import SettingsError
from taubench_gl.features import COLUMNS, LIGHT_FEATURES, OTHERS
from taubench_gl.frame.targets import write_channel
from taubench_gl.gpu.context import Gpu
from taubench_gl.metrics.color import display_color
from taubench_gl.pathtraced.cameras import (
    FittedCamera,
    PathTracedCamera,
    Residual,
    checked_view,
    relative_position,
    rounding_m,
)
from taubench_gl.pathtraced.motion import position_from_motion
from taubench_gl.pathtraced.passes import SHORT_NORMAL, PathTracedFrame
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.scene.model import Camera
from taubench_gl.settings import Settings

Array = np.ndarray


MOTION_PASSES = ("motion", "prev_position")
"""Passes that say where surfaces were, the one that vectors come from first."""

UNKNOWN_VIEW = View(np.zeros(3), np.eye(3), Camera())
"""Stands for the camera of files that have vectors, but neither a camera nor geometry."""

Follow = Callable[[PathTracedFrame, Array, View, View], Array]
"""Previous positions of a frame's surface points: from its passes, positions (h, w, 4) relative to its camera, its view
and the previous view -> (h, w, 3) relative to the previous camera."""


class PathTracedSource:
    """Uploads the frames of a sequence one after another.  Raises SettingsError for motion without its pass.

    Files with motion vectors have the channel ``vectors``: motion reprojection samples history where they point.  Their
    previous positions, else the points that the vectors lead to, are what positions are compared with.
    """

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
        """Open the textures.  ``lobes``: upload their radiance too; ``keep_frame``: keep the last passes as ``frame``.

        ``follow``: with motion reprojection, gives the previous positions of files without passes of motion.
        """
        self._gpu, self.sequence, self.camera, self._settings = gpu, sequence, camera, settings
        self.size, self.lobes = sequence.size, tuple(lobes)
        self.reprojection = settings.metrics.reprojection
        self.moves = any(name in sequence.index for name in MOTION_PASSES)
        self._follow = None if self.moves or self.reprojection == "camera" else follow
        if self.reprojection == "motion" and not self.moves and follow is None:
            raise SettingsError(
                "motion reprojection needs motion vectors or previous positions, which these files do not have",
                hint="use --reprojection camera, or map a pass to motion or prev_position",
            )
        self.missing = sequence.missing(self.lobes)
        # Vectors alone say where history is, but not whether it shows the same point.
        located = any(name in sequence.index for name in ("position", "depth"))
        self.geometry = located or self.reprojection == "camera"
        if not self.geometry:
            self.missing["position"] = "the files have neither positions nor depth"
        self.unmeasured = {c: self.missing[c] for c in COLUMNS if c in self.missing}
        self.unmeasured |= {c: "path-traced images do not have it" for c in OTHERS}
        self.unmeasured |= {c: "not requested" for c in COLUMNS if c not in settings.metrics.columns}
        self.radiance = tuple(c for c in LIGHT_FEATURES if c not in self.unmeasured)
        self.others: tuple[str, ...] = ()
        why = self.missing.get("position", f"the files have no pass {' or '.join(MOTION_PASSES)}")
        self.other = COUNTED if self.moves and located else why
        self.cuts = False  # images do not show which surfaces have no history
        self.channels = ("position", "normal", *self.radiance)
        self.channels += ("prev_position",) * (self.moves or self._follow is not None)
        self.channels += ("vectors",) * ("motion" in sequence.index)
        self.seen = Seen()
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
        passes = self.sequence.read(frame, self.lobes, geometry=self.geometry)
        self.frame = passes if self._keep_frame else None
        if not self.geometry and isinstance(self.camera, FittedCamera):
            view, residual = UNKNOWN_VIEW, None
        else:
            view, residual = checked_view(self.camera, frame, passes)
        self.previous_view, self.current_view = self.current_view or view, view
        arrays = frame_channels(passes, view, self.previous_view, self._settings)
        self.seen.add(passes, residual, arrays["position"][..., 3])
        if self._follow is not None:
            moved = self._follow(passes, arrays["position"], view, self.previous_view)
            arrays["prev_position"] = np.asarray(moved, dtype=np.float32)
        self._arrays.reverse()
        self._textures.reverse()
        self._arrays[0] = arrays
        for name in (*self.channels, *passes.lobes):
            channel = _format(name)
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
        out = np.zeros((*values.shape[:2], CHANNELS[_format(name)].components), dtype=np.float32)
        out[..., : values.shape[-1]] = values
        return out

    def hidden_backs(self) -> int:
        return 0  # unknown

    def describe(self) -> dict[str, Any]:
        """The summary blocks ``effects`` and ``path_traced``: the source of camera, passes and motion vectors."""
        index, name_of = self.sequence.index, self.sequence.mapping.file_name
        moves = {"previous_pose": {"on": True, "reason": "the files say how surfaces moved"}}
        return {
            "effects": moves if self.moves else {},
            "path_traced": {
                "mapping": self.sequence.mapping.name,
                "layer": index.layer,
                "passes": sorted(name for name in self.sequence.mapping.passes if name in index),
                "camera": self.camera.describe(),
                "view": index.view,
                "camera_mismatch_px": self.seen.mismatch_px,
                "vectors": name_of("motion") if "motion" in index else None,
            },
        }

    def release(self) -> None:
        for textures in self._textures:
            for texture in textures.values():
                texture.release()
            textures.clear()


MIXED, EDGE = 0.02, 0.1
"""Relative differences of 1 / depth: of a pixel from either side if it lies on neither; of the sides of an edge."""

OFF_CENTER_PX = 0.1
"""Median distance of samples from pixel centers above which a run has a note."""

FEW_EDGES, FEW_SHORT, COARSE_M = 20, 0.01, 1e-3
"""Edge pixels, share of normals, and rounding of positions (meters) below which nothing is said of them."""


@np.errstate(divide="ignore", invalid="ignore")  # depth may be any value
def mixed_pixels(depth: Array, sky: Array) -> tuple[int, int]:
    """Pixels on edges between surfaces whose position lies on neither surface, and all pixels on such edges.

    1 / planar depth is linear across the image on every plane, so each side is continued from its two pixels.  One
    sample in the pixel center lies on one of them, the mean of several between them.  ``depth`` (h, w): planar.
    """
    mixed = edges = 0
    inverse = np.where(sky | ~(depth > 0), np.nan, 1.0 / depth)
    for values in (inverse, inverse.T):
        a, b, here, c, d = (values[:, i : values.shape[1] - 4 + i] for i in range(5))
        sides = np.stack([2.0 * b - a, 2.0 * c - d])
        edge = np.abs(b - c) > EDGE * np.maximum(b, c)
        edge &= (np.abs(sides - np.stack([b, c])) < 0.5 * MIXED * np.abs(sides)).all(axis=0)
        off = (np.abs(sides - here) > MIXED * np.abs(sides)).all(axis=0)
        edges += int(np.count_nonzero(edge & np.isfinite(here)))
        mixed += int(np.count_nonzero(edge & off))
    return mixed, edges


@dataclass(slots=True)
class Seen:
    """What the frames of a sequence showed about their samples, for the notes of a run."""

    residuals: list[Residual] = field(default_factory=list)
    mixed: int = 0  # edge pixels on no surface
    edges: int = 0
    short_normals: float = 0.0  # largest share of a frame
    no_normals: float = 0.0
    rounding_m: float = 0.0  # of half-float positions
    from_depth: bool = False  # whether points from depth replace them

    def add(self, frame: PathTracedFrame, residual: Residual | None, depth: Array) -> None:
        """Add a frame; ``depth`` (h, w): planar, meters."""
        self.residuals += [residual] if residual is not None else []
        mixed, edges = mixed_pixels(depth, frame.sky)
        self.mixed, self.edges = self.mixed + mixed, self.edges + edges
        self.short_normals = max(self.short_normals, frame.short_normals)
        self.no_normals = max(self.no_normals, frame.no_normals)
        if frame.half_position and not frame.sky.all():
            self.rounding_m, self.from_depth = max(self.rounding_m, rounding_m(frame)), frame.finer_depth

    @property
    def mismatch_px(self) -> float | None:
        """The largest median distance of a frame's positions from its pixel centers; None: no frame has positions."""
        return max((each.median_px for each in self.residuals), default=None)

    def notes(self) -> list[str]:
        """What makes the columns of these frames differ from those of one sample in each pixel center."""
        out, worst = [], max(self.residuals, key=lambda each: each.median_px, default=None)
        if worst is not None and max(map(abs, worst.offset_px)) > OFF_CENTER_PX + worst.rounding_px:
            x, y = worst.offset_px
            out.append(f"positions are {x:+.2f}, {y:+.2f} px (right, down) off the pixel centers")
        filtered = []
        if worst is not None and worst.spread_px > OFF_CENTER_PX and not self.rounding_m:
            filtered.append(f"positions project {worst.spread_px:.2f} px (median) from their pixel centers")
        if self.edges >= FEW_EDGES and self.mixed > 0.5 * self.edges:
            filtered.append(f"{100 * self.mixed / self.edges:.0f} % of the edge pixels have positions on no surface")
        if self.short_normals > FEW_SHORT:
            filtered.append(f"{100 * self.short_normals:.1f} % of the normals are shorter than {SHORT_NORMAL}")
        if filtered:
            why = "passes are means of several samples, or samples lie beside the pixel center, which counts as change"
            out.append(f"{', '.join(filtered)}: {why}; render one sample in each pixel center")
        if self.no_normals > FEW_SHORT:
            text = f"{100 * self.no_normals:.1f} % of the surface pixels have no normal"
            out.append(f"{text}: if they show no surface, set sky = 'normal' in the mapping")
        if self.rounding_m > COARSE_M:
            what = "surface points are taken from depth" if self.from_depth else "write them or depth as 32-bit floats"
            out.append(f"positions are half floats, rounded by {self.rounding_m:.2g} m (median): {what}")
        return out


def frame_channels(frame: PathTracedFrame, view: View, previous: View, settings: Settings) -> dict[str, Array]:
    """Channels of one frame as ``channels`` defines them: position (h, w, 4), others (h, w, 3), float32.

    Positions become camera-relative in float64 and are then rounded to float32.  A surface that is not in front of its
    own camera is an error of the file: its position is NaN, and the masks count it as INVALID.
    """
    located = frame.position is not None or frame.depth is not None
    position, depth = relative_position(frame, view) if located else _ahead(frame, view)
    position = np.concatenate([position, depth[..., None]], axis=-1)
    position[frame.sky] = 0.0
    position[~frame.sky & ~(depth > 0)] = np.nan
    out = {"position": position.astype(np.float32)}
    normal = np.zeros_like(out["position"][..., :3]) if frame.normal is None else frame.normal
    if frame.mapping.normals == "view":
        normal = (normal @ view.world_from_view.T).astype(np.float32)
    out["normal"] = np.where(frame.sky[..., None], np.float32(0), normal)
    out |= {**frame.radiance, **frame.lobes}  # the mask pass applies the exposure
    if frame.combined is not None:
        color = frame.combined.astype(np.float64)
        if frame.mapping.color == "encoded":
            color = np.clip(color, 0.0, 1.0)
        else:
            color = display_color(color, settings.lighting.exposure_factor, settings.lighting.tone_map)
        out["color"] = color.astype(np.float32)
    if frame.motion is not None:
        out["vectors"] = frame.motion
    if not located:
        out["prev_position"] = _ahead(frame, previous)[0].astype(np.float32)
    elif frame.prev_position is not None:
        origin = 0.0 if frame.relative else previous.position
        out["prev_position"] = (frame.prev_position.astype(np.float64) - origin).astype(np.float32)
    elif frame.motion is not None:
        out["prev_position"] = position_from_motion(position, frame.motion, view, previous).astype(np.float32)
    return out


def _ahead(frame: PathTracedFrame, view: View) -> tuple[Array, Array]:
    """What stands for surface points that files do not have, as ``relative_position``: one in front of every camera."""
    depth = np.full(frame.sky.shape, 1.0 + view.camera.znear)
    return -view.world_from_view[:, 2] * depth[..., None], depth


def _format(name: str) -> str:
    """The entry of CHANNELS whose texture the channel ``name`` has: lobes are light."""
    return "motion" if name == "vectors" else name if name in CHANNELS else "direct"
