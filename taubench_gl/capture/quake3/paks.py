"""Data files of the game: archives (.pk3, zip) as one set of names, and the images in it."""

from __future__ import annotations

import re
import struct
import zipfile
import zlib
from pathlib import Path

import numpy as np

from taubench_gl.capture.parts import texture_pixels
from taubench_gl.data_files import opened
from taubench_gl.errors import SceneError
from taubench_gl.memory_budget import shown_bytes

Array = np.ndarray

DEBIAN_DATA = Path("/usr/share/games/openarena/baseoa")
"""Where Debian's packages of OpenArena put its data files."""
MAX_PAK, MAX_NAMES, MAX_MEMBER = 4 << 30, 500_000, 64 << 20
IMAGES = (".tga", ".jpg", ".jpeg", ".png")
_FAULTS = (zipfile.BadZipFile, zlib.error, struct.error, EOFError, OSError, ValueError, RuntimeError, OverflowError)
"""What ``zipfile`` raises for damaged archives."""


class Paks:
    """The archives of a folder.  As in the engine, names ignore case, and the last archive by name wins."""

    def __init__(self, folder: Path):
        """Open the archives of ``folder``.  Raises SceneError for a folder without archives and for a damaged
        archive.
        """
        paths = sorted(folder.glob("*.pk3"), key=lambda path: path.name.lower()) if folder.is_dir() else []
        if not paths:
            hint = f"give --data the folder with the game's .pk3 files; OpenArena's is {DEBIAN_DATA} after: "
            raise SceneError("holds no .pk3 file", where=str(folder), hint=hint + "apt-get install openarena")
        self.folder, self._files = folder, {}
        for rank, path in enumerate(paths):
            file = opened(path, SceneError, max_bytes=MAX_PAK)
            try:
                archive = zipfile.ZipFile(file)
            except _FAULTS as error:
                raise SceneError(f"is no readable archive: {error!s:.200}", where=str(path)) from None
            for place, info in enumerate(archive.infolist()):
                self._files[info.filename.lower()] = (archive, info, path, (rank, -place))
            if len(self._files) > MAX_NAMES:
                raise SceneError(f"holds more than {MAX_NAMES:,} files", where=str(path))

    def names(self, prefix: str, suffix: str) -> list[str]:
        """Names of files, lower case, in the order in which the engine joins scripts: archives from the first to the
        last, and each from its end."""
        found = (name for name in self._files if name.startswith(prefix) and name.endswith(suffix))
        return sorted(found, key=lambda name: self._files[name][3])

    def map_file(self, map_name: str) -> tuple[Path, str]:
        """Archive and name of a map.  Raises SceneError if there is none, with what to install."""
        name = f"maps/{map_name}.bsp"
        if name not in self._files:
            hint = "OpenArena's maps: apt-get install openarena openarena-oacmp1; others: put the map's .pk3 there"
            raise SceneError(f"has no {name}", where=str(self.folder), hint=hint)
        return self._files[name][2], name

    def where(self, name: str) -> str:
        """Archive and name of a file, for errors."""
        return f"{self._files[name.lower()][2]}: {name}"

    def read(self, name: str) -> bytes | None:
        """The content of a file; None if there is none.  Raises SceneError for a damaged or huge one."""
        name = name.lower().replace("\\", "/")
        if name not in self._files:
            return None
        archive, info, *_ = self._files[name]
        where = self.where(name)
        if info.file_size > MAX_MEMBER:
            raise SceneError(f"unpacks to {shown_bytes(info.file_size)}", where=where, hint="the limit is 64 MiB")
        try:
            with archive.open(info) as file:
                return file.read(MAX_MEMBER)
        except _FAULTS as error:
            raise SceneError(f"is damaged: {error!s:.200}", where=where) from None

    def image_name(self, name: str) -> str | None:
        """The image that a script or model means: the file of this name, else that of another extension."""
        name = name.lower().replace("\\", "/")
        stem, named = re.subn(r"\.(tga|jpe?g|png)$", "", name)
        names = [*[name] * named, *(stem + suffix for suffix in IMAGES)]
        return next((found for found in names if found in self._files), None)

    def image(self, name: str, most: int) -> Array:
        """Pixels of an image of the archives, (h, w, 4) uint8, at most ``most`` a side.  Raises SceneError."""
        return texture_pixels(self.read(name) or b"", self.where(name), most)
