"""Nodes, the hierarchy, the selected scene, skins, cameras, lights and EXT_mesh_gpu_instancing."""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.build import Node, NodeList
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import FLOAT, Accessors
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.gltf.meshes import morph_weights
from taubench_gl.scene.model import Camera, Light, Mesh, Nodes, Skin

Array = np.ndarray

LIGHTS = "KHR_lights_punctual"
LIGHT_TYPES = ("directional", "point", "spot")
WIDEST_YFOV = math.radians(179.0)
"""Field of view in place of one of 180 degrees or more."""


def read_cameras(document: Document) -> tuple[Camera, ...]:
    """All cameras of the file."""
    return tuple(_camera(document, camera, f"/cameras/{i}") for i, camera in enumerate(document.root.cameras or []))


def read_lights(document: Document) -> tuple[Light, ...]:
    """All lights of KHR_lights_punctual in the file."""
    lights = punctual_lights(document)
    if lights is None:
        return ()
    return tuple(_light(document, light, f"/extensions/{LIGHTS}/lights/{i}") for i, light in enumerate(lights.lights))


def punctual_lights(document: Document) -> schema.PunctualLights | None:
    """The lights of the file as JSON; those of unknown type, which ``unknown_lights`` lists, as points."""
    raw = document.root.extensions.get(LIGHTS)
    unknown = unknown_lights(document)
    if unknown and not document.strict:
        listed = [light | {"type": "point"} if i in unknown else light for i, light in enumerate(raw["lights"])]
        for i in unknown:
            document.repair("light-type", "is of unknown type", f"/extensions/{LIGHTS}/lights/{i}/type")
        own_property = schema.Property(extensions={LIGHTS: {"lights": listed}})
        return document.extension(own_property, LIGHTS, schema.PunctualLights, "")
    return document.extension(document.root, LIGHTS, schema.PunctualLights, "")


def unknown_lights(document: Document) -> frozenset[int]:
    """Indices of lights whose type is none of ``LIGHT_TYPES``."""
    lights = document.root.extensions.get(LIGHTS, {}).get("lights")
    entries = enumerate(lights) if isinstance(lights, list) else ()
    return frozenset(i for i, light in entries if isinstance(light, dict) and light.get("type") not in LIGHT_TYPES)


def _camera(document: Document, camera: schema.Camera, pointer: str) -> Camera:
    p, o = camera.perspective, camera.orthographic
    if (p is None) == (o is None) or (p is None) == (camera.type == "perspective"):
        message = f"must have exactly one of perspective and orthographic, matching its type {camera.type}"
        document.repair("camera", message, pointer)
        if p is None and o is None:
            return Camera(camera.name, camera.type, zfar=math.inf if camera.type == "perspective" else 100.0)
        p = p if o is None or camera.type == "perspective" else None
    return (
        _perspective(document, camera.name, p, pointer)
        if p is not None
        else _orthographic(document, camera.name, o, pointer)
    )


def _perspective(document: Document, name: str, p: schema.Perspective, pointer: str) -> Camera:
    yfov, zfar = p.yfov, math.inf if p.zfar is None else p.zfar
    if yfov >= math.pi:
        document.repair("camera", f"yfov {yfov:g} is not below pi", f"{pointer}/perspective/yfov")
        yfov = WIDEST_YFOV
    if zfar <= p.znear:
        message = f"zfar {zfar:g} is not greater than znear {p.znear:g}"
        document.repair("camera", message, f"{pointer}/perspective/zfar")
        zfar = math.inf
    return Camera(name, "perspective", yfov=yfov, aspect=p.aspect_ratio, znear=p.znear, zfar=zfar)


def _orthographic(document: Document, name: str, o: schema.Orthographic, pointer: str) -> Camera:
    xmag, ymag, zfar = o.xmag, o.ymag, o.zfar
    for side in ("xmag", "ymag"):
        if getattr(o, side) == 0:
            document.repair("camera", f"{side} must not be 0", f"{pointer}/orthographic/{side}")
    xmag, ymag = xmag or ymag or 1.0, ymag or xmag or 1.0
    if zfar <= o.znear:
        message = f"zfar {zfar:g} is not greater than znear {o.znear:g}"
        document.repair("camera", message, f"{pointer}/orthographic/zfar")
        zfar = o.znear + 100.0
    return Camera(name, "orthographic", xmag=xmag, ymag=ymag, znear=o.znear, zfar=zfar)


