"""The table of scenes: the package's own, and a user's."""

from __future__ import annotations

import pytest

from taubench_gl.datasets.registry import find_entry, load_registry, parse_registry
from taubench_gl.errors import DatasetError
from taubench_gl.report.tables import paper_numbers

NAMES = {
    "eternal-valley-fps", "eternal-valley-vr", "bistro-interior", "bistro-exterior", "emerald-square", "zero-day",
    "toasters", "bart-kitchen", "bart-robots", "bart-museum",
}  # fmt: skip


def test_every_scene_the_paper_names_is_there():
    entries = load_registry()
    assert set(entries) == NAMES
    for entry in entries.values():
        assert entry.title and entry.authors and entry.licence and entry.homepage.startswith("http")
    rows = {row["name"] for row in paper_numbers()["scenes"]}
    assert {e.paper for e in entries.values() if e.paper} == rows


def test_the_papers_spelling_will_do():
    entries = load_registry()
    assert find_entry(entries, "BistroInterior") == ("bistro-interior", entries["bistro-interior"])
    assert find_entry(entries, "eternalvalleyVR")[0] == "eternal-valley-vr"
    with pytest.raises(DatasetError, match="no scene is called 'Bistro'"):
        find_entry(entries, "Bistro")


def test_a_users_own_scenes(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[hall]\ntitle = "Hall"\nformat = "gltf"\nfps = 30.0\nframes = [0, 90]\ncamera = "main"\n'
                    'unit_scale = 100.0\n[toasters]\ntitle = "My toasters"\nformat = "obj sequence"\n')  # fmt: skip
    entries = load_registry([path])
    assert entries["hall"].options() == "--fps 30 --frames 0:90 --camera main --unit-scale 100"
    assert entries["toasters"].title == "My toasters" and set(entries) == NAMES | {"hall"}
    with pytest.raises(DatasetError, match=r"no scene is called 'hal' \(known: .*hall"):
        find_entry(entries, "hal")


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("[a", "is not valid TOML"),
        ('["a b"]\ntitle = "x"\nformat = "gltf"', "a name has letters"),
        ('[a]\nformat = "gltf"', "missing required field title"),
        ('[a]\ntitle = 3\nformat = "gltf"', "Expected str, got int"),
        ('[a]\ntitle = "x"\nformat = "gltf"\ncolour = 1', "unknown field colour"),
        ('[a]\ntitle = "x"\nformat = "3ds"', "format '3ds' is none of"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nurl = "file:///etc/x"', "url must be http"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nsha256 = "12"', "64 hexadecimal digits"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nfps = 0.0', "must be positive"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nframes = [3, 3]', "frames must be"),
        ('[a]\ntitle = "x"\nformat = "gltf"\nscene = "../x.glb"', "must lie inside"),
    ],
)
def test_bad_registries_give_one_line(text, what):
    with pytest.raises(DatasetError, match=what) as caught:
        parse_registry(text, "mine.toml")
    assert str(caught.value).startswith("mine.toml") and "\n" not in str(caught.value)


def test_a_registry_that_cannot_be_read(tmp_path):
    (tmp_path / "bytes.toml").write_bytes(b"\xff\xfe")
    for name, what in (("none.toml", "cannot be read"), ("bytes.toml", "not UTF-8")):
        with pytest.raises(DatasetError, match=what):
            load_registry([tmp_path / name])
