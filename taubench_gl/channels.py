"""The table of channels: everything a frame can hold per pixel.  Attachments, exports and docs derive from it.

Spaces: ``relative`` = world axes, metres from this frame's own camera.  Motion is +y up in GL memory, down in exports.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    """One channel.  ``components`` and ``dtype`` are the GPU's: f4/f2 float, u4 unsigned, f1 8-bit normalised."""

    name: str
    components: int
    dtype: str
    unit: str
    doc: str
    exr: tuple[str, ...]  # layer channel names on export
    attachment: bool = True  # written by the geometry pass

    @property
    def bytes(self) -> int:
        """Per pixel on the GPU."""
        return self.components * int(self.dtype[1])


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
            "xyz: unit shading normal (normal map included), world axes, turned to the visible side; w unused",
            ("Normal.X", "Normal.Y", "Normal.Z", None),
        ),
        ChannelInfo(
            "prev_position", 4, "f4", "m",
            "xyz: the same surface point one frame ago, relative to the previous camera (rigid, skinned, morphed)",
            ("PrevPosition.X", "PrevPosition.Y", "PrevPosition.Z", None),
        ),
        ChannelInfo(
            "geometric_normal", 4, "f2", "1",
            "xyz: unit normal of the triangle, world axes, turned to the visible side",
            ("GeometricNormal.X", "GeometricNormal.Y", "GeometricNormal.Z", None),
        ),
        ChannelInfo(
            "base_color", 4, "f2", "1", "linear base colour, alpha",
            ("BaseColor.R", "BaseColor.G", "BaseColor.B", "BaseColor.A"),
        ),
        ChannelInfo(
            "material", 4, "f2", "1",
            "x: metallic, y: perceptual roughness, z: ambient occlusion, w: specular factor, -1 where unlit",
            ("Metallic", "Roughness", "Occlusion", "Specular"),
        ),
        ChannelInfo(
            "emission", 4, "f4", "W/(sr m2)", "emitted radiance, linear",
            ("Emission.R", "Emission.G", "Emission.B", None),
        ),
        ChannelInfo(
            "ids", 2, "u4", "1",
            "x: draw record + 1 (0 = no surface), y: material + 1 (highest bit: cut)", ("InstanceId", "MaterialId"),
        ),
        *(
            ChannelInfo(
                name, 4, "f4", "W/(sr m2)", doc, (f"{exr}.R", f"{exr}.G", f"{exr}.B", None), attachment=False
            )
            for name, doc, exr in (
                ("direct", "radiance after one bounce from lights and sky, all lobes, linear", "Direct"),
                ("direct_diffuse", "its diffuse lobe", "DirectDiffuse"),
                ("direct_glossy", "its glossy lobe", "DirectGlossy"),
                ("indirect", "radiance after two bounces or more, linear", "Indirect"),
            )
        ),
        ChannelInfo(
            "color", 4, "f4", "1", "tone-mapped, sRGB-encoded, 0..1", ("R", "G", "B", None), attachment=False
        ),
        ChannelInfo(
            "motion", 2, "f4", "px", "previous - current, +x right", ("Motion.X", "Motion.Y"), attachment=False
        ),
        ChannelInfo("mask", 1, "u4", "bits", "reason bits (conventions.Reason)", ("Mask",), attachment=False),
    )
}  # fmt: skip


def stored_dtype(name: str, storage: str = "float") -> str:
    """Texture type of a channel: the channel table's, or with ``storage`` "half" 16-bit floats for 32-bit ones."""
    dtype = CHANNELS[name].dtype
    return "f2" if storage == "half" and dtype == "f4" else dtype
