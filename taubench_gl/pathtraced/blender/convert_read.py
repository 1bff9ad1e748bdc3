"""Reads a file into Blender, with one consistent take of an FBX file.  Runs in Blender's Python."""

import math

import bpy
from script_shared import fcurves_of

NAME_LIMIT = 60  # Blender 4 cuts names at 63 bytes


def read(job, losses):
    """Open or import ``job["source"]``; the scene's frame range is then that of its animation."""
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
        return
    bpy.ops.wm.read_factory_settings(use_empty=True)
    if suffix == "fbx":
        bpy.ops.import_scene.fbx(filepath=source, anim_offset=0.0)  # the default is one frame late
        choose_take(source, job["take"], losses)
    elif suffix in ("usd", "usda", "usdc", "usdz"):
        bpy.ops.wm.usd_import(filepath=source, import_all_materials=False)
    elif suffix == "abc":
        bpy.ops.wm.alembic_import(filepath=source, as_background_job=False, set_frame_range=True)
        cameras = [item.name for item in bpy.data.objects if item.type == "CAMERA"]
        if cameras:
            losses.add("the animation of lenses in Alembic files: that of the first frame is kept", cameras)
    elif suffix == "ply":
        bpy.ops.wm.ply_import(filepath=source)
    elif suffix == "stl":
        bpy.ops.wm.stl_import(filepath=source)
    elif suffix == "dae":
        if not hasattr(bpy.ops.wm, "collada_import") or "collada_import" not in dir(bpy.ops.wm):
            raise RuntimeError("Blender 5 does not read Collada; use bpy 4.5")
        bpy.ops.wm.collada_import(filepath=source)
    if not bpy.data.objects:
        raise RuntimeError("nothing was imported")
    if suffix != "abc" and not suffix.startswith("usd"):
        range_of_actions(bpy.context.scene)


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
        losses.add("actions that are not played in the scene (--take plays one)", left)


def owners_of_actions():
    return [
        *bpy.data.objects, *bpy.data.shape_keys, *bpy.data.materials, *bpy.data.cameras, *bpy.data.lights,
        *bpy.data.worlds, *bpy.data.scenes, *bpy.data.node_groups, *bpy.data.armatures, *bpy.data.meshes,
    ]  # fmt: skip


def choose_take(source, requested, losses):
    """Give every object its action of one take: ``requested``, else the first of the file.

    The importer names actions ``object|take|layer`` and gives each object the first one that it finds, whatever its
    take.
    """
    takes = [take for take in takes_of(source) if any(f"|{take}"[:NAME_LIMIT] in a.name for a in bpy.data.actions)]
    if requested and requested not in takes:
        raise RuntimeError(
            f"the file has no take {requested!r}; it has {', '.join(map(repr, takes)) or 'no animation'}"
        )
    if not takes:
        return
    selected = requested or takes[0]
    others = [take for take in takes if take != selected]
    if others:
        losses.add(f"take {selected!r} is played, others are left out (--take)", others)
    longest_first = sorted(takes, key=len, reverse=True)
    for owner in owners_of_actions():
        if owner.animation_data is None:
            continue
        actions = []
        for action in bpy.data.actions:
            starts = (f"{owner.name}|{take}" for take in longest_first)
            at = next((k for k, start in enumerate(starts) if action.name.startswith(start[:NAME_LIMIT])), None)
            if at is not None and longest_first[at] == selected:
                actions.append(action)
        if len(actions) > 1:
            losses.add("animation layers above the first are left out", [owner.name])
        owner.animation_data.action = actions[0] if actions else None
        if actions and hasattr(owner.animation_data, "action_slot") and actions[0].slots:
            owner.animation_data.action_slot = actions[0].slots[0]
    for action in list(bpy.data.actions):
        if action.users == action.use_fake_user:
            bpy.data.actions.remove(action)


def takes_of(source):
    """Names of the animation stacks of a binary FBX file, in its order."""
    from io_scene_fbx import parse_fbx

    root, _ = parse_fbx.parse(source)
    objects = [element for element in root.elems if element is not None and element.id == b"Objects"]
    stacks = [e for part in objects for e in part.elems if e is not None and e.id == b"AnimationStack"]
    return list(dict.fromkeys(stack.props[1].split(b"\0")[0].decode("utf-8", "replace") for stack in stacks))


def range_of_actions(scene):
    """Set the scene's frame range to that of all actions; one frame without any."""
    ranges = [tuple(action.frame_range) for action in bpy.data.actions if any(True for _ in fcurves_of(action))]
    scene.frame_start = max(math.floor(min((a for a, _ in ranges), default=0)), 0)
    scene.frame_end = max(math.ceil(max((b for _, b in ranges), default=0)), scene.frame_start)
