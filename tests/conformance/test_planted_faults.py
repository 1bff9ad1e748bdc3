"""Faults that engines have, planted into right frames: each is found and named, and none is blamed on another one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from engine_frames import scored, truth_of

from taubench_gl import math3d
from taubench_gl.animation import pose_vertices
from taubench_gl.conformance.score import FIRST, NOT_JUDGED, RIGHT, WRONG


def vectors(change):
    """Spoils the vectors of every frame: ``change(vectors, frame, truth)``."""

    def spoil(truth, frames):
        return [replace(f, motion=change(f.motion.copy(), truth.frame(k), truth)) for k, f in enumerate(frames)]

    return spoil


def flat(image):
    return image.reshape(-1, image.shape[-1])


def reproject(truth, frame, before, now=None):
    """Vectors of surface points that were at ``before`` (h * w, 3): matrices and a division, written out here."""
    width, height = truth.size
    out = np.full((height * width, 2), np.nan)
    surface = np.flatnonzero(np.isfinite(flat(frame.position)[:, 0]))
    ends = []
    for view, points in ((frame.previous, before), (frame.view, flat(frame.position) if now is None else now)):
        clip_from_world = view.centered().clip_from_view(width, height) @ np.linalg.inv(
            math3d.affine(view.world_from_view, view.position)
        )
        clip = np.column_stack([points, np.ones(len(points))])[surface] @ clip_from_world.T
        ends.append(clip[:, :2] / clip[:, 3:] * [0.5 * width, -0.5 * height])
    out[surface] = ends[0] - ends[1]
    motion = frame.motion.copy().reshape(-1, 2)
    motion[surface] = out[surface]
    return motion.reshape(height, width, 2)


def previous_points(truth, frame, scene=None, state=None):
    """Previous points of the pixels, with another scene or state of the previous frame."""
    scene, state = scene or truth.scene, state or truth.state(frame.number - 1)
    parts = [pose_vertices(scene, state, p.node, p.primitive, p.instance) for p in truth._parts]
    return truth.at(frame.hits, np.concatenate(parts))


def camera_only(v, frame, truth):
    out = reproject(truth, frame, flat(frame.position))
    return np.where(np.isfinite(frame.position), out[..., :1], v[..., :1])[..., :1] * [1, 0] + out * [0, 1]


def bind_pose(v, frame, truth):
    """The joints' matrices of the previous frame were never uploaded: those of the file are used."""
    nodes, state = truth.scene.nodes, truth.state(frame.number - 1)
    world = np.array([math3d.trs(nodes.translation[n], nodes.rotation[n], nodes.scale[n]) for n in range(len(nodes))])
    for node in range(len(nodes)):  # parents come first in these files
        if nodes.parent[node] >= 0:
            world[node] = world[nodes.parent[node]] @ world[node]
    joints = truth.scene.skins[0].joints
    spoiled = state.world.copy()
    spoiled[joints] = world[joints]
    return reproject(truth, frame, previous_points(truth, frame, state=replace(state, world=spoiled)))


def base_shape(v, frame, truth):
    state = truth.state(frame.number - 1)
    still = replace(state, weights={node: np.zeros_like(w) for node, w in state.weights.items()})
    return reproject(truth, frame, previous_points(truth, frame, state=still))


def late(truth, frames):
    return [replace(f, motion=frames[max(k - 1, 0)].motion) for k, f in enumerate(frames)]


def jitter_left(v, frame, truth):
    offsets = truth.case.offsets(truth.size)
    return v - (offsets[max(frame.number - 1, 0)] - offsets[frame.number]) * [1, -1]


def transposed_skin(v, frame, truth):
    state, skin = truth.state(frame.number - 1), truth.scene.skins[0]
    palette = state.world[skin.joints] @ skin.inverse_bind
    turned = palette.copy()
    turned[:, :3, :3] = palette[:, :3, :3].transpose(0, 2, 1)
    node, world = int(truth.scene.mesh_nodes[-1]), state.world.copy()
    world[skin.joints] = turned @ np.linalg.inv(skin.inverse_bind)
    assert truth.scene.nodes.skin[node] == 0
    return reproject(truth, frame, previous_points(truth, frame, state=replace(state, world=world)))


def half_positions(v, frame, truth):
    half = [flat(p).astype(np.float16).astype(float) for p in (frame.prev_position, frame.position)]
    return reproject(truth, frame, *half)


def divided_at_vertices(v, frame, truth):
    """The vertex shader divides the previous position, and the rasterizer interpolates the quotient."""
    width, height = truth.size
    then = frame.previous
    relative = truth.vertices(frame.number - 1) - then.position
    clip = relative @ then.clip_from_relative(width, height)[:, :3].T + then.clip_from_relative(width, height)[:, 3]
    places = (clip[:, :2] / clip[:, 3:] * [1, -1] + 1) * 0.5 * np.array([width, height]) - 0.5
    before = np.einsum("nk,nki->ni", frame.hits.weights, places[truth.triangles[frame.hits.triangle]])
    at = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).reshape(-1, 2)
    moved = (before - at).reshape(v.shape)
    return np.where(np.isfinite(frame.position[..., :1]), moved, v)


