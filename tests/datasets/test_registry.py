"""The registry of named scenes: the package's and the user's."""

from __future__ import annotations

import pytest

from taubench_gl.conventions import DEFAULT_THRESHOLD
from taubench_gl.datasets.registry import find_entry, load_registry, parse_registry
from taubench_gl.errors import DatasetError
from taubench_gl.report.paper import paper_numbers
from taubench_gl.settings import Settings


def test_registry_contains_every_scene_of_the_paper():
    entries = load_registry()
    for entry in entries.values():
        assert entry.title and entry.authors and entry.license and entry.homepage.startswith("http")
        Settings(**entry.settings())
        assert entry.paper is None or (entry.fps, entry.camera_fps) == (24.0, 60.0)
    rows = {row["name"] for row in paper_numbers()["scenes"]}
    assert {e.paper for e in entries.values() if e.paper} == rows


def test_names_in_the_papers_spelling():
    entries = load_registry()
    assert find_entry(entries, "BistroInterior") == ("bistro-interior", entries["bistro-interior"])
    assert find_entry(entries, "eternalvalleyVR")[0] == "eternal-valley-vr"
    with pytest.raises(DatasetError, match="'Bistro'"):
        find_entry(entries, "Bistro")


def test_registry_of_the_user(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[hall]\ntitle = "Hall"\nformat = "gltf"\nfps = 30.0\nframes = [0, 90]\ncamera = "main"\n'
                    'unit_scale = 100.0\n[toasters]\ntitle = "My toasters"\nformat = "obj sequence"\n')  # fmt: skip
    entries = load_registry([path])
    assert entries["hall"].options() == "--fps 30 --frames 0:90 --camera main --unit-scale 100"
    assert entries["hall"].camera_options() == ""
    assert entries["toasters"].title == "My toasters" and set(entries) == {*load_registry(), "hall"}
    with pytest.raises(DatasetError, match=r"'hal' .*hall"):
        find_entry(entries, "hal")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[a", "TOML"),
        ('["a b"]\ntitle = "x"\nformat = "gltf"', "a b"),
        ('[a]\nformat = "gltf"', "title"),
        ('[a]\ntitle = 3\nformat = "gltf"', "expected|Expected"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nhue = 1', "hue"),
        ('[a]\ntitle = "x"\nformat = "3ds"', "'3ds'"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nsha256 = "12"', "sha256"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nfps = 0.0', "fps"),
        ('[a]\ntitle = "x"\nformat = "gltf"\ncamera_fps = -1.0', "fps"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nexposure = 0.0', "exposure"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nlight_unit = "lumen"', "light unit"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nenvironment = "sky.png"', "environment"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nthresholds = {hue = 0.1}', "hue"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nframes = [3, 3]', "frames"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nscene = "../x.glb"', "scene"),
    ],
)
def test_invalid_registries_give_one_line(text, what):
    with pytest.raises(DatasetError, match=what) as caught:
        parse_registry(text, "mine.toml")
    assert str(caught.value).startswith("mine.toml") and "\n" not in str(caught.value)


def test_a_registry_that_cannot_be_read(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name in ("none.toml", "bytes.toml"):
        with pytest.raises(DatasetError) as caught:
            load_registry([tmp_path / name])
        assert caught.value.where == str(tmp_path / name)


def test_rows_carry_what_a_reproduction_needs():
    """Rates by table, light unit, exposure, environment and thresholds, as settings and as options."""
    text = (
        '[a]\ntitle = "x"\nformat = "usd"\nfps = 24.0\ncamera_fps = 60.0\nframes = [24, 49]\nlight_unit = "watt"\n'
        'exposure = 2.0\nenvironment = "0.1,0.2,0.3"\nthresholds = {color = 0.05, position = 0.2}\n'
    )
    entry = parse_registry(text, "mine.toml")["a"]
    settings = Settings(**entry.settings())
    assert (settings.sequence.fps, settings.sequence.frames) == (24.0, (24, 49))
    lighting = settings.lighting
    assert (lighting.light_unit, lighting.exposure, lighting.environment) == ("watt", 2.0, (0.1, 0.2, 0.3))
    assert settings.metrics.thresholds["color"] == 0.05 and settings.metrics.thresholds["normal"] == DEFAULT_THRESHOLD
    camera = Settings(**entry.camera_settings())
    assert (camera.sequence.fps, camera.sequence.frames) == (60.0, (60, 121)), "the same seconds"
    assert entry.options() == (
        "--fps 24 --frames 24:49 --light-unit watt --exposure 2 --environment 0.1,0.2,0.3 "
        "--threshold color=0.05 --threshold position=0.2"
    )
    assert entry.camera_options().startswith("--fps 60 --frames 60:121")
