"""The timeline above the frame slider: small images of the sequence, curves of the rates, a line at the frame."""

from __future__ import annotations

from imgui_bundle import ImVec2, ImVec4, imgui

from taubench_gl.report.palette import color_of
from taubench_gl.viewer.state import OVERLAYS, ViewerState
from taubench_gl.viewer.timeline import Timeline
from taubench_gl.viewer.widgets import Widgets, bar

HEIGHT = 44.0
"""Of the timeline, screen points."""
HEADROOM = 1.15
"""The largest share of a discard is this much below the upper edge."""
RATE_COLOR = (1.0, 1.0, 1.0, 0.95)


def draw_timeline(ui: Widgets, timeline: Timeline) -> None:
    """Small images, curves of the masks that are shown and of the reuse rate (white), a line at the frame.

    A click goes to a frame; the mouse over it names its rates.
    """
    s = ui.viewer.state
    corner, width = imgui.get_cursor_screen_pos(), max(imgui.get_content_region_avail().x, 40.0)
    imgui.image(imgui.ImTextureRef(timeline.texture.glo), ImVec2(width, HEIGHT))
    bar(corner.x, corner.y, width, HEIGHT, (0.0, 0.0, 0.0, 0.55))
    imgui.set_cursor_screen_pos(corner)
    imgui.invisible_button("##timeline", ImVec2(width, HEIGHT))
    ui.place("timeline")
    at = timeline.frame_at((imgui.get_mouse_pos().x - corner.x) / width)
    if imgui.is_item_active():
        s.playing = False
        s.go_to(at)
    elif imgui.is_item_hovered():
        imgui.set_tooltip(_words(timeline, s, at))

    def point(frame: int, share: float) -> ImVec2:
        return ImVec2(corner.x + timeline.place(frame) * width, corner.y + HEIGHT * (1.0 - share))

    for color, shares in _curves(timeline, s):
        drawn = imgui.get_color_u32(ImVec4(*color))
        for frame, share in shares.items():
            if frame + 1 in shares:
                ends = point(frame, share), point(frame + 1, shares[frame + 1])
                imgui.get_window_draw_list().add_line(*ends, drawn, 1.5)
    bar(point(s.frame, 1.0).x - 1.0, corner.y, 2.0, HEIGHT, (1.0, 0.85, 0.3))


def _curves(timeline: Timeline, s: ViewerState) -> list[tuple[tuple[float, ...], dict[int, float]]]:
    """Color and height (0 to 1) by frame of each curve; discards have the scale of the largest one."""
    rates = dict(sorted(timeline.rates.items()))
    names = [n for n in s.active_overlays() if n in OVERLAYS]
    shares = {n: {f: r.percent[n] for f, r in rates.items() if r.percent.get(n) is not None} for n in names}
    most = HEADROOM * max((p for by in shares.values() for p in by.values()), default=1.0) or 1.0
    curves = [
        ((*(c / 255.0 for c in color_of(OVERLAYS[n])), 1.0), {f: p / most for f, p in by.items()})
        for n, by in shares.items()
    ]
    return [*curves, (RATE_COLOR, {f: r.reusable / 100.0 for f, r in rates.items() if r.reusable is not None})]


def _words(timeline: Timeline, s: ViewerState, frame: int) -> str:
    rates = timeline.rates.get(frame)
    if rates is None:
        return f"frame {frame}: not shown yet"
    lines = [f"frame {frame}"]
    lines += [] if rates.reusable is None else [f"reusable {rates.reusable:.1f} % of surface pixels"]
    percent = {n: rates.percent.get(n) for n in s.active_overlays() if n in OVERLAYS}
    lines += [f"{n.replace('_', ' ')} {p:.2f} % of all pixels" for n, p in percent.items() if p is not None]
    return "\n".join([*lines, *(["light is coarse"] if rates.coarse else [])])
