"""Sample-count series: renders of the same frames at several samples per pixel, made by ``reference render``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from taubench_gl.errors import PathTracedError
from taubench_gl.evaluation import Observers, Pair
from taubench_gl.pathtraced.blender.render import read_render
from taubench_gl.pathtraced.cameras import CAMERA_FILE
from taubench_gl.pathtraced.evaluation import PathTracedOptions, evaluate_path_traced
from taubench_gl.pathtraced.sequence import PREFIX, PathTracedSequence
from taubench_gl.run import Run
from taubench_gl.settings import AUTO, Settings

Array = np.ndarray


@dataclass(frozen=True, slots=True)
class Render:
    """One folder of rendered frames."""

    folder: Path
    sequence: PathTracedSequence
    samples: int  # per pixel
    seed: int
    crisp: bool  # only pixel centers are sampled
    fps: float
    frame_ms: tuple[float, ...]  # recorded render times, in frame order
    clock: str
    lighting: Mapping[str, Any]  # light_unit and environment of the renders, where they are recorded

    @property
    def name(self) -> str:
        return f"{self.samples} spp, path-traced" + (f", seed {self.seed}" if self.seed else "")

    @property
    def options(self) -> PathTracedOptions:
        sidecar = self.folder / CAMERA_FILE
        return PathTracedOptions(camera_file=sidecar if sidecar.is_file() else None)

    def evaluate(self, settings: Settings, second: Render | None = None) -> Run:
        """Evaluate all frame pairs; ``second``: the same frames with another seed, for the noise floor."""
        options = self.options
        if second is not None:
            options = replace(options, second_seed=f"{PREFIX}{second.folder}")
        return evaluate_path_traced(f"{PREFIX}{self.folder}", _file_settings(settings), options)

    def light(self, settings: Settings, frame: int) -> dict[int, tuple[Array, Array]]:
        """Of ``frame`` and the one before: direct and indirect radiance, (h, w, 3) each; black where the files have
        none."""
        out: dict[int, tuple[Array, Array]] = {}

        def keep(pair: Pair) -> None:
            width, height = pair.source.size
            for previous in (False, True):
                images = (
                    pair.source.read(name, previous=previous)[..., :3].astype(np.float64)
                    if name in pair.source.channels
                    else np.zeros((height, width, 3))
                    for name in ("direct", "indirect")
                )
                out[pair.frame - previous] = tuple(images)

        settings = _file_settings(settings).replace(frames=(frame - 1, frame + 1))
        evaluate_path_traced(f"{PREFIX}{self.folder}", settings, self.options, Observers(on_pair=keep))
        return out


@dataclass(frozen=True, slots=True)
class SampleCountSeries:
    """Renders in order of their sample counts."""

    renders: tuple[Render, ...]
    reference: Render  # the most samples
    second: Render | None  # the reference with another seed; not in ``renders``
    frames: range  # in all renders

    def settings(self, settings: Settings) -> Settings:
        """``settings`` with the size, frames and frame rate of the files; crisp renders show unfiltered textures."""
        width, height = self.reference.sequence.size
        textures = "finest" if self.reference.crisp else settings.sequence.textures
        settings = settings.replace(**{n: v for n, v in self.reference.lighting.items() if settings.get(n) == AUTO})
        frames = (self.frames.start, self.frames.stop)
        return settings.replace(width=width, height=height, frames=frames, fps=self.reference.fps, textures=textures)


def find_series(spec: str) -> SampleCountSeries:
    """Renders in ``exr:DIR``: DIR itself if it holds frames, and each of its subfolders that does.

    Raises PathTracedError if there are none, if a render has no provenance by ``reference render``, or if the renders
    differ in size or have no common frames without gaps.
    """
    root = Path(spec.removeprefix(PREFIX))
    if not root.is_dir():
        raise PathTracedError("is no folder", where=str(root), hint="give exr:DIR, a render or a folder of renders")
    folders = [root, *sorted(p for p in root.iterdir() if p.is_dir())]
    renders = [_read(folder) for folder in folders if any(folder.glob("[!.]*.exr"))]
    if not renders:
        raise PathTracedError("holds no renders", where=str(root), hint="make them with 'taubench-gl reference render'")
    renders.sort(key=lambda r: (r.samples, r.seed))
    if len({r.sequence.size for r in renders}) > 1:
        raise PathTracedError("its renders have different sizes", where=str(root), hint="give renders of one size")
    common = set.intersection(*(set(r.sequence.frames) for r in renders))
    if len(common) < 2:
        raise PathTracedError("its renders have no pair of frames in common", where=str(root))
    frames = range(min(common), max(common) + 1)
    if len(common) != len(frames):
        hint = "render the missing frames: pairs need consecutive frames"
        raise PathTracedError("the common frames of its renders have gaps", where=str(root), hint=hint)
    reference, *others = [r for r in renders if r.samples == renders[-1].samples]
    second = others[0] if others else None
    return SampleCountSeries(tuple(r for r in renders if r is not second), reference, second, frames)


def _read(folder: Path) -> Render:
    sequence = PathTracedSequence.open(f"{PREFIX}{folder}")
    record = read_render(folder)
    if record is None or not record.samples:
        hint = "only 'taubench-gl reference render' records the sample count and the render times"
        raise PathTracedError("has no record of how it was rendered", where=str(folder), hint=hint)
    return Render(
        folder,
        sequence,
        record.samples,
        record.seed or 0,
        bool(record.crisp),
        float(record.fps or Settings().sequence.fps),
        tuple(1e3 * seconds for _, seconds in sorted(record.frame_seconds.items())),
        record.clock,
        {name: value for name, value in record.lighting.items() if value is not None},
    )


def _file_settings(settings: Settings) -> Settings:
    """Settings that apply to rendering only are reset to their defaults."""
    return settings.replace(pairs="all", samples_per_pixel=1, storage="float")
