"""Motion extrapolation: surfaces go on moving over the screen as they did between the last two rendered frames."""

from taubench_gl.reuse.splatting import moving, splat


class Extrapolate:
    """Every pixel moves on along its motion, the nearest surface wins, holes have the color of their background.

    Departs: lights, shadows and reflections move with the surface; no network corrects them.
    """

    name = "extrapolate"
    title = "Motion extrapolation by splatting"
    cite = "Guo et al. 2021, ExtraNet: real-time extrapolated rendering, ACM TOG 40 (6): without its network"
    reads = ("radiance", "motion", "position")
    generates = "extrapolate"

    def __init__(self, size, settings):
        pass

    def step(self, frame):
        helpers, color = frame["helpers"], frame["radiance"][..., :3]
        at = helpers.pixels() - frame["phase"] * moving(frame["motion"])
        return splat(at, frame["position"][..., 3]).values(color, helpers)