def _light(document: Document, light: schema.PunctualLight, pointer: str) -> Light:
    spot = light.spot or schema.Spot()
    inner, outer = spot.inner_cone_angle, spot.outer_cone_angle
    if light.type == "spot":
        if light.spot is None:
            document.repair("light-cone", "a spot light must have the property spot", pointer)
        # The extension wants inner < outer; Blender writes equal angles for a spot light with blend 0.
        if not inner <= outer <= math.pi / 2 + 1e-6 or not outer:
            message = f"needs innerConeAngle {inner:g} <= outerConeAngle {outer:g} <= pi/2"
            document.repair("light-cone", message, f"{pointer}/spot")
            outer = min(outer, math.pi / 2) or schema.Spot().outer_cone_angle
            inner = min(inner, outer)
    return Light(
        name=light.name,
        kind=light.type,
        color=light.color,
        intensity=light.intensity,
        range=math.inf if light.range is None else light.range,
        inner_cone=inner,
        outer_cone=min(outer, math.pi / 2),
    )


def read_skins(document: Document, accessors: Accessors, parent: Array) -> tuple[Skin, ...]:
    """All skins of the file.  ``parent`` (N,) of the nodes, without cycles."""
    return tuple(
        _skin(document, accessors, skin, parent, f"/skins/{i}") for i, skin in enumerate(document.root.skins or [])
    )


def _skin(document: Document, accessors: Accessors, skin: schema.Skin, parent: Array, pointer: str) -> Skin:
    for k, joint in enumerate(skin.joints):
        document.item("nodes", joint, f"{pointer}/joints/{k}")
    if not skin.joints:
        hint = "glTF forbids empty arrays: omit the property"
        document.repair("skin-ignored", "Expected array of length >= 1", f"{pointer}/joints", hint)
    if len(set(skin.joints)) != len(skin.joints):
        document.repair("skin-joints", "lists a joint twice", f"{pointer}/joints")
    _check_common_root(document, skin, parent, pointer)
    count = len(skin.joints)
    inverse_bind = np.tile(np.eye(4), (count, 1, 1))
    if skin.inverse_bind_matrices is not None:
        where = f"{pointer}/inverseBindMatrices"
        accessor = accessors.get(skin.inverse_bind_matrices, where)
        if accessor.type != "MAT4" or accessor.component_type != FLOAT:
            raise document.error(
                f"is {accessors.describe(skin.inverse_bind_matrices, where)}, must be MAT4 of FLOAT", where
            )
        accessors.no_stride(skin.inverse_bind_matrices, where)
        stored = min(accessor.count, count)
        if stored < count:
            message = f"{accessor.count} matrices for {count} joints"
            document.repair("bind-matrix", message, where, count=count - stored)
        # glTF is column-major: rows of the reshaped array are columns.
        raw = accessors.raw(skin.inverse_bind_matrices, where)[:stored].astype(np.float64)
        inverse_bind[:stored] = raw.reshape(stored, 4, 4).swapaxes(1, 2)
        projective = np.any(inverse_bind[:, 3] != (0, 0, 0, 1), axis=1)
        if np.any(projective):
            message = f"matrix {int(np.argmax(projective))} has a last row other than 0 0 0 1"
            document.repair("bind-matrix", message, where, count=int(projective.sum()))
            inverse_bind[:, 3] = (0, 0, 0, 1)
    joints = np.array(skin.joints, dtype=np.int32)
    joints.flags.writeable = inverse_bind.flags.writeable = False
    return Skin(skin.name, joints, inverse_bind)


def _lineage(node: int, parent: Array) -> list[int]:
    out = [node]
    while parent[out[-1]] >= 0:
        out.append(int(parent[out[-1]]))
    return out


def _check_common_root(document: Document, skin: schema.Skin, parent: Array, pointer: str) -> None:
    common: set[int] | None = None
    seen: set[int] = set()
    for joint in skin.joints:
        if common is not None and parent[joint] in seen:
            seen.add(joint)  # its ancestors are itself and those of a joint already visited
            continue
        lineage = _lineage(joint, parent)
        common = set(lineage) if common is None else common & set(lineage)
        seen.add(joint)
    if not common and skin.joints:
        document.repair("skin-joints", "joints have no common root", f"{pointer}/joints")
    if skin.skeleton is not None and skin.skeleton not in (common or ()):
        message = f"nodes[{skin.skeleton}] is not a common root of the joints"
        document.repair("skin-joints", message, f"{pointer}/skeleton")


