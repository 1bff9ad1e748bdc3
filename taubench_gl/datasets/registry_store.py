"""The cache of scenes: fetching, unpacking, and remembering what came the first time.

``<cache>/<name>/`` holds the file as it came, ``scene/`` with its contents, and ``record.json``: url, file, bytes,
sha256, and which of its scenes was asked for.  A download goes on where it stopped; one that differs from the first is
refused.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tarfile
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from urllib.parse import unquote, urlsplit

from taubench_gl.datasets.download import Progress, fetch, forget
from taubench_gl.datasets.registry import Entry
from taubench_gl.errors import DatasetError
from taubench_gl.outputs import make_folders, remove_folders, write_atomically

CACHE_VARIABLE = "TAUBENCH_CACHE"
MAX_UNPACKED = 200 * 2**30
MAX_MEMBERS = 1_000_000
SUFFIXES = {
    "gltf": (".glb", ".gltf"),
    "obj": (".obj",),
    "aff": (".aff", ".nff"),
    "fbx": (".fbx",),
    "blend": (".blend",),
}


@dataclass(frozen=True, slots=True)
class Record:
    """What was fetched.  ``url`` is None for a file the user brought."""

    file: str
    bytes: int
    sha256: str
    url: str | None
    scene: str | None = None  # which one of the archive, where the user chose


def cache_folder() -> Path:
    """Where scenes are kept: TAUBENCH_CACHE, else the user's cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen)
    base = os.environ.get("XDG_CACHE_HOME") or str(Path("~").expanduser() / ".cache")
    return Path(base) / "taubench-gl"


