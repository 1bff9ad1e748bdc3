"""Reads a USD file with what Blender's importer leaves out: rate, samples of light and visibility, strength of suns.

Runs in Blender's Python, whose own ``pxr`` reads the file.
"""

import math

import bpy
import numpy as np
from convert_curves import key_values

STRENGTH = ("inputs:intensity", "inputs:exposure", "inputs:color")
SIZES = ("inputs:radius", "inputs:width", "inputs:height", "inputs:angle", "inputs:shaping:cone:angle")
POWER = math.pi
"""Power in watts that Blender gives a light of intensity 1, for each square meter unless it is normalized."""


def import_usd(source, losses):
    """Import ``source``.  Raises RuntimeError for a file that cannot be read."""
    bpy.utils.expose_bundled_modules()
    from pxr import Usd, UsdGeom, UsdLux

    found = {}

    class Completion(bpy.types.USDHook):
        bl_idname, bl_label = "TAUBENCH_completion", "completion"

        @staticmethod
        def on_import(context):
            for path, ids in context.get_prim_map().items():
                for item in ids:
                    found.setdefault(item, []).append(str(path))
            return True

    bpy.utils.register_class(Completion)
    bpy.ops.wm.usd_import(filepath=source, import_all_materials=False)
    stage, scene = Usd.Stage.Open(source), bpy.context.scene
    rate = stage.GetTimeCodesPerSecond()
    scene.render.fps = max(round(rate), 1)
    scene.render.fps_base = scene.render.fps / rate
    for item in bpy.data.objects:
        # The importer joins an Xform and its only child: the longest path is that of what is drawn.
        paths = [*found.get(item, ()), *(found.get(item.data, ()) if item.data is not None else ())]
        if paths:
            prim = stage.GetPrimAtPath(max(paths, key=len))
            complete_visibility(item, prim, UsdGeom)
            if item.type == "LIGHT":
                complete_light(item, prim, losses)
    domes = [p.GetName() for p in stage.Traverse() if p.IsA(UsdLux.DomeLight) and times_of(p, STRENGTH)]
    if domes:
        losses.add("the animation of dome lights: its first frame is the environment", domes)


def times_of(prim, names):
    """Times of all samples of the attributes ``names``, in frames, increasing."""
    return sorted({t for name in names if (a := prim.GetAttribute(name)) for t in a.GetTimeSamples()})


def complete_visibility(item, prim, geometry):
    """Key ``hide_render`` of an object by the samples of its prim and of those above it."""
    above, times = prim, set()
    while above:
        times.update(times_of(above, ("visibility",)))
        above = above.GetParent()
    for time in sorted(times):
        item.hide_render = geometry.Imageable(prim).ComputeVisibility(time) == geometry.Tokens.invisible
        item.keyframe_insert("hide_render", frame=time)


def complete_light(item, prim, losses):
    """Set, or key at its samples, the energy and color of a light."""
    light, times = item.data, times_of(prim, STRENGTH)
    if times_of(prim, SIZES):
        losses.add("the animated size and cone of lights", [item.name])
    if not times and light.type != "SUN":
        return

    def value(name, time, default):
        attribute = prim.GetAttribute(name)
        found = attribute.Get(time) if attribute else None
        return default if found is None else found

    # One intensity is, by UsdLux: the irradiance of a sun that is normalized or has no size, else its radiance; Blender
    # takes the power of points and areas in watts, and makes suns 4 times stronger.
    shares = 1.0
    if light.type != "SUN":
        shares = POWER if light.normalize else POWER * light.area(matrix_world=item.matrix_world)
    elif not value("inputs:normalize", 0.0, False) and (angle := value("inputs:angle", 0.0, 0.53)) > 0:
        shares = math.pi * math.sin(math.radians(0.5 * angle)) ** 2
    light.normalize, light.exposure = True, 0.0
    strengths = [
        shares * value("inputs:intensity", t, 1.0) * 2.0 ** value("inputs:exposure", t, 0.0) for t in times or [0.0]
    ]
    light.energy = strengths[0]
    if np.ptp(strengths) > 0:
        key_values(light, "energy", "energy", times, strengths)
    colors = np.array([value("inputs:color", t, (1.0, 1.0, 1.0)) for t in times or [0.0]])
    if np.ptp(colors, axis=0).any():
        key_values(light, "color", "color", times, colors)
