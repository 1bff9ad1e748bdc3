"""Shaders of a method stay inside its folder, and are regular files of a bounded size."""

from __future__ import annotations

import os

import pytest
from reuse_tools import PLAIN_GLSL, PLAIN_TOML, write_method

from taubench_gl.errors import GraphicsError, MethodError
from taubench_gl.gpu.shader import MAX_INCLUDES, MAX_SOURCE_BYTES, resolve
from taubench_gl.reuse.loading import load_method


def with_shader(folder, name, glsl=PLAIN_GLSL):
    return write_method(folder, PLAIN_TOML.replace('"a.glsl"', repr(str(name))), a=glsl)


OUTSIDE = ["../secret.glsl", "../../../../../../etc/passwd", "/etc/passwd", "/dev/zero", "sub/../../secret.glsl", "."]


@pytest.mark.parametrize("name", OUTSIDE)
def test_shaders_outside_of_the_folder_are_not_read(tmp_path, name):
    (tmp_path / "secret.glsl").write_text(PLAIN_GLSL)
    for folder in (
        with_shader(tmp_path / "entry", name),
        with_shader(tmp_path / "include", "a.glsl", f'#include "{name}"\n{PLAIN_GLSL}'),
    ):
        with pytest.raises(MethodError) as caught:
            load_method(str(folder))
        assert name in str(caught.value) and "\n" not in str(caught.value)
        with pytest.raises(GraphicsError):
            resolve(name, roots=(folder,))


@pytest.mark.parametrize("target", ["../secret.glsl", "/dev/zero", "/etc/passwd", "link.glsl"])
def test_links_out_of_the_folder_are_not_followed(tmp_path, target):
    (tmp_path / "secret.glsl").write_text(PLAIN_GLSL)
    folder = with_shader(tmp_path / "m", "link.glsl")
    os.symlink(target, folder / "link.glsl")
    with pytest.raises(MethodError, match=r"link\.glsl"):
        load_method(str(folder))


def test_links_within_the_folder_and_linked_folders_work(tmp_path):
    folder = with_shader(tmp_path / "m", "link.glsl")
    os.symlink("a.glsl", folder / "link.glsl")
    os.symlink(folder, tmp_path / "other")
    assert load_method(str(folder)).passes == load_method(str(tmp_path / "other")).passes


def test_pipes_folders_and_large_files_are_not_read(tmp_path):
    for name, make in (
        ("pipe.glsl", lambda path: os.mkfifo(path)),
        ("folder.glsl", lambda path: path.mkdir()),
        ("large.glsl", lambda path: path.write_text(PLAIN_GLSL + "\n" * MAX_SOURCE_BYTES)),
        ("bytes.glsl", lambda path: path.write_bytes(b"\xff\xfe" + PLAIN_GLSL.encode())),
    ):
        folder = with_shader(tmp_path / name.partition(".")[0], name)
        make(folder / name)
        with pytest.raises(MethodError, match=name):
            load_method(str(folder))


@pytest.mark.parametrize("name", ["a" * 5000 + ".glsl", "nul\\u0000.glsl"])
def test_names_that_are_no_file_names(tmp_path, name):
    folder = write_method(tmp_path / "m", PLAIN_TOML.replace('"a.glsl"', f'"{name}"'), a=PLAIN_GLSL)
    with pytest.raises(MethodError) as caught:
        load_method(str(folder))
    assert len(str(caught.value)) < 600


def test_deep_includes_end_in_one_error(tmp_path):
    folder = with_shader(tmp_path / "m", "i0.glsl")
    for k in range(MAX_INCLUDES + 3):
        (folder / f"i{k}.glsl").write_text(f'#include "i{k + 1}.glsl"\n{PLAIN_GLSL if k == 0 else ""}')
    (folder / f"i{MAX_INCLUDES + 3}.glsl").write_text("")
    with pytest.raises(MethodError, match="deep"):
        load_method(str(folder))
