"""The reader of JSON, TOML and CSV from outside: each fault is one line, of the error class that the caller names."""

from __future__ import annotations

import errno
import json
import os
import re
from pathlib import Path
from typing import Literal

import msgspec
import pytest

from taubench_gl.data_files import (
    MAX_DEPTH,
    hashed,
    opened,
    parse_json,
    parse_toml,
    read_bytes,
    read_csv,
    read_json,
    read_toml,
    stored_arrays,
)
from taubench_gl.errors import OutputError, SceneError, printable
from taubench_gl.outputs import _process_space, csv_text
from taubench_gl.scene import load_scene

DEEP = 100_000
BAD_JSON = {
    "deep-list": "[" * DEEP + "]" * DEEP,
    "deep-object": '{"a":' * DEEP + "1" + "}" * DEEP,
    "not-so-deep": "[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1),
    "long-integer": "9" * 5000,
    "large-integer": "1" + "0" * 25,
    "infinite": "1e400",
    "nan": '{"a": NaN}',
    "infinity": "[-Infinity]",
    "cut": '{"a": [1, 2',
    "empty": "",
    "not-text": b"\xff\xfe\x00",
    "binary": b"\x00" * 100,
}
BAD_TOML = {
    "deep-list": "a = " + "[" * DEEP + "]" * DEEP,
    "deep-table": "a = " + "{a=" * DEEP + "1" + "}" * DEEP,
    "long-integer": "a = " + "9" * 5000,
    "large-integer": "a = 1" + "0" * 4000,
    "infinite": "a = 1e400",
    "cut": "a = [1, 2",
    "not-text": b"a = \xff",
}


def write(path, content):
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


BAD_CSV = {"cell": 'a,b\n1,"' + "x" * 200_000 + '"\n', "bytes": b"a\n\0\xff\n"}


@pytest.mark.parametrize(
    ("read", "content"),
    [
        pytest.param(read, content, id=f"{read.__name__} {name}")
        for read, bad in ((read_json, BAD_JSON), (read_toml, BAD_TOML), (read_csv, BAD_CSV))
        for name, content in bad.items()
    ],
)
def test_bad_content_is_one_line(tmp_path, read, content):
    path = write(tmp_path / "a", content)
    with pytest.raises(SceneError) as caught:
        list(read(path, fault=SceneError))
    error = caught.value
    assert str(path) in error.where and len(str(error)) < 600 and "\n" not in str(error)


def test_only_regular_files_of_limited_size_are_read(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)  # opening it as a file waits for ever
    loop = tmp_path / "loop"
    loop.symlink_to(loop)
    for path in (pipe, tmp_path, "/dev/zero", loop, tmp_path / "none", tmp_path / "nul\0", tmp_path / ("x" * 300)):
        with pytest.raises(OutputError) as caught:
            read_bytes(path)
        assert "\n" not in str(caught.value)
    large = write(tmp_path / "large", b"x" * ((1 << 20) + 1))
    with pytest.raises(OutputError, match="1 MiB"):
        read_bytes(large, max_bytes=1 << 20)
    assert len(read_bytes(large)) == (1 << 20) + 1


def test_what_is_valid_is_read_as_it_is(tmp_path):
    values = {"a": [1, -2.5, 2**63 - 1, 1e308, "é\udce9", None, True], "b": {}}
    path = write(tmp_path / "a.json", json.dumps(values))
    assert read_json(path) == values == parse_json(json.dumps(values))
    assert read_toml(write(tmp_path / "a.toml", "a = [1, inf]\nb.c = 0x10")) == {"a": [1, float("inf")], "b": {"c": 16}}
    assert parse_toml("a = 1_000") == {"a": 1000}
    rows = list(read_csv(write(tmp_path / "a.csv", '\ufeffa,b\n1,"x,y"\n2,z')))
    assert rows == [(1, ["a", "b"]), (2, ["1", "x,y"]), (3, ["2", "z"])]
    assert len(list(read_csv(tmp_path / "a.csv", whole_lines=True))) == 2


