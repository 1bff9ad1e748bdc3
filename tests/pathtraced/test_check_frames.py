"""The check of frames of other programs that it once got wrong (``reports4``), and the mapping that it writes."""

from __future__ import annotations

import json

import numpy as np
import pytest

from taubench_gl.export.run import ExportOptions, export_scene
from taubench_gl.paths import ASSETS
from taubench_gl.pathtraced.check import Check
from taubench_gl.pathtraced.exr import read_exr, write_exr
from taubench_gl.pathtraced.passes import ChannelIndex, ChannelNames, MotionMap, PassMap, load_mapping
from taubench_gl.pathtraced.readings import Reading
from taubench_gl.pathtraced.write_mapping import guess_passes, write_found
from taubench_gl.settings import Settings


@pytest.fixture
def run(taubench):
    """Runs ``check --json`` -> exit code, summary."""

    def call(*arguments):
        code, out, _ = taubench("check", *arguments, "--json")
        return code, json.loads(out)

    return call


STILL, MOVING, SKY = "still surfaces", "moving surfaces", "sky"
RIGHT = {  # set -> mapping, camera, exit code, wrong conventions, answers of the classes
    "engine/ok": ("engine/my.toml", "", 3, set(), {STILL: "right", MOVING: "not judged", SKY: "absent"}),
    "engine/camonly": ("engine/my.toml", "", 3, set(), {STILL: "right", MOVING: "not judged", SKY: "absent"}),
    "frames/2_zero_motion": (None, "", 1, set(), {STILL: "wrong", MOVING: "not judged", SKY: "absent"}),
    "frames/4_first_motion_nan": (None, "", 1, {"depth"}, {STILL: "right", MOVING: "not judged", SKY: "right"}),
    "frames/5_filtered": ("mitsuba", "", 0, set(), {}),
    "frames/5_truth": ("mitsuba", "", 0, set(), {}),
    "frames2/1_eevee45_sky": ("eevee", "", 3, set(), {STILL: "right", MOVING: "not judged", SKY: "right"}),
    "frames2/2_eevee_half_positions": ("eevee", "", 3, set(), {STILL: "right", MOVING: "not judged", SKY: "right"}),
    "frames2/3_check_right_files_blamed": (None, "", 3, set(), {STILL: "right", MOVING: "not judged", SKY: "right"}),
    "frames2/5_lux_row": ("frames2/luxcore.toml", "", 1, {"camera", "centers", "depth"}, {}),
    "frames2/5_lux_row ": ("luxcore", "", 0, set(), {}),
    "frames2/6_lux_infinite_positions": ("luxcore", "frames2/5_lux_row/camera.json", 0, set(), {}),
}  # fmt: skip


MOVING_PERCENT = {"engine/ok": (4, 6), "engine/camonly": (0, 0)}
OFF_CENTER = ("frames/5_filtered", "frames2/2_eevee_half_positions", "frames2/3_check_right_files_blamed")


@pytest.mark.parametrize("name", RIGHT)
def test_frames_of_real_programs(data, run, name):
    mapping, camera, code, wrong, classes = RIGHT[name]
    reports, folder = data / "reports4", data / "reports4" / name.strip()
    arguments = ["--camera-file", reports / camera if camera else folder / "camera.json"]
    if mapping is not None:
        arguments += ["--mapping", reports / mapping if ".toml" in mapping else mapping]
    ended, summary = run(f"exr:{folder}", *arguments)
    assert (ended, set(summary["wrong"])) == (code, wrong)
    assert {c["name"]: c["answer"] for c in summary["classes"]} == classes
    if name in MOVING_PERCENT:  # pixels that are not judged, of which the wrong vectors have none
        low, high = MOVING_PERCENT[name]
        assert low <= next(c["pixels"] for c in summary["classes"] if c["name"] == MOVING) <= high
    if name == "frames2/1_eevee45_sky":
        assert run(f"exr:{folder}", *arguments, "--allow-unjudged")[0] == 0
    notes = {v["convention"] for v in summary["verdicts"] if v["status"] == "note"}
    assert ("centers" in notes) == (name in OFF_CENTER)


def test_another_rate_is_named(data, run):
    folder = data / "reports4" / "frames" / "8_wrong_fps"
    for rate, code in (("30", 1), ("24", 0)):
        ended, summary = run(f"exr:{folder}", "--scene-file", folder / "scene.glb", "--fps", rate)
        assert ended == code and set(summary["wrong"]) == ({"camera"} if code else set())
    _, summary = run(f"exr:{folder}", "--scene-file", folder / "scene.glb", "--fps", "30")
    assert "--fps 24" in next(v["text"] for v in summary["verdicts"] if v["convention"] == "camera")


