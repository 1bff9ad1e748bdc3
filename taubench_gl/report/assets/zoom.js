// Zoom and pan of images on stages that share one view: buttons, + and −, pinch, Ctrl with the wheel, drag.

const MOST_ZOOM = 64;

// `stages`: elements with a child `.view`; `pixels()`: {width, height} of the image; `changed()` after each change;
// `pick(x, y, fixed)`: the pointer is at this pixel, or (fixed) was clicked there.
function makeZoom(stages, pixels, changed, pick) {
  const view = { scale: 1, x: 0, y: 0 }; // the corner of the stage as a fraction of the image
  const fingers = new Map();
  let moved = 0, spread = 0;
  const number = el("output", {}, "100 %");
  const button = (label, words, action) => el("button", { type: "button", "aria-label": label, onclick: action }, words);

  function apply() {
    const room = 1 - 1 / view.scale;
    view.x = clamp(view.x, 0, room);
    view.y = clamp(view.y, 0, room);
    for (const stage of stages) {
      stage.querySelector(".view").style.transform = `scale(${view.scale}) translate(${-100 * view.x}%, ${-100 * view.y}%)`;
      const magnified = (view.scale * stage.clientWidth) / pixels().width > 2;
      stage.classList.toggle("magnified", magnified);
      stage.classList.toggle("zoomed", view.scale > 1);
    }
    number.textContent = `${Math.round(100 * view.scale)} %`;
    changed();
  }
  // Zooms and keeps what is at the fraction (u, v) of the stage in place.
  function zoomTo(scale, u = 0.5, v = 0.5) {
    const at = [view.x + u / view.scale, view.y + v / view.scale];
    view.scale = clamp(scale, 1, MOST_ZOOM);
    view.x = at[0] - u / view.scale;
    view.y = at[1] - v / view.scale;
    apply();
  }
  function within(stage, event) {
    const box = stage.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }
  function pixelAt(stage, event) {
    const [u, v] = within(stage, event), { width, height } = pixels();
    return [Math.floor((view.x + u / view.scale) * width), Math.floor((view.y + v / view.scale) * height)]
      .map((value, axis) => clamp(value, 0, (axis ? height : width) - 1));
  }

  for (const stage of stages) {
    const own = (event) => !event.target.closest(".divider");
    stage.addEventListener("wheel", (event) => {
      if (!event.ctrlKey) return;
      event.preventDefault();
      zoomTo(view.scale * Math.exp(-0.004 * clamp(event.deltaY, -100, 100)), ...within(stage, event));
    }, { passive: false });
    stage.addEventListener("pointerdown", (event) => {
      if (!own(event)) return;
      moved = 0;
      fingers.set(event.pointerId, event);
      spread = 0;
    });
    stage.addEventListener("pointermove", (event) => {
      const before = fingers.get(event.pointerId);
      if (before) {
        const box = stage.getBoundingClientRect();
        const dx = event.clientX - before.clientX, dy = event.clientY - before.clientY;
        moved += Math.hypot(dx, dy);
        fingers.set(event.pointerId, event);
        if (fingers.size === 2) {
          const [a, b] = fingers.values();
          const now = Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
          if (spread) zoomTo((view.scale * now) / spread, ...within(stage, { clientX: (a.clientX + b.clientX) / 2, clientY: (a.clientY + b.clientY) / 2 }));
          spread = now;
        } else if (moved > 5 && view.scale > 1) {
          if (!stage.hasPointerCapture(event.pointerId)) stage.setPointerCapture(event.pointerId);
          view.x -= dx / box.width / view.scale;
          view.y -= dy / box.height / view.scale;
          apply();
        }
      }
      if (event.pointerType === "mouse" && !event.buttons && own(event)) pick(...pixelAt(stage, event), false);
    });
    const up = (event) => { fingers.delete(event.pointerId); spread = 0; };
    stage.addEventListener("pointerup", up);
    stage.addEventListener("pointercancel", up);
    stage.addEventListener("pointerleave", (event) => { if (!stage.hasPointerCapture(event.pointerId)) up(event); });
    stage.addEventListener("click", (event) => { if (own(event) && moved <= 5) pick(...pixelAt(stage, event), true); });
    stage.addEventListener("dblclick", (event) => { if (own(event)) zoomTo(view.scale * 2, ...within(stage, event)); });
    stage.addEventListener("keydown", (event) => {
      if (!own(event) || event.ctrlKey || event.metaKey) return;
      const scale = { "+": 1.5 * view.scale, "=": 1.5 * view.scale, "-": view.scale / 1.5, 0: 1 }[event.key];
      if (scale === undefined) return;
      event.preventDefault();
      zoomTo(scale);
    });
  }
  return {
    view, apply, zoomTo,
    controls: el("div", { class: "zoom", role: "group", "aria-label": "Zoom" },
      button("Zoom out", "−", () => zoomTo(view.scale / 1.5)), number,
      button("Zoom in", "+", () => zoomTo(view.scale * 1.5)), button("Show the whole image", "Fit", () => zoomTo(1))),
    // Moves the view so that the pixel (x, y) is inside.
    reveal(x, y) {
      const { width, height } = pixels(), size = 1 / view.scale;
      const fit = (low, at) => (at < low + 0.05 * size || at > low + 0.95 * size ? at - size / 2 : low);
      view.x = fit(view.x, (x + 0.5) / width);
      view.y = fit(view.y, (y + 0.5) / height);
      apply();
    },
    // Position of the pixel (x, y) on a stage, in % of its size: {left, top, width, height}.
    place(x, y) {
      const { width, height } = pixels(), share = 100 * view.scale;
      return { left: (x / width - view.x) * share, top: (y / height - view.y) * share, width: share / width, height: share / height };
    },
  };
}
