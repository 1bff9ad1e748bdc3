// The run page: discards over time, discards by threshold, and the choice of the run.

// ---- over time: point at a pair to read its values, click to show it in the frame viewer

function makePlots(box, state) {
  const area = el("div", { tabindex: "0", role: "application", "aria-label": "Discarded pixels per pair; the left and right arrow keys select a pair" });
  const readout = el("p", { class: "readout", "aria-live": "polite" });
  box.append(area, readout);
  let run, cursor = null, shownAt = null, x, cursors = [], hover = -1;

  function series(of, name) {
    return of.rows[name].map((count, i) => (count === null ? null : (100 * count) / of.rows.pixels[i]));
  }

  function draw(width) {
    const frames = run.rows.frame;
    area.replaceChildren();
    if (!frames.length) {
      area.append(el("p", { class: "missing" }, "This run has no frame pair, hence no values over time."));
      return;
    }
    const left = 52, right = 10, tall = width < 560 ? 190 : 250, low = 92, gap = 46;
    const height = 26 + tall + 2 * (gap + low) + 30;
    const root = plotRoot(width, height, "Discarded pixels and camera motion over time");
    const first = Math.min(...frames), last = Math.max(...frames);
    x = first === last ? () => (left + width - right) / 2 : linearScale(first, last, left, width - right);
    const others = state.runs.filter((r) => r !== run && r.rows.frame.length);
    const lines = (of, other) => of.measured.map((name) => {
      const column = state.columns.find((c) => c.name === name);
      return { frames: of.rows.frame, values: series(of, name), color: ink(name), dash: column.dash, other };
    });
    const shown = [...others.flatMap((of) => lines(of, true)), ...lines(run, false)].map((line) => {
      const inside = line.frames.map((f) => f >= first && f <= last);
      return { ...line, xs: line.frames.filter((_, i) => inside[i]).map(x), values: line.values.filter((_, i) => inside[i]) };
    });
    linePanel(root, { left, right: width - right, top: 26, bottom: 26 + tall }, {
      end: topOf(shown.map((l) => l.values), 1), count: 5, format: (value) => short(value) + " %", title: "discarded, % of all pixels", lines: shown });
    let top = 26 + tall + gap;
    for (const [name, title, unit] of [["angle_deg", "camera rotation per frame", "°"], ["translation_m", "camera translation per frame", " m"]]) {
      const values = run.rows[name];
      linePanel(root, { left, right: width - right, top, bottom: top + low }, {
        end: topOf([values], 1e-6), count: 3, format: (value) => short(value) + unit, title, lines: [{ xs: frames.map(x), values, color: "var(--ink)", dash: "-" }] });
      top += low + gap;
    }
    const bottom = top - gap;
    for (const offset of evenTicks(0, last - first || 1, width < 560 ? 4 : 8)) {
      const frame = first + Math.round(offset);
      if (frame <= last) root.append(text(x(frame), bottom + 20, frame, { "text-anchor": "middle" }));
    }
    if (width > 560) root.append(text(width - right, bottom + 20, "frame", { "text-anchor": "end" }));
    run.cuts.forEach((frame, i) => {
      if (frame < first || frame > last) return;
      root.append(svg("line", { class: "cut", x1: x(frame), x2: x(frame), y1: 26, y2: bottom }));
      if (i === 0 || run.cuts.length < 6) root.append(text(x(frame) + 4, 38, "cut", { class: "cutname" }));
    });
    cursors = [svg("line", { class: "shown", y1: 26, y2: bottom, visibility: "hidden" }), svg("line", { class: "cursor", y1: 26, y2: bottom, visibility: "hidden" })];
    root.append(...cursors);
    area.append(root);
    mark();
    read(hover);
  }

  function place(line, frame) {
    if (!line || !x) return;
    line.setAttribute("visibility", frame === null ? "hidden" : "visible");
    if (frame !== null) { line.setAttribute("x1", x(frame)); line.setAttribute("x2", x(frame)); }
  }
  function mark() { place(cursors[0], shownAt); place(cursors[1], cursor); }

  function read(index) {
    readout.replaceChildren();
    const frames = run.rows.frame;
    if (!frames.length) return;
    const mean = index < 0;
    readout.append(el("span", {}, el("b", {}, mean ? "mean of all pairs" : `frame ${frames[index]}`)));
    for (const name of run.measured) {
      const value = mean ? run.discard[name].mean_percent : series(run, name)[index];
      readout.append(lineEntry(ink(name), state.columns.find((c) => c.name === name).dash, `${name} ${percent(value)}`));
    }
    if (!mean) {
      readout.append(el("span", {}, `rotation ${short(run.rows.angle_deg[index])}°`), el("span", {}, `translation ${short(run.rows.translation_m[index])} m`));
      if (run.cuts.includes(frames[index])) readout.append(el("span", {}, el("b", {}, "cut")));
    }
  }

  function pick(index) {
    hover = index;
    cursor = index < 0 ? null : run.rows.frame[index];
    mark();
    read(index);
  }
  selectAlong(area, {
    positions: () => (x ? run.rows.frame.map(x) : []),
    current: () => hover,
    pick,
    choose: (index) => state.goTo(run.rows.frame[index]),
  });
  let again = null;
  return {
    setRun(next) { run = next; hover = -1; cursor = null; again ? again() : (again = whenSized(area, draw)); },
    show(frame) { shownAt = frame; mark(); },
  };
}