QUATERNION_TOLERANCE = 0.00769  # on the length, as in the Khronos validator: a step of a normalized byte
MATRIX_TOLERANCE = 1e-3  # on the cosine between columns
MAX_DEPTH = 2000
"""Limit on the depth of the hierarchy: world matrices are composed level by level."""

INSTANCE_BYTES = 600
"""Memory of one instance while its matrix is made: float64 parts, rotation and matrix."""

INSTANCING, VISIBILITY = "EXT_mesh_gpu_instancing", "KHR_node_visibility"


def parents(document: Document) -> Array:
    """Parent of every node, -1 for roots.  (N,) int32.  Raises SceneError for second parents and cycles."""
    nodes = document.root.nodes or []
    parent = np.full(len(nodes), -1, dtype=np.int32)
    for i, node in enumerate(nodes):
        for k, child in enumerate(node.children or []):
            pointer = f"/nodes/{i}/children/{k}"
            document.item("nodes", child, pointer)
            if parent[child] >= 0:
                raise document.error(f"nodes[{child}] is also a child of nodes[{parent[child]}]", pointer,
                                     "a node has one parent")  # fmt: skip
            parent[child] = i
    # With one parent each, nodes not reachable from a root belong to cycles.
    unseen = np.ones(len(nodes), dtype=bool)
    level, depth = np.flatnonzero(parent < 0).tolist(), 0
    while level:
        unseen[level] = False
        level, depth = [child for i in level for child in nodes[i].children or []], depth + 1
        if level and depth >= MAX_DEPTH:
            raise document.error(f"is more than {MAX_DEPTH} levels below its root", f"/nodes/{level[0]}")
    if np.any(unseen):
        raise document.error("is its own ancestor", f"/nodes/{int(np.argmax(unseen))}")
    return parent


def _reach(nodes: list[schema.Node], roots: list[int]) -> list[int]:
    stack, seen = list(roots), []
    while stack:
        i = stack.pop()
        seen.append(i)
        stack.extend(nodes[i].children or [])
    return seen


def choose_scene(document: Document, requested: str | int | None, parent: Array) -> tuple[Array, tuple[str, ...]]:
    """Which nodes belong to the requested scene, (N,) bool, and the names of all scenes.  Raises SceneError."""
    root = document.root
    nodes, scenes = root.nodes or [], root.scenes or []
    for i, scene in enumerate(scenes):
        listed: set[int] = set()
        for k, node in enumerate(scene.nodes or []):
            pointer = f"/scenes/{i}/nodes/{k}"
            document.item("nodes", node, pointer)
            if parent[node] >= 0:
                message = f"nodes[{node}] is not a root: it is a child of nodes[{parent[node]}]"
                document.repair("scene-roots", message, pointer)
            if node in listed:
                document.repair("scene-roots", f"nodes[{node}] is listed twice", pointer)
            listed.add(node)
    default = 0
    if root.scene is not None and document.has("scenes", root.scene, "/scene", "default-scene"):
        default = root.scene
    names = tuple(scene.name or f"scene {i}" for i, scene in enumerate(scenes))
    index = default
    if requested is not None:
        index = pick(document, requested, [s.name for s in scenes], "scene", "/scenes")
    roots = scenes[index].nodes or [] if scenes else np.flatnonzero(parent < 0).tolist()
    in_scene = np.zeros(len(nodes), dtype=bool)
    in_scene[_reach(nodes, roots)] = True
    return in_scene, names


def pick(document: Document, requested: str | int, names: list[str], noun: str, pointer: str) -> int:
    """Index of the item with this name or this number (also as text).  Raises SceneError."""
    index = -1
    if isinstance(requested, str):
        matches = [i for i, name in enumerate(names) if name == requested]
        if len(matches) > 1:
            raise document.error(f"{len(matches)} {noun}s are named {requested!r}", pointer, f"use an index: {matches}")
        if matches:
            return matches[0]
        if requested.isascii() and requested.isdigit() and len(requested) < 10:
            index = int(requested)
    else:
        index = int(requested)
    if 0 <= index < len(names):
        return index
    listing = ", ".join(f"{i}: {name!r}" for i, name in enumerate(names[:20])) or "none"
    raise document.error(
        f"has no {noun} {requested!r}", pointer, f"it has {listing}{', ...' if len(names) > 20 else ''}"
    )


