"""Downloads from a local server: complete, resumed, interrupted, silent, refused, changed and missing files."""

from __future__ import annotations

import hashlib
import io
import json
import socket
import tarfile
import threading
import zipfile
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from click.testing import CliRunner

pytest.importorskip("requests")

from taubench_gl.apps.cli import cli
from taubench_gl.datasets import download
from taubench_gl.datasets.registry import Entry
from taubench_gl.datasets.scene_cache import CachedScene, unpack
from taubench_gl.errors import DatasetError
from taubench_gl.scene import load_scene

AFF = b"s 0 0 0 1\nv from 0 0 5 at 0 0 0 up 0 1 0 angle 40 hither .1 resolution 4 3\n"


def zipped(files: dict[str, bytes], compression: int = zipfile.ZIP_STORED) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as z:
        for name, data in files.items():
            z.writestr(zipfile.ZipInfo(name), data, compression)
    return out.getvalue()


def tarred(files: dict[str, bytes], mode: str = "w:gz") -> bytes:
    out = io.BytesIO()
    with tarfile.open(fileobj=out, mode=mode) as t:
        for name, data in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(data)
            t.addfile(member, io.BytesIO(data))
    return out.getvalue()


class Server:
    """``files`` by path; ``limits``: bytes of the next responses before the connection drops; ``silent``: no response.

    ``tags``: version headers of every file; ``knows_if_range``: another version is sent in full.
    """

    def __init__(self) -> None:
        self.files: dict[str, bytes] = {}
        self.limits: list[int] = []
        self.ranges: list[str | None] = []
        self.status, self.takes_ranges, self.silent = 200, True, False
        self.tags: dict[str, str] = {}
        self.if_ranges: list[str | None] = []
        self.knows_if_range = True
        self.end = threading.Event()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                outer.answer(self)

            def log_message(self, *args: object) -> None:
                pass

        self.http = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.http.daemon_threads = True
        threading.Thread(target=self.http.serve_forever, daemon=True).start()

    def url(self, path: str) -> str:
        return f"http://127.0.0.1:{self.http.server_port}{path}"

    def answer(self, request: BaseHTTPRequestHandler) -> None:
        self.ranges.append(request.headers.get("Range"))
        self.if_ranges.append(request.headers.get("If-Range"))
        if self.silent:
            self.end.wait()
            return
        data = self.files.get(request.path)
        if data is None or self.status != 200:
            request.send_error(404 if data is None else self.status)
            return
        start = 0
        other = self.knows_if_range and self.if_ranges[-1] not in (None, *self.tags.values())
        if self.ranges[-1] and self.takes_ranges and not other:
            start = int(self.ranges[-1].removeprefix("bytes=").rstrip("-"))
            if start >= len(data):
                request.send_response(416)
                request.send_header("Content-Range", f"bytes */{len(data)}")
                request.end_headers()
                return
            request.send_response(206)
            request.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
        else:
            request.send_response(200)
        request.send_header("Content-Length", str(len(data) - start))
        for name, value in self.tags.items():
            request.send_header(name, value)
        request.end_headers()
        body = data[start:]
        request.wfile.write(body[: self.limits.pop(0)] if self.limits else body)


@pytest.fixture
def server(monkeypatch):
    monkeypatch.setattr(download.time, "sleep", lambda _: None)
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    made = Server()
    made.files["/world.zip"] = zipped({"world/main.aff": AFF, "world/read me.txt": b"hello" * 2000})
    yield made
    made.end.set()
    made.http.shutdown()
    made.http.server_close()


def store(server: Server, tmp_path, path: str = "/world.zip", **fields) -> CachedScene:
    entry = Entry(title="World", format="aff", **{"url": server.url(path), **fields})
    return CachedScene("world", entry, tmp_path)


def test_complete_download(server, tmp_path):
    seen = []
    place = store(server, tmp_path)
    scene = place.get(progress=lambda have, whole: seen.append((have, whole)))
    assert len(load_scene(scene).mesh_nodes) == 1 and seen[-1][0] == seen[-1][1] == len(server.files["/world.zip"])
    record = place.record()
    assert record.sha256 == hashlib.sha256(server.files["/world.zip"]).hexdigest()
    assert place.verify() == (record, scene)
    assert place.get() == scene and len(server.ranges) == 1, "a complete file is not downloaded again"
    assert not list(tmp_path.rglob("*.part"))


def test_interrupted_download_is_continued(server, tmp_path):
    server.limits = [100, 50]
    store(server, tmp_path).get()
    assert server.ranges == [None, "bytes=100-", "bytes=150-"]


