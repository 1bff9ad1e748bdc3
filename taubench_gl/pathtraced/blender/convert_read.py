"""Reads a file into Blender, with one consistent take of an FBX file.  Runs in Blender's Python."""

import math

import bpy
from convert_dae import import_dae
from convert_usd import import_usd
from script_shared import fcurves_of


def read(job, losses):
    """Open or import ``job["source"]``; the scene's frame range is then that of its animation.  -> the take's name."""
    take = job["take"]
    axes = {"forward_axis": "NEGATIVE_Z", "up_axis": "Y"} if job["up_axis"] == "Y" else {}
    source = job["source"]
    suffix = source.lower().rsplit(".", 1)[-1]
    if suffix == "blend":
        bpy.ops.wm.open_mainfile(filepath=source, load_ui=False, use_scripts=False)
        if bpy.app.autoexec_fail:
            losses.add("scripts inside the file are not run, and drivers that need them stand still")
        if bpy.context.scene.frame_start < 0:
            losses.add(f"frames before 0 are left out: the scene begins at frame {bpy.context.scene.frame_start}")
            bpy.context.scene.frame_start = 0
        if job["take"]:
            play_action(job["take"])
        note_unplayed(losses)
        return take
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if suffix == "fbx":
        if "fbx_import" not in dir(bpy.ops.wm):
            raise RuntimeError("Blender before 4.5 has no importer for all FBX files; use bpy 4.5")
        bpy.ops.wm.fbx_import(filepath=source, anim_offset=0.0)  # the default is one frame late
        take = choose_take(take, losses)
    elif suffix in ("usd", "usda", "usdc", "usdz"):
        import_usd(source, losses)
    elif suffix == "abc":
        bpy.ops.wm.alembic_import(filepath=source, as_background_job=False, set_frame_range=True)
        cameras = [item.name for item in bpy.data.objects if item.type == "CAMERA"]
        if cameras:
            losses.add("the animation of lenses in Alembic files: that of the first frame is kept", cameras)
    elif suffix == "ply":
        bpy.ops.wm.ply_import(filepath=source, **axes)
        note_ply_texture(source, losses)
    elif suffix == "stl":
        bpy.ops.wm.stl_import(filepath=source, **axes)
    elif suffix == "dae":
        import_dae(source, losses)
    if not bpy.data.objects:
        raise RuntimeError("nothing was imported")
    if suffix != "abc" and not suffix.startswith("usd"):
        range_of_actions(bpy.context.scene)
    return take


def play_action(name):
    """Play the action ``name`` on every object that it fits, and nothing else on these."""
    action = bpy.data.actions.get(name)
    if action is None:
        raise RuntimeError(f"the file has no action {name!r}; it has {', '.join(map(repr, bpy.data.actions.keys()))}")
    for owner in owners_of_actions():
        animation = owner.animation_data
        if animation is None:
            continue
        animation.action = action
        if hasattr(animation, "action_suitable_slots"):
            if not animation.action_suitable_slots:
                animation.action = None
                continue
            animation.action_slot = animation.action_suitable_slots[0]
        for track in animation.nla_tracks:
            track.mute = True
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = (max(round(frame), 0) for frame in action.frame_range)


def note_unplayed(losses):
    """Record the actions that nothing plays."""
    played = set()
    for owner in [*owners_of_actions(), *(m.node_tree for m in bpy.data.materials if m.node_tree)]:
        animation = owner.animation_data
        if animation is None:
            continue
        strips = [strip for track in animation.nla_tracks if not track.mute for strip in track.strips]
        played |= {animation.action, *(strip.action for strip in strips if not strip.mute)}
    left = [action.name for action in bpy.data.actions if action not in played]
    if left:
        losses.add("actions that are not played in the scene (--take in convert, else --animation, plays one)", left)


def owners_of_actions():
    return [
        *bpy.data.objects, *bpy.data.shape_keys, *bpy.data.materials, *bpy.data.cameras, *bpy.data.lights,
        *bpy.data.worlds, *bpy.data.scenes, *bpy.data.node_groups, *bpy.data.armatures, *bpy.data.meshes,
    ]  # fmt: skip


def choose_take(requested, losses):
    """Give every object its part of one take: ``requested``, else the first of the file.  -> its name.

    The importer makes an action of each take, in the order of the file, with a slot for each object; it gives every
    object the first take that moves it.
    """
    takes = sorted(bpy.data.actions, key=lambda action: action.session_uid)
    names = [take.name for take in takes]
    if requested and requested not in names:
        raise RuntimeError(
            f"the file has no take {requested!r}; it has {', '.join(map(repr, names)) or 'no animation'}"
        )
    if not takes:
        return None
    selected = bpy.data.actions[requested or names[0]]
    others = [name for name in names if name != selected.name]
    if others:
        losses.add(
            f"take {selected.name!r} is played, others are left out (--take in convert, else --animation)", others
        )
    for owner in owners_of_actions():
        if owner.animation_data is None:
            continue
        slots = {(slot.target_id_type, slot.name_display): slot for slot in selected.slots}
        slot = slots.get((owner.id_type, owner.name))
        owner.animation_data.action = selected if slot else None
        if slot:
            owner.animation_data.action_slot = slot
    for name in others:
        bpy.data.actions.remove(bpy.data.actions[name])
    return selected.name


def note_ply_texture(source, losses):
    """Record the texture that the header of a PLY file names, which Blender does not read."""
    with open(source, "rb") as file:
        for line in iter(lambda: file.readline(4096), b""):
            if line.startswith(b"comment TextureFile"):
                losses.add("the texture of PLY files", [line.split(None, 2)[2].decode("utf-8", "replace").strip()])
            if line.strip() == b"end_header":
                return


def range_of_actions(scene):
    """Set the scene's frame range to that of all actions; one frame without any."""
    ranges = [tuple(action.frame_range) for action in bpy.data.actions if any(True for _ in fcurves_of(action))]
    scene.frame_start = max(math.floor(min((a for a, _ in ranges), default=0)), 0)
    scene.frame_end = max(math.ceil(max((b for _, b in ranges), default=0)), scene.frame_start)
