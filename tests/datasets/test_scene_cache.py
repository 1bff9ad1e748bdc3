"""Files of named scenes: archives and scene files, refused, damaged, and with several scenes."""

from __future__ import annotations

import hashlib
import io
import json
import tarfile
import zipfile

import pytest
from click.testing import CliRunner

from taubench_gl.apps.cli import cli
from taubench_gl.datasets.registry import Entry
from taubench_gl.datasets.scene_cache import CachedScene, Record, unpack
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


def test_a_scene_file_is_copied_and_recorded(tmp_path):
    source = tmp_path / "mine.aff"
    source.write_bytes(AFF)
    place = CachedScene("x", Entry(title="x", format="aff"), tmp_path / "cache")
    assert place.record() is None
    assert place.take(source).read_bytes() == AFF
    assert place.record() == Record("mine.aff", len(AFF), hashlib.sha256(AFF).hexdigest())
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
    assert place.scene().read_bytes() == AFF


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
    with pytest.raises(DatasetError, match=r"no d\.aff"):
        chosen.take(tmp_path / "a.zip", "d.aff")
    (tmp_path / "three.zip").write_bytes(zipped(two | {"in/e.aff": AFF}))
    with pytest.raises(DatasetError, match=r"no d\.aff"):
        chosen.take(tmp_path / "three.zip", "d.aff")
    assert chosen.scene().name == "b.aff" and not list(chosen.folder.rglob("e.aff")), "what is refused changes nothing"
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
        place.scene()


def test_the_commands(tmp_path, monkeypatch):
    mine = tmp_path / "mine.toml"
    mine.write_text('[world]\ntitle = "World"\nformat = "aff"\nhomepage = "http://here"\nfps = 30.0\n')
    (tmp_path / "world.zip").write_bytes(zipped({"world/main.aff": AFF, "world/read me.txt": b"hello"}))
    monkeypatch.setenv("TAUBENCH_SCENES", str(mine))
    monkeypatch.setenv("TAUBENCH_CACHE", str(tmp_path / "cache"))

    def run(*words: str):
        return CliRunner().invoke(cli, ["scenes", *words])

    assert "world" in run("list").output and "toasters" in json.loads(run("list", "--json").output)
    assert "--fps 30" in run("show", "world").output and json.loads(run("show", "world", "--json").output)["fps"] == 30
    refused = run("get", "world", "--from", str(tmp_path / "world.zip"))
    assert isinstance(refused.exception, DatasetError) and "--accept-license" in str(refused.exception)
    nothing = run("get", "world", "--accept-license").exception
    assert isinstance(nothing, DatasetError) and "http://here" in nothing.hint and "--from" in nothing.hint
    got = run("get", "world", "--accept-license", "--from", str(tmp_path / "world.zip"))
    assert got.exit_code == 0 and "main.aff" in got.output and "not stated" in got.output


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
    place = CachedScene("x", Entry(title="x", format="aff"), tmp_path / "cache")
    with pytest.raises(DatasetError) as caught:
        place.take(tmp_path / "a.zip", name)
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
            place.scene()
