"""Exports are resumed, extended, refused and replaced; invalid input ends with one line and exit code 2."""

from __future__ import annotations

import errno
import json
import os

import numpy as np
import pytest
from export_tools import DEMO, HEIGHT, WIDTH, export
from fixed import fixed_settings

from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.export.run import MANIFEST, ExportOptions, export_scene
from taubench_gl.pathtraced.cameras import read_camera_file

pytestmark = pytest.mark.usefixtures("coarse_light")

FAST = ("position", "depth", "motion", "motion_forward")


def files(out) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("format", ["exr", "npz", "zarr", "sintel"])
def test_interrupted_and_resumed(tmp_path, format):
    """An export stopped after two frames and resumed has the files of an uninterrupted one; none is partial."""

    class Stop(Exception):
        pass

    def stop(progress):
        if progress.done == 2:
            raise Stop

    export(tmp_path / "whole", format, channels=FAST)
    with pytest.raises(Stop):
        export(tmp_path / "out", format, channels=FAST, progress=stop)
    between = files(tmp_path / "out")
    assert not [name for name in between if "partial" in name]
    result = export(tmp_path / "out", format, channels=FAST)
    assert (result.kept, result.written) == (2, 1)
    after = files(tmp_path / "out")
    whole = files(tmp_path / "whole")
    assert after.keys() == whole.keys()
    if format != "npz":  # zip files carry the time
        assert after == whole
    again = export(tmp_path / "out", format, channels=FAST)
    assert (again.kept, again.written) == (3, 0)


def test_names_that_are_not_utf8(tmp_path):
    lost = os.fsdecode(b"caf\xe9")
    (tmp_path / f"{lost}.glb").symlink_to(DEMO)
    settings = fixed_settings(width=WIDTH, height=HEIGHT, frames=(0, 1))
    export_scene(tmp_path / f"{lost}.glb", tmp_path / lost, settings, ExportOptions(channels=FAST))
    assert json.loads((tmp_path / lost / "export.json").read_text())["scene"] == lost
    data = (tmp_path / lost / "frame_00000.exr").read_bytes()
    assert rb"caf\udce9" in data


def test_failed_write_leaves_no_partial_file(tmp_path, monkeypatch):
    from taubench_gl.export import formats

    def fail(partial, **arrays):
        partial.write_bytes(b"half")
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(formats.np, "savez_compressed", fail)
    with pytest.raises(OutputError, match=os.strerror(errno.ENOSPC)):
        export(tmp_path / "out", "npz", channels=FAST)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["camera.json", "export.json"]


def test_other_settings_are_refused_and_replaced(tmp_path):
    export(tmp_path, "exr", channels=FAST, frames=(8, 10))
    before = files(tmp_path)
    for changes, named in (
        ({"width": 32}, "width"), ({"channels": ("depth",)}, "channels"), ({"fps": 30.0}, "fps"),
        ({"precision": "half"}, "precision"), ({"jitter": "halton"}, "jitter"),
    ):  # fmt: skip
        with pytest.raises(OutputError) as caught:
            export(tmp_path, "exr", **({"channels": FAST, "frames": (8, 10)} | changes))
        assert named in caught.value.what and "--overwrite" in caught.value.hint
    with pytest.raises(OutputError, match="format"):
        export(tmp_path, "npz", channels=FAST, frames=(8, 10))
    assert files(tmp_path) == before
    result = export(tmp_path, "npz", channels=FAST, frames=(9, 10), overwrite=True)
    assert result.written == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["camera.json", "export.json", "frame_00009.npz"]


def test_more_frames_are_added(tmp_path):
    export(tmp_path, "exr", channels=("depth",), frames=(8, 10))
    result = export(tmp_path, "exr", channels=("depth",), frames=(8, 12))
    assert (result.kept, result.written) == (2, 2)
    assert sorted(read_camera_file(tmp_path / "camera.json").views) == [8, 9, 10, 11]
    export(tmp_path, "exr", channels=("depth",), frames=(9, 10))  # a smaller range: the other frames stay
    export(tmp_path, "exr", channels=("depth",), frames=(13, 14))
    assert sorted(read_camera_file(tmp_path / "camera.json").views) == [8, 9, 10, 11, 13]
    assert json.loads((tmp_path / "export.json").read_text())["frames"] == [8, 14]
    with pytest.raises(OutputError, match="frames"):
        export(tmp_path / "z", "zarr", channels=("depth",), frames=(8, 10))
        export(tmp_path / "z", "zarr", channels=("depth",), frames=(8, 12))


