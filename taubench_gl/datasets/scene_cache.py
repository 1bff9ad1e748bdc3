"""The cache of named scenes: unpacking, and checksums.

``<cache>/<name>/`` holds ``scene/`` with the contents of the user's file, and ``record.json``: file, bytes, sha256 and
the selected scene.
"""

from __future__ import annotations

import json
import lzma
import os
import shutil
import struct
import tarfile
import zipfile
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any, BinaryIO

import msgspec

from taubench_gl.data_files import hashed, opened, read_json
from taubench_gl.datasets.registry import VARIABLE, Entry, find_entry, load_registry
from taubench_gl.errors import DatasetError
from taubench_gl.memory_budget import limit, over, shown_bytes
from taubench_gl.outputs import copy_atomically, make_folders, remove_folders, write_atomically
from taubench_gl.paths import cache_folder
from taubench_gl.scene.files import MAX_TEXT_BYTES
from taubench_gl.scene.gltf.document import GLB_MAGIC
from taubench_gl.setting_values import ENVIRONMENT_FILES

PREFIX = "scene:"
"""Marks a name of the registry where a path is expected."""

MAX_UNPACKED = 200 * 2**30
MAX_MEMBERS = 1_000_000
MAX_RATIO = 200
"""Limit on the bytes of an archive's files per byte of the archive: text reaches about 20, made archives over 1000."""
RATIO_FROM = 256 << 20
"""Bytes below which the ratio does not matter."""
_ARCHIVE_FAULTS = (
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, tarfile.TarError, struct.error, EOFError, OSError, ValueError,
    RuntimeError, NotImplementedError,
)  # fmt: skip
"""What the archive modules raise for damaged files, such as one flipped byte."""
SUFFIXES = {
    "gltf": (".glb", ".gltf"),
    "obj": (".obj",),
    "aff": (".aff", ".nff"),
    "fbx": (".fbx",),
    "blend": (".blend",),
    "usd": (".usd", ".usda", ".usdc", ".usdz"),
    "alembic": (".abc",),
    "ply": (".ply",),
    "stl": (".stl",),
    "collada": (".dae",),
}
TEXT_SUFFIXES = (".gltf", ".glb", ".obj", ".aff", ".nff")
"""Endings of files that are read as text unless they are binary glTF."""


@dataclass(frozen=True, slots=True)
class Record:
    """What the scene was unpacked from: the name, size and checksum of the user's file."""

    file: str
    bytes: int
    sha256: str
    scene: str | None = None  # the file of the archive that the user selected


