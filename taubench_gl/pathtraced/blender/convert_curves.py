"""Animation curves of Blender, read and written.  Runs in Blender's Python."""

import bpy
import numpy as np
from script_shared import fcurves_of

LINEAR = bpy.types.Keyframe.bl_rna.properties["interpolation"].enum_items["LINEAR"].value


def is_animated(owner, path):
    """Whether a curve or a driver moves the property ``path`` of an ID."""
    animation = owner.animation_data
    if animation is None:
        return False
    curves = [*(fcurves_of(animation.action) if animation.action else ()), *animation.drivers]
    strips = (strip for track in animation.nla_tracks for strip in track.strips if strip.action)
    curves += [curve for strip in strips for curve in fcurves_of(strip.action)]
    return any(curve.data_path == path for curve in curves)


def key_values(holder, path, full_path, frames, values):
    """Key the property ``path`` of ``holder``, ``full_path`` of its ID, linearly: frames (K,), values (K, n)."""
    owner = holder.id_data
    holder.keyframe_insert(path, frame=frames[0])
    values = np.asarray(values, dtype=np.float64).reshape(len(frames), -1)
    for curve in fcurves_of(owner.animation_data.action):
        if curve.data_path != full_path:
            continue
        points = curve.keyframe_points
        points.add(len(frames) - len(points))
        points.foreach_set("co", np.column_stack([frames, values[:, curve.array_index]]).astype(np.float32).ravel())
        points.foreach_set("interpolation", np.full(len(frames), LINEAR, dtype=np.int32))
        curve.update()