def no_near_plane(v, frame, truth):
    return reproject(truth, frame, flat(frame.prev_position))


def mirror_lost(v, frame, truth):
    state = truth.state(frame.number - 1)
    world = state.world.copy()
    for node in truth.scene.mesh_nodes:
        if np.linalg.det(world[node][:3, :3]) < 0:
            world[node][:3, 0] *= -1
    return reproject(truth, frame, previous_points(truth, frame, state=replace(state, world=world)))


def sky_zero(v, frame, truth):
    return np.where(np.isfinite(frame.position[..., :1]), v, 0.0)


def sky_undivided(v, frame, truth):
    """The direction of a sky pixel, of depth 1 now, is projected by the previous camera without its division."""
    width, height = truth.size
    column, row = np.meshgrid(np.arange(width), np.arange(height))
    tangent = np.tan(0.5 * frame.view.camera.yfov)
    x = ((column + 0.5) / width * 2 - 1) * tangent * width / height
    y = (1 - (row + 0.5) / height * 2) * tangent
    ray = np.stack([x, y, -np.ones_like(x)], axis=-1) @ frame.view.world_from_view.T @ frame.previous.world_from_view
    moved = (ray[..., :2] - np.stack([x, y], axis=-1)) / tangent * 0.5 * height * [1, -1]
    return np.where(np.isfinite(frame.position[..., :1]), v, moved)


def first_garbage(v, frame, truth):
    return v if frame.number else np.random.default_rng(0).normal(0, 20, v.shape)


def wrapped(v, frame, truth):
    """Before the first frame is the end of the animation."""
    if frame.number:
        return v
    last = truth.frame(3)
    before = truth.at(frame.hits, truth.vertices(3))
    return reproject(truth, replace(frame, previous=last.view), before)


def alpha_ignored(v, frame, truth):
    hits = truth.cast(frame.number, frame.view, truth.pixels, masked=False)
    whole = replace(frame, position=truth.at(hits, truth.vertices(frame.number)).reshape(frame.position.shape))
    moved = reproject(truth, whole, truth.at(hits, truth.vertices(frame.number - 1)))
    return np.where(np.isfinite(whole.position[..., :1]), moved, v)


PLANTED = {
    "sign": (vectors(lambda v, f, t: -v), "negated", "pitch disocclusion-camera"),
    "y axis": (vectors(lambda v, f, t: v * [1, -1]), "y negated", "pitch translate"),
    "x axis": (vectors(lambda v, f, t: v * [-1, 1]), "x negated", "roll translate"),
    "scale by two": (vectors(lambda v, f, t: 2 * v), "twice", "dolly rotate"),
    "half the rate": (vectors(lambda v, f, t: 0.5 * v), "half", "translate rotate"),
    "camera only": (vectors(camera_only), "camera only", "attached skin kilometer"),
    "zero": (vectors(lambda v, f, t: 0 * v), "zero", "yaw attached"),
    "previous bind pose": (vectors(bind_pose), "previous bind pose", "skin skin-morph"),
    "base morph": (vectors(base_shape), "previous base shape", "morph skin-morph"),
    "late one frame": (late, "late", "translate yaw"),
    "jitter left in": (vectors(jitter_left), "jitter", "jitter"),
    "NDC": (vectors(lambda v, f, t: v / np.array(t.size) * 2), "ndc", "yaw dolly"),
    "rows": (vectors(lambda v, f, t: v[::-1]), "rows", "dolly roll"),
    "transposed skin": (vectors(transposed_skin), "transposed skin", "skin skin-morph"),
    "float16 positions": (vectors(half_positions), "half precision", "kilometer"),
    "near-plane division": (vectors(no_near_plane), "near plane", "behind"),
    "division at vertices": (vectors(divided_at_vertices), "divided at vertices", "near dolly"),
    "mirrored": (vectors(mirror_lost), "mirror lost", "mirror"),
    "sky zero": (vectors(sky_zero), "zero", "yaw sky"),
    "sky undivided": (vectors(sky_undivided), "sky undivided", "yaw sky"),
    "first frame garbage": (vectors(first_garbage), "first", "dolly yaw"),
    "wrapped time": (vectors(wrapped), "wrapped time", "dolly translate"),
    "alpha ignored": (vectors(alpha_ignored), "alpha ignored", "grid"),
}


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_named(name):
    spoil, cause, cases = PLANTED[name]
    failed = {}
    for score in scored(spoil, *cases.split()).values():
        assert score.status == WRONG, score
        failed |= {(score.name, each.name): each.cause for each in score.classes if each.failed}
    if cause == FIRST:
        assert {kind for _, kind in failed} == {FIRST}
    else:
        assert set(failed.values()) == {cause}, failed


