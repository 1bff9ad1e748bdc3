"""Nodes, the hierarchy, the selected scene, skins, cameras, lights and EXT_mesh_gpu_instancing."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from taubench_gl import math3d
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import FLOAT, Accessors
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.model import Camera, Light, Mesh, Nodes, Skin

Array = np.ndarray

LIGHTS = "KHR_lights_punctual"


def read_cameras(document: Document) -> tuple[Camera, ...]:
    """All cameras of the file."""
    return tuple(_camera(document, camera, f"/cameras/{i}") for i, camera in enumerate(document.root.cameras or []))


def read_lights(document: Document) -> tuple[Light, ...]:
    """All lights of KHR_lights_punctual in the file."""
    lights = document.extension(document.root, LIGHTS, schema.PunctualLights, "")
    if lights is None:
        return ()
    return tuple(_light(document, light, f"/extensions/{LIGHTS}/lights/{i}") for i, light in enumerate(lights.lights))


def _camera(document: Document, camera: schema.Camera, pointer: str) -> Camera:
    p, o = camera.perspective, camera.orthographic
    if (p is None) == (o is None) or (p is None) == (camera.type == "perspective"):
        raise document.error(f"must have exactly one of perspective and orthographic, matching its type {camera.type}",
                             pointer)  # fmt: skip
    if p is not None:
        if p.yfov >= math.pi:
            raise document.error(f"yfov {p.yfov:g} is not below pi", f"{pointer}/perspective/yfov")
        if p.zfar is not None and p.zfar <= p.znear:
            raise document.error(
                f"zfar {p.zfar:g} is not greater than znear {p.znear:g}", f"{pointer}/perspective/zfar"
            )
        return Camera(
            camera.name,
            "perspective",
            yfov=p.yfov,
            aspect=p.aspect_ratio,
            znear=p.znear,
            zfar=math.inf if p.zfar is None else p.zfar,
        )
    for name in ("xmag", "ymag"):
        if getattr(o, name) == 0:
            raise document.error(f"{name} must not be 0", f"{pointer}/orthographic/{name}")
    if o.zfar <= o.znear:
        raise document.error(f"zfar {o.zfar:g} is not greater than znear {o.znear:g}", f"{pointer}/orthographic/zfar")
    return Camera(camera.name, "orthographic", xmag=o.xmag, ymag=o.ymag, znear=o.znear, zfar=o.zfar)


def _light(document: Document, light: schema.PunctualLight, pointer: str) -> Light:
    spot = light.spot or schema.Spot()
    if light.type == "spot":
        if light.spot is None:
            raise document.error("a spot light must have the property spot", pointer)
        # The extension wants inner < outer; Blender writes equal angles for a spot light with blend 0.
        if not spot.inner_cone_angle <= spot.outer_cone_angle <= math.pi / 2 + 1e-6 or not spot.outer_cone_angle:
            raise document.error(
                f"needs innerConeAngle {spot.inner_cone_angle:g} <= outerConeAngle {spot.outer_cone_angle:g} <= pi/2",
                f"{pointer}/spot",
            )
    return Light(
        name=light.name,
        kind=light.type,
        color=light.color,
        intensity=light.intensity,
        range=math.inf if light.range is None else light.range,
        inner_cone=spot.inner_cone_angle,
        outer_cone=min(spot.outer_cone_angle, math.pi / 2),
    )


def read_skins(document: Document, accessors: Accessors, parent: Array) -> tuple[Skin, ...]:
    """All skins of the file.  ``parent`` (N,) of the nodes, without cycles."""
    return tuple(
        _skin(document, accessors, skin, parent, f"/skins/{i}") for i, skin in enumerate(document.root.skins or [])
    )


def _skin(document: Document, accessors: Accessors, skin: schema.Skin, parent: Array, pointer: str) -> Skin:
    for k, joint in enumerate(skin.joints):
        document.item("nodes", joint, f"{pointer}/joints/{k}")
    if len(set(skin.joints)) != len(skin.joints):
        raise document.error("lists a joint twice", f"{pointer}/joints")
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
        if accessor.count < count:
            raise document.error(f"{accessor.count} matrices for {count} joints", where)
        # glTF is column-major: rows of the reshaped array are columns.
        raw = accessors.raw(skin.inverse_bind_matrices, where)[:count].astype(np.float64)
        inverse_bind = raw.reshape(count, 4, 4).swapaxes(1, 2)
        if np.any(inverse_bind[:, 3] != (0, 0, 0, 1)):
            at = int(np.argmax(np.any(inverse_bind[:, 3] != (0, 0, 0, 1), axis=1)))
            raise document.error(f"matrix {at} has a last row other than 0 0 0 1", where)
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
    if not common:
        raise document.error("joints have no common root", f"{pointer}/joints")
    if skin.skeleton is not None:
        document.item("nodes", skin.skeleton, f"{pointer}/skeleton")
        if skin.skeleton not in common:
            raise document.error(f"nodes[{skin.skeleton}] is not a common root of the joints", f"{pointer}/skeleton")


QUATERNION_TOLERANCE = 0.00769  # on the length, as in the Khronos validator: a step of a normalized byte
MATRIX_TOLERANCE = 1e-3  # on the cosine between columns
MAX_DEPTH = 2000
"""Limit on the depth of the hierarchy: world matrices are composed level by level."""

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
                raise document.error(f"nodes[{node}] is not a root: it is a child of nodes[{parent[node]}]", pointer)
            if node in listed:
                raise document.error(f"nodes[{node}] is listed twice", pointer)
            listed.add(node)
    if root.scene is not None:
        document.item("scenes", root.scene, "/scene")
    names = tuple(scene.name or f"scene {i}" for i, scene in enumerate(scenes))
    if requested is not None:
        index = pick(document, requested, [s.name for s in scenes], "scene", "/scenes")
    else:
        index = root.scene or 0
    roots = scenes[index].nodes or [] if scenes else np.flatnonzero(parent < 0).tolist()
    in_scene = np.zeros(len(nodes), dtype=bool)
    in_scene[_reach(nodes, roots)] = True
    return in_scene, names


def pick(document: Document, requested: str | int, names: list[str], what: str, pointer: str) -> int:
    """Index of the item with this name or this number (also as text).  Raises SceneError."""
    index = -1
    if isinstance(requested, str):
        found = [i for i, name in enumerate(names) if name == requested]
        if len(found) > 1:
            raise document.error(f"{len(found)} {what}s are named {requested!r}", pointer, f"use an index: {found}")
        if found:
            return found[0]
        if requested.isascii() and requested.isdigit() and len(requested) < 10:
            index = int(requested)
    else:
        index = int(requested)
    if 0 <= index < len(names):
        return index
    known = ", ".join(f"{i}: {name!r}" for i, name in enumerate(names[:20])) or "none"
    raise document.error(f"has no {what} {requested!r}", pointer, f"it has {known}{', ...' if len(names) > 20 else ''}")


class NodeTargets(NamedTuple):
    """The objects that nodes refer to, already read."""

    meshes: tuple[Mesh, ...]
    skins: tuple[Skin, ...]
    lights: tuple[Light, ...]


def read_nodes(document: Document, accessors: Accessors, parent: Array, in_scene: Array, targets: NodeTargets) -> Nodes:
    """All nodes as arrays.  Raises SceneError for invalid references."""
    nodes = document.root.nodes or []
    n = len(nodes)
    out = Nodes(
        names=tuple(node.name for node in nodes),
        parent=parent,
        translation=np.zeros((n, 3)),
        rotation=np.tile([0.0, 0.0, 0.0, 1.0], (n, 1)),
        scale=np.ones((n, 3)),
        matrix=np.tile(np.eye(4), (n, 1, 1)),
        has_matrix=np.zeros(n, dtype=bool),
        mesh=np.full(n, -1, np.int32),
        skin=np.full(n, -1, np.int32),
        camera=np.full(n, -1, np.int32),
        light=np.full(n, -1, np.int32),
        visible=np.ones(n, dtype=bool),
        in_scene=in_scene,
    )
    shared: dict[tuple[tuple[str, int], ...], Array] = {}  # instances, by their accessors
    for i, node in enumerate(nodes):
        pointer = f"/nodes/{i}"
        _transform(document, node, out, i)
        _references(document, node, out, i, targets)
        light = document.extension(node, LIGHTS, schema.LightReference, pointer)
        if light is not None:
            if light.light >= len(targets.lights):
                raise document.error(f"refers to lights[{light.light}]; the file has {len(targets.lights)}",
                                     f"{pointer}/extensions/{LIGHTS}/light")  # fmt: skip
            out.light[i] = light.light
        visibility = document.extension(node, VISIBILITY, schema.Visibility, pointer)
        if visibility is not None:
            out.visible[i] = visibility.visible
        instancing = document.extension(node, INSTANCING, schema.Instancing, pointer)
        if instancing is not None:
            where, key = f"{pointer}/extensions/{INSTANCING}/attributes", tuple(sorted(instancing.attributes.items()))
            if key not in shared:
                shared[key] = _instances(document, accessors, instancing, where)
            out.instances[i] = shared[key]
    for array in (out.parent, out.translation, out.rotation, out.scale, out.matrix, out.has_matrix, out.mesh, out.skin,
                  out.camera, out.light, out.visible, out.in_scene):  # fmt: skip
        array.flags.writeable = False
    return out


def _transform(document: Document, node: schema.Node, out: Nodes, i: int) -> None:
    pointer = f"/nodes/{i}"
    if node.matrix is not None:
        if not (node.translation is None and node.rotation is None and node.scale is None):
            raise document.error("has both a matrix and translation, rotation or scale", pointer)
        matrix = np.array(node.matrix).reshape(4, 4).T
        axes = math3d.normalize(matrix[:3, :3].T)
        shear = np.abs(axes @ axes.T)[np.triu_indices(3, 1)]
        if np.any(matrix[3] != (0, 0, 0, 1)) or np.any(shear > MATRIX_TOLERANCE):
            raise document.error(
                "matrix is not a translation, rotation and scale", f"{pointer}/matrix", "it shears or projects"
            )
        out.matrix[i], out.has_matrix[i] = matrix, True
    if node.translation is not None:
        out.translation[i] = node.translation
    if node.rotation is not None:
        length = math.hypot(*node.rotation)
        if not abs(length - 1.0) <= QUATERNION_TOLERANCE:
            raise document.error(f"quaternion has length {length:.6g}, must be 1", f"{pointer}/rotation")
        out.rotation[i] = node.rotation
    if node.scale is not None:
        out.scale[i] = node.scale


def _references(document: Document, node: schema.Node, out: Nodes, i: int, targets: NodeTargets) -> None:
    pointer = f"/nodes/{i}"
    if node.camera is not None:
        document.item("cameras", node.camera, f"{pointer}/camera")
        out.camera[i] = node.camera
    if node.mesh is None:
        if node.skin is not None or node.weights is not None:
            raise document.error("has a skin or weights but no mesh", pointer)
        return
    declared = document.item("meshes", node.mesh, f"{pointer}/mesh")
    mesh = targets.meshes[node.mesh]
    out.mesh[i] = node.mesh
    if node.weights is not None:
        if len(node.weights) != len(mesh.weights):
            raise document.error(
                f"{len(node.weights)} weights for {len(mesh.weights)} morph targets", f"{pointer}/weights"
            )
        out.weights[i] = np.array(node.weights)
    if node.skin is None:
        return
    document.item("skins", node.skin, f"{pointer}/skin")
    out.skin[i] = node.skin
    if any("JOINTS_0" not in p.attributes for p in declared.primitives):
        raise document.error("has a skin, and its mesh has no joints and weights", pointer)
    joints = len(targets.skins[node.skin].joints)
    for k, primitive in enumerate(mesh.primitives):
        if primitive.joints is not None and int(primitive.joints.max()) >= joints:
            raise document.error(
                f"joint {int(primitive.joints.max())} in primitives[{k}] of meshes[{node.mesh}]; "
                f"skins[{node.skin}] has {joints} joints",
                pointer,
            )


def _instances(document: Document, accessors: Accessors, instancing: schema.Instancing, pointer: str) -> Array:
    """node_from_instance, (K, 4, 4) float64."""
    counts = {accessors.get(index, f"{pointer}/{name}").count for name, index in instancing.attributes.items()}
    if len(counts) != 1:
        raise document.error(f"attributes have {len(counts)} different counts", pointer)
    (count,) = counts
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
    check_quaternions(document, rotation, f"{pointer}/ROTATION")
    out = math3d.trs(parts.get("TRANSLATION", np.zeros((count, 3))), rotation, parts.get("SCALE", np.ones((count, 3))))
    out.flags.writeable = False
    return out


def check_quaternions(document: Document, quaternions: Array, pointer: str) -> None:
    """Raise SceneError unless all quaternions (K, 4) have unit length within the tolerance."""
    length = np.linalg.norm(quaternions, axis=1)
    bad = ~(np.abs(length - 1.0) <= QUATERNION_TOLERANCE)
    if np.any(bad):
        at = int(np.argmax(bad))
        raise document.error(f"quaternion {at} has length {length[at]:.6g}, must be 1", pointer)
