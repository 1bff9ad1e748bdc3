"""One drawn frame, as the passes that follow the geometry pass need it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from taubench_gl.animation import FrameState, View
from taubench_gl.frame.casters import Casters
from taubench_gl.frame.materials import MaterialTable
from taubench_gl.frame.records import Placement
from taubench_gl.frame.scene_buffers import SceneBuffers
from taubench_gl.frame.targets import History, Targets
from taubench_gl.metrics.stochastic import LightCells

if TYPE_CHECKING:
    import moderngl


@dataclass(slots=True)
class FrameContext:
    """What a frame was drawn from, its channels, and what its passes hand on to each other."""

    state: FrameState
    view: View
    placement: Placement
    buffers: SceneBuffers
    materials: MaterialTable
    history: History
    before: tuple[FrameState, View, Placement] | None = None  # of the frame before, where a channel needs it
    number: int = 0  # of the frame, for shading that differs from frame to frame
    seed: int | None = None  # of the random numbers of light; None: that of the spec
    light_rows: np.ndarray | None = None  # LIGHT records of this frame
    exact_light: bool = False  # path-traced direct light of punctual lights has no noise at the camera's vertex
    light_grid: LightCells | None = None  # by whose cells path tracing chooses lights
    footprint: tuple[float, float] = (0.0, 0.0)  # ``pixel_footprint`` of the view, of path-traced light
    emitter_cells: int = 0  # row of ``light_cells`` at which those of emissive triangles begin
    casters: Casters | None = None
    tables: dict[str, Any] = field(default_factory=dict)  # textures and buffers that are no channels, by name

    @property
    def targets(self) -> Targets:
        """Render targets that this frame is drawn into."""
        return self.history.current

    @property
    def resources(self) -> Mapping[str, moderngl.Texture | moderngl.Buffer]:
        """Everything a pass may declare: channels, channels of the frame before as history_<name>, tables."""
        previous = self.history.previous.textures
        return {**self.targets.textures, **{f"history_{n}": t for n, t in previous.items()}, **self.tables}
