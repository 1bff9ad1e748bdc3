// The frame viewer of the run page: the frame with its reason masks, comparisons with the reprojected history, the plain
// frame or another run, sliders of the thresholds and a pixel probe.
const MODES = [
  ["masks", "Masks"],
  ["history", "Reprojected history"],
  ["plain", "Frame and masks"],
  ["runs", "Other run"],
];
const STRIPE = 4;

function makeViewer(box, state) {
  let run, images, at = 0, mode = "masks", other = null, opacity = 0.8, turn = 0;
  let pixel = null, pinned = false, choice = null;
  const shown = new Map();
  const viewer = makeFrameViewer({ images: () => images, go, redrawn: placeCross, point });
  const { stages, pair, scrubber, zoom, layouts } = viewer;
  const [{ stage, base }] = stages;
  const modes = makeToggles("View", "mode", setMode);
  const panel = el("div", { class: "panel" });
  const note = el("p", { class: "muted" });
  const fault = el("p", { class: "missing", role: "status", hidden: true });
  const probe = makeProbe(state);
  const cells = new Map(); // reason -> the cell of its share
  const heading = el("span", {});

  // The layers of the stage: what is shown of one frame of one run.  {run, image, words, item, label}
  let front = null, back = null;

  // The frame `index` of a run with its reason words, and its distances where they are stored and not damaged.
  async function layer(of, index) {
    const set = of.images, { width, height } = set, item = set.items[index];
    const [image, { words: recorded, codes }] = await Promise.all([framePart(set, index, "frame"), storedFrame(set, index, state.bits)]);
    return redo({ run: of, image, recorded, codes, item, damaged: set.planes && !codes, tint: new OffscreenCanvas(width, height) });
  }

  // The words of a layer at the thresholds of the page.
  function redo(one) {
    const { run: of, codes, recorded } = one;
    const moved = codes && of.moved();
    const live = moved ? wordsAt(recorded, codes, of.images.planes, of.at, state.bits) : { words: recorded, unknown: 0 };
    Object.assign(one, live, { moved: Boolean(moved) });
    tint(one);
    return one;
  }

  // Whether a reason word has a reason; sky has none that stands for a rate.
  function has(word, reason) {
    return word & reason.bits && !(reason.of && word & state.bits.sky);
  }

  function tint({ run: of, words, tint: canvas }) {
    const { width, height } = of.images;
    const pen = canvas.getContext("2d");
    const pixels = pen.createImageData(width, height);
    const target = new Uint32Array(pixels.data.buffer);
    const enabled = of.reasons.filter((r) => shown.get(r.name));
    const alpha = Math.round(255 * opacity);
    const colors = enabled.map((r) => {
      const bytes = new Uint8Array([1, 3, 5].map((k) => parseInt(r.color.slice(k, k + 2), 16)).concat(alpha));
      return new Uint32Array(bytes.buffer)[0];
    });
    const any = enabled.reduce((sum, r) => sum | r.bits, 0);
    const hits = [];
    for (let y = 0, i = 0; y < height; y++) {
      for (let x = 0; x < width; x++, i++) {
        const word = words[i];
        if (!(word & any)) continue;
        hits.length = 0;
        for (let k = 0; k < enabled.length; k++) if (has(word, enabled[k])) hits.push(k);
        if (hits.length) target[i] = colors[hits[Math.floor((x + y) / STRIPE) % hits.length]];
      }
    }
    pen.putImageData(pixels, 0, 0);
  }

  // The layer that the mode compares the frame with, or null.
  async function partner(current) {
    if (mode === "history") {
      return { ...current, image: await framePart(images, at, "previous"), plain: true, label: "reprojected history" };
    }
    if (mode === "plain") return { ...current, plain: true, label: "frame" };
    if (mode !== "runs") return null;
    const match = await layer(other, nearestItem(other.images, current.item.n));
    return { ...match, label: `${other.label}, frame ${match.item.n}` };
  }

  async function show() {
    const request = ++turn;
    const item = images.items[at];
    const seconds = run.rows.time_s[run.rows.frame.indexOf(item.n)];
    const which = `frame ${item.n}` + (seconds === null || seconds === undefined ? "" : `, ${seconds.toFixed(3)} s`);
    const caption = item.n === images.worst ? `${which} · worst frame` : which;
    scrubber.show(at, caption);
    state.onFrame(item.n);
    let current, second;
    try {
      current = await layer(run, at);
      second = await partner(current);
    } catch (error) {
      if (request === turn) { fault.textContent = `${error.message}.`; fault.hidden = false; }
      return;
    }
    if (request !== turn) return;
    current.label = { history: "current frame", plain: "masks", runs: run.label }[mode] || "";
    if (mode === "history") current.plain = true;
    [front, back] = [current, second];
    fault.hidden = !current.damaged;
    fault.textContent = `The distances of frame ${item.n} are damaged, or the browser changes image data: its masks stay at the thresholds of the run.`;
    base.setAttribute("aria-label", `${run.label}, ${which}`);
    stage.setAttribute("aria-label", "Image: arrow keys move the probe, plus and minus zoom, Escape releases the probe");
    viewer.show(...(back ? [front, back] : [front]));
    count();
    read();
    stage.dataset.frame = item.n;
    for (const next of [at + 1, at - 1]) if (images.items[next]) framePart(images, next, "frame");
  }

  // The shares of the frame in the panel: recorded ones at the thresholds of the run, else those of the words shown.
  function count() {
    const row = run.rows.frame.indexOf(front.item.n);
    const words = front.moved ? countWords(front.words) : null;
    for (const r of run.reasons) {
      const cell = cells.get(r.name);
      let pixels = (run.rows[r.name] || [])[row], all = run.rows.pixels[row];
      if (r.of && pixels !== undefined && pixels !== null) pixels = all - run.rows.sky[row] - pixels;
      if (words) [pixels, all] = [r.bits & front.unknown && !r.of ? null : pixelsWith(words, (word) => has(word, r)), front.words.length];
      const known = pixels !== null && pixels !== undefined;
      cell.textContent = known ? percent((100 * pixels) / all) : "–";
      cell.dataset.count = known ? pixels : "";
    }
    heading.textContent = front.moved ? "at these thresholds" : "this frame, % of all pixels";
    panel.classList.toggle("live", front.moved);
  }

  // ---- the probe

  function point(x, y, fixed) {
    if (!front || (pinned && !fixed)) return;
    pinned = fixed && !(pinned && pixel && pixel.x === x && pixel.y === y);
    pixel = { x, y };
    read();
  }

  function read() {
    if (pixel && front) {
      pixel = { x: clamp(pixel.x, 0, images.width - 1), y: clamp(pixel.y, 0, images.height - 1) };
      pixel.index = pixel.y * images.width + pixel.x;
      pixel.word = front.words[pixel.index];
      pixel.codes = front.codes;
    }
    probe.show(front && pixel, run, run.at);
    placeCross();
    state.onPixel(front && pixel);
  }

  function placeCross() {
    for (const one of stages) {
      one.cross.hidden = !pixel;
      one.cross.classList.toggle("pinned", pinned);
      if (pixel) for (const [name, value] of Object.entries(zoom.place(pixel.x, pixel.y))) one.cross.style[name] = `${value}%`;
    }
  }

  stage.addEventListener("keydown", (event) => {
    if (event.target !== stage || !front) return;
    const step = event.shiftKey ? 10 : 1;
    const by = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, -step], ArrowDown: [0, step] }[event.key];
    if (by) {
      event.preventDefault();
      const { width, height } = images;
      const [x, y] = pixel ? [pixel.x + by[0], pixel.y + by[1]] : [width >> 1, height >> 1];
      pixel = { x: clamp(x, 0, width - 1), y: clamp(y, 0, height - 1) };
      pinned = true;
      zoom.reveal(pixel.x, pixel.y);
      read();
    } else if (event.key === "Escape") {
      pinned = false;
      pixel = null;
      read();
    }
  });
  for (const one of stages) one.stage.addEventListener("pointerleave", () => { if (!pinned) { pixel = null; read(); } });

  // ---- controls

  function go(index) {
    at = clamp(index, 0, images.items.length - 1);
    return show();
  }
  function setMode(name) {
    mode = name;
    modes.press(mode);
    layouts.hidden = mode === "masks";
    if (choice) choice.hidden = mode !== "runs";
    return show();
  }
  function repaint() {
    if (front) { tint(front); if (back && !back.plain) tint(back); viewer.compose(); }
  }

  function fillPanel() {
    panel.replaceChildren();
    cells.clear();
    for (const group of [...new Set(run.reasons.map((r) => r.group))]) {
      const set = el("fieldset", {}, el("legend", {}, el("span", {}, group), cells.size ? null : heading));
      for (const r of run.reasons.filter((one) => one.group === group)) {
        if (!shown.has(r.name)) shown.set(r.name, r.on);
        const tick = el("input", { type: "checkbox", "data-reason": r.name });
        tick.checked = shown.get(r.name);
        tick.addEventListener("change", () => { shown.set(r.name, tick.checked); repaint(); });
        const cell = el("span", { class: "pc" });
        cells.set(r.name, cell);
        const swatch = el("i", { class: "swatch" });
        swatch.style.background = r.color;
        set.append(el("div", { class: "reason" }, el("label", {}, tick, swatch, el("span", {}, r.label)), tipButton(r.label, r.definition), cell));
      }
      panel.append(set);
    }
    const range = el("input", { type: "range", min: "0", max: "100", value: Math.round(100 * opacity), "aria-label": "Mask opacity" });
    const number = el("output", {}, `${Math.round(100 * opacity)} %`);
    range.addEventListener("input", () => { opacity = range.value / 100; number.textContent = `${range.value} %`; repaint(); });
    panel.append(el("div", { class: "opacity" }, el("span", {}, "opacity"), range, number));
  }

  function setRun(next) {
    run = next;
    images = run.images;
    front = back = pixel = null;
    pinned = false;
    viewer.clear();
    if (!images) {
      box.replaceChildren(el("p", { class: "missing" }, run.no_images));
      return;
    }
    fillPanel();
    const others = state.runs.filter((r) => r !== run && r.images);
    other = others.includes(other) ? other : others[0] || null;
    const usable = { masks: true, history: images.items[0].previous, plain: true, runs: other };
    if (!usable[mode]) mode = "masks";
    modes.fill(MODES.filter(([name]) => usable[name]));
    choice?.remove();
    choice = null;
    if (others.length > 1) {
      choice = el("select", { "aria-label": "Other run" }, ...others.map((r, i) => el("option", { value: i, selected: r === other }, r.label)));
      choice.addEventListener("change", () => { other = others[Number(choice.value)]; show(); });
      layouts.append(choice);
    }
    scrubber.set(images.items.length);
    at = Math.max(images.items.findIndex((item) => item.n === images.worst), 0);
    note.textContent = `${images.summary} A pixel with several reasons shows stripes in the color of each.`;
    box.replaceChildren(el("div", { class: "viewbar" }, modes.box, layouts, zoom.controls), el("div", { class: "viewer" },
      el("div", { class: "left" }, pair, scrubber.bar, fault, probe.box, note), panel));
    setMode(mode);
  }

  // Sliders of the thresholds, next to the image that they repaint.  `lines`: {name, stops, at, move(index)}.
  function setStops(lines) {
    for (const old of panel.querySelectorAll(".limit")) old.remove();
    for (const { name, stops, at: index, move } of lines) {
      const row = panel.querySelector(`[data-reason="${name}"]`)?.closest(".reason");
      if (!row) continue;
      const range = el("input", { type: "range", min: 0, max: stops.length - 1, value: index, "data-limit": name, "aria-label": `threshold of ${name}` });
      range.addEventListener("input", () => move(Number(range.value)));
      row.append(el("div", { class: "limit" }, range, el("output", {})));
    }
    for (const { name, at: index, move } of lines) move(index);
  }
  function showStop(name, index, words) {
    const range = panel.querySelector(`[data-limit="${name}"]`);
    if (!range) return;
    range.value = index;
    range.setAttribute("aria-valuetext", words);
    range.nextSibling.textContent = words.split(":")[0];
  }

  let queued = false;
  return {
    setRun, setStops, showStop, play: scrubber.play,
    goTo(frame) { if (images) go(nearestItem(images, frame)); },
    // The thresholds of the page changed: once per drawn frame, however often they do.
    thresholds() {
      if (queued || !front) return;
      queued = true;
      requestAnimationFrame(() => {
        queued = false;
        if (!front) return;
        redo(front);
        if (back) {
          if (back.run === run) Object.assign(back, { words: front.words }); else redo(back);
        }
        viewer.compose();
        count();
        read();
      });
    },
  };
}
