"""Download of one file over HTTP that resumes where it stopped, as long as the server still offers the same file.

``<file>.part`` holds the bytes received so far, ``<file>.part.json`` the version of the file they belong to.  A resumed
request carries If-Range (RFC 9110, 13.1.5), to which a server with another version answers with the whole file.  A
server that ignores If-Range is caught by the ETag, date and size of its answer.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from taubench_gl.data_files import read_json
from taubench_gl.errors import DatasetError, OutputError
from taubench_gl.outputs import own_file, write_atomically

CHUNK = 1 << 20
TRIES = 4
"""Attempts per download; each resumes where the previous one stopped."""
TIMEOUT = (10.0, 30.0)
"""Seconds to connect, and to wait for the next bytes."""

Progress = Callable[[int, int | None], None]
"""Called with the bytes received and the total (None: unknown)."""


@dataclass(frozen=True, slots=True)
class Version:
    """What identifies the version of the file at an address; None where the server does not report it."""

    url: str
    etag: str | None = None
    modified: str | None = None
    bytes: int | None = None

    @property
    def validator(self) -> str | None:
        """The value of If-Range: a strong ETag, else the date.  Weak ETags do not guarantee equal bytes."""
        return self.etag if self.etag and not self.etag.startswith("W/") else self.modified

    def may_be(self, other: Version) -> bool:
        """Whether no property that both have differs."""
        pairs = ((self.etag, other.etag), (self.modified, other.modified), (self.bytes, other.bytes))
        return self.url == other.url and all(a == b for a, b in pairs if a is not None and b is not None)


def fetch(url: str, part: Path, progress: Progress | None = None) -> None:
    """Download ``url`` to ``part``; a later call resumes where this one stops.  Raises DatasetError."""
    import requests
    import urllib3

    host = urlsplit(url).hostname or url
    for attempt in range(TRIES):
        if attempt:
            time.sleep(0.1 * 2**attempt)
        try:
            problem = _attempt(url, part, progress)
        except (requests.exceptions.Timeout, urllib3.exceptions.ReadTimeoutError):
            problem = f"{host} does not answer"
        except urllib3.exceptions.HTTPError:
            problem = f"interrupted after {_size(part)} bytes"
        except requests.exceptions.ConnectionError:
            problem = f"{host} cannot be reached"
            if not part.exists():
                hint = "without a network, give a local file with --from FILE"
                raise DatasetError(problem, where=url, hint=hint) from None
        except requests.exceptions.RequestException as error:
            raise DatasetError(f"cannot be fetched: {error}", where=url) from None
        if problem is None:
            return
    raise DatasetError(f"the download failed {TRIES} times: {problem}", where=url, hint="run it again to resume")


def forget(part: Path) -> None:
    """Remove a part and the record of its version."""
    part.unlink(missing_ok=True)
    _record(part).unlink(missing_ok=True)


def _attempt(url: str, part: Path, progress: Progress | None) -> str | None:
    """One request that continues ``part``.  -> None if it is complete, else the problem.

    Raises DatasetError if the server refuses, and errors of requests and urllib3.
    """
    import requests

    begun = _begun(part, url)
    if begun is None:
        forget(part)
    have = _size(part)
    with requests.get(url, headers=_headers(have, begun), stream=True, timeout=TIMEOUT) as response:
        if response.status_code not in (200, 206, 416):
            raise DatasetError(f"the server answers {response.status_code} {response.reason}", where=url)
        version = _version(response, url)
        same = begun is None or begun.may_be(version)
        if response.status_code == 416 and version.bytes == have and same:
            return None  # the range starts at the end of the file
        if response.status_code == 416 or not same or (have and response.status_code == 200):
            # The server cannot resume or has another version: this answer if it is the whole file, else a new request.
            forget(part)
            have = 0
            if response.status_code != 200:
                return "the file changes with every answer"
        write_atomically(_record(part), json.dumps(asdict(version)))
        with own_file(part, append=True) as file:
            read = getattr(response.raw, "read1", response.raw.read)
            while chunk := read(CHUNK):
                file.write(chunk)
                have += len(chunk)
                if progress is not None:
                    progress(have, version.bytes)
    complete = version.bytes is None or have == version.bytes
    return None if complete else f"interrupted after {have} of {version.bytes} bytes"


def _size(part: Path) -> int:
    return part.stat().st_size if part.exists() else 0


def _record(part: Path) -> Path:
    return part.with_name(part.name + ".json")


def _begun(part: Path, url: str) -> Version | None:
    """The version that the part belongs to; None without a part or where the version is unknown."""
    if not part.exists():
        return None
    try:
        begun = Version(**read_json(_record(part), Version))
    except (DatasetError, OutputError, TypeError):
        return None
    return begun if begun.url == url else None


def _headers(have: int, begun: Version | None) -> dict[str, str]:
    headers = {"Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
        if begun is not None and begun.validator is not None:
            headers["If-Range"] = begun.validator
    return headers


def _version(response: Any, url: str) -> Version:
    """The version of the whole file according to an answer."""
    headers = response.headers
    partial = response.status_code in (206, 416)
    size = headers.get("Content-Range", "").rpartition("/")[2] if partial else headers.get("Content-Length", "")
    return Version(url, headers.get("ETag"), headers.get("Last-Modified"), int(size) if size.isdigit() else None)
