"""Two-sided interpolation between the last two rendered frames, with occlusion from the motion of both."""

import numpy as np

from taubench_gl.reuse.splatting import BACKGROUND, moving, splat


class Interpolate:
    """Both frames are splatted to the time between them.  Where they show the same depth they are blended by time; else
    the surface that is nearer, or that one frame alone has, is shown.

    Forward motion of the earlier frame is the motion of the later one, splatted back; what the later one hides goes on
    moving as before.  Edges in front of either frame are shown, so they grow by up to a pixel.  Departs: no optical
    flow, so shadows and reflections are blended where they were and are.
    """

    name = "interpolate"
    title = "Two-sided interpolation by splatting"
    cite = "Yang et al. 2011, Image-based bidirectional scene reprojection, ACM TOG 30 (6)"
    reads = ("radiance", "motion", "position")
    generates = "interpolate"

    def __init__(self, size, settings):
        self.earlier = None

    def step(self, frame):
        depth = np.where(frame["position"][..., 3] > 0, frame["position"][..., 3], np.inf)
        now = frame["radiance"][..., :3], moving(frame["motion"]), depth
        if frame["phase"] == 0 or self.earlier is None:
            self.earlier = now
            return now[0]
        helpers, share = frame["helpers"], frame["phase"]
        (color, motion, _), (then, then_motion, then_depth) = now, self.earlier
        pixels = helpers.pixels()
        back = splat(pixels + motion, depth)
        seen = back.covered & (back.depth <= then_depth * BACKGROUND)
        forward = np.where(seen[..., None], -helpers.nearest(motion, back.at), -then_motion)
        late = splat(pixels + (1 - share) * motion, depth)
        early = splat(pixels + share * forward, then_depth)
        only_late = late.covered & (~early.covered | (late.depth < early.depth / BACKGROUND))
        only_early = early.covered & (~late.covered | (early.depth < late.depth / BACKGROUND))
        weight = np.where(only_late, 1.0, np.where(only_early, 0.0, share))[..., None]
        return weight * late.values(color, helpers) + (1 - weight) * early.values(then, helpers)
