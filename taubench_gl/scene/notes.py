"""Notes of a reader: what it decided, ignored or repaired, one counted note for each kind of finding.

A *repair* is a departure from the format that other programs allow and that the reader corrects; ``strict`` readers
raise instead.  A *remark* is allowed by the format and noted by both.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from taubench_gl.errors import SceneError
from taubench_gl.scene.model import Note

MAX_SHOWN = 8
"""Most names that one note lists."""


def listed(names: Iterable[str]) -> str:
    """The first ``MAX_SHOWN`` of ``names`` and how many more there are."""
    names = list(names)
    more = f" and {len(names) - MAX_SHOWN} more" if len(names) > MAX_SHOWN else ""
    return ", ".join(names[:MAX_SHOWN]) + more


@dataclass(frozen=True, slots=True)
class Kind:
    """A kind of finding: ``counted``, with ``{s}`` for the plural, and what the reader does about it."""

    counted: str
    consequence: str

    def message(self, count: int, details: tuple[str, ...] = ()) -> str:
        """``3 normals ...: normalized``, with the distinct ``details`` in parentheses."""
        named = f" ({listed(details)})" if details else ""
        return f"{count} {self.counted.replace('{s}', '' if count == 1 else 's')}{named}: {self.consequence}"


REPAIRS: dict[str, Kind] = {
    # The file as a whole
    "byte-order-mark": Kind("byte order mark{s}", "skipped"),
    "text-encoding": Kind("text{s} with bytes of another encoding", "these bytes are replaced"),
    "null-member": Kind("null member{s}", "read as absent"),
    "empty-array": Kind("empty array{s} or object{s}", "read as absent"),
    "empty-object": Kind("empty buffer{s}, bufferView{s} or accessor{s}", "nothing is drawn from them"),
    "wrong-type": Kind("member{s} of the wrong type", "replaced by the default"),
    "unknown-word": Kind("unknown value{s}", "replaced by the default"),
    "value-range": Kind("number{s} out of range", "replaced by the default"),
    "factor-range": Kind("factor{s} out of range", "limited to the range"),
    # OBJ and MTL
    "unknown-statement": Kind("unknown OBJ statement{s}", "ignored"),
    "curve": Kind("statement{s} of curves and surfaces", "not drawn"),
    "statement-numbers": Kind("OBJ statement{s} with more numbers than usual", "the first ones are used"),
    "statement-nonfinite": Kind("normal{s} or texture coordinate{s} that are no finite numbers", "read as 0"),
    "face-corners": Kind("face{s} with fewer than three corners", "not drawn"),
    "corner-slash": Kind("corner{s} of faces that end in a slash", "read without it"),
    "face-index": Kind("face{s} with an index outside the file", "not drawn, or drawn without normal or texture"),
    "library-name": Kind("mtllib statement{s} without a file name", "ignored"),
    "mtl-case": Kind("MTL statement{s} in other letters than the format's", "read without regard to case"),
    "mtl-statement": Kind("MTL statement{s} that cannot be read", "ignored"),
    # Data
    "short-buffer": Kind("buffer{s} shorter than declared", "what is there is used"),
    "data-uri": Kind("unusual data URI{s}", "read as far as they can be decoded"),
    "uri-spelling": Kind("URI{s} without percent-encoding", "read as file names"),
    "bounds": Kind("minimum{s} or maximum{s} other than the data's", "those of the data are used"),
    "key-time-bounds": Kind("accessor{s} of key times without min and max", "those of the data are used"),
    "alignment": Kind("accessor{s} with unaligned data", "read from where they are"),
    "stride": Kind("bufferView{s} with an invalid or misplaced byteStride", "read with it"),
    "buffer-target": Kind("use{s} of a bufferView for both indices and vertex attributes", "read as both"),
    "normalized-number": Kind("normalized accessor{s} of 32-bit numbers", "floats are read as they are"),
    "sparse-order": Kind("sparse accessor{s} with unordered indices", "applied in the order of the file"),
    # Meshes
    "normal-length": Kind("normal{s} of another length than 1", "normalized; zero and NaN become the face normal"),
    "tangent": Kind("tangent{s} of another length than 1 or with a sign other than 1 and -1", "normalized or rebuilt"),
    "color-range": Kind("vertex color{s} outside 0..1", "limited"),
    "nonfinite-attribute": Kind("vertex color{s} or texture coordinate{s} with NaN or infinity", "white, or 0, 0"),
    "unknown-attribute": Kind("vertex attribute{s} unknown to glTF", "ignored"),
    "attribute-numbers": Kind("gap{s} in the numbers of attributes", "read by their numbers"),
    "attribute-format": Kind("vertex attribute{s} of 32-bit integers", "read as they are"),
    "attribute-ignored": Kind("vertex attribute{s} of another type or count than glTF requires", "ignored"),
    "quantization": Kind("quantized attribute{s} without KHR_mesh_quantization", "read as quantized"),
    "joints-without-weights": Kind("primitive{s} with joints without weights, or weights without joints", "ignored"),
    "negative-weight": Kind("set{s} of skin weights with a negative one", "it becomes 0"),
    "morph-attribute": Kind("attribute{s} of morph targets that the primitive lacks or glTF does not know", "ignored"),
    "morph-count": Kind("mesh{s} whose primitives have different numbers of morph targets", "missing ones are at rest"),
    "morph-weights": Kind("list{s} of weights that are not one per morph target", "missing weights are 0"),
    # Materials
    "material-reference": Kind("reference{s} to a material that does not exist", "drawn with the default material"),
    "texture-reference": Kind("reference{s} to a texture, sampler or image that does not exist", "drawn without it"),
    "texture-unreadable": Kind("texture image{s} missing or damaged", "drawn as a flat color"),
    "image-source": Kind("image{s} with an unknown type or two sources", "read by content"),
    "extension-invalid": Kind("extension object{s} that cannot be read", "ignored"),
    "extension-misplaced": Kind("extension{s} on the wrong kind of object", "ignored"),
    # Nodes, cameras, lights, skins
    "quaternion-length": Kind("rotation{s} of another length than 1", "normalized"),
    "matrix-shear": Kind("node{s} with a matrix that shears or whose last row is not 0 0 0 1",
                         "drawn sheared, with the last row replaced"),
    "matrix-and-parts": Kind("node{s} with a matrix and also translation, rotation or scale", "the matrix is used"),
    "animated-matrix": Kind("animated node{s} with a matrix", "split into translation, rotation and scale"),
    "scene-roots": Kind("scene root{s} listed twice or below another node", "read once, below the parent"),
    "default-scene": Kind("default scene{s} without an entry", "the first scene is used"),
    "camera": Kind("camera{s} with an invalid projection", "limited, or replaced by a default one"),
    "camera-reference": Kind("reference{s} to a camera that does not exist", "read without it"),
    "light-type": Kind("light{s} of unknown type", "not simulated"),
    "light-cone": Kind("spot light{s} with invalid cone angles", "limited, or replaced by the default"),
    "light-reference": Kind("reference{s} to a light that does not exist", "read without it"),
    "skin-ignored": Kind("skin{s} without joints or weights, or on a node without mesh", "ignored"),
    "skin-joints": Kind("skin{s} with repeated joints, without a common root or with a wrong skeleton",
                        "read as they are"),
    "bind-matrix": Kind("joint{s} with an inverse bind matrix that is missing or whose last row is not 0 0 0 1",
                        "identity, or the last row is replaced"),
    # Animations
    "channel-ignored": Kind("animation channel{s} with a target that is missing or taken", "ignored"),
    "channel-path": Kind("animation channel{s} with a pointer and another path", "the pointer is used"),
    "interpolation": Kind("animation sampler{s} of unknown interpolation", "LINEAR is used"),
    "negative-time": Kind("key{s} before time 0", "only the motion after time 0 is seen"),
}  # fmt: skip
"""Kind of a repair -> its words."""

REMARKS: dict[str, Kind] = {
    # OBJ, MTL and AFF
    "polygon-crossing": Kind("polygon{s} whose outline crosses itself", "drawn as a fan around the first corner"),
    "library-missing": Kind("reference{s} to a material library that cannot be found", "drawn without it"),
    "texture-missing": Kind("texture{s} that cannot be found", "drawn without it"),
    "material-unknown": Kind("material{s} in no library", "replaced by the default material"),
    "material-twice": Kind("material{s} defined twice", "the first definition is used"),
    "mtl-unsupported": Kind("MTL statement{s} that are not simulated", "ignored"),
    "object-cut": Kind("change{s} of the faces of an object", "a cut for this object"),
    "object-gone": Kind("object{s} that disappear", "a cut for this object"),
    "texcoords-change": Kind("change{s} of texture coordinates", "the first are used"),
    "undrawn": Kind("statement{s} of lines or points", "not drawn"),
    # AFF
    "aff-key-times": Kind("track{s} with key times that do not increase",
                          "segments that do not end after all earlier ones are skipped, as in BART's code"),
    "aff-long-turn": Kind("rotation track{s} with turns of more than 180 degrees between two keys",
                          "turned as written; BART's code takes the shorter arc"),
    "aff-triangle-times": Kind("animated triangle{s} with key times that do not increase", "these keys are ignored"),
    "aff-axis": Kind("rotation{s} about an axis of length 0", "ignored"),
    "aff-animation-twice": Kind("animation{s} defined twice", "the last definition is used"),
    "aff-no-target": Kind("animation{s} without a target", "ignored"),
    "aff-static": Kind("transform{s} without an animation of that name", "static"),
    "aff-detail": Kind("file{s} with a detail level that is too high", "not included"),
    "aff-viewpoint": Kind("viewpoint{s} after the first", "the last one is used"),
    "aff-background": Kind("background color{s}", "not simulated: the sky is black"),
    "aff-ambient": Kind("ambient light{s}", "simulated only on surfaces without diffuse and specular reflection"),
    # glTF
    "instances-skinned": Kind("node{s} with a skin and EXT_mesh_gpu_instancing",
                              "every instance is drawn where the joints of the skin are"),
    "extension-undeclared": Kind("extension{s} used without a declaration in extensionsUsed", "read all the same"),
    "primitive-without-positions": Kind("primitive{s} without POSITION", "not drawn"),
    "primitive-without-triangles": Kind("primitive{s} without triangles", "not drawn"),
    "surplus-indices": Kind("triangle list{s} with one or two surplus indices", "ignored"),
    "missing-texcoord": Kind("primitive{s} without the texture coordinates of a texture", "0, 0 everywhere"),
    "draco-indices": Kind("primitive{s} whose Draco data has another number of indices than declared",
                          "the compressed data is used"),
    "draco-vertices": Kind("primitive{s} whose Draco data has another number of vertices than declared",
                           "the compressed data is used"),
    "camera-unused": Kind("camera{s} that no node of the scene refers to", "not used"),
    "texture-without-image": Kind("texture{s} without a readable image", "drawn without it"),
    "texcoord-number": Kind("texture{s} with texture coordinates other than 0 and 1", "drawn without it"),
    "specular-glossiness": Kind("material{s} of KHR_materials_pbrSpecularGlossiness",
                                "converted to metallic and roughness"),
    "specular-texture": Kind("specular texture{s} with other coordinates than the diffuse one",
                             "the specular factor is used"),
    "channel-without-target": Kind("animation channel{s} without a target node", "ignored"),
    "channel-unknown-path": Kind("animation channel{s} of unknown path", "ignored"),
    "not-animated": Kind("animation channel{s} of a property that is not animated here", "constant"),
    "interpolation-number": Kind("animation sampler{s} with a number as interpolation", "LINEAR is used"),
    "blender-intensity": Kind("light{s} whose intensity Blender's exporter animates in another unit than the light's",
                              "keys in the unit of the light"),
    "blender-cone": Kind("spot light{s} whose cone Blender's exporter animates by its blend or by invalid pointers",
                         "read as cone angles"),
    "repeated-key": Kind("key{s} at the time of a later key",
                         "a jump: the earlier ends what is before, the later begins what follows"),
}  # fmt: skip
"""Kind of a remark -> its words."""


def page() -> str:
    """docs/repairs.md: every kind of counted note."""
    lines = [
        "# Repairs and remarks of the scene readers",
        "",
        "This page is generated by `tools/record commands`. A scene has at most one note of each kind, with "
        "the number of findings and the place of the first; `kind` and `count` are fields of `Scene.notes`. What is "
        "never repaired is in [formats](formats.md).",
    ]
    for title, text, kinds in (
        ("Repairs", "Refused by `--strict` and `load_scene(path, strict=True)`.", REPAIRS),
        ("Remarks", "Noted in every mode.", REMARKS),
    ):
        lines += [
            "",
            f"## {title}",
            text,
            "",
            "| kind | what is counted | what the reader does |",
            "| --- | --- | --- |",
        ]
        rows = ((name, kind.counted.replace("{s}", "s"), kind.consequence) for name, kind in kinds.items())
        lines += [f"| `{name}` | {counted} | {consequence} |" for name, counted, consequence in rows]
    return "\n".join(lines) + "\n"


@dataclass(slots=True)
class _Tally:
    count: int
    where: str  # of the first
    keys: set[str]  # counted ones
    details: dict[str, None]


class Notes:
    """Collects the notes of one reader."""

    def __init__(self, strict: bool = False):
        self.strict = strict
        self._plain: dict[Note, None] = {}  # an ordered set
        self._tallies: dict[str, _Tally] = {}

    def add(self, message: str, where: str = "") -> None:
        """A decision that concerns the whole file; equal notes are recorded once."""
        self._plain[Note(message, where)] = None

    def remark(self, kind: str, where: str = "", count: int = 1, detail: str = "", key: str = "") -> None:
        """Count ``count`` findings of a kind of ``REMARKS``.

        ``detail``: a name shown in the note.  ``key``: findings of one kind with one key count once; '': ``where``.
        """
        assert kind in REMARKS, kind
        self._tally(kind, where, count, detail, key or where)

    def repair(self, kind: str, error: SceneError, count: int = 1, detail: str = "", where: str | None = None) -> None:
        """Count ``count`` departures of a kind of ``REPAIRS``; strict: raise ``error`` instead.

        ``where``: as in notes; None: that of the error.
        """
        assert kind in REPAIRS, kind
        if self.strict:
            raise error
        if where is None:
            where = error.where or ""
        self._tally(kind, where, count, detail, where)

    def _tally(self, kind: str, where: str, count: int, detail: str, key: str) -> None:
        tally = self._tallies.setdefault(kind, _Tally(0, where, set(), {}))
        if key and key in tally.keys:
            return
        tally.keys.add(key)
        tally.count += count
        if detail:
            tally.details[detail] = None

    def all(self) -> tuple[Note, ...]:
        """Plain notes in the order of recording, then the counted ones."""
        counted = (
            Note((REPAIRS.get(kind) or REMARKS[kind]).message(t.count, tuple(t.details)), t.where, kind, t.count)
            for kind, t in self._tallies.items()
        )
        return (*self._plain, *counted)
