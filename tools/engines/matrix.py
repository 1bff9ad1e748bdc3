"""Injects wrong conventions and wrong vectors into frames of real programs, and prints what the check says.

    python tools/engines/matrix.py camera|scene FOLDER SET=MAPPING ...

FOLDER holds the files of scene.py and a folder of EXR files for each SET.  An entry of the table: the *name* is that of
the fault, "not judged", "absent" (the files lack the pass), "-" where nothing changes by more than the tolerance (the
motion of the camera is even, or a camera file is needed), and in capitals what must not be: MISSED, OTHER NAME.
"""

import json
import sys
import tempfile
from functools import partial
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path += [str(ROOT), str(ROOT / "tests")]

from pathtraced.faults import INJECTED, MISTAKES, Corrupted, horizontal  # noqa: E402

from taubench_gl.option_groups import PathTracedOptions  # noqa: E402
from taubench_gl.pathtraced.cameras import SceneCamera, SidecarCamera  # noqa: E402
from taubench_gl.pathtraced.check import check_sequence  # noqa: E402
from taubench_gl.pathtraced.evaluation import plan_sequence  # noqa: E402
from taubench_gl.pathtraced.scene_truth import render_truth  # noqa: E402
from taubench_gl.settings import Settings  # noqa: E402

CAMERA_ONLY = {"matrix", "lens"}
FAULTS = {"object motion missing": {"still"}, "halved": {"half", "unit"}, "zero": {"zero"}, "random": {"random"},
          "one frame late": {"late", "order"}, "previous frame's camera": {"camera late", "order"},
          "constant": {"constant"}, "object motion halved": {"half"}}  # fmt: skip
"""Fault of vectors -> what names it: a fault of a class, or a convention."""


class Set:
    """Frames of one program with their camera, and with their scene."""

    def __init__(self, mode, folder, name, mapping):
        options = {"scene_file": folder / "scene.gltf"} if mode == "scene" else {"camera_file": folder / "camera.json"}
        plan = plan_sequence(f"exr:{folder / name}", Settings(), PathTracedOptions(mapping=mapping, **options))
        self.sequence, self.camera, self.scene = plan.sequence, plan.camera, mode == "scene"
        self.frames = {n: plan.sequence.read(n) for n in plan.sequence.frames}
        self.file = SidecarCamera(folder / "camera.json").file
        self.truth = None
        if self.scene:
            for n, frame in self.frames.items():
                plan.camera.place(n, frame)
            self.truth = partial(dict.fromkeys, ()) if not self.moves else self.rendered(plan.settings)

        check = self.check(self.frames)
        self.said, self.wrong = said(check), {v.convention for v in check.wrong} | faults(check)

    @property
    def moves(self):
        return next(iter(self.frames.values())).motion is not None

    def rendered(self, settings):
        truth = render_truth(self.camera, settings, self.frames)
        return lambda numbers: {n: truth[n] for n in numbers}

    def check(self, frames, matrices=None, yfov=None):
        camera = self.camera
        if matrices is not None and not self.scene:
            entries = {
                str(n): {"kind": "perspective", "yfov": yfov, "world_from_view": m.tolist()}
                for n, m in matrices.items()
            }
            with tempfile.NamedTemporaryFile("w", suffix=".json") as file:
                json.dump({"schema": "taubench-gl/camera/1", "frames": entries}, file)
                file.flush()
                camera = SidecarCamera(file.name)
        elif self.scene:
            camera = SceneCamera(self.camera.scene, self.camera.track, 24.0)
        return check_sequence(Corrupted(self.sequence, frames), camera, list(frames), 4, self.truth)


def convention(one, name):
    """What the check says of a wrong convention."""
    spoil, values = MISTAKES[name]
    keys = set(values)
    if name == "world":
        keys = {"positions"}
    if name == "from 0.5" and one.sequence.mapping.motion.unit != "px":
        keys = {"zero"}
    some = next(iter(one.frames.values()))
    if (keys & CAMERA_ONLY or name.startswith(("camera", "all"))) and one.scene:
        return "-"
    motion = keys & {"direction", "y", "unit", "zero", "components", "jitter"}
    needed = {"normals": some.normal, "depth": some.depth}
    if (motion and some.motion is None) or any(needed.get(key, "") is None for key in keys):
        return "absent"
    if name.startswith(("z", "y-left")) and name == one.sequence.mapping.up:
        return "-"
    yfov = some_view(one).camera.yfov
    matrices = {n: m for n, m in one.file.matrices.items()}
    frames = one.frames
    if spoil is None:
        yfov = horizontal(yfov, some.size)
    else:
        frames, matrices = spoil(frames, matrices, one.sequence.mapping)
    check = one.check(frames, matrices, yfov)
    found = {v.convention for v in check.wrong} - one.wrong
    shown = any(check[key].status == "not checked" for key in keys)
    if found and keys & found:
        return "named" if found == keys else "named, " + ", ".join(sorted(found - keys))
    if found | (faults(check) - one.wrong):
        return "OTHER NAME " + ", ".join(sorted(found | faults(check)))
    return "not judged" if shown or any(c.answer == "not judged" for c in check.classes) else "MISSED"


def some_view(one):
    return next(iter(one.file.views.values()))


def vectors(one, name):
    """What the check says of wrong vectors."""
    if not one.moves:
        return "absent"
    frames = INJECTED[name](one.frames, one.file.views)
    changed = [np.nanmax(np.linalg.norm(frames[n].motion - f.motion, axis=-1)[~f.sky]) for n, f in one.frames.items()]
    if np.median(changed) < 0.1:
        return "-"
    check = one.check(frames)
    found = ({v.convention for v in check.wrong} | faults(check)) - one.wrong
    if found & FAULTS[name]:
        return "named"
    if found:
        return "OTHER NAME " + ", ".join(sorted(found))
    return "not judged" if any(c.answer == "not judged" for c in check.classes) else "MISSED"


def main(mode, folder, *given):
    """Print the table."""
    sets = {name: Set(mode, Path(folder), name, mapping) for name, mapping in (each.split("=") for each in given)}
    print("|", " | ".join(["injected", *sets]), "|")
    print("|" + " --- |" * (1 + len(sets)))
    print("|", " | ".join(["nothing", *(one.said for one in sets.values())]), "|", flush=True)
    for name in MISTAKES:
        print("|", " | ".join([name, *(convention(one, name) for one in sets.values())]), "|", flush=True)
    for name in INJECTED:
        print("|", " | ".join([name, *(vectors(one, name) for one in sets.values())]), "|", flush=True)


def faults(check):
    return {c.fault or c.name for c in check.classes if c.answer == "wrong"}


def said(check):
    classes = [f"{c.name} {c.answer}" for c in check.classes if c.answer != "right"] or [check.answer]
    return "; ".join([*(f"{v.convention} wrong" for v in check.wrong), *classes])


if __name__ == "__main__":
    main(*sys.argv[1:])
