"""Runs in Blender's Python: converts a file that Blender reads to .glb.  Imports only bpy, NumPy and its neighbors.

    python convert_script.py job.json

Reports events as lines that start with ``@tb `` and hold one JSON object.  All other output is Blender's.
"""

import bpy
from convert_light import bake_world, replace_area_lights
from convert_losses import NO_FORM, Losses
from convert_motion import CONVERTED, bake_motion
from convert_read import read
from script_shared import read_job, report, stop

KINDS = ("MESH", "CAMERA", "LIGHT", "ARMATURE")


def main():
    job = read_job()
    losses = Losses()
    try:
        take = read(job, losses)
    except Exception as error:  # an importer raises any type of exception for broken files
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        named = [line for line in lines if line.startswith("Error")] or lines[-1:] or [type(error).__name__]
        report(event="failed", why=f"Blender cannot read it: {named[-1].removeprefix('Error:').strip()}")
        stop(3)
    scene = bpy.context.scene
    if empty := what_is_left(scene):
        report(event="failed", why=f"has nothing to draw, only {empty}")
        stop(3)
    counts = {kind: sum(o.type == kind for o in scene.objects) for kind in KINDS}
    actions = len(bpy.data.actions)
    losses.of_scene(scene)
    motion = bake_motion(scene, losses)
    replace_area_lights(scene, losses)
    environment = bake_world(scene, job["environment"], losses)
    export(job, scene, motion["animated"])
    report(
        event="done",
        blender=bpy.app.version_string,
        counts=counts,
        actions=actions,
        take=take,
        lost=losses.lines(),
        fps=scene.render.fps / scene.render.fps_base,
        # The exporter multiplies the rate by fps_base where it should divide.
        time_scale=scene.render.fps_base**2,
        frames=[scene.frame_start, scene.frame_end],
        size=[scene.render.resolution_x, scene.render.resolution_y],
        visible=motion["visible"],
        camera=scene.camera.name if scene.camera else None,
        environment=environment,
    )
    stop(0)


def what_is_left(scene):
    """What a file holds that has nothing to draw, no camera and no light; None for any other."""
    types = {item.type for item in scene.objects}
    meshes = [item for item in scene.objects if item.type == "MESH"]
    drawn = any(item.data.polygons or item.modifiers for item in meshes) or bool(scene.world)
    if drawn or types & (CONVERTED - {"MESH"} | NO_FORM | {"CAMERA", "LIGHT"}):
        return None
    if any(item.instance_type != "NONE" for item in scene.objects):
        return None
    if meshes:
        return "points without faces"
    return "an armature and its animation" if "ARMATURE" in types else "empty objects"


def export(job, scene, animated):
    """Write the scene as one animation that begins at its first frame, sampled at every frame."""
    scene.frame_set(scene.frame_start)
    bpy.ops.export_scene.gltf(
        filepath=job["target"],
        export_format="GLB",
        export_yup=True,
        use_active_scene=True,
        use_renderable=True,
        export_cameras=True,
        export_lights=True,
        export_animations=animated,
        export_animation_mode="SCENE",
        export_anim_scene_split_object=False,
        export_anim_slide_to_zero=True,
        export_pointer_animation=True,
        export_optimize_animation_size=False,  # it takes motion of less than 1e-4 for none
        export_tangents=False,  # the scene reader computes the same tangents
        export_all_influences=True,
        export_import_convert_lighting_mode=job["lights"],
    )


if __name__ == "__main__":
    main()
