"""Positional space warp: the last rendered frame, seen by depth from the newest camera."""

import numpy as np

from taubench_gl.reuse.splatting import splat


class SpaceWarp:
    """Every surface point is projected by the newest camera; ``timewarp`` is its case of a camera that only turns.

    Departs: products of headset makers warp a grid of vertices and let it stretch over holes.
    """

    name = "space-warp"
    title = "Positional space warp to the newest camera"
    cite = "McMillan and Bishop 1995, Plenoptic modeling, SIGGRAPH: image warping by depth"
    reads = ("radiance", "position", "prev_position")
    generates = "extrapolate"
    settings = {"objects": {"default": True, "doc": "surfaces also go on moving in the world"}}  # noqa: RUF012

    def __init__(self, size, settings):
        self.objects = settings["objects"]

    def step(self, frame):
        color, position, pair = frame["radiance"][..., :3], frame["position"], frame["pair"]
        height, width = color.shape[:2]
        surface = position[..., 3:] > 0
        x, y = np.meshgrid(np.arange(width), np.arange(height)[::-1])  # y of the rays is up
        rays = pair.sky_origin + x[..., None] * pair.sky_dx + y[..., None] * pair.sky_dy
        points = np.where(surface, np.append(position[..., :3], surface, axis=-1), rays)
        if self.objects:
            step = position[..., :3] + pair.camera_delta - frame["prev_position"][..., :3]
            points[..., :3] += frame["phase"] * np.where(surface & np.isfinite(step), step, 0.0)
        clip = points @ frame["shown_clip_from_current"].T
        front = np.where(clip[..., 3] > 0, clip[..., 3], np.nan)[..., None]
        at = (0.5 * clip[..., :2] / front + 0.5) * [width, height] - 0.5
        at[..., 1] = height - 1 - at[..., 1]
        return splat(at, np.nan_to_num(np.where(surface, front, 0.0)[..., 0])).values(color, frame["helpers"])
