"""Path-traced rungs: renders of the same frames at several samples per pixel, as reference and as points."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.cost.errors import KEPT, Channels
from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import Pair
from taubench_gl.pathtraced.cycles.render import CAMERA_FILE, PROVENANCE_FILE, read_render
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.sequence import PREFIX, PathTracedSequence
from taubench_gl.run import Run
from taubench_gl.settings import Settings


@dataclass(frozen=True, slots=True)
class Rung:
    """One folder of frames.  ``samples`` per pixel, ``seed``; ``crisp``: pixel centres alone."""

    folder: Path
    sequence: PathTracedSequence
    samples: int
    seed: int
    crisp: bool
    fps: float
    frame_ms: tuple[float, ...]  # render time of every frame that noted one
    clock: str

    @property
    def name(self) -> str:
        return f"{self.samples} spp, path-traced" + (f", seed {self.seed}" if self.seed else "")

    @property
    def options(self) -> PathTracedOptions:
        sidecar = self.folder / CAMERA_FILE
        return PathTracedOptions(camera_file=sidecar if sidecar.is_file() else None)


@dataclass(frozen=True, slots=True)
class Ladder:
    """``reference``: the most samples; ``second``: the same with another seed, for the noise floor, if there is one."""

    rungs: tuple[Rung, ...]
    reference: Rung
    second: Rung | None
    frames: range


def find_ladder(spec: str) -> Ladder:
    """Rungs in ``exr:DIR``: DIR itself if it holds frames, and each of its folders that does.

    Samples and times come from the provenance that 'reference render' writes.  Raises PathTracedError for none,
    for rungs of different sizes, or without common frames.
    """
    root = Path(spec.removeprefix(PREFIX))
    if not root.is_dir():
        raise PathTracedError("is no folder", where=str(root), hint="give exr:DIR, a render or a folder of renders")
    folders = [root, *sorted(p for p in root.iterdir() if p.is_dir())]
    rungs = [_rung(folder) for folder in folders if any(folder.glob("[!.]*.exr"))]
    if not rungs:
        raise PathTracedError("holds no renders", where=str(root), hint="'taubench-gl reference render' makes them")
    rungs.sort(key=lambda r: (r.samples, r.seed))
    sizes = {r.sequence.size for r in rungs}
    if len(sizes) > 1:
        raise PathTracedError("its renders have different sizes", where=str(root), hint="give renders of one size")
    common = set.intersection(*(set(r.sequence.frames) for r in rungs))
    if len(common) < 2:
        raise PathTracedError("its renders have no pair of frames in common", where=str(root))
    frames = range(min(common), max(common) + 1)
    if len(common) != len(frames):
        raise PathTracedError(
            "the frames its renders share have gaps", where=str(root), hint="render them: pairs need neighbours"
        )
    most = [r for r in rungs if r.samples == rungs[-1].samples]
    reference = most[0]
    second = most[1] if len(most) > 1 else None
    return Ladder(tuple(r for r in rungs if r is not second), reference, second, frames)


def _rung(folder: Path) -> Rung:
    sequence = PathTracedSequence.open(f"{PREFIX}{folder}")
    told = read_render(folder, sequence.frames)
    if told is None or not told.get("samples"):
        hint = "only renders by 'taubench-gl reference render' say how long they took and with how many samples"
        raise PathTracedError("does not say how it was rendered", where=str(folder), hint=hint)
    values = json.loads((folder / PROVENANCE_FILE).read_text(encoding="utf-8"))
    times = tuple(
        1e3 * float(s) for _, s in sorted((values.get("frame_seconds") or {}).items(), key=lambda kv: int(kv[0]))
    )
    fps = float((values.get("settings") or {}).get("fps") or Settings().sequence.fps)
    return Rung(
        folder, sequence, int(told["samples"]), int(told["seed"] or 0), bool(told["crisp"]), fps, times, told["clock"]
    )


def fitting(settings: Settings, ladder: Ladder) -> Settings:
    """``settings`` at the size, frames and rate of the renders, with the textures that pixel-centre renders show."""
    width, height = ladder.reference.sequence.size
    textures = "finest" if ladder.reference.crisp else settings.sequence.textures
    frames = (ladder.frames.start, ladder.frames.stop)
    return settings.replace(width=width, height=height, frames=frames, fps=ladder.reference.fps, textures=textures)


def path_traced_settings(settings: Settings) -> Settings:
    """Of a run over files: what only rendering knows stays at its default."""
    return settings.replace(pairs="all", samples_per_pixel=1, storage="float", summation="integer")


def run_rung(rung: Rung, settings: Settings, second: Rung | None = None) -> Run:
    """Masks and columns of one rung; ``second``: with its noise floor."""
    options = rung.options
    if second is not None:
        options = replace(options, second_seed=f"{PREFIX}{second.folder}")
    return evaluate_path_traced(f"{PREFIX}{rung.folder}", path_traced_settings(settings), options)


def rung_channels(rung: Rung, settings: Settings, frames: tuple[int, int]) -> dict[int, Channels]:
    """What ``errors.channels_of`` gives, from files."""
    kept: dict[int, Channels] = {}

    def keep(pair: Pair) -> None:
        arrays: dict[str, Any] = {n: pair.source.read(n) for n in KEPT if n in pair.source.channels}
        kept[pair.frame] = arrays | {"motion": pair.motion(), "camera_position": np.asarray(pair.view.position)}

    evaluate_path_traced(
        f"{PREFIX}{rung.folder}", path_traced_settings(settings).replace(frames=frames), rung.options, on_pair=keep
    )
    return kept


def floor_of(run: Run) -> Mapping[str, float | None]:
    """Column -> percent that noise alone discards, where the run was given a second seed."""
    return {c: (e or {}).get("mean_percent") for c, e in (run.summary.get("noise_floor") or {}).items()}
