"""The layout and formats of MPI-Sintel (Butler et al., ECCV 2012; its README and depth add-on).

    flow/SCENE/frame_0001.flo          forward flow to the next frame: u right, v down, pixels; > 1e9: unknown
    occlusions/SCENE/frame_0001.png    8-bit gray, 255: inside the next frame but hidden there by something nearer
    invalid/SCENE/frame_0001.png       255: outside the next frame, or without a position in it
    depth/SCENE/frame_0001.dpt         planar depth, meters; 1e10 where there is no surface
    camdata_left/SCENE/frame_0001.cam  M (3, 3) and N (3, 4), float64: pixel = M N world; pixel centers at integers
    clean/SCENE/frame_0001.png         8-bit RGB, if ``color`` is exported

All integers and floats are little-endian.  Frame i of the scene is frame_{i+1}; the last of a sequence has
no flow.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from taubench_gl.conventions import Reason
from taubench_gl.errors import SettingsError
from taubench_gl.export.formats import Writer
from taubench_gl.export.frames import ExportFrame, extrinsics
from taubench_gl.outputs import replacing, write_atomically

Array = np.ndarray
TAG = 202021.25
"""First four bytes of .flo, .dpt and .cam: this float, which reads PIEH as text."""

UNKNOWN_FLOW = 1e10
NO_SURFACE = 1e10
_NO_POSITION = int(Reason.OUTSIDE | Reason.BEHIND | Reason.INVALID | Reason.CUT | Reason.FIRST)


def flo_bytes(flow: Array) -> bytes:
    """Bytes of a .flo file of ``flow`` (h, w, 2) float32, pixels; values that are not finite are written as unknown."""
    height, width, _ = flow.shape
    values = np.where(np.isfinite(flow).all(axis=-1, keepdims=True), flow, UNKNOWN_FLOW)
    return struct.pack("<fii", TAG, width, height) + values.astype("<f4").tobytes()


def dpt_bytes(depth: Array) -> bytes:
    """Bytes of a .dpt file of planar ``depth`` (h, w) float32, 0 = no surface."""
    height, width = depth.shape
    values = np.where(depth > 0, depth, NO_SURFACE)
    return struct.pack("<fii", TAG, width, height) + values.astype("<f4").tobytes()


def cam_bytes(intrinsics: Array, extrinsic: Array) -> bytes:
    """Bytes of a .cam file of M, ``intrinsics`` (3, 3), and N, ``extrinsic`` (3, 4)."""
    return struct.pack("<f", TAG) + intrinsics.astype("<f8").tobytes() + extrinsic.astype("<f8").tobytes()


class SintelWriter(Writer):
    """Writes the folder tree.  A frame is complete if all its files exist.  The channel ``color`` is optional."""

    names = ("depth", "motion_forward", "mask_forward")

    def _paths(self, frame: int) -> dict[str, Path]:
        kinds = {"camdata_left": ".cam", "depth": ".dpt", "occlusions": ".png", "invalid": ".png", "flow": ".flo"}
        if frame == self.spec.frames[-1]:  # the next frame is not exported
            kinds = {"camdata_left": ".cam", "depth": ".dpt"}
        if "color" in self.spec.names:
            kinds["clean"] = ".png"
        return {
            kind: self.out / kind / self.spec.scene / f"frame_{frame + 1:04d}{suffix}" for kind, suffix in kinds.items()
        }

    def done(self, frame: int) -> bool:
        return all(path.is_file() for path in self._paths(frame).values())

    def write(self, frame: ExportFrame) -> None:
        if frame.view.camera.kind != "perspective":
            raise SettingsError(
                "a .cam file can only hold a perspective camera", hint="choose another --camera or --format"
            )
        for kind, path in self._paths(frame.number).items():
            if kind == "clean":
                _write_png(path, _to_bytes(frame.channels["color"]))
            elif kind in ("occlusions", "invalid"):
                hidden, invalid = masks_of(frame.channels["mask_forward"][..., 0])
                _write_png(path, 255 * (hidden if kind == "occlusions" else invalid).astype(np.uint8))
            elif kind == "flow":
                write_atomically(path, flo_bytes(frame.channels["motion_forward"]), parents=True)
            elif kind == "depth":
                write_atomically(path, dpt_bytes(frame.channels["depth"][..., 0]), parents=True)
            else:
                write_atomically(path, cam_bytes(frame.camera["intrinsics"], extrinsics(frame.view)), parents=True)

    def remove(self) -> None:
        for kind in ("flow", "occlusions", "invalid", "depth", "camdata_left", "clean"):
            folder = self.out / kind / self.spec.scene
            for path in folder.glob("frame_*"):
                path.unlink()


def masks_of(reasons: Array) -> tuple[Array, Array]:
    """Reason words against the next frame (h, w) -> occluded, invalid: (h, w) bool each, never both true."""
    invalid = (reasons & _NO_POSITION) != 0
    return ~invalid & ((reasons & int(Reason.DISOCCLUDED)) != 0), invalid


def _to_bytes(color: Array) -> Array:
    return np.clip(np.nan_to_num(color[..., :3]) * 255.0 + 0.5, 0, 255).astype(np.uint8)


def _write_png(path: Path, pixels: Array) -> None:
    from PIL import Image

    with replacing(path, parents=True) as partial:
        Image.fromarray(pixels).save(partial, format="PNG")
