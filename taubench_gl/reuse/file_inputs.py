"""Path-traced files ``exr:DIR`` as inputs of reuse methods."""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

import numpy as np

from taubench_gl.animation import CameraTrack, View
from taubench_gl.frame.sources import RasterSource
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.frame.targets import write_channel
from taubench_gl.lobes import REUSE_INPUTS
from taubench_gl.metrics.reprojection import Reprojection
from taubench_gl.pathtraced.cameras import FittedCamera, SceneCamera
from taubench_gl.pathtraced.motion import position_from_motion, position_from_scene
from taubench_gl.pathtraced.passes import PathTracedFrame, linear_radiance
from taubench_gl.pathtraced.sequence import PathTracedSequence
from taubench_gl.pathtraced.source import PathTracedSource
from taubench_gl.reuse.contract import LIGHTS
from taubench_gl.reuse.frame import INPUTS, MIN_ALBEDO, input_texture, texture_bytes
from taubench_gl.reuse.inputs import CHANNEL_INPUTS, HISTORY_INPUTS, FrameRequest, Inputs, MaskPass, Textures
from taubench_gl.reuse.reshade import RESHADED
from taubench_gl.scene.model import Scene
from taubench_gl.settings import Settings

Array = np.ndarray

ALBEDOS = {"diffuse_albedo": "diffuse_color", "specular_albedo": "glossy_color"}
"""Input -> field of PathTracedFrame."""

LIGHT_INPUTS = ("diffuse", "specular", "emitted", "diffuse_demodulated", "specular_demodulated")
UPLOADED = ("direct", *LIGHT_INPUTS, *ALBEDOS)
"""Inputs besides radiance that are computed here from the passes of the files."""