class CachedScene:
    """A named scene in the cache."""

    def __init__(self, name: str, entry: Entry, cache: Path | None = None):
        self.name, self.entry = name, entry
        self.folder = (cache or cache_folder()) / name

    def record(self) -> Record | None:
        """The record of the file that was taken; None if there is none.  Raises DatasetError if it is damaged."""
        path = self.folder / "record.json"
        if not path.exists():
            return None
        hint = "delete it and get the scene again"
        record = msgspec.convert(read_json(path, Record, DatasetError, hint=hint), Record)
        _require_inside(record.file, str(path))
        return record

    def take(self, source: Path, scene: str | None = None) -> Path:
        """Unpack an archive, or copy a scene file.  -> the scene.  Raises DatasetError, and changes nothing.

        ``scene``: the file of the archive, if it holds several.
        """
        if scene is not None:
            _require_inside(scene, self.name)
        if not source.is_file():
            raise DatasetError("is not a file", where=str(source), hint="name the archive or the scene file itself")
        with opened(source, DatasetError) as file:
            _packing(file, source)  # before all of it is read for its checksum
        checksum = sha256_of(source)
        if self.entry.sha256 not in (None, checksum):
            raise DatasetError(f"has checksum {checksum}, the registry has {self.entry.sha256}", where=str(source))
        old, kept, unpacked = self.record(), self.folder / "scene", self.folder / "unpacking"
        same = old is not None and old.sha256 == checksum
        record = Record(source.name, source.stat().st_size, checksum, scene or (old.scene if same else None))
        new_folders: list[Path] = []
        try:
            new_folders = make_folders(self.folder)
            shutil.rmtree(unpacked, ignore_errors=True)
            if same and kept.is_dir():
                self._found(kept, record)
            else:
                unpack(source, unpacked)
                self._require_scene(source, unpacked)
                self._found(unpacked, record)
                shutil.rmtree(kept, ignore_errors=True)
                unpacked.replace(kept)
        except OSError as e:
            raise DatasetError(f"cannot be stored: {e.strerror}", where=str(self.folder)) from None
        finally:
            shutil.rmtree(unpacked, ignore_errors=True)
            remove_folders(new_folders)  # as far as they are empty: where the file was refused
        write_atomically(self.folder / "record.json", json.dumps(asdict(record), indent=2) + "\n")
        return self.scene()

    def scene(self) -> Path:
        """The path to evaluate.  Raises DatasetError if it is not found."""
        return self._found(self.folder / "scene", self.record())

    def _found(self, folder: Path, record: Record | None) -> Path:
        """``scene`` of an unpacked ``folder`` with its ``record``."""
        selected = (record.scene if record is not None else None) or self.entry.scene
        if selected is not None:
            _require_inside(selected, self.name)
            direct = folder / selected
            if direct.exists() or "*" in selected or "%" in selected:
                return direct
            matches = sorted(folder.rglob(Path(selected).name)) if folder.is_dir() else []
            if len(matches) == 1:
                return matches[0]
        if self.entry.format == "obj sequence":
            folders = sorted({p.parent for p in folder.rglob("*.obj")})
            if len(folders) == 1:
                return folders[0]
            raise DatasetError(f"holds OBJ files in {len(folders)} folders, expected one", where=str(self.folder))
        files = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES[self.entry.format])
        # A single scene file that the user gave is accepted under any name.
        if len(files) == 1 and (selected is None or (record is not None and record.file == files[0].name)):
            return files[0]
        names = ", ".join(p.name for p in files[:8])
        fault = f"no {selected}" if selected else f"{len(files)} files of the format {self.entry.format}, expected one"
        hint = f"choose with --scene from {names}" if files else "check that it is the right file"
        raise DatasetError(f"holds {fault}", where=str(self.folder), hint=hint)

    def settings(self) -> dict[str, Any]:
        """``Entry.settings``, with the path of an environment image of the archive.  Raises DatasetError."""
        out = self.entry.settings()
        name = str(out.get("environment", ""))
        if name.lower().endswith(ENVIRONMENT_FILES):
            direct = self.folder / "scene" / name
            matches = [direct] if direct.is_file() else sorted((self.folder / "scene").rglob(Path(name).name))
            if len(matches) != 1:
                message = f"holds {len(matches)} files named {Path(name).name}, the environment of {self.name}"
                raise DatasetError(message, where=str(self.folder / "scene"))
            out["environment"] = str(matches[0])
        return out

    def _require_scene(self, source: Path, folder: Path) -> None:
        """Raises DatasetError where nothing in ``folder`` can be the scene, whichever file is chosen."""
        suffixes = SUFFIXES[self.entry.format.removesuffix(" sequence")]
        names_in_folder = {p.name for p in folder.rglob("*") if p.is_file()}
        named = self.entry.scene is not None and Path(self.entry.scene).name in names_in_folder
        if not named and not any(name.lower().endswith(suffixes) for name in names_in_folder):
            raise DatasetError(
                f"holds no {' or '.join(suffixes)} file", where=str(source), hint=f"is it {self.entry.title}?"
            )


def registry_entries(registries: Sequence[Path] = ()) -> dict[str, Entry]:
    """Scenes of the package and of ``registries``, default: the files that TAUBENCH_SCENES names."""
    named = [Path(p) for p in os.environ.get(VARIABLE, "").split(os.pathsep) if p]
    return load_registry(list(registries) or named)


def find_named(text: str) -> CachedScene | None:
    """The cached scene that ``text`` names; None if it is a path or an unknown name.

    ``scene:NAME`` is always a name; NAME alone is a name unless a file of that name exists.  Raises DatasetError.
    """
    name = text.removeprefix(PREFIX)
    if name == text and (not text or Path(text).suffix or os.sep in text or ":" in text or os.path.lexists(text)):
        return None
    try:
        name, entry = find_entry(registry_entries(), name)
    except DatasetError:
        if text.startswith(PREFIX):
            raise
        return None
    return CachedScene(name, entry)


def scene_text(cached: CachedScene) -> str:
    """The argument of ``load_scene``: the scene's path, with the rate of a sequence.  Raises DatasetError."""
    if cached.record() is None:
        raise DatasetError(
            f"{cached.name} is a known scene that is not in the cache",
            hint=f"taubench-gl scenes get {cached.name} --from FILE",
        )
    rate = f"@{cached.entry.fps:g}" if cached.entry.format == "obj sequence" and cached.entry.fps is not None else ""
    return f"{cached.scene()}{rate}"


