// Discards by threshold: a curve per feature, and below them a track per feature with a slider.  A slider stops where the
// number of pixels is exact: at levels of the stored distances, else at edges of the recorded bins, and at the threshold
// of the run.

function makeCurves(box, state) {
  const TRACK = 34; // height of a track in pixels: sliders are large enough to touch and do not overlap
  const area = el("div");
  const table = el("table", { "aria-label": "Thresholds and discarded pixels" });
  const live = el("p", { class: "muted" });
  const reset = el("button", { type: "button" }, "Reset to the thresholds of the run");
  const side = el("div", {}, table, el("div", { class: "actions" }, reset), live);
  let run, lines = [], low = 1e-3, high = 1, x, y, all = 0, frame = null, pixel = null, marks = null, thin = null;

  function stopsOf(of, name) {
    const used = of.thresholds[name], planes = of.counts && of.images.planes;
    if (planes && planes.levels[name]) {
      const { values, home, kept } = planes.levels[name];
      const coarsest = Math.max(...of.images.items.map((item) => planes.steps[item.n]));
      return kept[coarsest].map((code) => ({
        t: code === home ? used : values[code - 1], code, used: code === home, value: (100 * of.counts.above(name, code)) / of.pixels }));
    }
    const { edges, above } = of.curves[name];
    const stops = edges.map((t, i) => ({ t, value: (100 * above[i]) / of.pixels }));
    if (used > 0) {
      stops.push({ t: used, value: of.discard[name].mean_percent, used: true });
      stops.sort((a, b) => a.t - b.t || (a.used ? 1 : -1));
    }
    return stops;
  }

  function prepare(of) {
    return state.features.filter((f) => of.curves[f]).map((name) => {
      const { edges, above } = of.curves[name];
      const stops = stopsOf(of, name);
      const home = stops.findIndex((s) => s.used);
      const chosen = stops.findIndex((s) => s.code !== undefined && s.code === of.at[name]);
      return { name, edges, percents: above.map((n) => (100 * n) / of.pixels), stops, home, at: chosen >= 0 ? chosen : Math.max(home, 0),
        used: of.thresholds[name], exact: of.discard[name].mean_percent };
    });
  }

  function range() {
    const starts = [1e-3], ends = [1];
    for (const line of lines) {
      const top = line.percents[0], foot = line.percents[line.percents.length - 1];
      const falling = line.percents.map((p, i) => [p, i]).filter(([p]) => Math.min(Math.abs(p - top), Math.abs(p - foot)) > 0.005 * top);
      if (falling.length) { starts.push(line.edges[falling[0][1]]); ends.push(line.edges[falling[falling.length - 1][1]]); }
      if (line.used) { starts.push(line.used); ends.push(line.used); }
    }
    low = Math.max(Math.min(...starts) / 1.5, Math.min(1e-4, ...lines.map((l) => (l.used || 1) / 1000)));
    high = Math.max(...ends) * 1.5;
  }

  function draw(width) {
    area.replaceChildren();
    if (!lines.length) {
      area.append(el("p", { class: "missing" }, "This run recorded no threshold curve: it has no frame pair or measured no feature."));
      return;
    }
    const left = 64, right = 14, top = 14, bottom = (width < 560 ? 240 : 320), tracks = bottom + 30;
    const height = tracks + TRACK * (lines.length + 1) + 6;
    x = logScale(low, high, left, width - right);
    const other = state.runs.filter((r) => r !== run).flatMap(prepare);
    const end = Math.max(1, ...[...lines, ...other].map((l) => Math.max(0, ...l.percents.filter((_, i) => l.edges[i] >= low)))) * 1.05;
    y = linearScale(0, end, bottom, top);
    const root = plotRoot(width, height, "Discarded pixels by threshold", "group");
    const decades = [];
    for (let p = Math.ceil(Math.log10(low)); p <= Math.log10(high); p++) decades.push(Math.pow(10, p));
    drawAxes(root, { left, right: width - right, top, bottom }, {
      x: { scale: x, ticks: decades, format: decade }, y: { scale: y, ticks: y.ticks(5), format: (value) => short(value) + " %", label: "discarded, % of all pixels" } });
    for (const [list, dim] of [[other, true], [lines, false]]) {
      for (const line of list) root.append(curve(line, line.edges, line.percents, dim ? "line other" : "line"));
    }
    root.append((thin = svg("g", {})), (marks = svg("g", {})));
    lines.forEach((line, i) => {
      const middle = tracks + TRACK * (i + 0.5);
      root.append(text(left - 10, middle + 4, line.name, { "text-anchor": "end" }), shape(line, middle + TRACK / 2 - 6, TRACK - 12));
      root.append(svg("line", { class: "track", x1: left, x2: width - right, y1: middle + TRACK / 2 - 6, y2: middle + TRACK / 2 - 6 }));
      line.y = middle;
      line.stem = svg("line", { class: "stem", stroke: ink(line.name), y2: middle });
      line.dot = svg("circle", { class: "point", r: 4.5, fill: ink(line.name) });
      if (line.home >= 0) root.append(svg("circle", { class: "used", cx: x(line.used), cy: y(line.exact), r: 4.5, stroke: ink(line.name) }), svg("circle", { class: "used", cx: x(line.used), cy: middle, r: 4.5, stroke: ink(line.name) }));
      root.append(line.stem, line.dot);
    });
    for (const line of lines) root.append((line.handle = handle(line)));
    root.append(text(left - 10, tracks + TRACK * (lines.length + 0.5) + 4, "all", { "text-anchor": "end" }), common(tracks + TRACK * (lines.length + 0.5)));
    area.append(root);
    lines.forEach(place);
    drawFrame();
    drawPixel();
  }

  function curve(line, ts, percents, kind) {
    const keep = ts.map((t) => t >= low && t <= high);
    const style = state.columns.find((c) => c.name === line.name).dash;
    return svg("path", { class: kind, stroke: ink(line.name), "stroke-dasharray": dashArray(style),
      d: linePath(ts.filter((_, i) => keep[i]).map(x), percents.filter((_, i) => keep[i]).map(y)) });
  }

  // The distribution of the distances: the root of the pixels per octave as height.
  function shape(line, foot, height) {
    const bins = line.percents.slice(0, -1).map((p, i) => [line.edges[i], line.edges[i + 1], Math.sqrt(Math.max(p - line.percents[i + 1], 0) / Math.log2(line.edges[i + 1] / line.edges[i]))])
      .filter(([a, b]) => b >= low && a <= high);
    const top = Math.max(1e-9, ...bins.map((bin) => bin[2]));
    const parts = bins.map(([a, b, n]) => `M${x(a).toFixed(1)} ${foot}V${(foot - (height * n) / top).toFixed(1)}H${x(b).toFixed(1)}V${foot}Z`);
    return svg("path", { class: "shape", fill: ink(line.name), d: parts.join("") });
  }

  // Thin: the curves of the frame in the viewer, or of the pair pointed at over time.
  function drawFrame() {
    if (!thin) return;
    thin.replaceChildren();
    const row = run.rows.frame.indexOf(frame);
    if (!run.counts || row < 0) return;
    for (const line of lines) {
      const stops = line.stops.filter((s) => s.code !== undefined);
      thin.append(curve(line, stops.map((s) => s.t), stops.map((s) => (100 * run.counts.above(line.name, s.code, row)) / run.rows.pixels[row]), "line thin"));
    }
  }

  // A mark on each track at the distance of the pixel under the probe.
  function drawPixel() {
    if (!marks) return;
    marks.replaceChildren();
    if (!pixel || !pixel.codes || pixel.word & state.bits.not_comparable) return;
    for (const line of lines) {
      const code = pixel.codes[line.name][pixel.index], { values } = run.images.planes.levels[line.name];
      const t = code === 0 ? values[0] : code === values.length ? values[code - 1] : Math.sqrt(values[code - 1] * values[code]);
      marks.append(svg("path", { class: "probed", "data-probed": line.name, d: markPath("diamond", x(t), line.y) }));
    }
  }

  // "0.001" to "1000", else "1e−4".
  function decade(value) {
    const power = Math.round(Math.log10(value));
    return Math.abs(power) <= 3 ? String(Number(value.toPrecision(1))) : `1e${power}`.replace("-", "−");
  }

  function handle(line) {
    const node = svg("g", { class: "handle", tabindex: 0, role: "slider", "data-feature": line.name,
      "aria-label": `threshold of ${line.name}`, "aria-valuemin": 0, "aria-valuemax": line.stops.length - 1 });
    node.append(svg("rect", { class: "hit", x: -22, y: -TRACK / 2, width: 44, height: TRACK }), svg("circle", { class: "dot", r: 9, fill: ink(line.name) }));
    slide(node, {
      drag: (event) => move(line, closest(line, thresholdAt(event))),
      step: (by) => move(line, line.at + by),
      end: (last) => move(line, last ? line.stops.length - 1 : 0),
    });
    return node;
  }

  // The triangle on the last track moves all dots to one threshold.
  function common(middle) {
    const node = svg("g", { class: "handle", tabindex: 0, role: "slider", "data-feature": "all", "aria-label": "threshold of all features",
      "aria-valuemin": 0, "aria-valuemax": lines[0].edges.length - 1 });
    node.append(svg("rect", { class: "hit", x: -22, y: -TRACK / 2, width: 44, height: TRACK }), svg("path", { d: "M0 -8 L9 8 L-9 8 Z" }));
    const edges = lines[0].edges;
    const set = (index) => {
      all = clamp(index, 0, edges.length - 1);
      for (const line of lines) move(line, closest(line, edges[all]), false);
      changed();
      put();
    };
    const put = () => {
      node.setAttribute("transform", `translate(${x(edges[all])} ${middle})`);
      node.setAttribute("aria-valuenow", all);
      node.setAttribute("aria-valuetext", `all at ${short(edges[all], 4)}`);
    };
    if (!all) all = edges.findIndex((t) => t >= (lines[0].used || 0.1));
    slide(node, {
      drag: (event) => {
        const t = thresholdAt(event);
        set(edges.reduce((best, e, i) => (Math.abs(Math.log(e / t)) < Math.abs(Math.log(edges[best] / t)) ? i : best), 0));
      },
      step: (by) => set(all + by),
      end: (last) => set(last ? edges.length - 1 : 0),
    });
    put();
    return node;
  }

  function thresholdAt(event) {
    return x.invert(event.clientX - area.getBoundingClientRect().left);
  }
  function closest(line, t) {
    return line.stops.reduce((best, s, i) => (Math.abs(Math.log(s.t / t)) < Math.abs(Math.log(line.stops[best].t / t)) ? i : best), 0);
  }

  function move(line, index, tell = true) {
    line.at = clamp(index, 0, line.stops.length - 1);
    place(line);
    if (line.stops[line.at].code !== undefined) {
      run.at[line.name] = line.stops[line.at].code;
      if (tell) changed();
    }
  }
  function changed() { if (run.counts) state.onThresholds(); }

  function place(line) {
    const stop = line.stops[line.at];
    if (line.handle) {
      const [px, py] = [x(stop.t), y(stop.value)];
      line.handle.setAttribute("transform", `translate(${px} ${line.y})`);
      line.handle.setAttribute("aria-valuenow", line.at);
      line.handle.setAttribute("aria-valuetext", aria(line, stop));
      line.dot.setAttribute("cx", px);
      line.dot.setAttribute("cy", py);
      for (const [name, value] of [["x1", px], ["x2", px], ["y1", py]]) line.stem.setAttribute(name, value);
    }
    state.onStop(line.name, line.at, aria(line, stop));
    if (!line.cells) return;
    const change = stop.value - line.exact;
    line.cells[0].textContent = short(stop.t, 4) + unit(line);
    line.cells[1].textContent = percent(stop.value);
    line.cells[1].dataset.percent = stop.value;
    line.cells[1].dataset.threshold = stop.t;
    line.cells[2].textContent = line.at === line.home ? "as run" : (change >= 0 ? "+" : "−") + Math.abs(change).toFixed(2);
  }
  function aria(line, stop) { return `${short(stop.t, 4)}${unit(line)}: ${percent(stop.value)}`; }
  function unit(line) { return state.columns.find((c) => c.name === line.name).unit ? " m" : ""; }

  function fillTable() {
    const head = el("tr", {}, ...["feature", "threshold", "discarded", "change, pp"].map((t) => el("th", { scope: "col" }, t)));
    const body = el("tbody", { "aria-live": "polite" });
    for (const line of lines) {
      line.cells = [0, 1, 2].map(() => el("td", {}));
      line.cells[1].dataset.live = line.name;
      const swatch = el("i", { class: "swatch" });
      swatch.style.background = ink(line.name);
      body.append(el("tr", {}, el("th", { scope: "row" }, swatch, " ", line.name), ...line.cells));
      place(line);
    }
    table.replaceChildren(el("thead", {}, head), body);
    side.hidden = !lines.length;
    const exact = "Sliders stop where the number of pixels is exact. Rings mark the thresholds of the run. Above each track: the distribution of the distances (square root). Position is in meters.";
    const thinner = " Thin lines: the frame shown. Diamonds: the distances of the pixel under the probe.";
    live.textContent = run.counts ? exact + thinner : exact;
    if (!run.counts && run.images && run.images.no_planes) live.prepend(el("span", { class: "note" }, `${run.images.no_planes} `));
    box.dataset.live = Boolean(run.counts);
  }
  reset.addEventListener("click", () => { lines.forEach((line) => move(line, Math.max(line.home, 0), false)); changed(); });
  let again = null;
  return {
    setRun(next) {
      run = next;
      lines = prepare(run);
      all = 0;
      pixel = null;
      range();
      if (!box.firstChild) box.append(el("div", { class: "curvebox" }, area, side));
      fillTable();
      state.onStops(run.counts ? lines.map((line) => ({ ...line, move: (index) => move(line, index) })) : []);
      again ? again() : (again = whenSized(area, draw));
    },
    showFrame(number) { frame = number; drawFrame(); },
    showPixel(probed) { pixel = probed; drawPixel(); },
  };
}
