// Discards against threshold, every dot a slider.  Thresholds rest on the edges of the recorded bins, where the number
// of pixels is exact, and on the threshold the run used.
function makeCurves(box, state) {
  const area = el("div");
  const table = el("table");
  const reset = el("button", { type: "button" }, "Back to the thresholds used");
  const side = el("div", {}, table, el("div", { class: "actions" }, reset),
    el("p", { class: "muted" }, "Dots rest on the recorded bin edges, where the count of pixels is exact; rings are the thresholds used. Each axis value is in its feature’s own unit: position in metres."));
  let run, lines = [], low = 1e-3, high = 1, x, y, size, all = 0;

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
    size = width;
    area.replaceChildren();
    if (!lines.length) {
      area.append(el("p", { class: "missing" }, "This run recorded no curve of discards against threshold: it has no pair, or measured no feature."));
      return;
    }
    const left = 50, right = 14, top = 14, height = width < 560 ? 300 : 400, foot = 58;
    const lx = linear(Math.log10(low), Math.log10(high), left, width - right);
    x = (t) => lx(Math.log10(clamp(t, low, high)));
    const other = state.runs.filter((r) => r !== run).flatMap(prepare);
    const end = Math.max(1, ...[...lines, ...other].map((l) => Math.max(0, ...l.percents.filter((_, i) => l.edges[i] >= low)))) * 1.05;
    y = linear(0, end, height - foot, top);
    const root = svg("svg", { class: "plot", viewBox: `0 0 ${width} ${height}`, height, role: "group", "aria-label": "Discarded pixels against threshold" });
    for (const value of ticks(end, 5)) {
      root.append(svg("line", { class: "grid", x1: left, x2: width - right, y1: y(value), y2: y(value) }));
      root.append(label(left - 8, y(value) + 4, short(value) + " %", "end"));
    }
    for (let p = Math.ceil(Math.log10(low)); p <= Math.log10(high); p++) {
      const t = Math.pow(10, p);
      root.append(svg("line", { class: "grid", x1: x(t), x2: x(t), y1: top, y2: height - foot }));
      root.append(label(x(t), height - foot + 18, p >= -3 && p <= 3 ? String(Number(t.toPrecision(1))) : `1e${p}`.replace("-", "−"), "middle"));
    }
    for (const [list, dim] of [[other, true], [lines, false]]) {
      for (const line of list) {
        const keep = line.edges.map((t) => t >= low && t <= high);
        const style = state.columns.find((c) => c.name === line.name).dash;
        root.append(svg("path", { class: "line" + (dim ? " other" : ""), stroke: ink(line.name), "stroke-dasharray": dash(style),
          d: path(line.edges.filter((_, i) => keep[i]).map(x), line.percents.filter((_, i) => keep[i]).map(y)) }));
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

  function label(cx, cy, text, anchor) {
    const node = svg("text", { x: cx, y: cy, "text-anchor": anchor });
    node.textContent = text;
    return node;
  }

  function handle(line) {
    const node = svg("g", { class: "handle", tabindex: 0, role: "slider", "data-feature": line.name,
      "aria-label": `threshold of ${line.name}`, "aria-valuemin": 0, "aria-valuemax": line.stops.length - 1 });
    node.append(svg("circle", { class: "hit", r: 20 }), svg("circle", { class: "dot", r: 8, fill: ink(line.name) }));
    slide(node, (event) => move(line, near(line, event)), (step) => move(line, line.at + step), (stop) => move(line, stop ? line.stops.length - 1 : 0));
    return node;
  }

  // One triangle on the axis that moves every dot to the same threshold.
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
    slide(node, (event) => {
      const t = valueAt(event);
      set(edges.reduce((best, e, i) => (Math.abs(Math.log(e / t)) < Math.abs(Math.log(edges[best] / t)) ? i : best), 0));
    }, (step) => set(all + step), (stop) => set(stop ? edges.length - 1 : 0));
    put();
    return node;
  }

  function slide(node, drag, step, end) {
    node.addEventListener("pointerdown", (event) => { node.setPointerCapture(event.pointerId); node.focus({ preventScroll: true }); event.preventDefault(); });
    node.addEventListener("pointermove", (event) => { if (node.hasPointerCapture(event.pointerId)) drag(event); });
    node.addEventListener("keydown", (event) => {
      const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -8, PageUp: 8 }[event.key];
      if (by === undefined && event.key !== "Home" && event.key !== "End") return;
      event.preventDefault();
      by === undefined ? end(event.key === "End") : step(by);
    });
  }

  function valueAt(event) {
    const at = event.clientX - area.getBoundingClientRect().left;
    const share = (at - 50) / (size - 14 - 50);
    return Math.pow(10, Math.log10(low) + clamp(share, 0, 1) * (Math.log10(high) - Math.log10(low)));
  }
  function closest(line, t) {
    return line.stops.reduce((best, s, i) => (Math.abs(Math.log(s.t / t)) < Math.abs(Math.log(line.stops[best].t / t)) ? i : best), 0);
  }
  function near(line, event) { return closest(line, valueAt(event)); }

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
    line.cells[2].textContent = line.at === line.home ? "used" : (change >= 0 ? "+" : "−") + Math.abs(change).toFixed(2);
  }
  function unit(line) { return state.columns.find((c) => c.name === line.name).unit ? " m" : ""; }

  function fillTable() {
    const head = el("tr", {}, ...["feature", "threshold", "discarded", "change"].map((t) => el("th", { scope: "col" }, t)));
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