def sha256_of(path: Path) -> str:
    """Checksum of a file, 64 hexadecimal digits.  Raises DatasetError."""
    return hashed(path, DatasetError).hexdigest()


ARCHIVES = (".zip", ".tar", ".tar.gz", ".tgz", ".tar.bz2", ".tar.xz")
"""Endings of names that archives have."""


_COMPRESSED = {b"\x1f\x8b": "r:gz", b"BZh": "r:bz2", b"\xfd7zXZ\x00": "r:xz"}


def unpack(archive: Path, folder: Path) -> None:
    """Unpack a zip or tar archive, or copy a single scene file, to a new folder.  Raises DatasetError."""
    folder.mkdir(parents=True)
    with opened(archive, DatasetError) as file:
        try:
            packing = _packing(file, archive)
            if packing == "zip":
                with zipfile.ZipFile(file) as z:
                    _require_bounded(archive, ((m.filename, m.file_size) for m in z.infolist()))
                    z.extractall(folder)
            elif packing is not None:
                with tarfile.open(fileobj=file, mode=packing) as t:
                    _require_bounded(archive, ((m.name, m.size) for m in t))
                    t.extractall(folder, filter="data")
            else:
                copy_atomically(file, folder / archive.name)
        except _ARCHIVE_FAULTS as e:
            raise DatasetError(f"cannot be unpacked: {e}", where=str(archive), hint="is the file complete?") from None


def _packing(file: BinaryIO, path: Path) -> str | None:
    """``zip``, the mode in which ``tarfile`` opens the file, or None for a single scene file; at the file's start.

    Few bytes are read.  Raises DatasetError for what is named like an archive and is none, and for a scene file that is
    larger than its reader takes.
    """
    try:
        packing = "zip" if zipfile.is_zipfile(file) else _tar_mode(file)
        file.seek(0)
        start = file.read(len(GLB_MAGIC))
        file.seek(0)
    except OSError as error:
        raise DatasetError(f"cannot be read: {error.strerror}", where=str(path)) from None
    if packing is not None:
        return packing
    if path.name.lower().endswith(ARCHIVES):  # a damaged one is recognized by nothing else
        raise DatasetError("is a damaged archive", where=str(path), hint="is the file complete?")
    text = path.suffix.lower() in TEXT_SUFFIXES and start != GLB_MAGIC
    most = MAX_TEXT_BYTES if text else limit()
    if os.fstat(file.fileno()).st_size > most:
        raise DatasetError(f"is larger than {shown_bytes(most)}", where=str(path), hint=None if text else over(most))
    return None


def _tar_mode(file: BinaryIO) -> str | None:
    """Mode of the tar archive in a file, None for none.  ``tarfile`` itself tries every compression on every byte."""
    file.seek(0)
    start = file.read(512)
    file.seek(0)
    if not any(start):  # the end of a tar archive
        return None
    mode = next((mode for mark, mode in _COMPRESSED.items() if start.startswith(mark)), "r:")
    try:
        tarfile.open(fileobj=file, mode=mode).close()
    except tarfile.TarError:
        return None
    return mode


def _require_bounded(archive: Path, members: Iterable[tuple[str, int]]) -> None:
    """Raises DatasetError at the first of ``members``, name and bytes, that breaks a limit; tars are read lazily."""
    count = total = 0
    most = max(RATIO_FROM, MAX_RATIO * archive.stat().st_size)
    for name, size in members:
        count, total = count + 1, total + size
        if count > MAX_MEMBERS or total > min(MAX_UNPACKED, most):
            hint = f"the limits are {MAX_MEMBERS} files, and {MAX_RATIO} times the size of the archive"
            raise DatasetError("unpacks to more files or bytes than allowed", where=str(archive), hint=hint)
        if name.startswith(("/", "\\")) or ".." in PurePosixPath(name.replace("\\", "/")).parts:
            raise DatasetError(f"holds {name!r}, a path outside its folder", where=str(archive))


def _require_inside(name: str, where: str) -> None:
    """Raises DatasetError for a name, of a file in a scene's folder, that leads out of the folder."""
    parts = PurePosixPath(name.replace("\\", "/")).parts
    if not parts or name.startswith(("/", "\\")) or ".." in parts or "\0" in name:
        raise DatasetError(f"{name!r:.80} is no file in the scene's folder", where=where, hint="give a relative name")