def test_server_without_ranges_restarts(server, tmp_path):
    server.takes_ranges, server.limits = False, [100]
    store(server, tmp_path).get()
    assert server.ranges == [None, "bytes=100-"]


def test_failed_download_is_continued_by_the_next_call(server, tmp_path):
    server.limits = [10] * 4
    with pytest.raises(DatasetError, match="40"):
        store(server, tmp_path).get()
    store(server, tmp_path).get()
    assert server.ranges[-1] == "bytes=40-"


def test_complete_partial_file_is_accepted(server, tmp_path):
    whole = server.files["/world.zip"]
    (tmp_path / "world").mkdir()
    (tmp_path / "world" / "world.zip.part").write_bytes(whole)
    note = {"url": server.url("/world.zip"), "bytes": len(whole)}
    (tmp_path / "world" / "world.zip.part.json").write_text(json.dumps(note))
    store(server, tmp_path).get()
    assert server.ranges == [f"bytes={len(whole)}-"], "one request, answered 416"


def test_partial_file_of_unknown_origin_is_discarded(server, tmp_path):
    (tmp_path / "world").mkdir()
    (tmp_path / "world" / "world.zip.part").write_bytes(b"something else")
    store(server, tmp_path).get()
    assert server.ranges == [None]


TAGS = [
    ({"ETag": '"one"'}, {"ETag": '"two"'}, '"one"'),
    ({"Last-Modified": "Mon, 01 Jan 2024 00:00:00 GMT"}, {"Last-Modified": "Tue, 02 Jan 2024 00:00:00 GMT"},
     "Mon, 01 Jan 2024 00:00:00 GMT"),
    ({"ETag": 'W/"one"'}, {"ETag": 'W/"two"'}, None),  # a weak tag does not imply equal bytes
]  # fmt: skip


@pytest.mark.parametrize("knows_if_range", [True, False])
@pytest.mark.parametrize(("first", "then", "asked"), TAGS)
def test_changed_file_is_not_appended_to_the_old_part(server, tmp_path, first, then, asked, knows_if_range):
    old = server.files["/world.zip"]
    server.tags, server.limits, server.knows_if_range = first, [100] * 4, knows_if_range
    with pytest.raises(DatasetError, match="400"):
        store(server, tmp_path).get()
    part = tmp_path / "world" / "world.zip.part"
    assert part.read_bytes() == old[:400] and server.if_ranges[1:] == [asked] * 3
    new = zipped({"world/main.aff": AFF, "world/read me.txt": b"other" * 2000})
    assert len(new) == len(old) and new != old
    server.files["/world.zip"], server.tags, server.limits = new, then, []
    place = store(server, tmp_path)
    place.get()
    assert (place.folder / "world.zip").read_bytes() == new and not list(tmp_path.rglob("*.part*"))


def test_changed_file_without_version_is_detected_by_its_size(server, tmp_path):
    server.limits = [100] * 4
    with pytest.raises(DatasetError):
        store(server, tmp_path).get()
    server.files["/world.zip"] = zipped({"world/main.aff": AFF})
    place = store(server, tmp_path)
    place.get()
    assert (place.folder / "world.zip").read_bytes() == server.files["/world.zip"]


def test_changed_download_is_refused(server, tmp_path):
    place = store(server, tmp_path)
    place.get()
    (place.folder / "world.zip").unlink()
    server.files["/world.zip"] += b"more"
    with pytest.raises(DatasetError, match=r"record\.json"):
        place.get()
    with pytest.raises(DatasetError, match=r"world\.zip"):
        place.verify()


def test_checksum_of_the_registry_applies_to_the_first_download(server, tmp_path):
    with pytest.raises(DatasetError):
        store(server, tmp_path, sha256="0" * 64).get()
    assert not (tmp_path / "world" / "record.json").exists()
    good = hashlib.sha256(server.files["/world.zip"]).hexdigest()
    store(server, tmp_path, sha256=good).get()


@pytest.mark.parametrize("status", [403, 404, 500])
def test_http_errors(server, tmp_path, status):
    server.status = status
    path = "/none.zip" if status == 404 else "/world.zip"
    with pytest.raises(DatasetError, match=str(status)):
        store(server, tmp_path, path).get()


def test_silent_server_times_out(server, tmp_path, monkeypatch):
    server.silent = True
    monkeypatch.setattr(download, "TIMEOUT", (0.2, 0.2))
    with pytest.raises(DatasetError, match=r"127\.0\.0\.1"):
        store(server, tmp_path).get()


