"""One file over HTTP, cut off or not: a download goes on where it stopped, and only if the file is still the same one.

``<file>.part`` is what has come so far, ``<file>.part.json`` what the server said of the file it began with.  Going on
asks with If-Range (RFC 9110, 13.1.5), so that a server with another file answers with all of it; one that knows no
If-Range is caught by the ETag, date and size of its answer.
"""

from __future__ import annotations

import json
import shutil
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from taubench_gl.errors import DatasetError

CHUNK = 1 << 20
TRIES = 4
"""Attempts at one download, each going on where the last stopped."""
TIMEOUT = (10.0, 30.0)
"""Seconds to connect, and to wait for the next bytes."""

Progress = Callable[[int, int | None], None]
"""Called with bytes so far and in all (None: unknown)."""


@dataclass(frozen=True, slots=True)
class Version:
    """What tells one file at an address from another that comes to lie there.  What the server did not say is None."""

    url: str
    etag: str | None = None
    modified: str | None = None
    bytes: int | None = None

    @property
    def validator(self) -> str | None:
        """For If-Range: a strong ETag, else the date; weak ETags promise no equal bytes."""
        return self.etag if self.etag and not self.etag.startswith("W/") else self.modified

    def may_be(self, other: Version) -> bool:
        """Does nothing that both say speak against their being one file?"""
        pairs = ((self.etag, other.etag), (self.modified, other.modified), (self.bytes, other.bytes))
        return self.url == other.url and all(a == b for a, b in pairs if a is not None and b is not None)


def fetch(url: str, out: Path, part: Path, progress: Progress | None = None) -> None:
    """Download ``url`` to ``out``, by way of ``part``, which a later call goes on with.  Raises DatasetError."""
    import requests
    import urllib3

    host = urlsplit(url).hostname or url
    trouble = ""
    for attempt in range(TRIES):
        begun = _begun(part, url)
        if begun is None:
            forget(part)
        have = part.stat().st_size if part.exists() else 0
        try:
            with requests.get(url, headers=_headers(have, begun), stream=True, timeout=TIMEOUT) as response:
                if response.status_code not in (200, 206, 416):
                    raise DatasetError(f"the server answers {response.status_code} {response.reason}", where=url)
                version = _version(response, url)
                same = begun is None or begun.may_be(version)
                if response.status_code == 416 and version.bytes == have and same:
                    break
                if response.status_code == 416 or not same or (have and response.status_code == 200):
                    # The server cannot go on, or another file lies there now: this answer, if it is all of it, or anew.
                    forget(part)
                    have = 0
                    if response.status_code != 200:
                        trouble = "another file lies there with every answer"
                        continue
                _remember(part, version)
                with part.open("ab") as file:
                    # Whatever has come is written at once: iter_content drops the last piece when the line does.
                    read = getattr(response.raw, "read1", response.raw.read)
                    while chunk := read(CHUNK):
                        file.write(chunk)
                        have += len(chunk)
                        if progress is not None:
                            progress(have, version.bytes)
            if version.bytes is None or have == version.bytes:
                break
            trouble = f"cut off after {have} of {version.bytes} bytes"
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


def forget(part: Path) -> None:
    """Remove a part and what is known of it."""
    part.unlink(missing_ok=True)
    _note(part).unlink(missing_ok=True)


def _note(part: Path) -> Path:
    return part.with_name(part.name + ".json")


def _begun(part: Path, url: str) -> Version | None:
    """What the part is the beginning of; None where there is no part or nobody knows."""
    if not part.exists():
        return None
    try:
        begun = Version(**json.loads(_note(part).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        return None
    return begun if begun.url == url else None


def _remember(part: Path, version: Version) -> None:
    _note(part).write_text(json.dumps(asdict(version)), encoding="utf-8")


def _headers(have: int, begun: Version | None) -> dict[str, str]:
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if begun is not None and begun.validator is not None:
            headers["If-Range"] = begun.validator
    return headers


def _version(response: Any, url: str) -> Version:
    """What an answer says of the whole file."""
    told = response.headers
    partial = response.status_code in (206, 416)
    size = told.get("Content-Range", "").rpartition("/")[2] if partial else told.get("Content-Length", "")
    return Version(url, told.get("ETag"), told.get("Last-Modified"), int(size) if size.isdigit() else None)