def pixels_of(frame, truth, name):
    return frame.node == truth.scene.nodes.names.index(name)


def redrawn(truth, frames, points_of):
    """Frames whose surface points are ``points_of(k)``, (h * w, 3) world, NaN for sky."""
    out = []
    for k, frame in enumerate(frames):
        points = points_of(k).reshape(frame.points.shape) - truth.view(k).position
        out.append(replace(frame, points=points, sky=np.isnan(points[..., 0])))
    return out


def cast(truth, k, view=None, pose=pose_vertices, **changes):
    """Surface points of frame ``k`` as ``Truth.cast`` finds them with the keywords ``changes``, (h * w, 3) world."""
    hits = truth.cast(k, view or truth.view(k), truth.pixels, pose, **changes)
    return truth.at(hits, truth.vertices(k, pose))


def wrong_camera(truth, frames):
    """Frames of the surfaces of ``truth`` from a camera 20 cm to the right."""

    def points(k):
        return cast(truth, k, replace(truth.view(k), position=truth.view(k).position + [0.2, 0.0, 0.0]))

    return redrawn(truth, frames, points)


def without_box(truth, frames):
    node = truth.scene.nodes.names.index("moving box")
    return redrawn(truth, frames, lambda k: cast(truth, k, without=node))


def doubled(truth, frames):
    return [replace(f, points=2 * (f.points + truth.view(k).position) - truth.view(k).position)
            for k, f in enumerate(frames)]  # fmt: skip


def z_up(truth, frames):
    """Blender's axes: (x, -z, y)."""
    return [
        replace(f, points=(f.points + truth.view(k).position)[..., [0, 2, 1]] * [1, -1, 1] - truth.view(k).position)
        for k, f in enumerate(frames)
    ]


def upside_down(truth, frames):
    return [replace(f, points=f.points[::-1], sky=f.sky[::-1]) for f in frames]


def poses_late(truth, frames):
    return redrawn(truth, frames, lambda k: truth.frame(max(k - 1, 0)).position)


def no_visibility(truth, frames):
    return redrawn(truth, frames, lambda k: cast(truth, k, hidden=True))


def opaque(truth, frames):
    return redrawn(truth, frames, lambda k: cast(truth, k, masked=False))


def late_swarm(truth, frames):
    """A small moving object is drawn one frame late, all else is right."""

    def points(k):
        def pose(scene, state, node, *part):
            late = truth.state(k - 1) if scene.nodes.names[node] == "swarm" else state
            return pose_vertices(scene, late, node, *part)

        return cast(truth, k, pose=pose)

    return redrawn(truth, frames, points)


@pytest.mark.parametrize(
    ("spoil", "case", "word"),
    [(wrong_camera, "translate", "camera"), (without_box, "translate", "'moving box' is missing"),
     (doubled, "dolly", "2 times"), (z_up, "dolly", "axes"), (upside_down, "yaw", "rows"), (poses_late, "yaw", "pose"),
     (no_visibility, "visibility", "hidden"), (opaque, "grid", "alpha"),
     (late_swarm, "instances", "pose")],
)  # fmt: skip
def test_a_scene_not_loaded_as_written_is_not_judged(spoil, case, word):
    score = scored(spoil, case)[case]
    assert score.status == NOT_JUDGED and not score.classes
    assert word in score.reason


def test_without_geometry_nothing_is_judged():
    score = scored(lambda truth, frames: [replace(f, points=None, normal=None) for f in frames], "dolly")["dolly"]
    assert score.status == NOT_JUDGED


def test_normals_alone_show_the_scene():
    def keep(truth, frames):
        return [replace(f, points=None) for f in frames]

    def turn(truth, frames):
        return [replace(f, points=None, normal=np.roll(f.normal, 1, axis=-1)) for f in frames]

    assert scored(keep, "dolly")["dolly"].status == RIGHT
    assert scored(turn, "dolly")["dolly"].status == NOT_JUDGED


def test_half_floats_have_half_a_step_more():
    def halved(truth, frames):
        from taubench_gl.conformance.frames import half_step

        stored = [f.motion.astype(np.float16).astype(float) for f in frames]
        return [replace(f, motion=m, step_px=half_step(m)) for f, m in zip(frames, stored, strict=True)]

    assert {s.status for s in scored(halved, "behind", "yaw", "still").values()} == {RIGHT}


def test_truth_is_of_the_same_surface_point():
    frame, truth = truth_of("skin").frame(2), truth_of("skin")
    moved = reproject(truth, frame, flat(frame.prev_position))
    assert np.nanmax(np.abs(moved - frame.motion)) < 1e-9
