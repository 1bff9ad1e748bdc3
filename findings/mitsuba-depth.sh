#!/usr/bin/env bash
# The AOV depth of a perspective camera: documented as the distance from the pinhole, it starts at the near clipping plane.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv" && "$folder/venv/bin/pip" -q --disable-pip-version-check install mitsuba==3.9.1 numpy==2.4.6 || exit 2
cd "$folder" && "$folder/venv/bin/python" - <<'PYTHON'
import mitsuba as mi
import numpy as np

mi.set_variant("scalar_rgb")


def passes(near):
    """Depth (h, w) and the distance of the position AOV from the camera (h, w) of a wall 5 m away."""
    film = {"type": "hdrfilm", "width": 33, "height": 33, "rfilter": {"type": "box"}, "pixel_format": "rgb"}
    sampler = {"type": "stratified", "sample_count": 1, "jitter": False}  # the pixel center
    sensor = {"type": "perspective", "fov": 80, "near_clip": near, "film": film, "sampler": sampler}
    wall = {"type": "rectangle", "to_world": mi.ScalarTransform4f().translate([0, 0, 5]).scale(20)}
    integrator = {"type": "aov", "aovs": "d:depth,p:position"}
    image = np.array(mi.render(mi.load_dict({"type": "scene", "integrator": integrator, "sensor": sensor, "wall": wall})))
    depth, position = image[..., -4], image[..., -3:]
    return depth, np.linalg.norm(position, axis=-1)


worst = 0.0
for near in (0.01, 1.0, 4.0):
    depth, distance = passes(near)
    cosine = 5.0 / distance
    worst = max(worst, np.abs(depth - (distance - near / cosine)).max())
    print(f"mitsuba 3.9.1, near_clip {near}: depth {depth[16, 16]:.3f} in the center, {depth[0, 0]:.3f} in a corner; "
          f"distances {distance[16, 16]:.3f}, {distance[0, 0]:.3f}")  # fmt: skip
print(f"depth = distance - near_clip / cos(angle) to {worst:.1e}")
raise SystemExit(not (worst < 1e-4 and abs(depth[16, 16] - 1.0) < 1e-3))
PYTHON
