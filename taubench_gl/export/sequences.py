"""Formats with one file per sequence, as programs that learn read them: NSS of ng-model-gym, and noisebase.

Frames are kept as archives until all are there: a killed export continues with them.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from itertools import chain, pairwise
from pathlib import Path
from typing import Any
from zipfile import ZIP_DEFLATED, ZipFile

import numpy as np

from taubench_gl.animation import View
from taubench_gl.animation.pairs import reprojection
from taubench_gl.data_files import stored_arrays
from taubench_gl.errors import SettingsError
from taubench_gl.export.formats import NpzWriter
from taubench_gl.export.frames import ExportFrame
from taubench_gl.metrics.reprojection import reproject
from taubench_gl.outputs import remove_files, replacing, write_arrays, write_parts

Array = np.ndarray

SKY_DISTANCE = 1e5
"""Scene units from the camera to points of the sky, which the format of noisebase does not know."""

RGBE_RANGE = 20.0
"""Natural logarithm of the brightest over the darkest exponent of an RGBE image: darker than 2e-9 of it is 0."""

TYPES = {"F32": np.dtype("<f4"), "I32": np.dtype("<i4"), "BOOL": np.dtype("?")}
"""Name in a safetensors file -> type."""


class SequenceWriter(NpzWriter):
    """Writes one file per sequence, and an archive per frame until the file has replaced them all.

    A format has the ``names`` of channels that it needs; ``pattern``, names of its files; ``arrays(frame)``, what they
    hold of a frame: images (h, w, components) and numbers by name; and ``assemble(names)``, which writes the files of
    what ``read`` gives.  Its docstring is the description of conventions in its files.
    """

    def files(self) -> list[Path]:
        """Files of this format in the folder; all of them, unless every archive is there too."""
        return sorted(self.out.glob(self.pattern))

    def done(self, frame: int) -> bool:
        return super().done(frame) or bool(self.files())

    def prepare(self) -> None:
        """Make the files, once every archive is there, and delete the archives."""
        if all(self.path(frame).is_file() for frame in reversed(self.spec.frames)):
            with stored_arrays(self.path(self.spec.frames[0])) as first:
                self.assemble(list(first))
        if self.files():
            super().remove()

    def write(self, frame: ExportFrame) -> None:
        if frame.view.camera.kind != "perspective":
            raise SettingsError("these files can only hold a perspective camera", hint="give another --camera")
        write_arrays(self.path(frame.number), {name: _packed(values) for name, values in self.arrays(frame).items()})
        self.prepare()

    def remove(self) -> None:
        super().remove()
        remove_files(self.out, [self.pattern])

    def read(self, name: str, frames: range) -> Iterator[Array]:
        """An array of ``frames``, one after another."""
        for frame in frames:
            with stored_arrays(self.path(frame)) as arrays:
                yield arrays[name]

    def about(self) -> dict[str, str]:
        """What a file says about itself."""
        spec = {name: str(getattr(self.spec, name)) for name in ("scene", "fps", "frames")}
        return spec | {"conventions": " ".join(self.__doc__.split())}


def _packed(values: Any) -> Array:
    """Images with their components first; float32 for float64."""
    values = np.moveaxis(values, -1, 0) if np.ndim(values) == 3 else np.asarray(values)
    return np.ascontiguousarray(values, dtype=np.float32 if values.dtype == np.float64 else None)


def clip_matrices(camera: dict[str, Array]) -> tuple[Array, Array]:
    """Clip from view and clip from world (4, 4) of ``camera_matrices``, with forward Z in [0, 1] instead of reversed Z.

    The second acts on row vectors (x, y, z, 1).
    """
    clip = camera["clip_from_view"].copy()
    clip[2] = clip[3] - clip[2]
    return clip, (clip @ np.linalg.inv(camera["world_from_view"])).T


class NssWriter(SequenceWriter):
    """Data set NSS of ng-model-gym 0.4: ``SCENE.safetensors``, all arrays (frame, ...).

    colour_linear and ground_truth_linear: linear radiance x exposure of the scene, of the input and of the target;
    exposure: natural logarithm of what is left to apply, 0.  motion and motion_lr: (y, x), current - previous, +y down,
    pixels of the target and of the input, without jitter, 0 where undefined.  depth: device depth, 0 near, 1 far and
    sky; the planar depth is depth_params[1] / (depth - depth_params[0]), scene units.  jitter: (y, x), pixels of the
    input, +y down: pixel i shows i + jitter.  viewProj: acts on row vectors, scene units.  camera_cut: there is no
    history.  Row 0 is the top.
    """

    pattern, names = "*.safetensors", ("motion",)

    def arrays(self, frame: ExportFrame) -> dict[str, Any]:
        channels, lens, (clip, view_projection) = frame.channels, frame.view.camera, clip_matrices(frame.camera)
        depth, params = channels["input_depth"], [-clip[2, 2], clip[2, 3], 1.0 / clip[0, 0], 1.0 / clip[1, 1]]
        light = {"colour_linear": "noisy0_radiance", "ground_truth_linear": "clean_radiance"}
        images = {name: channels[channel][..., :3] for name, channel in light.items()}
        for name, motion in (("motion", channels["motion"]), ("motion_lr", channels["input_motion"])):
            most = np.array(motion.shape[:2])  # their limit: an image
            images[name] = np.clip(np.nan_to_num(-motion[..., ::-1]), -most, most)
        images["depth"] = np.where(depth > 0, params[0] + params[1] / np.where(depth > 0, depth, 1.0), 1.0)
        # ng-model-gym's far plane of a camera that has none
        planes = {"zNear": [lens.znear], "zFar": [min(lens.zfar, 5000.0)], "depth_params": params}
        cameras = {"jitter": frame.camera["input_jitter_px"][::-1], "viewProj": view_projection}
        cut = np.array([frame.number in (self.spec.frames[0], *self.spec.cuts)])
        rest = {"exposure": [0.0], "render_size": np.int32(depth.shape[:2]), "camera_cut": cut}
        return images | planes | cameras | rest  # single bytes last: what readers map into memory is aligned

    def assemble(self, names: list[str]) -> None:
        frames, start = self.spec.frames, 0
        header = {"__metadata__": self.about() | {"Length": str(len(frames))}}
        for name in names:
            one = next(self.read(name, frames))
            end, kind = start + len(frames) * one.nbytes, next(kind for kind in TYPES if TYPES[kind] == one.dtype)
            header[name] = {"dtype": kind, "shape": [len(frames), *one.shape], "data_offsets": [start, end]}
            start = end
        text = json.dumps(header).encode()
        text += b" " * (-len(text) % 8)
        values = (values.tobytes() for name in names for values in self.read(name, frames))
        write_parts(self.out / f"{self.spec.scene}.safetensors", chain([len(text).to_bytes(8, "little"), text], values))


class NoisebaseWriter(SequenceWriter):
    """Sample Training Format v1 of noisebase 1.1: Zarr v2 in ``scene0000.zip``, another file after each camera cut.

    position, motion, normal: world axes, scene units; position + motion: where the surface point was in the previous
    frame; motion is 0 where that is not known.  Points of the sky lie 1e5 units away and move with the camera.  color:
    RGBE of linear radiance x exposure, a sample per seed; exposure: the range of its natural logarithm.  reference:
    linear radiance x exposure.  proj_mat: column vectors, z forward, depth 0 to 1; view_proj_mat: row vectors.  All
    samples of a pixel show one point.  Row 0 is the top.
    """

    pattern = "scene*.zip"
    names = ("position", "depth", "prev_position", "normal", "base_color", "material", "motion")

    def arrays(self, frame: ExportFrame) -> dict[str, Any]:
        channels, view, (clip, view_projection) = frame.channels, frame.view, clip_matrices(frame.camera)
        position, motion = world_points(frame, self.spec.view(max(frame.number - 1, 0)))
        noisy = [image[..., :3] for name, image in channels.items() if re.fullmatch(r"noisy\d+_radiance", name)]
        color, exposure = rgbe(np.moveaxis(np.stack(noisy, axis=-1), 2, 0))
        normal, base = np.float16(channels["normal"]), channels["base_color"][..., :3]
        diffuse = np.float16(base * (1.0 - channels["material"][..., :1]))
        surfaces = {"position": position, "motion": motion, "normal": normal, "diffuse": diffuse}
        light = {"color": color, "exposure": exposure, "reference": channels["clean_radiance"][..., :3]}
        _, up, back = view.world_from_view.T
        camera = {"camera_position": view.position, "camera_target": view.position - 100.0 * back, "camera_up": up}
        camera |= {"proj_mat": clip @ np.diag([1.0, 1.0, -1.0, 1.0]), "view_proj_mat": view_projection}
        return surfaces | light | camera | {"crop_offset": np.zeros(2, dtype=np.int32)}

    def assemble(self, names: list[str]) -> None:
        frames, cuts = self.spec.frames, map(self.spec.frames.index, self.spec.cuts)
        samples = next(self.read("color", frames)).shape[-1]
        for number, (start, stop) in enumerate(pairwise([0, *cuts, len(frames)])):
            with replacing(self.out / f"scene{number:04d}.zip") as path, ZipFile(path, "w", ZIP_DEFLATED) as file:
                file.writestr(".zgroup", json.dumps({"zarr_format": 2}))
                file.writestr(".zattrs", json.dumps(self.about()))
                for name in names:
                    for k, values in enumerate(self.read(name, frames[start:stop])):
                        if name in ("position", "motion", "normal", "diffuse"):  # archives hold once what samples share
                            values = np.repeat(values[..., None], samples, axis=-1)
                        file.writestr(f"{name}/{k}{'.0' * values.ndim}", values.tobytes())
                    shape = {"shape": [stop - start, *values.shape], "chunks": [1, *values.shape]}
                    about = {"zarr_format": 2, "order": "C", "compressor": None, "filters": None, "fill_value": 0}
                    file.writestr(f"{name}/.zarray", json.dumps(about | shape | {"dtype": values.dtype.str}))


def world_points(frame: ExportFrame, before: View) -> tuple[Array, Array]:
    """Points that pixels show and their steps to the previous frame, of which ``before`` is the view.

    World axes, (h, w, 3) float64 each.
    """
    channels, view = frame.channels, frame.view
    surface, known = channels["depth"] > 0, np.isfinite(channels["motion"]).all(axis=-1, keepdims=True)
    pair = reprojection(view, before, *surface.shape[1::-1])
    then = reproject(pair, np.concatenate([channels["position"], channels["depth"]], -1), channels["prev_position"]).q
    then = np.where(surface, then, SKY_DISTANCE * then)  # directions, where there is no surface
    position = np.where(surface, channels["position"], then) + view.position
    return position, np.where(known, then + before.position - position, 0.0)


def rgbe(light: Array) -> tuple[Array, Array]:
    """Radiance (3, h, w, S) -> RGBE (4, h, w, S) uint8, and the range of exponents (2,), natural logarithms.

    A value is rgb / 255 exp((e + 1) / 256 (range[1] - range[0]) + range[0]), the e of the brightest channel rounded up,
    so that no channel exceeds 255 (noisebase, docs/algorithms/rgbe.md).
    """
    brightest = np.log(np.maximum(light.max(axis=0, keepdims=True), 1e-37, dtype=np.float64))
    low = brightest.max() - RGBE_RANGE
    steps = np.clip(np.floor((brightest - low) / RGBE_RANGE * 256), 0, 255)
    rgb = np.clip(light / np.exp((steps + 1) / 256 * RGBE_RANGE + low), 0, 1)
    return np.concatenate([np.rint(rgb * 255), steps]).astype(np.uint8), np.array([low, low + RGBE_RANGE])
