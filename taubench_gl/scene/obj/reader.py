"""Reads an OBJ file, or a numbered sequence of OBJ files, into a Scene.

Axes are the model's (Y up; meters unless the user sets a unit scale).  Every ``o`` is an object, or every ``g`` where
the file has no ``o``.  Polygons are cut into triangles, faces without normals are flat, and all faces are
double-sided.

In a sequence, frame i is file i and is shown at i / fps.  An object with constant topology is one mesh with a morph
target for each distinct shape and LINEAR weights: every frame has exactly the vertices of its file, and motion follows
them.  Where its faces change, one mesh ends and another begins.  The new mesh is one of ``Scene.replacements``: a cut
for that object only, whose pixels have no history.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from taubench_gl.conventions import FILE_NUMBER
from taubench_gl.errors import SceneError
from taubench_gl.math3d import normalize
from taubench_gl.memory_budget import require
from taubench_gl.scene.build import NodeList, only_animation
from taubench_gl.scene.files import Identity
from taubench_gl.scene.model import Channel, Mesh, MorphTarget, Primitive, Scene
from taubench_gl.scene.notes import Notes
from taubench_gl.scene.obj.materials import Library
from taubench_gl.scene.obj.parse import MISSING, ObjFile, Part, parse_obj
from taubench_gl.stage_log import progressed

Array = np.ndarray

PREFIX = "seq:"
DEFAULT_FPS = 24.0
MAX_FRAMES = 100_000

_RATE = re.compile(r"@(\d+(?:\.\d+)?)$")
_PLACE = re.compile(r"%0?\d*d|\*")


def is_sequence(text: str) -> bool:
    """Whether ``text`` is a sequence: ``seq:...``, a pattern with ``*`` or ``%04d``, or a folder with OBJ files."""
    if text.startswith(PREFIX):
        return True
    bare = Path(_RATE.sub("", text))
    if bare.suffix.lower() == ".obj" and _PLACE.search(bare.name):
        return True
    try:
        return bare.is_dir() and any(p.suffix.lower() == ".obj" for p in bare.iterdir())
    except OSError:
        return False


def find_frames(text: str) -> tuple[list[Path], float, list[str]]:
    """Files sorted by number, frames per second, and warnings.  Raises SceneError.

    ``text``: a folder or a pattern, with optional prefix ``seq:`` and suffix ``@FPS``.
    """
    bare = text.removeprefix(PREFIX)
    rate = _RATE.search(bare)
    fps = float(rate[1]) if rate else DEFAULT_FPS
    if not 0 < fps <= 1e6:
        raise SceneError(f"{fps:g} frames per second is outside 0..1e6", where=text)
    path = Path(bare[: rate.start()] if rate else bare)
    folder, place = (path, None) if path.is_dir() else (path.parent, _PLACE.search(path.name))
    if place is None and folder != path:
        raise SceneError("is neither a folder nor a pattern", where=text, hint="use name%04d.obj or name*.obj")
    pattern = re.compile(rf"(.*?)({FILE_NUMBER})(\D*\.obj)", re.IGNORECASE)
    if place is not None:
        before, after = (re.escape(part) for part in (path.name[: place.start()], path.name[place.end() :]))
        pattern = re.compile(rf"({before})({FILE_NUMBER})({after})")
    try:
        names = sorted(p.name for p in folder.iterdir())
    except OSError as e:
        raise SceneError(f"cannot be read: {e.strerror}", where=str(folder)) from None
    matches = [m for m in map(pattern.fullmatch, names) if m]
    if not matches:
        raise SceneError("no numbered .obj file matches", where=text, hint="name files name000.obj, name001.obj")
    stems = {(m[1], m[3]) for m in matches}
    if len(stems) > 1:
        shown = ", ".join(f"{a}*{b}" for a, b in sorted(stems)[:4])
        raise SceneError(f"the folder contains several sequences: {shown}", where=text, hint="give one of them")
    if len(matches) > MAX_FRAMES:
        raise SceneError(f"{len(matches)} files, more than {MAX_FRAMES}", where=text)
    matches.sort(key=lambda m: (int(m[2]), m[2]))
    numbers = [int(m[2]) for m in matches]
    twice = next((i for i in range(1, len(numbers)) if numbers[i] == numbers[i - 1]), None)
    if twice is not None:
        message = f"{matches[twice - 1][0]} and {matches[twice][0]} have the same number {numbers[twice]}"
        raise SceneError(message, where=text, hint="write all numbers with as many digits")
    warnings = []
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        warnings.append("the file numbers have gaps: frames are the files in order")
    return [folder / m[0] for m in matches], fps, warnings


@dataclass(slots=True)
class Shape:
    """One object in one frame.  ``corners`` are relative to the lowest indices of the object."""

    materials: tuple[str, ...]
    corners: tuple[Array, ...]  # per material (T, 3, 3) int64
    fans: tuple[Array, ...]  # per material (F, 3, 3) int64: the faces of the file, however they are cut
    v: Array  # (n, 3) the object's range of the positions
    colors: Array | None  # (n, 3) linear
    vt: Array
    vn: Array

    def same_topology(self, other: Shape) -> bool:
        return (
            self.materials == other.materials
            and self.v.shape == other.v.shape
            and self.vn.shape == other.vn.shape
            and self.vt.shape == other.vt.shape
            and all(np.array_equal(a, b) for a, b in zip(self.fans, other.fans, strict=True))
        )


def shapes(file: ObjFile) -> dict[str, Shape]:
    """The objects of one file by name, in file order."""
    groups: dict[str, list[Part]] = {}
    for part in file.parts:
        groups.setdefault(part.object, []).append(part)
    return {name: _shape(file, parts) for name, parts in groups.items()}


def _shape(file: ObjFile, parts: list[Part]) -> Shape:
    """The object of ``parts``, with indices relative to its lowest ones: it is unchanged if they move because another
    object grew.
    """
    joined = np.concatenate([p.corners.reshape(-1, 3) for p in parts])
    low, arrays = np.zeros(3, dtype=np.int64), []
    for column, values in enumerate((file.v, file.vt, file.vn)):
        used = joined[:, column][joined[:, column] != MISSING]
        low[column] = used.min() if len(used) else 0
        arrays.append(values[low[column] : used.max() + 1] if len(used) else values[:0])
    corners, fans = (
        tuple(np.where(triangles == MISSING, MISSING, triangles - low) for triangles in kind)
        for kind in ([p.corners for p in parts], [p.fans for p in parts])
    )
    v, vt, vn = arrays
    colors = None if file.colors is None else file.colors[low[0] : low[0] + len(v)]
    return Shape(tuple(p.material for p in parts), corners, fans, v, colors, vt, vn)


MORPHED_BYTES, WEIGHT_BYTES = 72, 8
"""Memory of a vertex of one shape, float64 and as morph target; of the weight of a shape in one frame."""
MAX_OBJECTS = 100_000


def read_obj(path: Path, scene: str | int | None, animation: Sequence[str | int] | None, strict: bool = False) -> Scene:
    """``load_scene`` for one .obj file, a still scene.  Raises SceneError with file and line."""
    _only_scene(path.name, scene)
    return _Assembly([path], 1.0, Notes(strict)).scene(path.stem, path, animation)


def read_obj_sequence(
    text: str, scene: str | int | None, animation: Sequence[str | int] | None, strict: bool = False
) -> Scene:
    """``load_scene`` for a folder or pattern of numbered OBJ files.  Raises SceneError."""
    _only_scene(text, scene)
    files, fps, warnings = find_frames(text)
    assembly = _Assembly(files, fps, Notes(strict))
    for warning in warnings:
        assembly.notes.add(warning)
    assembly.notes.add(f"{len(files)} files at {fps:g} frames per second, the first at 0 s")
    return assembly.scene(files[0].stem.rstrip("0123456789") or files[0].stem, files[0], animation)


def _only_scene(name: str, scene: str | int | None) -> None:
    if scene is not None:
        raise SceneError("OBJ files contain one scene", where=name, hint="omit the scene's name")


@dataclass(slots=True)
class _Track:
    """One object with constant topology: frames ``first`` .. ``last``, and the shape of each frame."""

    name: str
    first: int
    last: int
    base: Shape
    which: list[int]  # per frame: 0 the base, k the k-th of ``others``
    others: list[tuple[Array, Array]]  # positions, normals
    index_of_shape: dict[bytes, int]  # bytes of positions and normals -> entry of ``which``
    replaces: bool  # its object existed in the previous frame, with other faces

    def add(self, shape: Shape) -> None:
        key = shape.v.tobytes() + shape.vn.tobytes()
        if key not in self.index_of_shape:
            self.index_of_shape[key] = len(self.others) + 1
            self.others.append((shape.v, shape.vn))
        self.which.append(self.index_of_shape[key])


class _Assembly:
    def __init__(self, files: list[Path], fps: float, notes: Notes):
        self.files, self.fps, self.notes = files, fps, notes
        self.library = Library(files[0].parent, notes)
        self.identity = Identity()
        self.tracks: list[_Track] = []
        self._read()

    def _read(self) -> None:
        open_tracks: dict[str, _Track] = {}
        for frame, path in enumerate(self.files):
            progressed(frame / len(self.files))
            file = parse_obj(path, self.notes, lambda share, frame=frame: progressed((frame + share) / len(self.files)))
            self.identity.add(file.data)
            self._notes(file)
            now: dict[str, _Track] = {}
            for name, shape in shapes(file).items():
                track = open_tracks.get(name)
                if track is not None and track.base.same_topology(shape):
                    if not np.array_equal(track.base.vt, shape.vt):
                        self.notes.remark("texcoords-change", path.name, detail=name, key=f"{path.name} {name}")
                    track.last = frame
                    track.add(shape)
                else:
                    if track is not None:
                        self.notes.remark("object-cut", path.name, detail=name, key=f"{path.name} {name}")
                    track = _Track(name, frame, frame, shape, [], [], {}, replaces=track is not None)
                    track.index_of_shape[shape.v.tobytes() + shape.vn.tobytes()] = 0
                    track.add(shape)
                    self.tracks.append(track)
                now[name] = track
            for name in open_tracks.keys() - now.keys():
                self.notes.remark("object-gone", path.name, detail=name, key=f"{path.name} {name}")
            open_tracks = now
            if len(self.tracks) > MAX_OBJECTS:
                raise SceneError(f"more than {MAX_OBJECTS} objects", where=path.name)
            morphed = sum(
                len(t.others) * (MORPHED_BYTES * len(t.base.v) + WEIGHT_BYTES * len(t.which)) for t in self.tracks
            )
            require(morphed, "the shapes up to this file", SceneError, path.name)

    def _notes(self, file: ObjFile) -> None:
        for names, where in file.libraries:
            self.library.read(names, where)
        for message, count in file.undrawn.items():
            self.notes.remark("undrawn", file.path.name, count, detail=message, key=f"{file.path.name} {message}")

    def scene(self, name: str, path: Path, animation: Sequence[str | int] | None) -> Scene:
        nodes, meshes, channels, replacements = NodeList(), [], [], []
        root = nodes.add(name)
        count = len(self.files)
        for track in self.tracks:
            node = nodes.add(track.name or name, root, mesh=len(meshes))
            meshes.append(self._mesh(track))
            if track.replaces:
                replacements.append(node)
            if track.others:
                times = np.arange(track.first, track.last + 1) / self.fps
                weights = np.zeros((len(times), len(track.others)))
                moved = np.flatnonzero(np.array(track.which) > 0)
                weights[moved, np.array(track.which)[moved] - 1] = 1.0
                channels.append(Channel("node", node, "weights", "LINEAR", times, weights))
            if track.first > 0 or track.last < count - 1:
                channels.append(self._visible(node, track))
        if count > 1:
            # The root's visibility is constant; its last key sets the duration of the sequence.
            times = np.array([0.0, (count - 1) / self.fps])
            channels.append(Channel("node", root, "visible", "STEP", times, np.ones((2, 1))))
        for data in self.library.data.values():
            self.identity.add(data)
        for image in self.library.images.files:
            self.identity.add_file(image)
        return Scene(
            name=name,
            nodes=nodes.nodes(),
            meshes=tuple(meshes),
            materials=tuple(self.library.materials),
            images=tuple(self.library.images.images),
            **only_animation("sequence", channels, animation is None or len(animation) > 0),
            notes=self.notes.all(),
            path=path,
            sha256=self.identity.hexdigest(),
            files=self.identity.files,
            replacements=frozenset(replacements),
        )

    def _visible(self, node: int, track: _Track) -> Channel:
        keys = [(0.0, 0.0)] if track.first > 0 else []
        keys.append((track.first / self.fps, 1.0))
        if track.last < len(self.files) - 1:
            keys.append(((track.last + 1) / self.fps, 0.0))
        times, values = np.array(keys).T
        return Channel("node", node, "visible", "STEP", times, values[:, None])

    def _mesh(self, track: _Track) -> Mesh:
        primitives = tuple(
            self._primitive(track, material, corners)
            for material, corners in zip(track.base.materials, track.base.corners, strict=True)
        )
        return Mesh(track.name, primitives, np.zeros(len(track.others)))

    def _primitive(self, track: _Track, material: str, corners: Array) -> Primitive:
        base = track.base
        flat = corners.reshape(-1, 3)
        vertices, inverse = _distinct(flat)
        v, t, n = flat[vertices].T
        smooth = bool(np.all(n >= 0)) and _all_nonzero([base.vn, *(vn for _, vn in track.others)], n)
        texcoords = None
        if np.any(t >= 0):
            uv = np.where((t >= 0)[:, None], base.vt[np.maximum(t, 0)], 0.0)
            texcoords = np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1).astype(np.float32)
        positions = base.v[v]
        normals = normalize(base.vn[n]) if smooth else None
        targets = tuple(
            MorphTarget(
                (other_v[v] - positions).astype(np.float32),
                (normalize(other_vn[n]) - normals).astype(np.float32) if smooth else None,
            )
            for other_v, other_vn in track.others
        )
        return Primitive(
            positions=positions.astype(np.float32),
            triangles=inverse.reshape(-1, 3).astype(np.uint32),
            material=self.library.use(material),
            normals=None if normals is None else normals.astype(np.float32),
            texcoords=(texcoords, None),
            colors=None if base.colors is None else np.insert(base.colors[v], 3, 1.0, axis=1).astype(np.float32),
            targets=targets,
        )


def _all_nonzero(arrays: list[Array], used: Array) -> bool:
    """Whether all used normals have a length above 0."""
    return all(bool(np.all(np.any(a[used] != 0.0, axis=1))) for a in arrays)


def _distinct(corners: Array) -> tuple[Array, Array]:
    """First row of each distinct corner, and for every corner its distinct index.  (C, 3) -> (U,), (C,)."""
    key = corners[:, 0].copy()
    for column in (1, 2):
        width = int(corners[:, column].max()) + 2
        if int(key.max() + 1) * width > 2**62:
            key = np.unique(key, return_inverse=True)[1].reshape(-1)
        key = key * width + corners[:, column] + 1
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1)