class Store:
    """One scene's place in the cache."""

    def __init__(self, name: str, entry: Entry, cache: Path | None = None):
        self.name, self.entry = name, entry
        self.folder = (cache or cache_folder()) / name

    def record(self) -> Record | None:
        """What is remembered of the first time; None where there was none.  Raises DatasetError if it is damaged."""
        path = self.folder / "record.json"
        try:
            return Record(**json.loads(path.read_text(encoding="utf-8")))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError):
            raise DatasetError("is damaged", where=str(path), hint="delete it and get the scene again") from None

    def get(self, url: str | None = None, progress: Progress | None = None, scene: str | None = None) -> Path:
        """Download and unpack; what is already there and whole is kept.  -> the scene.  Raises DatasetError.

        ``scene``: which file of the archive, where it holds several.
        """
        url = url or self.entry.url
        if url is None:
            raise DatasetError(
                f"{self.name}: no fixed address is known for this scene",
                hint=f"download it from {self.entry.homepage or 'its homepage'}, then: get {self.name} --from FILE",
            )
        known = self.record()
        expected = self.entry.sha256 or (known.sha256 if known and known.url == url else None)
        target = self.folder / (PurePosixPath(unquote(urlsplit(url).path)).name or "download")
        if not (known and known.file == target.name and target.is_file() and sha256_of(target) == known.sha256):
            self._download(url, target, expected, progress)
        return self._keep(target, url, scene)

    def take(self, source: Path, scene: str | None = None) -> Path:
        """Copy a file the user has and unpack it.  -> the scene, as ``get``.  Raises DatasetError."""
        if not source.is_file():
            raise DatasetError("is not a file", where=str(source), hint="name the archive or the scene file itself")
        found = sha256_of(source)
        if self.entry.sha256 not in (None, found):
            raise DatasetError(f"has checksum {found}, the registry says {self.entry.sha256}", where=str(source))
        try:
            made = make_folders(self.folder)
        except OSError as e:
            raise DatasetError(f"cannot be made: {e.strerror}", where=str(self.folder)) from None
        try:
            return self._keep(source, None, scene)
        finally:
            remove_folders(made)  # as far as they are empty: where the file was refused

    def verify(self) -> tuple[Record, Path]:
        """Check the cached file against its record.  -> what is remembered, the scene.  Raises DatasetError."""
        record = self.record()
        if record is None:
            raise DatasetError(f"{self.name} is not in {self.folder.parent}", hint=f"scenes get {self.name}")
        path = self.folder / record.file
        if not path.is_file():
            raise DatasetError("is gone", where=str(path), hint=f"scenes get {self.name}")
        found = sha256_of(path)
        if found != record.sha256:
            raise DatasetError(
                f"has changed: checksum {found}, was {record.sha256}",
                where=str(path),
                hint="delete it and get it again",
            )
        return record, self.scene()

    def scene(self) -> Path:
        """What to evaluate.  Raises DatasetError where it cannot be found."""
        folder, record = self.folder / "scene", self.record()
        wanted = (record.scene if record is not None else None) or self.entry.scene
        if wanted is not None:
            direct = folder / wanted
            if direct.exists() or "*" in wanted or "%" in wanted:
                return direct
            found = sorted(folder.rglob(Path(wanted).name)) if folder.is_dir() else []
            if len(found) == 1:
                return found[0]
        if self.entry.format == "obj sequence":
            folders = sorted({p.parent for p in folder.rglob("*.obj")})
            if len(folders) == 1:
                return folders[0]
            raise DatasetError(f"holds OBJ files in {len(folders)} folders, expected one", where=str(folder))
        there = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES[self.entry.format])
        # A file that the user names is the one that is meant, whatever it is called.
        if len(there) == 1 and (wanted is None or (record is not None and record.file == there[0].name)):
            return there[0]
        names = ", ".join(p.name for p in there[:8])
        what = f"no {wanted}" if wanted else f"{len(there)} files of the format {self.entry.format}, expected one"
        hint = f"choose with --scene from {names}" if there else "is it the right file?"
        raise DatasetError(f"holds {what}", where=str(folder), hint=hint)

    # ------------------------------------------------------------------------------------------------------- fetching
    def _download(self, url: str, target: Path, expected: str | None, progress: Progress | None) -> None:
        try:
            import pooch
        except ModuleNotFoundError:
            raise DatasetError(
                "downloading needs the package pooch", hint="pip install 'taubench-gl[datasets]'"
            ) from None
        part = self.folder / (target.name + ".part")
        self.folder.mkdir(parents=True, exist_ok=True)
        stale = self.folder / (target.name + ".old")
        if target.exists():
            target.replace(stale)  # pooch would keep it and only warn; it stays until the new one is whole
        pooch.get_logger().setLevel("ERROR")
        try:
            pooch.retrieve(
                url,
                known_hash=None if expected is None else f"sha256:{expected}",
                fname=target.name,
                path=self.folder,
                downloader=lambda address, out, _: fetch(address, Path(out), part, progress),
            )
        except ValueError as e:  # pooch's way to say that the checksum differs
            forget(part)
            if "hash" not in str(e).lower():
                raise
            raise DatasetError(
                "what lies there now is not what was fetched first", where=url,
                hint=f"if that is meant, delete {self.folder / 'record.json'} and get it again",
            ) from None  # fmt: skip
        except OSError as e:
            raise DatasetError(f"cannot be stored: {e.strerror or e}", where=str(target)) from None
        finally:
            if stale.exists():
                stale.unlink() if target.exists() else stale.replace(target)
        forget(part)

    def _keep(self, came: Path, url: str | None, chosen: str | None) -> Path:
        """Unpack what came, copy it to its place if it is not there, and remember it.  What is no such scene at all
        leaves everything as it was.
        """
        old, checksum, target = self.record(), sha256_of(came), self.folder / came.name
        if chosen is None and old is not None and old.sha256 == checksum:
            chosen = old.scene
        record = Record(target.name, came.stat().st_size, checksum, url, chosen)
        scene, unpacked = self.folder / "scene", self.folder / "unpacking"
        fresh = old is None or old.sha256 != record.sha256 or not scene.is_dir()
        shutil.rmtree(unpacked, ignore_errors=True)
        try:
            if fresh:
                unpack(came, unpacked)
                self._require_scene(came, unpacked)
            if came.resolve() != target.resolve():
                shutil.copyfile(came, target)
            if fresh:
                shutil.rmtree(scene, ignore_errors=True)
                unpacked.replace(scene)
        except OSError as e:
            raise DatasetError(f"cannot be copied: {e.strerror}", where=str(came)) from None
        finally:
            shutil.rmtree(unpacked, ignore_errors=True)
        write_atomically(self.folder / "record.json", json.dumps(asdict(record), indent=2) + "\n")
        return self.scene()

    def _require_scene(self, came: Path, folder: Path) -> None:
        """Raises DatasetError where nothing in ``folder`` can be the scene, whichever file is chosen."""
        suffixes = SUFFIXES[self.entry.format.removesuffix(" sequence")]
        there = {p.name for p in folder.rglob("*") if p.is_file()}
        named = self.entry.scene is not None and Path(self.entry.scene).name in there
        if not named and not any(name.lower().endswith(suffixes) for name in there):
            raise DatasetError(
                f"holds no {' or '.join(suffixes)} file", where=str(came), hint=f"is it {self.entry.title}?"
            )


def sha256_of(path: Path) -> str:
    """Checksum of a file, 64 hexadecimal digits.  Raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def unpack(archive: Path, folder: Path) -> None:
    """Put what a zip or tar archive holds, or a single scene file, into a new folder.  Raises DatasetError."""
    folder.mkdir(parents=True)
    try:
        if zipfile.is_zipfile(archive):
            with zipfile.ZipFile(archive) as z:
                _bounded(archive, [(m.filename, m.file_size) for m in z.infolist()])
                z.extractall(folder)
        elif tarfile.is_tarfile(archive):
            with tarfile.open(archive) as t:
                _bounded(archive, [(m.name, m.size) for m in t])
                t.extractall(folder, filter="data")
        else:
            shutil.copyfile(archive, folder / archive.name)
    except (zipfile.BadZipFile, tarfile.TarError, EOFError, OSError, RuntimeError, NotImplementedError) as e:
        raise DatasetError(f"cannot be unpacked: {e}", where=str(archive), hint="is it whole?") from None


def _bounded(archive: Path, members: list[tuple[str, int]]) -> None:
    if len(members) > MAX_MEMBERS or sum(size for _, size in members) > MAX_UNPACKED:
        raise DatasetError("unpacks to more than a scene can be", where=str(archive))
    for name, _ in members:
        if name.startswith(("/", "\\")) or ".." in PurePosixPath(name.replace("\\", "/")).parts:
            raise DatasetError(f"holds {name!r}, which leads out of its folder", where=str(archive))