class NodeTargets(NamedTuple):
    """The objects that nodes refer to, already read."""

    meshes: tuple[Mesh, ...]
    skins: tuple[Skin, ...]
    lights: tuple[Light, ...]


def read_nodes(document: Document, accessors: Accessors, parent: Array, in_scene: Array, targets: NodeTargets) -> Nodes:
    """All nodes as arrays.  Raises SceneError for invalid references."""
    out = NodeList()
    shared: dict[tuple[tuple[str, int], ...], Array] = {}  # instances, by their accessors
    unknown = unknown_lights(document)
    animated = animated_nodes(document)
    for i, node in enumerate(document.root.nodes or []):
        pointer = f"/nodes/{i}"
        new = out[out.add(node.name, int(parent[i]), in_scene=bool(in_scene[i]))]
        _transform(document, node, new, pointer)
        if new.matrix is not None and i in animated:
            document.repair("animated-matrix", f"nodes[{i}] has a matrix and cannot be animated", animated[i])
            _decompose(new)
        _references(document, node, new, targets, pointer)
        light = document.extension(node, LIGHTS, schema.LightReference, pointer)
        if light is not None and light.light >= len(targets.lights):
            message = f"refers to lights[{light.light}]; the file has {len(targets.lights)}"
            document.repair("light-reference", message, f"{pointer}/extensions/{LIGHTS}/light")
        elif light is not None and light.light not in unknown:
            new.light = light.light
        visibility = document.extension(node, VISIBILITY, schema.Visibility, pointer)
        if visibility is not None:
            new.visible = visibility.visible
        instancing = document.extension(node, INSTANCING, schema.Instancing, pointer)
        if instancing is not None:
            where, key = f"{pointer}/extensions/{INSTANCING}/attributes", tuple(sorted(instancing.attributes.items()))
            if key not in shared:
                shared[key] = _instances(document, accessors, instancing, where)
            new.instances = shared[key]
            if new.skin >= 0:
                document.remark("instances-skinned", pointer)
    return out.nodes()


def _transform(document: Document, node: schema.Node, new: Node, pointer: str) -> None:
    if node.matrix is not None:
        if not (node.translation is None and node.rotation is None and node.scale is None):
            document.repair("matrix-and-parts", "has both a matrix and translation, rotation or scale", pointer)
        matrix = np.array(node.matrix).reshape(4, 4).T
        axes = math3d.normalize(matrix[:3, :3].T)
        shear = np.abs(axes @ axes.T)[np.triu_indices(3, 1)]
        if np.any(matrix[3] != (0, 0, 0, 1)) or np.any(shear > MATRIX_TOLERANCE):
            message, hint = "matrix is not a translation, rotation and scale", "it shears or projects"
            document.repair("matrix-shear", message, f"{pointer}/matrix", hint)
            matrix[3] = (0, 0, 0, 1)
        new.matrix = matrix
        return
    if node.translation is not None:
        new.translation = node.translation
    if node.rotation is not None:
        length = math.hypot(*node.rotation)
        new.rotation = node.rotation
        if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
            message = f"quaternion has length {length:.6g}, must be 1"
            document.repair("quaternion-length", message, f"{pointer}/rotation")
            new.rotation = math3d.unit_quaternions(np.array(node.rotation))
    if node.scale is not None:
        new.scale = node.scale


def _references(document: Document, node: schema.Node, new: Node, targets: NodeTargets, pointer: str) -> None:
    if node.camera is not None and document.has("cameras", node.camera, f"{pointer}/camera", "camera-reference"):
        new.camera = node.camera
    if node.mesh is None:
        if node.skin is not None or node.weights is not None:
            document.repair("skin-ignored", "has a skin or weights but no mesh", pointer)
        return
    declared = document.item("meshes", node.mesh, f"{pointer}/mesh")
    mesh = targets.meshes[node.mesh]
    new.mesh = node.mesh
    if node.weights is not None:
        new.weights = morph_weights(document, node.weights, len(mesh.weights), pointer)
    if node.skin is None:
        return
    document.item("skins", node.skin, f"{pointer}/skin")
    joints = len(targets.skins[node.skin].joints)
    if any("JOINTS_0" not in p.attributes for p in declared.primitives):
        document.repair("skin-ignored", "has a skin, and its mesh has no joints and weights", pointer)
    if not joints or all(p.joints is None for p in mesh.primitives):
        return
    new.skin = node.skin
    for k, primitive in enumerate(mesh.primitives):
        if primitive.joints is not None and (last := int(primitive.joints.max())) >= joints:
            message = f"joint {last} in primitives[{k}] of meshes[{node.mesh}]; skins[{node.skin}] has {joints} joints"
            raise document.error(message, pointer)


