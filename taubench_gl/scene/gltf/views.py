"""Cameras and KHR_lights_punctual lights."""

from __future__ import annotations

import math

from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Camera, Light

LIGHTS = "KHR_lights_punctual"


def read_cameras(document: Document) -> tuple[Camera, ...]:
    """All cameras of the file."""
    return tuple(_camera(document, camera, f"/cameras/{i}") for i, camera in enumerate(document.root.cameras or []))


def read_lights(document: Document) -> tuple[Light, ...]:
    """All lights of the file; none where it does not use the extension."""
    lights = document.extension(document.root, LIGHTS, schema.PunctualLights, "")
    if lights is None:
        return ()
    return tuple(_light(document, light, f"/extensions/{LIGHTS}/lights/{i}") for i, light in enumerate(lights.lights))


def _camera(document: Document, camera: schema.Camera, pointer: str) -> Camera:
    p, o = camera.perspective, camera.orthographic
    if (p is None) == (o is None) or (p is None) == (camera.type == "perspective"):
        raise document.error(f"must have exactly one of perspective and orthographic, that of its type {camera.type}",
                             pointer)  # fmt: skip
    if p is not None:
        if p.yfov >= math.pi:
            raise document.error(f"yfov {p.yfov:g} is not below pi", f"{pointer}/perspective/yfov")
        if p.zfar is not None and p.zfar <= p.znear:
            raise document.error(f"zfar {p.zfar:g} is not beyond znear {p.znear:g}", f"{pointer}/perspective/zfar")
        return Camera(
            camera.name,
            "perspective",
            yfov=p.yfov,
            aspect=p.aspect_ratio,
            znear=p.znear,
            zfar=math.inf if p.zfar is None else p.zfar,
        )
    for name in ("xmag", "ymag"):
        if getattr(o, name) == 0:
            raise document.error(f"{name} must not be 0", f"{pointer}/orthographic/{name}")
    if o.zfar <= o.znear:
        raise document.error(f"zfar {o.zfar:g} is not beyond znear {o.znear:g}", f"{pointer}/orthographic/zfar")
    return Camera(camera.name, "orthographic", xmag=o.xmag, ymag=o.ymag, znear=o.znear, zfar=o.zfar)


def _light(document: Document, light: schema.PunctualLight, pointer: str) -> Light:
    spot = light.spot or schema.Spot()
    if light.type == "spot":
        if light.spot is None:
            raise document.error("a spot light must have the property spot", pointer)
        if not spot.inner_cone_angle < spot.outer_cone_angle <= math.pi / 2 + 1e-6:
            raise document.error(
                f"needs innerConeAngle {spot.inner_cone_angle:g} < outerConeAngle {spot.outer_cone_angle:g} <= pi/2",
                f"{pointer}/spot",
            )
    return Light(
        name=light.name,
        kind=light.type,
        color=light.color,
        intensity=light.intensity,
        range=math.inf if light.range is None else light.range,
        inner_cone=spot.inner_cone_angle,
        outer_cone=min(spot.outer_cone_angle, math.pi / 2),
    )
