"""The scenes of the paper that are there: datasets in the cache, else stand-ins, which are made."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from taubench_gl.benchmark.scenes import SceneRecipe, scene_file
from taubench_gl.datasets.registry import Entry, find_entry
from taubench_gl.datasets.scene_cache import CachedScene, registry_entries
from taubench_gl.datasets.stand_ins import FITTED, STAND_INS
from taubench_gl.errors import DatasetError, TaubenchError
from taubench_gl.report.paper import paper_numbers

DATASET, STAND_IN = "dataset", "stand-in"
CAMERA_FPS = 60.0
"""Rate of Tables 2 and 3, the paper's capture rate."""

RENDER_FPS = float(paper_numbers()["settings"]["render_fps"])
"""Rate of the paper's Table 4."""

Resolver = Callable[[str], tuple[str, dict[str, Any]]]
"""Maps the name of a scene in the cache to an argument of ``load_scene`` and the settings of its registry entry."""


@dataclass(frozen=True, slots=True)
class PaperScene:
    """A scene of the paper that can be evaluated.

    ``fitted``: what a stand-in was made to have of the paper; empty for a dataset.
    """

    name: str  # of the registry
    row: str  # its row in the paper's tables
    kind: str  # DATASET or STAND_IN
    path: str  # argument of ``load_scene``
    settings: dict[str, Any]  # of its images (Table 4)
    camera_settings: dict[str, Any]  # of camera activity (Tables 2 and 3)
    fitted: frozenset[str] = frozenset()

    @property
    def label(self) -> str:
        return f"{self.row}, {self.kind}"


@dataclass(frozen=True, slots=True)
class AvailableScenes:
    """The scenes of the paper that can be evaluated; ``missing``: name of another one -> why it cannot, one line."""

    scenes: tuple[PaperScene, ...]
    missing: dict[str, str] = field(default_factory=dict)


def paper_entries(entries: dict[str, Entry] | None = None) -> dict[str, Entry]:
    """The registry's entries of the paper's scenes, by name.  Entries with other rows are left out."""
    entries = registry_entries() if entries is None else entries
    rows = {scene["name"] for scene in paper_numbers()["scenes"]}
    return {name: entry for name, entry in entries.items() if entry.paper in rows}


def find_scenes(names: Sequence[str], resolve: Resolver) -> AvailableScenes:
    """The scenes that ``names`` selects; none: all of the paper.

    A scene that is not in the cache has its stand-in, which is made.  Raises DatasetError for a scene of ``names`` that
    is not there, and for a name that is not of the paper.
    """
    entries = paper_entries()
    selected = list(dict.fromkeys(find_entry(entries, name)[0] for name in names))
    scenes: list[PaperScene] = []
    missing: dict[str, str] = {}
    for name in selected or entries:
        try:
            scenes.append(_find(name, entries[name], resolve))
        except TaubenchError as error:
            if selected:
                raise
            missing[name] = str(error).removeprefix(f"{name}: ")
    return AvailableScenes(tuple(scenes), missing)


def _find(name: str, entry: Entry, resolve: Resolver) -> PaperScene:
    row, activity = str(entry.paper), {"fps": CAMERA_FPS} | entry.camera_settings()
    if CachedScene(name, entry).record() is not None:
        path, settings = resolve(f"scene:{name}")
        environment = {key: settings[key] for key in ("environment",) if key in settings}
        return PaperScene(name, row, DATASET, path, settings, activity | environment)
    if name not in STAND_INS:
        hint = f"taubench-gl scenes get {name} --from FILE"
        raise DatasetError("is not in the cache and has no stand-in", where=name, hint=hint)
    rates = {"fps": entry.fps} if entry.fps is not None else {}
    return PaperScene(name, row, STAND_IN, str(scene_file(SceneRecipe(name))), rates, {"fps": activity["fps"]}, FITTED)
