"""A texture changes between two calls: ``cost`` does not mix the results, as tests/batch shows of a buffer."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import PIL.Image

from taubench_gl.cost import configurations
from taubench_gl.paths import PACKAGE

sys.path.append(str(Path(__file__).parents[1] / "scene"))
from gltf_files import glb, read_parts

DEMO = PACKAGE.parent / "assets" / "demo.glb"
FIXED = ("--light-unit", "candela", "--exposure", "1", "--environment", "none")


def paint(folder: Path, color: tuple[int, int, int]) -> None:
    """Write the texture of ``demo_with_texture``; the file size is the same for every color."""
    PIL.Image.new("RGB", (4, 4), color).save(folder / "texture.png")


def demo_with_texture(folder: Path) -> Path:
    """The demo scene with a base color texture in its own file."""
    root, blob = read_parts(DEMO)
    root["images"] = [*root.get("images", []), {"uri": "texture.png"}]
    root["textures"] = [*root.get("textures", []), {"source": len(root["images"]) - 1}]
    sampled = {"baseColorTexture": {"index": len(root["textures"]) - 1}}
    for material in root["materials"]:
        material["pbrMetallicRoughness"] = material.get("pbrMetallicRoughness", {}) | sampled
    path = folder / "demo.glb"
    path.write_bytes(glb(json.dumps(root).encode(), blob))
    paint(folder, (200, 40, 40))
    return path


def test_cost_does_not_continue_with_a_changed_scene(taubench, tmp_path, monkeypatch):
    scene = demo_with_texture(tmp_path)
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
    assert code == 2 and str(tmp_path / "study") in err and len(err.strip().splitlines()) == 1, err
    assert sorted((tmp_path / "study" / "records").rglob("*.json")) == records
