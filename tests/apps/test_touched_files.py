"""A texture changes between two calls: ``batch`` and ``cost`` do not mix the results."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import PIL.Image
import pytest

from taubench_gl.cost import configurations
from taubench_gl.paths import PACKAGE
from taubench_gl.scene import load_scene

sys.path.append(str(Path(__file__).parents[1] / "scene"))
from gltf_files import glb, read_parts

pytest.importorskip("pyarrow")

DEMO = PACKAGE.parent / "assets" / "demo.glb"
FIXED = ("--light-unit", "candela", "--exposure", "1", "--environment", "none")


def paint(folder: Path, color: tuple[int, int, int]) -> None:
    """Write the texture of ``demo_with_texture``; the file size is the same for every color."""
    PIL.Image.new("RGB", (4, 4), color).save(folder / "texture.png")


def demo_with_texture(folder: Path, suffix: str) -> Path:
    """The demo scene with a base color texture in its own file; as .gltf also with its own buffer."""
    root, blob = read_parts(DEMO)
    root["images"] = [*root.get("images", []), {"uri": "texture.png"}]
    root["textures"] = [*root.get("textures", []), {"source": len(root["images"]) - 1}]
    sampled = {"baseColorTexture": {"index": len(root["textures"]) - 1}}
    for material in root["materials"]:
        material["pbrMetallicRoughness"] = material.get("pbrMetallicRoughness", {}) | sampled
    path = folder / f"demo{suffix}"
    if suffix == ".gltf":
        (folder / "demo.bin").write_bytes(blob)
        root["buffers"][0]["uri"] = "demo.bin"
        path.write_text(json.dumps(root), encoding="utf-8")
    else:
        path.write_bytes(glb(json.dumps(root).encode(), blob))
    paint(folder, (200, 40, 40))
    return path


@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_batch_evaluates_a_changed_scene_again(taubench, tmp_path, suffix):
    scene = demo_with_texture(tmp_path, suffix)
    study = tmp_path / "study.toml"
    study.write_text(
        f'scenes = ["{scene.name}"]\nframes = "0:3"\nsize = "32x18"\ncolumns = ["frustum", "position", "normal"]\n'
    )

    def summary(*arguments: object) -> dict:
        code, _, err = taubench("batch", *arguments)
        assert code == 0, err
        (found,) = (tmp_path / "out" / "jobs").glob("*/summary.json")
        return json.loads(found.read_text())

    first = summary("run", study, "--out", tmp_path / "out")
    assert first["scene"]["sha256"] == load_scene(scene).sha256
    untouched = summary("resume", tmp_path / "out")
    assert untouched == first, "finished jobs stay unchanged"
    paint(tmp_path, (40, 40, 200))
    again = summary("resume", tmp_path / "out")
    assert again["scene"]["sha256"] == load_scene(scene).sha256 != first["scene"]["sha256"]


def test_cost_does_not_continue_with_a_changed_scene(taubench, tmp_path, monkeypatch):
    scene = demo_with_texture(tmp_path, ".glb")
    command = ["cost", scene, "--out", tmp_path / "study", "--size", "8x5", "--frames", "0:2", "--repeats", "1"]
    command += ["--columns", "direct", "--truth-within", "9", "--time", "1", *FIXED]
    for name, few in {"PREVIEWS": ({},), "SAMPLES": (1,), "WITHIN": (50.0,)}.items():
        monkeypatch.setattr(configurations, name, few)
    code, _, err = taubench(*command)
    assert code == 0, err
    records = sorted((tmp_path / "study" / "records").rglob("*.json"))
    code, _, err = taubench(*command)
    assert code == 0 and sorted((tmp_path / "study" / "records").rglob("*.json")) == records, err
    paint(tmp_path, (40, 40, 200))
    code, _, err = taubench(*command)
    assert code == 2 and "scene" in err and len(err.strip().splitlines()) == 1, err
    assert sorted((tmp_path / "study" / "records").rglob("*.json")) == records
