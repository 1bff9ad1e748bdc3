"""What a scene is made of, in one number: results that were measured on other bytes are not mixed with new ones."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

from taubench_gl.errors import SceneError

BLOCK = 1 << 20


class Identity:
    """SHA-256 over the bytes of every file a scene is read from, in the order in which its reader comes to them.

    A scene in one file has the file's own checksum.  Pictures count by their files, not by their pixels, so that no
    texture is decoded for it; those that no material samples are not part of the scene.
    """

    def __init__(self) -> None:
        self._digest = sha256()
        self._named: set[Path] = set()
        self.files = 0
        """Files taken in so far."""

    def add(self, data: bytes | memoryview) -> None:
        """Take in a file's bytes that were read already."""
        self._digest.update(data)
        self.files += 1

    def add_file(self, path: Path) -> None:
        """Take in a file that is read later, once however often it is named.  Raises SceneError."""
        if path in self._named:
            return
        self._named.add(path)
        self.files += 1
        try:
            with path.open("rb") as file:
                while block := file.read(BLOCK):
                    self._digest.update(block)
        except OSError as e:
            raise SceneError(f"cannot be read: {e.strerror}", where=path.name) from None

    def hexdigest(self) -> str:
        """64 hexadecimal digits over all that was taken in so far."""
        return self._digest.hexdigest()