# A mapping for files that no preset knows
@pytest.fixture(scope="module")
def foreign(tmp_path_factory):
    """Frames as an engine could write them: rows from the bottom, clip space, current - previous, y up, centimeters."""
    made, out = tmp_path_factory.mktemp("export"), tmp_path_factory.mktemp("engine")
    settings = Settings(width=64, height=36, frames=(40, 44), light="raster")
    export_scene(ASSETS / "demo.glb", made, settings, ExportOptions("exr", ("position", "depth", "motion")))
    camera = json.loads((made / "camera.json").read_text())
    for n in range(40, 44):
        image = read_exr(made / f"frame_{n:05d}.exr")
        eye = np.array(camera["frames"][str(n)]["world_from_view"])[:3, 3]
        planes = {f"GBuffer.WorldPos.{c}": 100 * (image.plane(f"Position.{c}") + eye[i]) for i, c in enumerate("XYZ")}
        sky = image.plane("Depth.V") == 0 if "Depth.V" in image.names else image.plane("Depth.Z") == 0
        planes = {name: np.where(sky, 0, values) for name, values in planes.items()}
        planes["Velocity.R"] = -2 / 64 * image.plane("Motion.X")
        planes["Velocity.G"] = 2 / 36 * image.plane("Motion.Y")
        write_exr(out / f"shot_{n:04d}.exr", {name: values[::-1].astype(np.float32) for name, values in planes.items()})
    (out / "camera.json").write_text(json.dumps(camera))
    return out


def test_a_mapping_is_written(foreign, tmp_path, run):
    """Two commands from foreign frames to all three answers, and the mapping holds what was found."""
    file = tmp_path / "engine.toml"
    code, summary = run(f"exr:{foreign}", "--camera-file", foreign / "camera.json", "--write-mapping", file)
    assert code == 3 and not summary["wrong"]
    mapping = load_mapping(file)
    assert (mapping.rows, mapping.up, mapping.positions) == ("bottom", "y", "world")
    assert mapping.meters == pytest.approx(0.01)
    motion = mapping.motion
    assert (motion.unit, motion.direction, motion.y, motion.zero) == ("ndc", "current-previous", "up", "0")
    code, summary = run(f"exr:{foreign}", "--scene-file", ASSETS / "demo.glb", "--mapping", file)
    assert code == 0 and {c["name"]: c["answer"] for c in summary["classes"]} == dict.fromkeys(
        (STILL, MOVING, SKY), "right"
    )
    again = tmp_path / "again.toml"
    assert (
        run(f"exr:{foreign}", "--camera-file", foreign / "camera.json", "--mapping", file, "--write-mapping", again)[0]
        == 3
    )
    assert load_mapping(again).motion == motion and load_mapping(again).passes == mapping.passes


def test_a_written_mapping_keeps_what_the_check_does_not_correct(tmp_path):
    motion = MotionMap(zero="0.5", jitter="included", encoding="cube-root", no_data=0.0)
    passes = {"motion": ChannelNames(("V.R", 'V."G"'))}
    mapping = PassMap(passes, name="m", principal_point=(0, 1), sky="normal", primaries="ap1", motion=motion)
    write_found(tmp_path / "m.toml", ChannelIndex(passes["motion"].channels, mapping), Check((), Reading()))
    assert load_mapping(tmp_path / "m.toml") == mapping


def test_passes_are_guessed_by_their_names():
    names = ("R", "G", "B", "A", "depth", "ViewLayer.prevWorldPosition.X", "ViewLayer.prevWorldPosition.Y",
             "ViewLayer.prevWorldPosition.Z", "pp.X", "pp.Y", "pp.Z", "nn.X", "nn.Y", "nn.Z", "MotionVectors.G",
             "MotionVectors.R", "Something.X", "Direct.R", "Direct.G", "Direct.B")  # fmt: skip
    assert guess_passes(names) == {
        "combined": ("R", "G", "B"), "depth": ("depth",), "position": ("pp.X", "pp.Y", "pp.Z"),
        "prev_position": tuple(f"ViewLayer.prevWorldPosition.{c}" for c in "XYZ"), "normal": ("nn.X", "nn.Y", "nn.Z"),
        "motion": ("MotionVectors.R", "MotionVectors.G"), "direct": ("Direct.R", "Direct.G", "Direct.B"),
    }  # fmt: skip
