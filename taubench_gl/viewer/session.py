"""One sitting: a window, a viewer in it, and a person, a script or a benchmark that drives it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from taubench_gl.viewer import prefs
from taubench_gl.viewer.app import Viewer
from taubench_gl.viewer.layout import BAR, SIDE, start_size
from taubench_gl.viewer.opening import Asked
from taubench_gl.viewer.script import ScriptRunner, parse
from taubench_gl.viewer.window import Window


@dataclass(frozen=True, slots=True)
class Session:
    """``folder``: where prefs are kept, None for nowhere; ``window``: size in screen points, None for a fitting one."""

    asked: Asked
    light: bool | None = None
    window: tuple[int, int] | None = None
    shots: Path = Path(".")
    script: Path | None = None
    bench: int | None = None
    folder: Path | None = None
    say: Callable[[str], None] = print


def run_session(session: Session) -> None:
    """Until the person, the script or the benchmark is done.  Raises TaubenchError."""
    lines = parse(session.script) if session.script is not None else None
    automatic = lines is not None or session.bench is not None
    kept = prefs.load(session.folder)[0].window if session.folder is not None else None
    settings = session.asked.settings
    picture = (settings.sequence.width, settings.sequence.height)
    exact = (picture[0] + SIDE, picture[1] + BAR)  # scripts and benchmarks count on a window that fits the picture
    size = session.window or kept or (exact if automatic else start_size(picture))
    window = Window(size, vsync=not automatic)
    viewer = None
    try:
        with window.gpu:
            viewer = Viewer(window.gpu, session.asked, light=session.light, folder=session.folder)
            viewer.shots = session.shots
            window.attach(viewer)
            if session.bench is not None:
                rate = viewer.bench(session.bench, lambda: window.present(viewer))
                width, height = viewer.engine.feed.size
                session.say(
                    f"{rate:.1f} frames/s at {width}x{height}, median of {session.bench}, {window.gpu.renderer}"
                )
            elif lines is not None:
                ScriptRunner(viewer, lambda: window.step(viewer), window.resize, session.say).run(lines)
            else:
                window.run(viewer)
            window.gpu.check("the viewer")
    finally:
        with window.gpu:
            if viewer is not None:
                viewer.close()
        window.close()