def test_offline(tmp_path):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))  # bound, not listening
        entry = Entry(title="x", format="aff", url=f"http://127.0.0.1:{taken.getsockname()[1]}/x.zip")
        with pytest.raises(DatasetError, match="--from FILE"):
            CachedScene("x", entry, tmp_path).get()


def test_entry_without_url(tmp_path):
    entry = Entry(title="x", format="aff", homepage="http://here")
    with pytest.raises(DatasetError, match=r"http://here.*get x --from FILE"):
        CachedScene("x", entry, tmp_path).get()


def test_local_file_is_copied_and_verified(tmp_path):
    source = tmp_path / "mine.aff"
    source.write_bytes(AFF)
    place = CachedScene("x", Entry(title="x", format="aff"), tmp_path / "cache")
    scene = place.take(source)
    assert scene.read_bytes() == AFF and place.verify()[0].url is None
    (place.folder / "mine.aff").write_bytes(b"other")
    with pytest.raises(DatasetError, match=r"mine\.aff"):
        place.verify()
    with pytest.raises(DatasetError, match=r"none\.zip"):
        place.take(tmp_path / "none.zip")
    with pytest.raises(DatasetError, match="0" * 64):
        CachedScene("x", Entry(title="x", format="aff", sha256="0" * 64), tmp_path).take(source)


def test_file_without_a_scene_changes_nothing(tmp_path):
    right, wrong = tmp_path / "mine.aff", tmp_path / "other" / "mine.zip"
    right.write_bytes(AFF)
    wrong.parent.mkdir()
    wrong.write_bytes(zipped({"thesis.pdf": b"%PDF"}))
    place = CachedScene("x", Entry(title="Mine", format="aff"), tmp_path / "cache")
    with pytest.raises(DatasetError, match=r"mine\.zip: .*\.aff or \.nff .*Mine"):
        place.take(wrong)
    assert not (tmp_path / "cache").exists()
    place.take(right)
    kept = {path: path.read_bytes() for path in place.folder.rglob("*") if path.is_file()}
    with pytest.raises(DatasetError, match="Mine"):
        place.take(wrong)
    assert {path: path.read_bytes() for path in place.folder.rglob("*") if path.is_file()} == kept
    assert place.verify()[1].read_bytes() == AFF


@pytest.mark.parametrize("name", ["../out.aff", "/out.aff", "a/../../out.aff"])
def test_archive_paths_outside_the_folder_are_refused(tmp_path, name):
    (tmp_path / "a.zip").write_bytes(zipped({name: AFF}))
    (tmp_path / "a.tar.gz").write_bytes(tarred({name: AFF}))
    for archive in ("a.zip", "a.tar.gz"):
        with pytest.raises(DatasetError, match=r"out\.aff"):
            unpack(tmp_path / archive, tmp_path / "to" / archive)
    assert not (tmp_path / "out.aff").exists()


def test_selection_of_the_scene_in_an_archive(tmp_path):
    def place(files: dict[str, bytes], take: str | None = None, **fields) -> CachedScene:
        (tmp_path / "a.zip").write_bytes(zipped(files))
        made = CachedScene("x", Entry(title="x", **fields), tmp_path / "cache")
        made.take(tmp_path / "a.zip", take)
        return made

    two = {"in/a.aff": AFF, "in/b.aff": AFF}
    assert place(two, format="aff", scene="b.aff").scene().name == "b.aff"
    with pytest.raises(DatasetError, match="2 files"):
        place(two, format="aff")
    with pytest.raises(DatasetError, match=r"c\.aff .*--scene .*a\.aff, b\.aff"):
        place(two, format="aff", scene="c.aff")
    chosen = place(two, format="aff", scene="c.aff", take="b.aff")
    assert chosen.scene().name == "b.aff" and chosen.record().scene == "b.aff"
    assert chosen.take(tmp_path / "a.zip").name == "b.aff", "the selection is stored"
    (tmp_path / "other name.aff").write_bytes(AFF)
    assert chosen.take(tmp_path / "other name.aff").name == "other name.aff"
    quad = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
    frames = place({f"t/t{i}.obj": quad for i in range(3)}, format="obj sequence").scene()
    assert load_scene(frames).duration == pytest.approx(2 / 24)


def test_damaged_archive_and_damaged_record(tmp_path):
    (tmp_path / "a.zip").write_bytes(zipped({"a.aff": AFF * 100})[:-30] + b"PK\5\6" + bytes(18))
    place = CachedScene("x", Entry(title="x", format="aff"), tmp_path)
    with pytest.raises(DatasetError):
        place.take(tmp_path / "a.zip")
    assert not place.folder.exists()
    place.folder.mkdir()
    (place.folder / "record.json").write_text("{")
    with pytest.raises(DatasetError, match=r"record\.json"):
        place.verify()