def _instances(document: Document, accessors: Accessors, instancing: schema.Instancing, pointer: str) -> Array:
    """node_from_instance, (K, 4, 4) float64."""
    counts = {accessors.get(index, f"{pointer}/{name}").count for name, index in instancing.attributes.items()}
    if len(counts) != 1:
        raise document.error(f"attributes have {len(counts)} different counts", pointer)
    (count,) = counts
    if all(accessors.get(index, pointer).buffer_view is None for index in instancing.attributes.values()):
        accessors.fill(count * INSTANCE_BYTES, pointer)
    document.reserve("instances", count * INSTANCE_BYTES, pointer)
    normalized = {(5120, True), (5122, True)}
    parts: dict[str, Array] = {}
    for name, kind, formats in (
        ("TRANSLATION", "VEC3", {(5126, False)}),
        ("ROTATION", "VEC4", {(5126, False)} | normalized),
        ("SCALE", "VEC3", {(5126, False)}),
    ):
        index, where = instancing.attributes.get(name), f"{pointer}/{name}"
        if index is None:
            continue
        accessor = accessors.get(index, where)
        if accessor.type != kind or (accessor.component_type, accessor.normalized) not in formats:
            raise document.error(f"is {accessors.describe(index, where)}, which {INSTANCING} does not allow", where)
        parts[name] = accessors.floats(index, where).astype(np.float64)
    rotation = parts.get("ROTATION", np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)))
    rotation = check_quaternions(document, rotation, f"{pointer}/ROTATION")
    out = math3d.trs(parts.get("TRANSLATION", np.zeros((count, 3))), rotation, parts.get("SCALE", np.ones((count, 3))))
    out.flags.writeable = False
    return out


def check_quaternions(document: Document, quaternions: Array, pointer: str) -> Array:
    """``quaternions`` (K, 4) with those of another length than 1, beyond the tolerance, normalized."""
    length = np.linalg.norm(quaternions, axis=1)
    bad = ~(np.abs(length - 1.0) <= QUATERNION_TOLERANCE)
    if not np.any(bad):
        return quaternions
    at = int(np.argmax(bad))
    message = f"quaternion {at} has length {length[at]:.6g}, must be 1"
    document.repair("quaternion-length", message, pointer, count=int(bad.sum()))
    return np.where(bad[:, None], math3d.unit_quaternions(quaternions), quaternions)


def animated_nodes(document: Document) -> dict[int, str]:
    """Nodes whose translation, rotation or scale an animation names -> JSON pointer of the first channel."""
    out: dict[int, str] = {}
    for i, animation in enumerate(document.root.animations or []):
        for k, channel in enumerate(animation.channels):
            node, pointer = channel.target.node, f"/animations/{i}/channels/{k}"
            moved = _POINTED.fullmatch(_pointer_of(channel.target))
            if moved is not None:
                out.setdefault(int(moved[1]), f"{pointer}/target/extensions/KHR_animation_pointer/pointer")
            elif node is not None and channel.target.path in ("translation", "rotation", "scale"):
                out.setdefault(node, f"{pointer}/target/node")
    return out


_POINTED = re.compile(r"/nodes/(0|[1-9]\d{0,8})/(?:translation|rotation|scale)")


def _pointer_of(target: schema.ChannelTarget) -> str:
    pointer = target.extensions.get("KHR_animation_pointer", {}).get("pointer")
    return pointer if isinstance(pointer, str) else ""


def _decompose(node: Node) -> None:
    """Replace the matrix of an animated node by translation, rotation and scale."""
    matrix, node.matrix = node.matrix, None
    scale = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) < 0:
        scale[0] = -scale[0]
    node.translation, node.scale = matrix[:3, 3], scale
    if np.all(scale != 0.0):
        node.rotation = math3d.quat_from_mat3(matrix[:3, :3] / scale)