// ---- by threshold: each dot is a slider.  It stops at the edges of the recorded bins, where the number of pixels is
// exact, and at the threshold of the run

function makeCurves(box, state) {
  const area = el("div");
  const table = el("table");
  const reset = el("button", { type: "button" }, "Reset to the thresholds of the run");
  const side = el("div", {}, table, el("div", { class: "actions" }, reset),
    el("p", { class: "muted" }, "Dots stop at the edges of the recorded bins, where the number of pixels is exact. Rings mark the thresholds of the run. The threshold axis is in the unit of each feature; position is in meters."));
  let run, lines = [], low = 1e-3, high = 1, x, y, all = 0;

  function prepare(of) {
    const pixels = of.pixels;
    return state.features.filter((f) => of.curves[f]).map((name) => {
      const { edges, above } = of.curves[name];
      const used = of.thresholds[name];
      const stops = edges.map((t, i) => ({ t, value: (100 * above[i]) / pixels }));
      const exact = of.discard[name].mean_percent;
      if (used > 0) {
        stops.push({ t: used, value: exact, used: true });
        stops.sort((a, b) => a.t - b.t || (a.used ? 1 : -1));
      }
      const home = stops.findIndex((s) => s.used);
      return { name, edges, percents: edges.map((_, i) => (100 * above[i]) / pixels), stops, home, at: Math.max(home, 0), used, exact };
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
    const left = 64, right = 14, top = 14, height = width < 560 ? 300 : 400, foot = 58;
    x = logScale(low, high, left, width - right);
    const other = state.runs.filter((r) => r !== run).flatMap(prepare);
    const end = Math.max(1, ...[...lines, ...other].map((l) => Math.max(0, ...l.percents.filter((_, i) => l.edges[i] >= low)))) * 1.05;
    y = linearScale(0, end, height - foot, top);
    const root = plotRoot(width, height, "Discarded pixels by threshold", "group");
    const decades = [];
    for (let p = Math.ceil(Math.log10(low)); p <= Math.log10(high); p++) decades.push(Math.pow(10, p));
    drawAxes(root, { left, right: width - right, top, bottom: height - foot }, {
      x: { scale: x, ticks: decades, format: decade }, y: { scale: y, ticks: y.ticks(5), format: (value) => short(value) + " %", label: "discarded, % of all pixels" } });
    for (const [list, dim] of [[other, true], [lines, false]]) {
      for (const line of list) {
        const keep = line.edges.map((t) => t >= low && t <= high);
        const style = state.columns.find((c) => c.name === line.name).dash;
        root.append(svg("path", { class: "line" + (dim ? " other" : ""), stroke: ink(line.name), "stroke-dasharray": dashArray(style),
          d: linePath(line.edges.filter((_, i) => keep[i]).map(x), line.percents.filter((_, i) => keep[i]).map(y)) }));
      }
    }
    for (const line of lines) {
      if (line.home >= 0) root.append(svg("circle", { class: "used", cx: x(line.used), cy: y(line.exact), r: 4.5, stroke: ink(line.name) }));
    }
    for (const line of lines) root.append((line.handle = handle(line)));
    root.append(common(height - foot, left, width - right));
    area.append(root);
    lines.forEach(place);
  }

  // "0.001" to "1000", else "1e−4".
  function decade(value) {
    const power = Math.round(Math.log10(value));
    return Math.abs(power) <= 3 ? String(Number(value.toPrecision(1))) : `1e${power}`.replace("-", "−");
  }

  function handle(line) {
    const node = svg("g", { class: "handle", tabindex: 0, role: "slider", "data-feature": line.name,
      "aria-label": `threshold of ${line.name}`, "aria-valuemin": 0, "aria-valuemax": line.stops.length - 1 });
    node.append(svg("circle", { class: "hit", r: 20 }), svg("circle", { class: "dot", r: 8, fill: ink(line.name) }));
    slide(node, {
      drag: (event) => move(line, closest(line, thresholdAt(event))),
      step: (by) => move(line, line.at + by),
      end: (last) => move(line, last ? line.stops.length - 1 : 0),
    });
    return node;
  }

  // The triangle on the axis moves all dots to one threshold.
  function common(bottom, left, right) {
    const node = svg("g", { class: "handle", tabindex: 0, role: "slider", "data-feature": "all", "aria-label": "threshold of all features",
      "aria-valuemin": 0, "aria-valuemax": lines[0].edges.length - 1 });
    node.append(svg("circle", { class: "hit", r: 22, cy: 14 }), svg("path", { d: "M0 1 L9 16 L-9 16 Z" }));
    const edges = lines[0].edges;
    const set = (index) => {
      all = clamp(index, 0, edges.length - 1);
      const t = edges[all];
      for (const line of lines) move(line, closest(line, t));
      put();
    };
    const put = () => {
      node.setAttribute("transform", `translate(${x(edges[all])} ${bottom + 24})`);
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

  function move(line, index) {
    line.at = clamp(index, 0, line.stops.length - 1);
    place(line);
  }

  function place(line) {
    const stop = line.stops[line.at];
    if (line.handle) {
      line.handle.setAttribute("transform", `translate(${x(stop.t)} ${y(stop.value)})`);
      line.handle.setAttribute("aria-valuenow", line.at);
      line.handle.setAttribute("aria-valuetext", `${short(stop.t, 4)}${unit(line)}: ${percent(stop.value)}`);
    }
    if (!line.cells) return;
    const change = stop.value - line.exact;
    line.cells[0].textContent = short(stop.t, 4) + unit(line);
    line.cells[1].textContent = percent(stop.value);
    line.cells[1].dataset.percent = stop.value;
    line.cells[1].dataset.threshold = stop.t;
    line.cells[2].textContent = line.at === line.home ? "as run" : (change >= 0 ? "+" : "−") + Math.abs(change).toFixed(2);
  }
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
    }
    table.replaceChildren(el("thead", {}, head), body);
    side.hidden = !lines.length;
  }
  reset.addEventListener("click", () => lines.forEach((line) => move(line, Math.max(line.home, 0))));
  let again = null;
  return {
    setRun(next) {
      run = next;
      lines = prepare(run);
      all = 0;
      range();
      fillTable();
      if (!box.firstChild) box.append(el("div", { class: "curvebox" }, area, side));
      again ? again() : (again = whenSized(area, draw));
    },
  };
}

// ---- the choice of the run

const state = {
  runs: data.runs, columns: data.columns, features: data.features,
  onFrame: (frame) => plots.show(frame),
  goTo: (frame) => viewer.goTo(frame),
};
const viewer = makeViewer(document.getElementById("viewer"), state);
const plots = makePlots(document.getElementById("plots"), state);
const curves = makeCurves(document.getElementById("curves"), state);

function choose(run) {
  plots.setRun(run);
  viewer.setRun(run);
  curves.setRun(run);
}

if (data.runs.length > 1) {
  const select = document.getElementById("run");
  data.runs.forEach((run, i) => select.append(el("option", { value: i }, run.label)));
  select.addEventListener("change", () => choose(data.runs[Number(select.value)]));
  document.getElementById("run-choice").hidden = false;
}
choose(data.runs[0]);
