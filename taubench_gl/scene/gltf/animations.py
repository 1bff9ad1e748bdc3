"""Animations: samplers, channels, KHR_animation_pointer, and which animations play together."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from taubench_gl.scene.files import shortened
from taubench_gl.scene.gltf import schema
from taubench_gl.scene.gltf.accessors import FLOAT, Accessors
from taubench_gl.scene.gltf.blender import CONES, means_blender
from taubench_gl.scene.gltf.document import Document
from taubench_gl.scene.gltf.nodes import LIGHTS, check_quaternions, pick
from taubench_gl.scene.model import Animation, Channel, Mesh

Array = np.ndarray

POINTER = "KHR_animation_pointer"


class Target(NamedTuple):
    """An animated property: ``size`` numbers at ``path`` of the ``kind`` (node, camera or light) with this index."""

    kind: str
    index: int
    path: str
    size: int


_NODE = {"translation": ("translation", 3), "rotation": ("rotation", 4), "scale": ("scale", 3),
         "extensions/KHR_node_visibility/visible": ("visible", 1)}  # fmt: skip
_CAMERA = {f"perspective/{p}": p for p in ("yfov", "znear", "zfar")} | {
    f"orthographic/{p}": p for p in ("xmag", "ymag", "znear", "zfar")
}
_LIGHT = {"color": ("color", 3), "intensity": ("intensity", 1), "range": ("range", 1),
          "spot/innerConeAngle": ("inner_cone", 1), "spot/outerConeAngle": ("outer_cone", 1)}  # fmt: skip
_LIGHTS = re.escape(f"/extensions/{LIGHTS}/lights/")
_ONE_WEIGHT = re.compile(r"weights/(0|[1-9]\d{0,4})")
_POINTER = re.compile(rf"(/nodes/|/cameras/|/meshes/|{_LIGHTS})(0|[1-9]\d{{0,8}})/(.+)")


def resolve_pointer(
    document: Document, text: str, weight_count: Callable[[int], int], lights: int, pointer: str
) -> list[Target]:
    """Targets of one animated JSON pointer; none, with a note, for a property that cannot be animated.

    ``lights``: how many the file has.
    """
    match = _POINTER.fullmatch(text)
    targets = _resolve(document, match[1], int(match[2]), match[3], weight_count, lights, pointer) if match else []
    if not targets:
        document.remark("not-animated", pointer, detail=shortened(text))
    return targets


def _resolve(
    document: Document, owner: str, index: int, path: str, weight_count: Callable[[int], int], lights: int, pointer: str
) -> list[Target]:
    if owner == "/nodes/":
        if not document.has("nodes", index, pointer, "channel-ignored"):
            return []
        if targets := _weights(path, index, weight_count):
            return targets
        return [Target("node", index, *_NODE[path])] if path in _NODE else []
    if owner == "/meshes/":
        if not document.has("meshes", index, pointer, "channel-ignored"):
            return []
        # A node with weights does not use those of its mesh.
        users = [i for i, n in enumerate(document.root.nodes or []) if n.mesh == index and n.weights is None]
        return [target for i in users for target in _weights(path, i, weight_count)]
    if owner == "/cameras/":
        if not document.has("cameras", index, pointer, "channel-ignored"):
            return []
        has_property = path in _CAMERA and path.startswith(document.root.cameras[index].type)
        return [Target("camera", index, _CAMERA[path], 1)] if has_property else []
    if index >= lights:
        document.repair("channel-ignored", "refers to a light that does not exist", pointer)
        return []
    if path in CONES and means_blender(document):
        return [Target("light", index, path, 1)]
    return [Target("light", index, *_LIGHT[path])] if path in _LIGHT else []


def _weights(path: str, node: int, weight_count: Callable[[int], int]) -> list[Target]:
    """The target of ``weights``, or of one weight, ``weights/2``, of a node; empty for a weight that it lacks."""
    count, single = weight_count(node), _ONE_WEIGHT.fullmatch(path)
    if single is not None:
        return [Target("node", node, path, 1)] if int(single[1]) < count else []
    return [Target("node", node, "weights", count)] if path == "weights" and count else []


PATHS = {"translation": 3, "rotation": 4, "scale": 3}
SMALL = {5120, 5121, 5122, 5123}


class AnimationReader:
    """Reads the animations of one document.

    ``meshes`` give the number of morph weights of each node; ``lights``: how many the file has.
    """

    def __init__(self, document: Document, accessors: Accessors, meshes: tuple[Mesh, ...], lights: int):
        self.document, self.accessors, self.meshes, self.lights = document, accessors, meshes, lights
        self._times: dict[int, tuple[Array, int]] = {}
        self._outputs: dict[tuple[int, ...], Array] = {}

    def read(self) -> tuple[Animation, ...]:
        return tuple(
            self._animation(animation, f"/animations/{i}")
            for i, animation in enumerate(self.document.root.animations or [])
        )

    def _animation(self, animation: schema.Animation, pointer: str) -> Animation:
        for name in ("channels", "samplers"):
            if not getattr(animation, name):
                hint = "glTF forbids empty arrays: omit the property"
                message = "Expected array of length >= 1"
                self.document.repair("empty-array", message, f"{pointer}/{name}", hint, detail=name)
        for k, sampler in enumerate(animation.samplers):
            self._check_sampler(sampler, f"{pointer}/samplers/{k}")
        channels: list[Channel] = []
        channel_of_target: dict[tuple[str, int, str], int] = {}
        for k, channel in enumerate(animation.channels):
            where = f"{pointer}/channels/{k}"
            if channel.sampler >= len(animation.samplers):
                raise self.document.error(
                    f"refers to samplers[{channel.sampler}]; the animation has {len(animation.samplers)}",
                    f"{where}/sampler",
                )
            sampler, at = animation.samplers[channel.sampler], f"{pointer}/samplers/{channel.sampler}"
            if self.accessors.get(sampler.input, at).count == 0:
                self.document.repair("channel-ignored", "has no keys", f"{at}/input")
                continue
            for target in self._targets(channel, where):
                key = (target.kind, target.index, target.path)
                if key in channel_of_target:
                    message = f"has the same target as channel {channel_of_target[key]}"
                    self.document.repair("channel-ignored", message, f"{where}/target")
                    continue
                channel_of_target[key] = k
                channels.append(self._channel(sampler, target, at, POINTER in channel.target.extensions))
        return Animation(animation.name, tuple(self._joined_weights(channels, pointer)))

    def _joined_weights(self, channels: list[Channel], pointer: str) -> list[Channel]:
        """``channels`` with one channel for all single weights of a node; the other weights of the node rest.

        Weights of another interpolation, or of other key times unless all are LINEAR, than the first are left out with
        a note.
        """
        singles: dict[int, list[Channel]] = {}
        out = [c for c in channels if not _ONE_WEIGHT.fullmatch(c.path)]
        whole = {c.index for c in out if c.path == "weights"}
        for c in (c for c in channels if _ONE_WEIGHT.fullmatch(c.path)):
            first = singles.setdefault(c.index, [c])[0]
            same = np.array_equal(c.times, first.times) or c.interpolation == "LINEAR"
            if c.index in whole or c.interpolation != first.interpolation or not same:
                self.document.remark("not-animated", pointer, detail=c.path)
            elif c is not first:
                singles[c.index].append(c)
        for node, parts in singles.items():
            if node in whole:
                continue
            rest = np.zeros(self._weight_count(node))
            json = self.document.root.nodes[node]
            initial = self.meshes[json.mesh].weights if json.weights is None else json.weights[: len(rest)]
            rest[: len(initial)] = initial
            times = parts[0].times
            if not all(np.array_equal(times, c.times) for c in parts):
                times = np.unique(np.concatenate([c.times for c in parts]))
            cubic = parts[0].interpolation == "CUBICSPLINE"
            values = np.zeros((len(times), 3, len(rest))) if cubic else np.tile(rest, (len(times), 1))
            if cubic:
                values[:, 1] = rest
            for c in parts:
                column = int(c.path.rpartition("/")[2])
                same = len(times) == len(c.times)
                values[..., column] = c.values[..., 0] if same else np.interp(times, c.times, c.values[:, 0])
            out.append(Channel("node", node, "weights", parts[0].interpolation, times, values))
        return out

    def _targets(self, channel: schema.Channel, pointer: str) -> list[Target]:
        """Targets of a channel: none (with a note), one property, or one per node for the weights of a mesh."""
        target, document = channel.target, self.document
        animated = document.extension(target, POINTER, schema.AnimationPointer, f"{pointer}/target")
        if animated is not None:
            where = f"{pointer}/target/extensions/{POINTER}"
            if target.path != "pointer":
                message = f"target path is {shortened(target.path)}; the extension requires 'pointer'"
                document.repair("channel-path", message, where)
            return resolve_pointer(document, animated.pointer, self._weight_count, self.lights, f"{where}/pointer")
        if target.node is None:
            document.remark("channel-without-target", pointer)
            return []
        if not document.has("nodes", target.node, f"{pointer}/target/node", "channel-ignored"):
            return []
        if target.path == "weights":
            count = self._weight_count(target.node)
            if count == 0:
                message = f"nodes[{target.node}] has no morph targets to animate"
                document.repair("channel-ignored", message, f"{pointer}/target")
                return []
            return [Target("node", target.node, "weights", count)]
        if target.path not in PATHS:
            document.remark("channel-unknown-path", pointer, detail=shortened(target.path))
            return []
        return [Target("node", target.node, target.path, PATHS[target.path])]

    def _weight_count(self, node: int) -> int:
        mesh = self.document.root.nodes[node].mesh
        return 0 if mesh is None else len(self.meshes[mesh].weights)

    def _check_sampler(self, sampler: schema.AnimationSampler, pointer: str) -> None:
        document, accessors = self.document, self.accessors
        where = f"{pointer}/input"
        accessor = accessors.get(sampler.input, where)
        if accessor.type != "SCALAR" or accessor.component_type != FLOAT:
            raise document.error(
                f"times are {accessors.describe(sampler.input, where)}, must be SCALAR of FLOAT", where
            )
        if accessor.count and (accessor.min is None or accessor.max is None):
            document.repair("key-time-bounds", "accessor of key times lacks min and max", where)
        accessors.get(sampler.output, f"{pointer}/output")
        accessors.no_stride(sampler.input, where)
        accessors.no_stride(sampler.output, f"{pointer}/output")

    def _interpolation(self, sampler: schema.AnimationSampler, pointer: str) -> str:
        word = sampler.interpolation
        if word in ("STEP", "LINEAR", "CUBICSPLINE"):
            return word
        if isinstance(word, int):
            self.document.remark("interpolation-number", pointer)
            return "LINEAR"
        message, hint = f"{shortened(word)} is not an interpolation", "STEP, LINEAR or CUBICSPLINE"
        self.document.repair("interpolation", message, f"{pointer}/interpolation", hint)
        return "LINEAR"

    def _channel(self, sampler: schema.AnimationSampler, target: Target, pointer: str, by_pointer: bool) -> Channel:
        interpolation = self._interpolation(sampler, pointer)
        times, repeated = self._key_times(sampler.input, f"{pointer}/input")
        if repeated:
            self.document.remark("repeated-key", f"{pointer}/input", repeated)
        values = self._values(sampler, target, interpolation, f"{pointer}/output", by_pointer)
        return Channel(target.kind, target.index, target.path, interpolation, times, values)

    def _key_times(self, index: int, pointer: str) -> tuple[Array, int]:
        """Times in order (K,) float64, and the number of those that equal the next one."""
        if index not in self._times:
            times = self.accessors.raw(index, pointer)[:, 0].astype(np.float64)
            steps = times[1:] - times[:-1]
            if times[0] < 0 or (steps < 0).any():
                at = 0 if times[0] < 0 else int(np.argmax(steps < 0)) + 1
                message = f"key time {at} is {times[at]:g}; times must be at least 0 and increasing"
                if (steps < 0).any():
                    raise self.document.error(message, pointer)
                self.document.repair("negative-time", message, pointer, count=int((times < 0).sum()))
            times.flags.writeable = False
            self._times[index] = times, int((steps == 0).sum())
        return self._times[index]

    def _values(
        self, sampler: schema.AnimationSampler, target: Target, interpolation: str, pointer: str, by_pointer: bool
    ) -> Array:
        """(K, n) float64, for CUBICSPLINE (K, 3, n); channels with a common sampler share the array.

        Numbers of a pointer to a float property can be integers, which are converted unless they are normalized.
        """
        document, accessors = self.document, self.accessors
        keys = len(self._times[sampler.input][0])
        accessor = accessors.get(sampler.output, pointer)
        scalar = target.path == "weights" or target.size == 1
        kind = "SCALAR" if scalar else f"VEC{target.size}"
        if target.path == "visible":
            fits = accessor.component_type == 5121 and not accessor.normalized and interpolation == "STEP"
        else:
            normalized = accessor.normalized and target.path in ("rotation", "weights")
            integers = accessor.component_type in SMALL and (normalized or by_pointer)
            fits = accessor.component_type == FLOAT or integers
        if accessor.type != kind or not fits:
            raise document.error(
                f"output for {target.path} is {accessors.describe(sampler.output, pointer)} ({interpolation}), "
                f"expected {kind}",
                pointer,
            )
        rows = 3 if interpolation == "CUBICSPLINE" else 1
        expected = keys * rows * (target.size if scalar else 1)
        if accessor.count != expected:
            raise document.error(f"has {accessor.count} elements, {keys} keys need {expected}", pointer)
        rotation = target.path == "rotation"
        key = (sampler.input, sampler.output, rows, target.size, rotation)
        if key not in self._outputs:
            values = accessors.floats(sampler.output, pointer).astype(np.float64).reshape(keys, rows, target.size)
            if rotation:
                values[:, rows // 2] = check_quaternions(document, values[:, rows // 2], pointer)
            values = values if rows == 3 else values[:, 0]
            values.flags.writeable = False
            self._outputs[key] = values
        return self._outputs[key]


def choose_animations(
    document: Document, animations: tuple[Animation, ...], requested: Sequence[str | int] | None
) -> tuple[tuple[Channel, ...], tuple[str, ...]]:
    """The channels of all playing animations, and the names of these animations.

    Some exporters write one animation per object, and all of them play.  Files with several takes of one character play
    one at a time.  So every animation plays that has no target in common with an earlier one.  Raises SceneError where
    requested animations share a target.
    """
    names = [animation.name for animation in animations]
    if requested is None:
        order = list(range(len(animations)))
    else:
        if isinstance(requested, (str, int)):
            requested = [requested]
        order = list(dict.fromkeys(pick(document, name, names, "animation", "/animations") for name in requested))
    channels: list[Channel] = []
    playing: list[str] = []
    silent: dict[str, list[str]] = {}
    animation_of_target: dict[tuple[str, int, str], int] = {}
    for i in order:
        keys = [(c.target, c.index, c.path) for c in animations[i].channels]
        rival = next((animation_of_target[key] for key in keys if key in animation_of_target), None)
        label = names[i] or f"animation {i}"
        if rival is None:
            animation_of_target.update(dict.fromkeys(keys, i))
            channels.extend(animations[i].channels)
            playing.append(label)
            continue
        other = names[rival] or f"animation {rival}"
        if requested is not None:
            raise document.error(f"has targets in common with {other!r}", f"/animations/{i}", "choose one of the two")
        silent.setdefault(other, []).append(label)
    for other, labels in silent.items():
        shown = ", ".join(repr(label) for label in labels[:8])
        ending = f" and {len(labels) - 8} more" if len(labels) > 8 else ""
        document.note(
            f"{other!r} plays; {shown}{ending} have targets in common with it and do not (select with --animation)"
        )
    return tuple(channels), tuple(playing)
