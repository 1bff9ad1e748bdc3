"""Benchmarks of light: many lights, indirect-light methods, and the cost of skipped effects."""

from __future__ import annotations

import dataclasses

import numpy as np
from benches import FPS, Options, Result, Row, bench, real_scene, row
from lamp_field import lamp_field

from taubench_gl.datasets.stand_ins import STAND_INS
from taubench_gl.effects.decide import FORCEABLE, decide
from taubench_gl.evaluation.owner import GpuOwner
from taubench_gl.frame.spec import AnimatedScene
from taubench_gl.gpu.context import Gpu
from taubench_gl.gpu.timing import PassTimer
from taubench_gl.paths import ASSETS
from taubench_gl.scene import load_scene
from taubench_gl.scene.model import Scene
from taubench_gl.settings import FIXED_LIGHTING, Settings

LIGHT_FRAMES = 2
"""Frames per round; few, because a frame with 690 lights without ranges takes seconds on llvmpipe."""


class Subject(GpuOwner):
    """A source with its own timer."""

    def __init__(self, gpu: Gpu, scene: Scene, settings: Settings, force: tuple[str, ...] = ()):
        super().__init__(gpu)
        self.timer, self._frame = PassTimer(gpu), 0
        self.source = self.open_source(AnimatedScene(scene), settings, force=force, timer=self.timer)

    def advance(self) -> None:
        with self.timer.measure("frame"):
            self.source.advance(self._frame % 7)
        self._frame += 1

    def samples(self, name: str) -> list[float]:
        """Milliseconds of all frames except the first, which includes compilation."""
        return self.timer.samples_ms()[name][1:].tolist()


@bench
def lights(gpu: Gpu, options: Options) -> Result:
    """Direct light of 690 point lights with culling, compared with 16 lights, interleaved."""
    settings = Settings(
        width=options.size[0],
        height=options.size[1],
        fps=FPS,
        columns=("frustum", "direct"),
        shadow_lights=0,
        **FIXED_LIGHTING,
    )
    scenes = {
        "16 lights": lamp_field(4, 12),
        "690 lights, range 2 m": lamp_field(reach=2.0),
        "690 lights, range 4 m": lamp_field(reach=4.0),
        "690 lights, range 8 m": lamp_field(reach=8.0),
        "690 lights, no range": lamp_field(),
    }
    subjects = {name: Subject(gpu, scene, settings) for name, scene in scenes.items()}
    for _ in range(1 + LIGHT_FRAMES * options.repeats):
        for subject in subjects.values():
            subject.advance()
    rows = [row(f"direct, {name}", subject.samples("direct")) for name, subject in subjects.items()]
    size = f"{settings.sequence.width}x{settings.sequence.height}"
    notes = [f"hilly ground of 40 x 40 m, {size}, light error {settings.lighting.light_error:g}"]
    for measured, (name, subject) in zip(rows, subjects.items(), strict=True):
        light = subject.source.light
        counts = light.tile_counts()
        if counts is None:
            continue
        ratio = measured.median_ms / rows[0].median_ms
        kept = counts[counts > 0]
        notes.append(
            f"{name}: {ratio:.2f} x the time of 16 lights; a tile keeps {kept.mean():.0f} on average, at most "
            f"{kept.max()}; light lists take {light.memory['light lists'] / 2**20:.1f} MiB"
        )
    for subject in subjects.values():
        subject.release()
    return Result("Many lights", rows, notes)