class FileInputs(Inputs):
    """Inputs from path-traced files ``exr:DIR``, whose noise is that of a real renderer.

    Geometry comes from the passes of the files.  Surfaces are followed by their pass of previous positions, else by
    their motion pass, else by the rasterized scene, else they count as still.  Channels that methods read and the files
    lack (path tracers rarely write previous positions or ids) are rasterized from the scene with the same camera.  The
    exact mask comes from ``exact`` files of the same frames with many samples; without them there is none, because
    noise would count as change.
    """

    def __init__(
        self, request: FrameRequest, reads: Collection[str], *, cuts: Collection[int] = (), exact: str | None = None
    ):
        """Open the files of ``request``.  ``exact``: ``exr:DIR`` of noise-free frames.  Raises PathTracedError."""
        super().__init__(request, reads, cuts)
        gpu, scene, camera = request.gpu, request.scene, request.camera
        sequence = PathTracedSequence.open(self.kind.files, mapping=request.mapping)
        width, height = self.size = self.output_size = sequence.size
        self._passes = sequence.index
        self.motion_from = _motion_source(sequence, scene, request.settings)
        settings = request.settings.replace(width=width, height=height)
        if self.motion_from == "camera":
            settings = settings.replace(reprojection="camera")
        self.settings, self.missing = settings, self._missing_inputs()
        track = FittedCamera() if scene is None else SceneCamera(scene, camera, settings.sequence.fps)
        # Whether a method reads the lobes apart, and the files have them.
        self._splits_light = bool(set(LIGHT_INPUTS) & self.reads - set(self.missing))
        lobes = tuple(name for names in REUSE_INPUTS.values() for name in names) if self._splits_light else ()
        follow = self._previous_positions
        files = PathTracedSource(gpu, sequence, track, settings, keep_frame=True, lobes=lobes, follow=follow)
        self.source = self.own(files)
        self._rasterized = None if scene is None else self._missing_channels(scene, camera, settings)
        self._masks = MaskPass(self, self.source, settings, ())
        uploaded = ("radiance", *(n for n in UPLOADED if n in self.reads and n not in self.missing))
        uploaded += ("base_color",) if self._albedo_from == "file" else ()
        self._uploaded = {name: self.own(input_texture(gpu, name, self.size)) for name in uploaded}
        self.exact = None
        if exact is not None:
            noise_free = PathTracedSequence.open(exact, mapping=request.mapping)
            noise_free.require(self.size, of="the input")
            self.exact = self.own(PathTracedSource(gpu, noise_free, track, settings, follow=follow))
            self._exact_masks = MaskPass(self, self.exact, settings, self.exact.radiance)

    # -------------------------------------------------------------------------------------------- what there is
    @property
    def frames(self) -> range:
        return self.source.sequence.select(self.settings.sequence.frames)

    @property
    def _albedo_from(self) -> str | None:
        """Where the input base_color is from: file (the color of the diffuse lobe), or else the scene."""
        if "base_color" not in self.reads:
            return None
        return "file" if "diffuse_color" in self._passes else "scene"

    def _missing_inputs(self) -> dict[str, str]:
        name_of, out = self._passes.mapping.file_name, {}
        lobes = [f"{lobe}_{part}" for lobe in ("diffuse", "glossy") for part in ("direct", "indirect", "color")]
        if lacking := [name_of(name) for name in lobes if name not in self._passes]:
            out |= dict.fromkeys(LIGHT_INPUTS, f"the files lack {', '.join(lacking)}")
        lost = {name: field for name, field in ALBEDOS.items() if field not in self._passes}
        out |= {name: f"the files lack {name_of(field)}" for name, field in lost.items()}
        others = ("hit_distance", "sample_count", "variance", "reactive", "transparency", LIGHTS, *RESHADED)
        return out | dict.fromkeys(others, "files do not have it")

    def _missing_channels(self, scene: Scene, camera: CameraTrack, settings: Settings) -> RasterSource | None:
        """A source of the channels that are read and missing in the files; None if there are none."""
        read = {HISTORY_INPUTS.get(name, name) for name in self.reads} & set(CHANNEL_INPUTS)
        missing = read - set(self.source.channels) - ({"base_color"} if self._albedo_from == "file" else set())
        if self.motion_from == "rasterized":
            missing |= {"prev_position"}
        if not missing:
            return None
        self.source.sequence.require_centered()
        geometry = settings.replace(columns=("frustum",), textures="finest")
        return self.open_source(AnimatedScene(scene, camera), geometry, extra=tuple(sorted(missing)))

    # -------------------------------------------------------------------------------------------- frame by frame
    def _previous_positions(self, passes: PathTracedFrame, position: Array, view: View, previous: View) -> Array:
        """Where the surfaces of a frame were in the previous one, (h, w, 3), as ``pathtraced.source.Follow`` asks.

        The input and noise-free files of the same frames use it.
        """
        if self.motion_from == "rasterized":
            points = (self._rasterized.read(name) for name in ("position", "prev_position"))
            tolerance = self.settings.metrics.threshold("position")
            return position_from_scene(position, *points, view, previous, tolerance)
        # Noise-free files without the pass show the surfaces of the input.
        return position_from_motion(position, self.source.frame.motion, view, previous)

    def _draw(self, frame: int) -> View:
        if self._rasterized is not None:
            self._rasterized.advance(frame)
        return self.source.advance(frame)

    def _sources(self) -> tuple[Textures, Textures]:
        current, history = super()._sources()
        if self._rasterized is not None:
            current, history = {**self._rasterized.current, **current}, {**self._rasterized.previous, **history}
        return current, history

    def _compute(self, frame: int, view: View, pair: Reprojection, declared: int) -> Textures:
        for name, values in self._arrays(f"{self.source.sequence.path}, frame {frame}").items():
            if name in self._uploaded:
                write_channel(self._uploaded[name], name, values)
        return self._uploaded

    def _arrays(self, where: str) -> dict[str, Array]:
        """Inputs that are computed from the passes of the current frame, (h, w, components) float32."""
        passes, exposure = self.source.frame, np.float32(self.settings.lighting.exposure_factor)
        radiance = linear_radiance(passes.combined, passes.mapping, float(exposure), where)
        shaded = np.ones((*radiance.shape[:2], 1), dtype=np.float32)
        out = {"radiance": radiance}
        if "direct" in self._uploaded:
            out["direct"] = self._direct_light(radiance)
        for name, field in ALBEDOS.items():
            if getattr(passes, field) is not None:
                out[name] = np.maximum(getattr(passes, field), np.float32(MIN_ALBEDO))
        if self._splits_light:
            surface = ~passes.sky[..., None]
            for name, lobes in REUSE_INPUTS.items():
                light = sum(values for key, values in passes.lobes.items() if key.rpartition("_")[0] in lobes)
                out[name] = np.where(surface, light * exposure, np.float32(0))
                out[f"{name}_demodulated"] = out[name] / out[f"{name}_albedo"]
            out["emitted"] = radiance - out["diffuse"] - out["specular"]
        if passes.diffuse_color is not None:
            out["base_color"] = passes.diffuse_color
        four = {name for name in out if INPUTS[name].components == 4}
        return {name: np.concatenate([v, shaded], axis=-1) if name in four else v for name, v in out.items()}

    def _direct_light(self, radiance: Array) -> Array:
        """Direct light x exposure, ``radiance`` on sky pixels; without such a pass, all light.  (h, w, 3) float32."""
        frame, exposure = self.source.frame, np.float32(self.settings.lighting.exposure_factor)
        if "direct" in frame.radiance:
            light = frame.radiance["direct"] * exposure
        else:  # without the emission that methods get
            sources = [s for s in (self.source, self._rasterized) if s is not None and "emission" in s.channels]
            light = radiance - (exposure * sources[0].read("emission")[..., :3] if sources else 0.0)
        return np.where(frame.sky[..., None], radiance, light).astype(np.float32)

    @property
    def bytes(self) -> int:
        rasterized = 0 if self._rasterized is None else self._rasterized.describe()["memory"]["gpu_bytes"]
        return texture_bytes(*self._uploaded.values()) + self._masks.bytes + rasterized

    def describe(self) -> dict[str, Any]:
        notes = [] if self.exact else ["no exact mask: give noise-free files of the same frames as --reference"]
        if self._rasterized is not None:
            missing = sorted(set(self._rasterized.channels) & self.reads - set(self.source.channels))
            if missing:
                notes.append(f"rasterized, because the files lack it: {', '.join(missing)}")
        if "direct" in self._uploaded and "direct" in self.source.missing:
            notes.append("the files have no direct light of its own: all light counts as direct")
        if self.motion_from == "camera" and self.settings.metrics.reprojection != "camera":
            notes.append("surfaces count as still: the files have no motion pass, and there is no scene")
        name_of = self._passes.mapping.file_name
        return super().describe() | {
            "notes": notes,
            "motion_from": self.motion_from,
            "motion_pass": name_of(self.motion_from) if self.motion_from in ("prev_position", "motion") else None,
            "base_color_from": {"file": name_of("diffuse_color"), "scene": "rasterized"}.get(self._albedo_from or ""),
        }


def _motion_source(sequence: PathTracedSequence, scene: Scene | None, settings: Settings) -> str:
    """What surfaces are followed by: prev_position or motion (passes), rasterized, or camera (they count as still)."""
    if settings.metrics.reprojection == "camera":
        return "camera"
    for name in ("prev_position", "motion"):
        if name in sequence.index:
            return name
    return "camera" if scene is None else "rasterized"
