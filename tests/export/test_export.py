"""The whole command: resumed, refused, replaced, and wrong input in one line."""

from __future__ import annotations

import json
import os
import subprocess
import sys

import pytest
from export_tools import DEMO, HEIGHT, WIDTH, export

from taubench_gl.apps import cli
from taubench_gl.errors import OutputError, SettingsError
from taubench_gl.export.run import MANIFEST, export_scene
from taubench_gl.pathtraced.cameras import read_camera_file
from taubench_gl.settings import Settings

FAST = ("position", "depth", "motion", "motion_forward")


def files(out) -> dict[str, bytes]:
    return {str(p.relative_to(out)): p.read_bytes() for p in sorted(out.rglob("*")) if p.is_file()}


@pytest.mark.parametrize("format", ["exr", "npz", "zarr", "sintel"])
def test_interrupted_and_resumed(tmp_path, format):
    """Stopped after two frames, gone on: the same files as without a stop; no half-written file in between."""

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
    told = export(tmp_path / "out", format, channels=FAST)
    assert (told.kept, told.written) == (2, 1)
    after = files(tmp_path / "out")
    whole = files(tmp_path / "whole")
    assert after.keys() == whole.keys()
    if format != "npz":  # zip files carry the time
        assert after == whole
    again = export(tmp_path / "out", format, channels=FAST)
    assert (again.kept, again.written) == (3, 0)


@pytest.mark.parametrize("format", ["exr", "npz", "zarr", "sintel"])
def test_a_full_disk_is_one_line(tmp_path, format):
    """The system refuses files of more than 4 KiB: exit code 2, one line, no frame and no half of one."""
    command = ["export", str(DEMO), "--out", str(tmp_path / "out"), "--format", format, "--size", "64x36"]
    limited = "import resource as r, sys; r.setrlimit(r.RLIMIT_FSIZE, (4096, 4096)); sys.argv[0] = 'taubench-gl'; "
    limited += "from taubench_gl.apps.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", limited, *command, "--frames", "0:1", "--channels", "position"],
        capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert done.stderr.startswith(f"taubench-gl: error: {tmp_path / 'out'}") and done.stderr.count("\n") == 1
    assert "cannot be written: File too large" in done.stderr
    left = [p for p in (tmp_path / "out").rglob("*") if "partial" in p.name or p.name.startswith("frame_")]
    assert [p.suffix for p in left] == ([".cam"] if format == "sintel" else [])  # a frame of many files, not done


def test_names_that_are_no_text_are_exported(tmp_path):
    """Scene and folder with a byte that is no UTF-8."""
    lost = os.fsdecode(b"caf\xe9")
    (tmp_path / f"{lost}.glb").symlink_to(DEMO)
    settings = Settings.of(width=WIDTH, height=HEIGHT, frames=(0, 1))
    export_scene(tmp_path / f"{lost}.glb", tmp_path / lost, settings, channels=FAST)
    assert json.loads((tmp_path / lost / "export.json").read_text())["scene"] == lost
    data = (tmp_path / lost / "frame_00000.exr").read_bytes()
    assert rb"caf\udce9" in data


def test_a_killed_writer_leaves_nothing_half(tmp_path, monkeypatch):
    """What fails while it writes leaves the frame undone and no partial file behind."""
    from taubench_gl.export import formats

    def fail(partial, **arrays):
        partial.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(formats.np, "savez_compressed", fail)
    with pytest.raises(OutputError, match="No space left on device"):
        export(tmp_path / "out", "npz", channels=FAST)
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["camera.json", "export.json"]


def test_other_settings_are_refused_and_replaced(tmp_path):
    export(tmp_path, "exr", channels=FAST, frames=(8, 10))
    before = files(tmp_path)
    for changes, named in (
        ({"width": 32}, "width"), ({"channels": ("depth",)}, "channels"), ({"fps": 30.0}, "fps"),
        ({"precision": "half"}, "precision"), ({"jitter": "halton"}, "jitter"),
    ):  # fmt: skip
        with pytest.raises(OutputError, match=f"holds an export with other .*{named}.*--overwrite"):
            export(tmp_path, "exr", **({"channels": FAST, "frames": (8, 10)} | changes))
    with pytest.raises(OutputError, match="other format"):
        export(tmp_path, "npz", channels=FAST, frames=(8, 10))
    assert files(tmp_path) == before
    told = export(tmp_path, "npz", channels=FAST, frames=(9, 10), overwrite=True)
    assert told.written == 1
    assert sorted(p.name for p in tmp_path.iterdir()) == ["camera.json", "export.json", "frame_00009.npz"]


