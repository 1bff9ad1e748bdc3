"""Motion extrapolation: surfaces go on moving over the screen as they did between the last two rendered frames."""

from taubench_gl.reuse.splatting import moving, splat


class Extrapolate:
    """Every pixel moves on along its motion, the nearest surface wins, holes have the color of their background.

    Departs: lights, shadows and reflections move with the surface; no network corrects them.
    """

    name = "extrapolate"
    title = "Motion extrapolation by splatting"
    cite = (
        "Didyk et al. 2010, Perceptually-motivated real-time temporal upsampling of 3D content, EG",
        "Guo et al. 2021, ExtraNet: real-time extrapolated rendering, ACM TOG 40 (6): motion of the last two frames",
    )
    reads = ("radiance", "motion", "position")
    generates = "extrapolate"

    def __init__(self, size, settings):
        pass

    def step(self, frame):
        helpers, color = frame["helpers"], frame["radiance"][..., :3]
        if frame["phase"] == 0:
            return color
        at = helpers.pixels() - frame["phase"] * moving(frame["motion"])
        return splat(at, frame["position"][..., 3]).values(color, helpers)
