"""How page and viewer open at the pair of frames of a demo."""

from __future__ import annotations

from typing import Any

from taubench_gl.animation import choose_camera
from taubench_gl.demos.demo import Demo
from taubench_gl.features import TABLE
from taubench_gl.glossary import label_of

FPS = 1.0
"""Frames per second of a demo whose opening names no other rate."""


def opening_settings(demo: Demo) -> dict[str, Any]:
    """Fields of Settings of the pair: columns of its masks and color, the camera, and what the opening sets.

    The camera is named, because an evaluation of a still scene otherwise has a framing orbit.
    """
    return {"columns": _columns(demo), "fps": FPS, "camera": _camera(demo), **demo.opening.settings}


def _camera(demo: Demo) -> int:
    """Index of the scene's own camera."""
    scene = demo.scene()
    return list(scene.camera_nodes).index(choose_camera(scene).node)


def _columns(demo: Demo) -> tuple[str, ...]:
    """The columns that measure the masks of the opening, and color."""
    shown = 0
    for mask in demo.opening.masks:
        shown |= mask
    measured = (f.name for f in TABLE if f.name != "color" and any(bit & shown for bit in (f.bit, *f.details)))
    return ("frustum", *measured, "color")


def pair_text(demo: Demo) -> str:
    """``Frames 0 and 1 at 1 frame per second; masks: position; reprojection: motion.``"""
    opening, fps = demo.opening, opening_settings(demo)["fps"]
    masks = ", ".join(label_of(mask) for mask in opening.masks)
    rest = {k: v for k, v in opening.settings.items() if k not in ("fps", "columns")}
    more = "".join(f"; {name.replace('_', ' ')}: {_text(value)}" for name, value in rest.items())
    rate = f"{fps:g} frame{'s' if fps != 1 else ''} per second"
    eyes = rest.get("history") == "eye"
    which = f"Frame {opening.frame}, both eyes," if eyes else f"Frames {opening.frame - 1} and {opening.frame}"
    return f"{which} at {rate}; masks: {masks}{more}."


def _text(value: Any) -> str:
    return ", ".join(f"{k} {v:.4g}" for k, v in value.items()) if isinstance(value, dict) else str(value)