def test_more_frames_are_added(tmp_path):
    export(tmp_path, "exr", channels=("depth",), frames=(8, 10))
    told = export(tmp_path, "exr", channels=("depth",), frames=(8, 12))
    assert (told.kept, told.written) == (2, 2)
    assert sorted(read_camera_file(tmp_path / "camera.json").views) == [8, 9, 10, 11]
    export(tmp_path, "exr", channels=("depth",), frames=(9, 10))  # fewer: the others stay
    export(tmp_path, "exr", channels=("depth",), frames=(13, 14))
    assert sorted(read_camera_file(tmp_path / "camera.json").views) == [8, 9, 10, 11, 13]
    assert json.loads((tmp_path / "export.json").read_text())["frames"] == [8, 14]
    with pytest.raises(OutputError, match="other frames"):
        export(tmp_path / "z", "zarr", channels=("depth",), frames=(8, 10))
        export(tmp_path / "z", "zarr", channels=("depth",), frames=(8, 12))


def test_what_the_scene_does_not_give(tmp_path):
    told = export(tmp_path, "npz", channels=("depth", "indirect"), indirect="none", frames=(0, 1))
    assert told.names == ("depth",) and "indirect" in told.unmeasured
    assert json.loads((tmp_path / "export.json").read_text())["unmeasured"].keys() == {"indirect"}
    with pytest.raises(SettingsError, match="gives none of these channels: indirect: "):
        export(tmp_path / "b", "npz", channels=("indirect",), indirect="none")
    assert not (tmp_path / "b").exists()


def test_other_peoples_folders_are_left_alone(tmp_path):
    (tmp_path / "thesis.tex").touch()
    with pytest.raises(OutputError, match="holds other files and no export"):
        export(tmp_path, "exr", overwrite=True)
    with pytest.raises(OutputError, match="is not a folder"):
        export(tmp_path / "thesis.tex", "exr")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--channels", "depht"), "no channel is named 'depht'"),
        (("--channels", ""), "nothing to export"),
        (("--channels", "color", "--format", "npz", "--columns", "sky"), "cannot measure sky"),
        (("--frames", "90:95"), "frames 90:95 of 61 frames are none"),
        (("--camera", "nobody"), "no camera 'nobody'"),
    ],
)
def test_wrong_input(tmp_path, capsys, arguments, complaint):
    out = tmp_path / "out"
    with pytest.raises(SystemExit) as caught:
        cli.main(["export", str(DEMO), "--out", str(out), "--size", f"{WIDTH}x{HEIGHT}", *arguments])
    assert caught.value.code == 2 and complaint in capsys.readouterr().err
    assert not out.exists()


def test_the_command(tmp_path, capsys):
    with pytest.raises(SystemExit) as caught:
        cli.main(["export", str(DEMO), "--out", str(tmp_path / "o"), "--size", "16x9", "--frames", "0:2",
                  "--channels", "depth,motion", "--format", "npz"])  # fmt: skip
    assert caught.value.code == 0
    assert "2 frames written: depth, motion" in capsys.readouterr().out


def test_a_start_that_was_killed_locks_nobody_out(tmp_path):
    """What a killed writer of the manifest leaves is ours; anything else in a folder without one is not."""
    settings = Settings.of(width=WIDTH, height=HEIGHT, frames=(0, 1))
    out = tmp_path / "out"
    out.mkdir()
    (out / f".{MANIFEST}.123-0.partial").write_text("half")
    assert export_scene(DEMO, out, settings, channels=FAST).written == 1
    other = tmp_path / "other"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    with pytest.raises(OutputError, match="holds other files"):
        export_scene(DEMO, other, settings, channels=FAST)
