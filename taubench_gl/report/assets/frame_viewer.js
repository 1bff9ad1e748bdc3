// The frame viewer of the run page: the frame with its reason masks, a slider over the frames, and comparisons with the
// reprojected history, the plain frame or another run.
const MODES = [
  ["masks", "Masks"],
  ["history", "Reprojected history"],
  ["plain", "Frame and masks"],
  ["runs", "Other run"],
];
const STRIPE = 4;

function makeViewer(box, state) {
  let run, images, at = 0, mode = "masks", opacity = 0.8, words = null, turn = 0;
  const shown = new Map();
  const stage = el("div", { class: "stage" });
  const base = el("canvas", { class: "base", role: "img" });
  const mask = el("canvas", { class: "mask", "aria-hidden": "true" });
  const tags = [el("span", { class: "tag left" }), el("span", { class: "tag right" })];
  const divider = makeDivider(stage, () => {
    paintBase(...drawn);
    if (mode === "plain") paintMask();
  });
  stage.append(base, mask, ...tags, divider);
  const scrubber = makeScrubber(go);
  const modes = el("div", { class: "modes", role: "group", "aria-label": "View" });
  const panel = el("div", { class: "panel" });
  const note = el("p", { class: "muted" });
  const percents = new Map();

  function load(set, index, part) {
    if (!set.load) set.load = imageLoader(90);
    const item = set.items[index];
    return set.load(part + item.n, item[part], `${part} of frame ${item.n}`);
  }

  function unpack(image, width, height) {
    const bytes = pixelsOf(image, width, height);
    const found = new Uint16Array(width * height);
    for (let i = 0; i < found.length; i++) found[i] = bytes[4 * i] | (bytes[4 * i + 1] << 8);
    return found;
  }

  function paintMask() {
    const { width, height } = images;
    mask.width = width;
    mask.height = height;
    const pen = mask.getContext("2d", { willReadFrequently: true });
    const pixels = pen.createImageData(width, height);
    const enabled = run.reasons.filter((r) => shown.get(r.name));
    const colors = enabled.map((r) => [1, 3, 5].map((k) => parseInt(r.color.slice(k, k + 2), 16)));
    const start = mode === "plain" ? Math.round(divider.at * width) : 0;
    const alpha = Math.round(255 * opacity);
    const hits = [];
    for (let y = 0; y < height && words; y++) {
      for (let x = start; x < width; x++) {
        const word = words[y * width + x];
        if (!word) continue;
        hits.length = 0;
        for (let k = 0; k < enabled.length; k++) if (word & enabled[k].bits) hits.push(k);
        if (!hits.length) continue;
        const color = colors[hits[Math.floor((x + y) / STRIPE) % hits.length]];
        pixels.data.set([color[0], color[1], color[2], alpha], 4 * (y * width + x));
      }
    }
    pen.putImageData(pixels, 0, 0);
    mask.style.display = mode === "history" || mode === "runs" ? "none" : "";
  }

  function otherRun() {
    return state.runs.find((r) => r !== run && r.images);
  }

  async function show() {
    const request = ++turn;
    const { width, height } = images;
    const item = images.items[at];
    const row = run.rows.frame.indexOf(item.n);
    const seconds = run.rows.time_s[row];
    const which = `frame ${item.n}` + (seconds === null || seconds === undefined ? "" : `, ${seconds.toFixed(3)} s`);
    const caption = item.n === images.worst ? `${which} · worst frame` : which;
    scrubber.show(at, caption);
    for (const [name, cell] of percents) {
      const count = (run.rows[name] || [])[row];
      cell.textContent = count === null || count === undefined ? "–" : percent((100 * count) / run.rows.pixels[row]);
    }
    state.onFrame(item.n);
    const other = mode === "runs" ? otherRun() : null;
    const second = other && other.images;
    const nearest = second && second.items.reduce((best, it, i) =>
      Math.abs(it.n - item.n) < Math.abs(second.items[best].n - item.n) ? i : best, 0);
    const parts = await Promise.all([
      load(images, at, "frame"), load(images, at, "mask"),
      mode === "history" ? load(images, at, "previous") : second ? load(second, nearest, "frame") : null,
    ]);
    if (request !== turn) return;
    words = unpack(parts[1], width, height);
    stage.style.aspectRatio = `${width} / ${height}`;
    base.width = width;
    base.height = height;
    base.setAttribute("aria-label", `${run.label}, ${which}`);
    paintBase(parts[0], parts[2]);
    paintMask();
    const names = { history: ["reprojected history", "current frame"], plain: ["frame", "masks"],
      runs: [other ? `${other.label}, frame ${second.items[nearest].n}` : "", run.label] }[mode] || ["", ""];
    tags.forEach((tag, i) => { tag.textContent = names[i]; tag.hidden = !names[i]; });
    divider.hidden = mode === "masks";
    stage.dataset.frame = item.n;
    for (const next of [at + 1, at - 1]) if (images.items[next]) load(images, next, "frame");
  }

  let drawn = [null, null];
  function paintBase(image, before) {
    drawn = [image, before];
    const pen = base.getContext("2d");
    const { width, height } = images;
    pen.filter = mode === "masks" ? "saturate(.35)" : "none";
    pen.drawImage(image, 0, 0, width, height);
    if (before) {
      pen.save();
      pen.beginPath();
      pen.rect(0, 0, divider.at * width, height);
      pen.clip();
      pen.drawImage(before, 0, 0, width, height);
      pen.restore();
    }
  }

  function go(index) {
    at = clamp(index, 0, images.items.length - 1);
    return show();
  }
  function setMode(name) {
    mode = name;
    for (const button of modes.children) button.setAttribute("aria-pressed", button.dataset.mode === mode);
    return show();
  }

  function fillPanel() {
    panel.replaceChildren();
    percents.clear();
    for (const group of [...new Set(run.reasons.map((r) => r.group))]) {
      const set = el("fieldset", {}, el("legend", {}, el("span", {}, group), el("span", {}, "this frame, % of all pixels")));
      for (const r of run.reasons.filter((one) => one.group === group)) {
        if (!shown.has(r.name)) shown.set(r.name, r.on);
        const tick = el("input", { type: "checkbox", "data-reason": r.name });
        tick.checked = shown.get(r.name);
        tick.addEventListener("change", () => { shown.set(r.name, tick.checked); paintMask(); });
        const cell = el("span", { class: "pc" });
        percents.set(r.name, cell);
        const swatch = el("i", { class: "swatch" });
        swatch.style.background = r.color;
        set.append(el("label", { class: "reason", title: r.definition }, tick, swatch, el("span", {}, r.label), cell));
      }
      panel.append(set);
    }
    const range = el("input", { type: "range", min: "0", max: "100", value: Math.round(100 * opacity), "aria-label": "Mask opacity" });
    const number = el("output", {}, `${Math.round(100 * opacity)} %`);
    range.addEventListener("input", () => { opacity = range.value / 100; number.textContent = `${range.value} %`; paintMask(); });
    panel.append(el("div", { class: "opacity" }, el("span", {}, "opacity"), range, number));
  }

  function setRun(next) {
    run = next;
    images = run.images;
    scrubber.stop();
    if (!images) {
      box.replaceChildren(el("p", { class: "missing" }, run.no_images));
      return;
    }
    fillPanel();
    modes.replaceChildren(...MODES.filter(([name]) => name !== "runs" || otherRun()).map(([name, text]) =>
      el("button", { type: "button", "data-mode": name, "aria-pressed": name === mode, onclick: () => setMode(name) }, text)));
    if (mode === "runs" && !otherRun()) mode = "masks";
    scrubber.set(images.items.length);
    const worst = images.items.findIndex((item) => item.n === images.worst);
    at = Math.max(worst, 0);
    note.textContent = `${images.summary} A pixel with several reasons shows stripes in the color of each.`;
    box.replaceChildren(modes, el("div", { class: "viewer" },
      el("div", {}, stage, scrubber.bar, note), panel));
    setMode(mode);
  }

  return {
    setRun,
    goTo(frame) {
      if (!images) return;
      go(images.items.reduce((best, it, i) => Math.abs(it.n - frame) < Math.abs(images.items[best].n - frame) ? i : best, 0));
    },
  };
}
