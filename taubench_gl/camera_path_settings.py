"""Settings of a recorded camera: its file, what the file leaves open, and the place of its path in the scene."""

from __future__ import annotations

from dataclasses import dataclass

from taubench_gl.fields import Checked, above_zero, one_of, setting

AXES = {"opengl": "x y z", "optical": "x -y -z", "body": "-y z -x", "unity": "x y -z", "unreal": "y z -x"}
"""Conventions of a camera's axes: those that point right, up and backward."""

START, WORLD, NODE = "start", "world", "node:"
"""Values of ``camera_path_place``; the last is followed by the name of a node."""


@dataclass(frozen=True, slots=True)
class CameraPathSettings(Checked):
    """A recorded camera: its file, what the file leaves open, and the place of its path.  Raises SettingsError."""

    camera_path: str | None = setting(
        None,
        "Play a recorded camera instead of that of the scene: TUM, KITTI, EuRoC, COLMAP images.txt, transforms.json, "
        "nerfstudio, Open3D, .chan, WebXR (iwer) or CSV (docs/camera-paths.md)",
        selects=True,
        metavar="FILE",
    )
    camera_path_axes: str | None = setting(
        None,
        "Axes of the camera in the file.  opengl: x right, y up, z backward.  optical: x right, y down, z forward.  "
        "body: x forward, y left, z up.  unity, unreal: of these engines, left-handed",
        one_of(AXES),
        selects=True,
        shown="those of the format; CSV needs it",
    )
    camera_path_up: str | None = setting(
        None,
        "Axis of the file's world that points up",
        one_of(("+x", "-x", "+y", "-y", "+z", "-z")),
        selects=True,
        shown="that of the format; TUM, COLMAP, Open3D, .chan and CSV need it",
    )
    camera_path_fps: float | None = setting(
        None,
        "Samples per second of KITTI, COLMAP, transforms.json, Open3D, .chan; of CSV, units of its times per second",
        above_zero(),
        unit="1/s",
        selects=True,
    )
    camera_path_order: str | None = setting(
        None,
        "Order of angles of .chan and CSV: their axes, the first to turn first, such as ZXY; or the columns of heading "
        "(left), pitch (up) and roll (counterclockwise), such as yaw,-pitch,roll",
        selects=True,
        metavar="ORDER",
    )
    camera_path_body: str | None = setting(
        None,
        "Pose of the camera in EuRoC's body, T_BS: sensor.yaml, or 16 numbers by rows",
        metavar="FILE|NUMBERS",
        selects=True,
    )
    camera_path_gaps: str = setting(
        "cut",
        "Where samples are missing for more than four steps.  cut: the camera waits, then jumps, and the pair is a "
        "cut.  hold: the same, without the cut.  slerp: it glides",
        one_of(("cut", "hold", "slerp")),
        selects=True,
    )
    camera_path_place: str = setting(
        START,
        "start: position and heading of the first pose go onto those of the scene's camera.  world: as in the file.  "
        "node:NAME: in the space of a node of the scene",
        selects=True,
        metavar="start|world|node:NAME",
    )
    camera_path_scale: float = setting(
        1.0, "Meters per unit of the file's positions", above_zero(), unit="m", selects=True
    )
    camera_path_speed: float = setting(1.0, "Factor on the speed of the recording", above_zero(), selects=True)
