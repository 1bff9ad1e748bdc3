"""The cache of scenes: fetching, unpacking, and remembering what came the first time.

``<cache>/<name>/`` holds the file as it came, ``scene/`` with its contents, and ``record.json``: url, file, bytes,
sha256.  A download goes on where it stopped; one that differs from the first is refused.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import tarfile
import time
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import unquote, urlsplit

from taubench_gl.datasets.registry import Entry
from taubench_gl.errors import DatasetError

CACHE_VARIABLE = "TAUBENCH_CACHE"
CHUNK = 1 << 20
MAX_UNPACKED = 200 * 2**30
MAX_MEMBERS = 1_000_000
TRIES = 4
"""Attempts at one download, each going on where the last stopped."""
TIMEOUT = (10.0, 30.0)
"""Seconds to connect, and to wait for the next bytes."""
SUFFIXES = {
    "gltf": (".glb", ".gltf"),
    "obj": (".obj",),
    "aff": (".aff", ".nff"),
    "fbx": (".fbx",),
    "blend": (".blend",),
}

Progress = Callable[[int, int | None], None]
"""Called with bytes so far and in all (None: unknown)."""


@dataclass(frozen=True, slots=True)
class Record:
    """What was fetched.  ``url`` is None for a file the user brought."""

    file: str
    bytes: int
    sha256: str
    url: str | None


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

    def get(self, url: str | None = None, progress: Progress | None = None) -> Path:
        """Download and unpack; what is already there and whole is kept.  -> the scene.  Raises DatasetError."""
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
        return self._keep(target, url)

    def take(self, source: Path) -> Path:
        """Copy a file the user has and unpack it.  -> the scene.  Raises DatasetError."""
        if not source.is_file():
            raise DatasetError("is not a file", where=str(source), hint="name the archive or the scene file itself")
        found = sha256_of(source)
        if self.entry.sha256 not in (None, found):
            raise DatasetError(f"has checksum {found}, the registry says {self.entry.sha256}", where=str(source))
        target = self.folder / source.name
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            if source.resolve() != target.resolve():
                shutil.copyfile(source, target)
        except OSError as e:
            raise DatasetError(f"cannot be copied: {e.strerror}", where=str(source)) from None
        return self._keep(target, None)

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
        folder = self.folder / "scene"
        wanted = self.entry.scene
        if wanted is not None:
            direct = folder / wanted
            if direct.exists() or "*" in wanted or "%" in wanted:
                return direct
            found = sorted(folder.rglob(Path(wanted).name)) if folder.is_dir() else []
            if len(found) == 1:
                return found[0]
            raise DatasetError(f"holds no {wanted}", where=str(folder), hint="is it the right file?")
        if self.entry.format == "obj sequence":
            folders = sorted({p.parent for p in folder.rglob("*.obj")})
            if len(folders) == 1:
                return folders[0]
            raise DatasetError(f"holds OBJ files in {len(folders)} folders, expected one", where=str(folder))
        found = sorted(p for p in folder.rglob("*") if p.suffix.lower() in SUFFIXES[self.entry.format])
        if len(found) != 1:
            raise DatasetError(
                f"holds {len(found)} files of the format {self.entry.format}, expected one", where=str(folder)
            )
        return found[0]

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
            part.unlink(missing_ok=True)
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
        part.unlink(missing_ok=True)

    def _keep(self, target: Path, url: str | None) -> Path:
        record = Record(target.name, target.stat().st_size, sha256_of(target), url)
        old = self.record()
        scene = self.folder / "scene"
        if old is None or old.sha256 != record.sha256 or not scene.is_dir():
            shutil.rmtree(scene, ignore_errors=True)
            unpacked = self.folder / "unpacking"
            shutil.rmtree(unpacked, ignore_errors=True)
            unpack(target, unpacked)
            unpacked.replace(scene)
        (self.folder / "record.json").write_text(json.dumps(asdict(record), indent=2) + "\n", encoding="utf-8")
        return self.scene()


def fetch(url: str, out: Path, part: Path, progress: Progress | None = None) -> None:
    """Download ``url`` to ``out``, by way of ``part``, which a later call goes on with.  Raises DatasetError."""
    import requests
    import urllib3

    host = urlsplit(url).hostname or url
    trouble = ""
    for attempt in range(TRIES):
        have = part.stat().st_size if part.exists() else 0
        try:
            headers = {"Accept-Encoding": "identity"} | ({"Range": f"bytes={have}-"} if have else {})
            with requests.get(url, headers=headers, stream=True, timeout=TIMEOUT) as response:
                if response.status_code == 416 and _whole(response) == have:
                    break
                if response.status_code == 416 or (have and response.status_code == 200):
                    part.unlink(missing_ok=True)  # the server cannot go on, or the file is another one now
                    have = 0
                    if response.status_code == 416:
                        continue
                if response.status_code not in (200, 206):
                    raise DatasetError(f"the server answers {response.status_code} {response.reason}", where=url)
                whole = _whole(response) if response.status_code == 206 else _length(response)
                with part.open("ab") as file:
                    # Whatever has come is written at once: iter_content drops the last piece when the line does.
                    read = getattr(response.raw, "read1", response.raw.read)
                    while chunk := read(CHUNK):
                        file.write(chunk)
                        have += len(chunk)
                        if progress is not None:
                            progress(have, whole)
            if whole is None or have == whole:
                break
            trouble = f"cut off after {have} of {whole} bytes"
        except (requests.exceptions.Timeout, urllib3.exceptions.ReadTimeoutError):
            trouble = f"{host} does not answer"
        except urllib3.exceptions.HTTPError:
            trouble = f"cut off after {part.stat().st_size if part.exists() else 0} bytes"
        except requests.exceptions.ConnectionError:
            trouble = f"{host} cannot be reached"
            if not part.exists():
                raise DatasetError(trouble, where=url, hint="offline? give a file you have with --from FILE") from None
        except requests.exceptions.RequestException as e:
            raise DatasetError(f"cannot be fetched: {e}", where=url) from None
        if attempt + 1 < TRIES:
            time.sleep(0.2 * 2**attempt)
    else:
        raise DatasetError(f"the download failed {TRIES} times: {trouble}", where=url, hint="run it again to go on")
    shutil.copyfile(part, out)


def _length(response: Any) -> int | None:
    text = response.headers.get("Content-Length", "")
    return int(text) if text.isdigit() else None


def _whole(response: Any) -> int | None:
    """Size of the whole file from Content-Range."""
    text = response.headers.get("Content-Range", "").rpartition("/")[2]
    return int(text) if text.isdigit() else None


def sha256_of(path: Path) -> str:
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