def test_the_commands(server, tmp_path, monkeypatch):
    mine = tmp_path / "mine.toml"
    mine.write_text(f'[world]\ntitle = "World"\nformat = "aff"\nurl = "{server.url("/world.zip")}"\nfps = 30.0\n')
    monkeypatch.setenv("TAUBENCH_SCENES", str(mine))
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))

    def run(*words: str):
        return CliRunner().invoke(cli, ["scenes", *words])

    assert "world" in run("list").output and "toasters" in json.loads(run("list", "--json").output)
    assert "--fps 30" in run("show", "world").output and json.loads(run("show", "world", "--json").output)["fps"] == 30
    refused = run("get", "world")
    assert isinstance(refused.exception, DatasetError) and "--accept-license" in str(refused.exception)
    got = run("get", "world", "--accept-license")
    assert got.exit_code == 0 and "main.aff" in got.output and "not stated" in got.output
    assert run("verify", "world").exit_code == 0
    assert isinstance(run("verify", "toasters").exception, DatasetError)


@pytest.mark.parametrize("kind", ["zip", "tar.gz", "tar.xz", "tar.bz2"])
def test_an_archive_with_one_flipped_byte_is_unpacked_or_refused(tmp_path, kind):
    """Any byte: the modules raise exceptions of their own, of zlib and of lzma."""
    files = {f"in/{i}.aff": AFF * (20 + i) for i in range(3)}
    whole = zipped(files, zipfile.ZIP_DEFLATED) if kind == "zip" else tarred(files, f"w:{kind.removeprefix('tar.')}")
    refused = 0
    for place in range(0, len(whole), max(1, len(whole) // 150)):
        flipped = bytearray(whole)
        flipped[place] ^= 0x55
        (tmp_path / f"a.{kind}").write_bytes(flipped)
        try:
            unpack(tmp_path / f"a.{kind}", tmp_path / f"to{place}")
        except DatasetError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 50


def test_archives_that_unpack_to_far_more_than_their_size_are_refused(tmp_path, monkeypatch):
    """The limit on the ratio applies above RATIO_FROM; a tar is not read to its end."""
    monkeypatch.setattr("taubench_gl.datasets.scene_cache.RATIO_FROM", 1 << 20)
    zeros = bytes(1 << 20)
    files = {f"{i}.aff": zeros for i in range(8)}
    (tmp_path / "a.zip").write_bytes(zipped(files, zipfile.ZIP_DEFLATED))
    (tmp_path / "a.tar.gz").write_bytes(tarred(files))
    for archive in ("a.zip", "a.tar.gz"):
        with pytest.raises(DatasetError, match="more files or bytes"):
            unpack(tmp_path / archive, tmp_path / "to" / archive)
        assert not list((tmp_path / "to" / archive).iterdir())
    (tmp_path / "b.zip").write_bytes(zipped(files))  # not compressed
    unpack(tmp_path / "b.zip", tmp_path / "to" / "b")
    assert len(list((tmp_path / "to" / "b").iterdir())) == 8


@pytest.mark.parametrize("name", ["../../x.aff", "/etc/hostname", "..", "a/../../../x.aff", "..\\x.aff", "", "nul\0"])
def test_a_chosen_scene_outside_the_folder_is_refused(tmp_path, name):
    (tmp_path / "x.aff").write_bytes(AFF)
    (tmp_path / "a.zip").write_bytes(zipped({"in/a.aff": AFF}))
    place = CachedScene("x", Entry(title="x", format="aff", url="http://nowhere.invalid/a.zip"), tmp_path / "cache")
    for work in (lambda: place.take(tmp_path / "a.zip", name), lambda: place.get(scene=name)):
        with pytest.raises(DatasetError) as caught:
            work()
        assert "\n" not in str(caught.value) and not place.folder.exists()
    place.take(tmp_path / "a.zip")
    entry = Entry(title="x", format="aff", scene=name)
    if name:
        with pytest.raises(DatasetError):
            CachedScene("x", entry, tmp_path / "cache").scene()
    record = json.loads((place.folder / "record.json").read_text())
    for damaged in (record | {"file": "../../x.aff"}, record | {"bytes": "many"}, record | {"file": 3}, [record], {}):
        (place.folder / "record.json").write_text(json.dumps(damaged))
        with pytest.raises(DatasetError):
            place.verify()
