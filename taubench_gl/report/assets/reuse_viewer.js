// The frame viewer of a reuse evaluation: two images or error maps, and a filter by pixel class with the mean error of
// each class.

const MAGMA = [
  [0, 0, 4], [20, 14, 54], [59, 15, 112], [100, 26, 128], [140, 41, 129], [183, 55, 121], [222, 73, 104], [247, 112, 92],
  [254, 159, 109], [254, 206, 145], [252, 253, 191],
];

// Color of an error of 0 .. 255.
function magma(value) {
  const at = (value / 255) * (MAGMA.length - 1), low = Math.min(Math.floor(at), MAGMA.length - 2);
  return MAGMA[low].map((channel, i) => channel + (at - low) * (MAGMA[low + 1][i] - channel));
}
const MAGMA_TABLE = Array.from({ length: 256 }, (_, value) => magma(value));

// `images`: of report/reuse_frames.py; `info`: {classes, error, milliseconds}; `onFrame(number)` after a frame is shown.
function makeComparison(box, images, info, onFrame) {
  const { width, height, names } = images;
  const load = imageLoader(160);
  const shown = new Set(info.classes.map((_, k) => k));
  const viewer = makeFrameViewer({ images: () => images, go, milliseconds: info.milliseconds });
  const { scrubber, zoom, layouts } = viewer, [{ stage, base }] = viewer.stages;
  scrubber.set(images.items.length);
  const sides = [1, names.length - 1].map((chosen, side) => {
    const select = el("select", { id: side ? "right" : "left" },
      ...names.map((name, i) => el("option", { value: i, selected: i === chosen }, name)));
    select.addEventListener("change", show);
    return select;
  });
  const modes = makeToggles("View", "mode", setMode, [["images", "Images"], ["errors", "Error maps"]]);
  const panel = el("div", { class: "panel" });
  const cells = [];
  let at = Math.max(images.items.findIndex((item) => item.n === images.worst), 0), mode = "images", turn = 0;

  function fillPanel() {
    const body = el("tbody");
    for (const [k, one] of [...info.classes.entries()].filter(([k]) => images.class_pixels.some((count) => count[k]))) {
      const tick = el("input", { type: "checkbox", "data-class": one.name, id: `class-${one.name}` });
      tick.checked = true;
      tick.addEventListener("change", () => { if (tick.checked) shown.add(k); else shown.delete(k); filtered(); });
      const row = [el("td"), el("td"), el("td")];
      cells.push({ k, tick, row });
      body.append(el("tr", { title: one.doc }, el("th", { scope: "row" }, el("label", {}, tick, ` ${one.label}`)), ...row));
    }
    const total = [el("td"), el("td"), el("td")];
    cells.push({ k: null, row: total });
    body.append(el("tr", { class: "total" }, el("th", { scope: "row" }, "shown pixels"), ...total));
    const set = (on) => () => {
      for (const cell of cells) if (cell.tick) { cell.tick.checked = on; if (on) shown.add(cell.k); else shown.delete(cell.k); }
      filtered();
    };
    panel.append(
      el("table", { class: "classes" }, el("caption", {}, `mean ${info.error} by pixel class, this frame`),
        el("thead", {}, el("tr", {}, ...["class", "% of pixels", "left", "right"].map((t) => el("th", { scope: "col" }, t)))), body),
      el("p", { class: "actions" }, el("button", { type: "button", onclick: set(true) }, "All classes"),
        el("button", { type: "button", onclick: set(false) }, "None")));
  }

  // The mean over the pixels of some classes of a frame, from the means and counts of the classes.
  function meanOf(name, frame, classes) {
    const row = images.every_frame.indexOf(frame), means = (images.class_errors[name] || [])[row], counts = images.class_pixels[row];
    if (!means) return null;
    let sum = 0, pixels = 0;
    for (const k of classes) if (counts[k]) { sum += means[k] * counts[k]; pixels += counts[k]; }
    return pixels ? sum / pixels : null;
  }

  function fillCells() {
    const frame = images.items[at].n, counts = images.class_pixels[images.every_frame.indexOf(frame)];
    const all = counts.reduce((a, b) => a + b, 0);
    for (const { k, row } of cells) {
      const classes = k === null ? [...shown] : [k];
      row[0].textContent = percent((100 * classes.reduce((sum, c) => sum + counts[c], 0)) / all);
      sides.forEach((side, i) => { row[i + 1].textContent = short(meanOf(names[side.value], frame, classes)); });
    }
  }

  function filtered() {
    fillCells();
    show();
    onFilter();
  }

  // One layer as pixels: an image, or an error map in colors; pixels of classes that are not shown are darkened.
  function layerOf(image, classes, isError) {
    const out = new ImageData(width, height);
    if (image) out.data.set(pixelsOf(image, width, height));
    const { data } = out;
    for (let i = 0; i < width * height; i++) {
      const p = 4 * i;
      const color = isError && image ? MAGMA_TABLE[data[p]] : [data[p], data[p + 1], data[p + 2]];
      const factor = shown.has(classes[p]) ? 1 : 0.15;
      for (let c = 0; c < 3; c++) data[p + c] = factor * color[c];
      data[p + 3] = 255;
    }
    return createImageBitmap(out);
  }

  async function show() {
    const request = ++turn;
    const item = images.items[at], isError = mode === "errors";
    const chosen = sides.map((side) => Number(side.value));
    const wanted = chosen.map((i) => (isError ? item.errors : item.images)[i]);
    const [classes, ...loaded] = await Promise.all([
      load(`classes${item.n}`, item.classes, `classes of frame ${item.n}`),
      ...wanted.map((uri, k) => uri && load(`${mode}${chosen[k]}-${item.n}`, uri, `image of frame ${item.n}`)),
    ]);
    if (request !== turn) return;
    const index = pixelsOf(classes, width, height);
    const made = await Promise.all(loaded.map((image) => layerOf(image, index, isError)));
    if (request !== turn) return;
    const [left, right] = made.map((image, k) => {
      const none = wanted[k] ? "" : isError ? " (no error map)" : " (no image)";
      return { image, plain: true, label: names[chosen[k]] + none };
    });
    viewer.show(right, left);
    scrubber.show(at, `frame ${item.n}${item.n === images.worst ? " · worst frame" : ""}`);
    base.setAttribute("aria-label", `${names[chosen[0]]} and ${names[chosen[1]]}, ${isError ? "error maps" : "images"}, frame ${item.n}`);
    stage.dataset.frame = item.n;
    stage.dataset.mode = mode;
    fillCells();
    onFrame(item.n);
  }

  function setMode(name) {
    mode = name;
    modes.press(mode);
    return show();
  }

  function go(index) {
    at = clamp(index, 0, images.items.length - 1);
    return show();
  }

  let onFilter = () => {};
  fillPanel();
  box.replaceChildren(
    el("div", { class: "sides" }, modes.box, el("label", {}, "left ", sides[0]), el("label", {}, "right ", sides[1]), layouts, zoom.controls),
    el("div", { class: "viewer" }, el("div", { class: "left" }, viewer.pair, scrubber.bar, el("p", { class: "muted" }, info.text)), panel));
  setMode("images");
  return {
    goTo(frame) {
      go(nearestItem(images, frame));
    },
    // Mean error over the classes shown, of a method in every frame of `frames`.
    values: (name, frames) => frames.map((frame) => meanOf(name, frame, shown)),
    whenFiltered(run) { onFilter = run; },
  };
}