def test_channels_that_the_scene_does_not_have(tmp_path):
    result = export(tmp_path, "npz", channels=("depth", "indirect"), indirect="none", frames=(0, 1))
    assert result.names == ("depth",) and "indirect" in result.unmeasured
    assert json.loads((tmp_path / "export.json").read_text())["unmeasured"].keys() == {"indirect"}
    with pytest.raises(SettingsError, match="indirect: "):
        export(tmp_path / "b", "npz", channels=("indirect",), indirect="none")
    assert not (tmp_path / "b").exists()


def test_folders_with_other_files_are_refused(tmp_path):
    (tmp_path / "thesis.tex").touch()
    for out in (tmp_path, tmp_path / "thesis.tex"):
        with pytest.raises(OutputError) as caught:
            export(out, "exr", overwrite=True)
        assert caught.value.where == str(out)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.tex"]


@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--channels", "depht"), "'depht'"),
        (("--channels", ""), "--channels"),
        (("--channels", "color", "--format", "npz", "--columns", "sky"), "sky"),
        (("--frames", "90:95"), "90:95"),
        (("--camera", "nobody"), "'nobody'"),
    ],
)
def test_invalid_options(tmp_path, taubench, arguments, named):
    code, _, err = taubench("export", DEMO, "--out", tmp_path / "out", "--size", f"{WIDTH}x{HEIGHT}", *arguments)
    assert code == 2 and named in err and not (tmp_path / "out").exists()


def test_folder_with_a_partial_manifest_is_usable(tmp_path):
    """A killed export leaves a partial manifest."""
    settings = fixed_settings(width=WIDTH, height=HEIGHT, frames=(0, 1))
    out = tmp_path / "out"
    out.mkdir()
    (out / f".{MANIFEST}.123-0.partial").write_text("half")
    assert export_scene(DEMO, out, settings, ExportOptions(channels=FAST)).written == 1


def test_parts_of_an_export_share_a_metered_exposure(tmp_path):
    auto = {"exposure": "auto", "channels": ("color",)}
    exposures = []
    for frames in ((8, 10), (10, 12)):
        export(tmp_path / "parts", "npz", frames=frames, **auto)
        manifest = json.loads((tmp_path / "parts" / "export.json").read_text())
        exposures.append(manifest["settings"]["exposure"])
    assert exposures[0] == exposures[1] != 1.0 and manifest["frames"] == [8, 12]
    export(tmp_path / "later", "npz", frames=(10, 12), **auto)
    later = json.loads((tmp_path / "later" / "export.json").read_text())["settings"]
    assert isinstance(later["exposure"], float) and later["light_unit"] == "candela"


def test_an_export_of_geometry_meters_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr("taubench_gl.evaluation.exposure.meter", None)
    export(tmp_path, "npz", frames=(8, 9), exposure="auto", channels=("position",))
    assert json.loads((tmp_path / "export.json").read_text())["settings"]["exposure"] == 1.0


def test_exact_reasons_are_visibility_and_changed_light():
    from export_tools import drawn

    from taubench_gl.conventions import CHANGED_LIGHT, Visibility

    first, second = drawn((0, 8), ("exact_reasons", "prev_visibility"))
    assert not first.channels["exact_reasons"].any()
    bits, seen = (second.channels[name][..., 0] for name in ("exact_reasons", "prev_visibility"))
    assert ((bits & np.uint32(~CHANGED_LIGHT & 0xFFFFFFFF)) == seen).all()
    changed = (bits & int(CHANGED_LIGHT)) != 0
    assert changed.any() and ((seen[changed] & int(Visibility.VISIBLE)) != 0).all()
    with pytest.raises(SettingsError):
        drawn((8,), ("exact_reasons",), storage="half")
