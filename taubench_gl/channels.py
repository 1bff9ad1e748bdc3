"""The channel table: every per-pixel value of a frame.  Attachments, exports and docs are derived from it.

Positions are relative to the camera of their own frame, along world axes.  Motion is +y up in GL memory and down in
exports.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from taubench_gl.lobes import SCENE_LOBES, TABLE

RADIANCE_UNIT = "W/(sr m2) or cd/m2"
"""Unit of radiance channels: watt or candela by the setting ``light_unit``; exposure is not applied."""


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    """One per-pixel value: its texture, its unit and its names in files."""

    name: str
    components: int  # of the GPU texture
    dtype: str  # of the GPU texture: f4, f2 float; u4 unsigned; f1 8-bit normalized
    unit: str
    doc: str
    exr: tuple[str | None, ...]  # channel names in exported EXR files, one per component; None: not exported
    attachment: bool = True  # written by the geometry pass

    @property
    def bytes(self) -> int:
        """Bytes of a pixel on the GPU."""
        return self.components * int(self.dtype[1])


def _light(bounce: str, doc: str) -> Iterator[ChannelInfo]:
    """Radiance of all lobes, and of each lobe that rendered scenes can have."""
    lobes = {f"{bounce}_{lobe.name}": lobe.doc.format(bounce) for lobe in TABLE if lobe.name in SCENE_LOBES}
    for name, text in ({bounce: doc} | lobes).items():
        exr = name.title().replace("_", "")
        yield ChannelInfo(
            name, 4, "f4", RADIANCE_UNIT, text, (f"{exr}.R", f"{exr}.G", f"{exr}.B", None), attachment=False
        )


CHANNELS: dict[str, ChannelInfo] = {
    c.name: c
    for c in (
        ChannelInfo(
            "position", 4, "f4", "m",
            "xyz: surface point, world axes, relative to this frame's camera; w: planar view depth, 0 = no surface",
            ("Position.X", "Position.Y", "Position.Z", "Depth.Z"),
        ),
        ChannelInfo(
            "normal", 4, "f4", "1",
            "xyz: unit shading normal with normal map, world axes, facing the viewer",
            ("Normal.X", "Normal.Y", "Normal.Z", None),
        ),
        ChannelInfo(
            "prev_position", 4, "f4", "m",
            "xyz: the same surface point in the previous frame (rigid, skinned, morphed), relative to its camera",
            ("PrevPosition.X", "PrevPosition.Y", "PrevPosition.Z", None),
        ),
        ChannelInfo(
            "geometric_normal", 4, "f2", "1",
            "xyz: unit normal of the triangle, world axes, facing the viewer",
            ("GeometricNormal.X", "GeometricNormal.Y", "GeometricNormal.Z", None),
        ),
        ChannelInfo(
            "base_color", 4, "f2", "1", "linear base color, alpha",
            ("BaseColor.R", "BaseColor.G", "BaseColor.B", "BaseColor.A"),
        ),
        ChannelInfo(
            "material", 4, "f2", "1",
            "x: metallic, y: perceptual roughness, z: ambient occlusion, w: specular factor, -1 where unlit",
            ("Metallic", "Roughness", "Occlusion", "Specular"),
        ),
        ChannelInfo(
            "emission", 4, "f4", RADIANCE_UNIT, "emitted radiance, linear",
            ("Emission.R", "Emission.G", "Emission.B", None),
        ),
        ChannelInfo(
            "ids", 2, "u4", "1",
            "x: draw record + 1 (0 = no surface), y: material + 1 (highest bit: cut)", ("InstanceId", "MaterialId"),
        ),
        *_light("direct", "radiance of lights, emitters and sky after one bounce, all lobes, linear"),
        *_light("indirect", "radiance after two or more bounces, linear"),
        ChannelInfo(
            "path_info", 4, "f4", "m, 1, radiance2",
            "x: hit distance of the first bounce, mean over the samples that hit, 0 if none; y: sample count; z: "
            "variance of the mean of direct luminance; w: of indirect luminance",
            ("HitDistance", "SampleCount", "DirectVariance", "IndirectVariance"), attachment=False,
        ),
        ChannelInfo(
            "color", 4, "f4", "1", "tone-mapped, sRGB-encoded, 0..1", ("R", "G", "B", None), attachment=False
        ),
        ChannelInfo(
            "motion", 2, "f4", "px", "previous - current, +x right", ("Motion.X", "Motion.Y"), attachment=False
        ),
        ChannelInfo(
            "prev_visibility", 1, "u4", "bits",
            "whether the previous camera saw this surface point, by a ray (conventions.Visibility)",
            ("PrevVisibility",),
            attachment=False,
        ),
        ChannelInfo("mask", 1, "u4", "bits", "reason bits (conventions.Reason)", ("Mask",), attachment=False),
    )
}  # fmt: skip


def stored_dtype(name: str, storage: str = "float") -> str:
    """Texture dtype of a channel: that of the table; with ``storage`` "half", f2 instead of f4."""
    dtype = CHANNELS[name].dtype
    return "f2" if storage == "half" and dtype == "f4" else dtype