def test_values_of_another_type_are_named(tmp_path):
    class Kind(msgspec.Struct):
        size: tuple[int, int]
        name: str = ""

    path = tmp_path / "a.json"
    for text, named in (
        ('{"size": [1, "x"]}', "size[1] is text, expected an integer"),
        ('{"size": 5}', "size is an integer, expected a list"),
        ("[]", "the file is a list, expected an object"),
        ("{}", "size"),
    ):
        with pytest.raises(OutputError) as caught:
            read_json(write(path, text), Kind)
        assert named in caught.value.what
    values = {"size": [1, 2], "more": "kept"}
    assert read_json(write(path, json.dumps(values)), Kind) == values


def test_the_entry_of_a_table_that_is_wrong_is_named(tmp_path):
    class Kind(msgspec.Struct, forbid_unknown_fields=True):
        groups: list[dict[str, dict[str, int]]]
        color: dict[str, Literal["srgb", "linear"] | None] = {}

    path = tmp_path / "a.toml"
    for text, key in (
        ("[[groups]]\nu = { x = 1 }\n[[groups]]\na = { x = 1 }\nb = { x = 1, y = 'z' }\n", "groups[1].b.y "),
        ("[[groups]]\na = { x = 1 }\nb = 3\n", "groups[0].b "),
        ("[[groups]]\n[group]\n", "group "),
        (
            "groups = []\ncolor = { a = 'linear', b = 'rgb' }\n",
            "color.b: invalid enum value 'rgb', expected one of srgb, linear",
        ),
    ):
        with pytest.raises(OutputError) as caught:
            read_toml(write(path, text), Kind)
        assert caught.value.what.startswith(key)


def test_formulas_in_csv_are_text():
    cells = ["=1+1", "+cmd", "-2+3", "@sum", "-1.5", "+1e3", "plain", -1.5, None, "a=b"]
    assert csv_text([cells]) == "'=1+1,'+cmd,'-2+3,'@sum,-1.5,+1e3,plain,-1.5,,a=b\n"


def test_control_characters_are_not_printed():
    assert printable("a\x1b[31mb\x07c\x9bd\re\n\tf") == "a [31mb c d e\n\tf"


def test_files_of_the_system_are_read():
    """Files of /proc and /sys have a size of 0, and fail for a buffer of many megabytes."""
    for path in ("/proc/sys/kernel/random/boot_id", "/proc/meminfo", "/proc/self/status"):
        if Path(path).exists():
            assert len(read_bytes(path)) > 30
    assert re.fullmatch("-[0-9a-f]{8}", _process_space())


@pytest.mark.skipif(not os.path.exists("/proc/self/mem"), reason="needs a file that fails when it is read")
def test_a_file_that_fails_when_it_is_read_is_the_callers_error(tmp_path):
    """Byte 0 of a process's memory is an input error (EIO): all ways to read give one line with the file's name."""
    for name in ("a.glb", "a.obj", "a.json", "a.npz", "a.png"):
        os.symlink("/proc/self/mem", tmp_path / name)
    with opened(tmp_path / "a.glb", SceneError) as file:
        for read in (lambda: file.read(4), file.read):
            with pytest.raises(SceneError) as caught:
                read()
            assert caught.value.where == str(tmp_path / "a.glb") and os.strerror(errno.EIO) in caught.value.what
    for load, fault in (
        (lambda: load_scene(tmp_path / "a.glb"), SceneError),
        (lambda: load_scene(tmp_path / "a.obj"), SceneError),
        (lambda: read_json(tmp_path / "a.json"), OutputError),
        (lambda: hashed(tmp_path / "a.json"), OutputError),
        (lambda: stored_arrays(tmp_path / "a.npz").__enter__(), OutputError),
    ):
        with pytest.raises(fault) as caught:
            load()
        assert os.strerror(errno.EIO) in str(caught.value)