@bench
def valley(gpu: Gpu, options: Options) -> Result:
    """The stand-in's 690 lights (73 static, 617 moving) and its sun, compared with 16 lights, interleaved."""
    every = load_scene(STAND_INS["eternal-valley-fps"])
    light = np.full_like(every.nodes.light, -1)
    chosen = every.light_nodes[:: len(every.light_nodes) // 16][:16]
    light[chosen] = every.nodes.light[chosen]
    few = dataclasses.replace(every, nodes=dataclasses.replace(every.nodes, light=light))
    rows, notes = [], []
    for shadows in (0, 8):
        settings = Settings(
            width=options.size[0],
            height=options.size[1],
            fps=60,
            columns=("frustum", "direct"),
            shadow_lights=shadows,
            **FIXED_LIGHTING,
        )
        subjects = {name: Subject(gpu, scene, settings) for name, scene in (("16", few), ("690", every))}
        for _ in range(1 + LIGHT_FRAMES * options.repeats):
            for subject in subjects.values():
                subject.advance()
        for name, subject in subjects.items():
            rows.append(row(f"direct, {name} lights, {shadows} with shadows", subject.samples("direct")))
        notes.append(f"{shadows} with shadows: {rows[-1].median_ms / rows[-2].median_ms:.2f} x the time of 16 lights")
        notes.append(f"light lists take {subjects['690'].source.light.memory['light lists'] / 2**20:.1f} MiB")
        for subject in subjects.values():
            subject.release()
    return Result("The valley stand-in's lights", rows, notes)


@bench
def indirect(gpu: Gpu, options: Options) -> Result:
    """Frame time of each indirect-light method on the demo scene, in which lights and surfaces always move."""
    scene = load_scene(ASSETS / "demo.glb")
    subjects = {
        method: Subject(
            gpu,
            scene,
            Settings(width=options.size[0], height=options.size[1], fps=FPS, indirect=method, **FIXED_LIGHTING),
        )
        for method in ("none", "rsm", "probes")
    }
    for _ in range(1 + LIGHT_FRAMES * options.repeats):
        for subject in subjects.values():
            subject.advance()
    rows, notes = [], []
    base = float(np.median(subjects["none"].samples("frame")))
    for method, subject in subjects.items():
        samples = subject.samples("frame")
        rows.append(row(f"frame, indirect {method}", samples))
        if method != "none":
            rows.append(row(f"of it the indirect pass, {method}", subject.samples("indirect")))
        notes.append(f"indirect {method}: {float(np.median(samples)) / base:.2f} x a frame without indirect light")
        subject.release()
    return Result("Methods of indirect light, assets/demo.glb", rows, notes)


@bench
def effects(gpu: Gpu, options: Options) -> Result:
    """Per scene and skipped effect: frame time with this effect forced, minus frame time on demand."""
    settings = Settings(width=options.size[0], height=options.size[1], fps=FPS, **FIXED_LIGHTING)
    geometry = Settings(
        width=options.size[0], height=options.size[1], fps=FPS, columns=("frustum", "position"), **FIXED_LIGHTING
    )
    cases = [
        (real_scene(), settings, "all columns"),
        (real_scene("sponza/Sponza.gltf"), geometry, "frustum and position"),
        (real_scene("khronos/CesiumMan/CesiumMan.glb"), settings, "all columns"),
    ]
    rows: list[Row] = []
    notes = []
    for path, chosen, columns in cases:
        scene = load_scene(path)
        skipped = [name for name, effect in decide(scene, chosen).items() if not effect.enabled and name in FORCEABLE]
        for force in [*((name,) for name in skipped), tuple(skipped)]:
            if not force:
                continue
            what = force[0] if len(force) == 1 else "all of these"
            saved, extra = _saved(gpu, scene, chosen, force, options.repeats)
            rows.append(row(f"{path.stem} ({columns}): {what}", saved, f"{extra / 2**20:.1f} MiB"))
            notes.append(f"{path.stem}: skipping {what} saves {extra / 2**20:.1f} MiB")
    return Result("Milliseconds per frame saved by skipping effects", rows, notes)


def _saved(gpu: Gpu, scene: Scene, settings: Settings, force: tuple[str, ...], repeats: int) -> tuple[list[float], int]:
    """Differences in milliseconds per frame, and in bytes."""
    with Subject(gpu, scene, settings) as plain, Subject(gpu, scene, settings, force) as forced:
        pair = plain, forced
        for _ in range(1 + 2 * repeats):
            for subject in pair:
                subject.advance()
        times = [np.array(subject.samples("frame")) for subject in pair]
        memory = [subject.source.describe()["memory"]["gpu_bytes"] for subject in pair]
    return (times[1] - times[0]).tolist(), memory[1] - memory[0]
