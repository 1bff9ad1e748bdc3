"""The exposure that a glTF file of this package records."""

from __future__ import annotations

import json

import pytest

from taubench_gl.scene import load_scene


@pytest.mark.parametrize(
    ("text", "exposure"), [("0.69", 0.69), ("nan", None), ("0", None), ("-1", None), ("1e40", None), ("bright", None)]
)
def test_only_a_usable_exposure_is_read(text, exposure, tmp_path):
    file = tmp_path / "scene.gltf"
    own = {"taubench_gl": {"exposure": text}}
    file.write_text(json.dumps({"asset": {"version": "2.0", "extras": own}, "scenes": [{"nodes": [0]}], "nodes": [{}]}))
    assert load_scene(file).exposure == exposure
