// The frame viewer of every page: one or two layers of a frame on a zoomable stage with a divider, side by side or in
// turn, and a slider over the frames that plays.
//
// A layer is {image, label, tint, plain}: a picture, its name where two are shown, the masks over it, and whether these
// are left out.

const LAYOUTS = [["wipe", "Wipe"], ["side", "Side by side"], ["flicker", "Flicker"]];
const FLICKER_MS = 700;

// A group of buttons of which one is pressed: {box, fill(list), press(name)}.  `list`: [[name, words]]; `choose(name)` on
// a click; each button has its name as data-`key`.
function makeToggles(label, key, choose, list = []) {
  const box = el("div", { class: "modes", role: "group", "aria-label": label });
  const press = (name) => {
    for (const button of box.querySelectorAll("button")) button.setAttribute("aria-pressed", button.dataset[key] === name);
  };
  const fill = (entries) => box.replaceChildren(...entries.map(([name, words]) =>
    el("button", { type: "button", [`data-${key}`]: name, onclick: () => choose(name) }, words)));
  fill(list);
  return { box, fill, press };
}

// The index of the item of a set of images that is nearest to a frame.
function nearestItem(set, frame) {
  return set.items.reduce((best, item, i) => (Math.abs(item.n - frame) < Math.abs(set.items[best].n - frame) ? i : best), 0);
}

// `images()`: {width, height, items, worst} of the images shown; `go(index)` shows one of its items; `milliseconds`:
// between frames while playing; `redrawn()` after a change of the view; `point(x, y, fixed)`: as `pick` of makeZoom.
function makeFrameViewer({ images, go, milliseconds, redrawn = () => {}, point = () => {} }) {
  let layout = "wipe", phase = 0, timer = 0, front = null, back = null;
  const stages = [0, 1].map((k) => {
    const stage = el("div", { class: "stage", tabindex: k ? "-1" : "0", role: "group" });
    const base = el("canvas", { class: "base", role: "img" }), mask = el("canvas", { class: "mask", "aria-hidden": "true" });
    const tags = [el("span", { class: "tag left", hidden: true }), el("span", { class: "tag right", hidden: true })];
    const cross = el("div", { class: "cross", hidden: true });
    stage.append(el("div", { class: "view" }, base, mask), cross, ...tags);
    return { stage, base, mask, tags, cross };
  });
  const divider = makeDivider(stages[0].stage, compose);
  stages[0].stage.append(divider);
  const pair = el("div", { class: "pair" }, ...stages.map((one) => one.stage));
  const scrubber = makeScrubber(go, milliseconds);
  const zoom = makeZoom(stages.map((one) => one.stage), images, () => { compose(); redrawn(); }, point);
  const layouts = makeToggles("Arrangement of the two images", "layout", setLayout, LAYOUTS);
  layouts.press(layout);

  // Draws the columns from `from` to `to` of a layer on a stage, all in pixels of the images.
  function draw(target, { image, tint, plain }, from, to) {
    const { width, height } = images();
    for (const [sheet, source] of [[target.base, image], [target.mask, plain ? null : tint]]) {
      if (!source || to <= from) continue;
      const pen = sheet.getContext("2d", { willReadFrequently: true });
      pen.imageSmoothingEnabled = sheet === target.base;
      pen.save();
      pen.beginPath();
      pen.rect(from, 0, to - from, height);
      pen.clip();
      pen.drawImage(source, 0, 0, width, height);
      pen.restore();
    }
  }

  function compose() {
    if (!front) return;
    const { width, height } = images();
    const split = back && layout === "side";
    stages.forEach((target) => {
      for (const canvas of [target.base, target.mask]) { canvas.width = width; canvas.height = height; }
      target.tags.forEach((tag) => { tag.hidden = true; });
    });
    const name = (target, side, words) => { target.tags[side].textContent = words; target.tags[side].hidden = false; };
    if (!back) {
      draw(stages[0], front, 0, width);
    } else if (split) {
      [back, front].forEach((one, k) => { draw(stages[k], one, 0, width); name(stages[k], 0, one.label); });
    } else if (layout === "flicker") {
      const one = phase ? back : front;
      draw(stages[0], one, 0, width);
      name(stages[0], 0, one.label);
    } else {
      const cut = Math.round(clamp(zoom.view.x + divider.at / zoom.view.scale, 0, 1) * width);
      draw(stages[0], back, 0, cut);
      draw(stages[0], front, cut, width);
      name(stages[0], 0, back.label);
      name(stages[0], 1, front.label);
    }
    stages[1].stage.hidden = !split;
    pair.classList.toggle("side", Boolean(split));
    divider.hidden = !back || layout !== "wipe";
  }

  function setLayout(name) {
    layout = name;
    phase = 0;
    layouts.press(layout);
    alternate();
    compose();
  }

  function alternate() {
    clearInterval(timer);
    if (back && layout === "flicker") timer = setInterval(() => { phase = 1 - phase; compose(); }, FLICKER_MS);
  }

  return {
    stages, pair, scrubber, zoom, layouts: layouts.box, compose,
    // Shows one or two layers, the second on the left of the divider.
    show(...layers) {
      const { width, height } = images();
      [front, back = null] = layers;
      for (const one of stages) one.stage.style.aspectRatio = `${width} / ${height}`;
      pair.style.setProperty("--ratio", width / height);
      zoom.apply();
      alternate();
    },
    // Shows nothing and stops what moves.
    clear() {
      front = back = null;
      clearInterval(timer);
      scrubber.stop();
    },
  };
}
