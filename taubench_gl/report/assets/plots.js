// Discards and camera motion over time: point at a pair to read it, click to see it in the viewer.
function makePlots(box, state) {
  const area = el("div", { tabindex: "0", role: "application", "aria-label": "Discards per pair; left and right arrows walk through the pairs" });
  const readout = el("p", { class: "readout", "aria-live": "polite" });
  box.append(area, readout);
  let run, cursor = null, shownAt = null, x, marks, cursors = [], hover = -1;

  function series(of, name) {
    return of.rows[name].map((count, i) => (count === null ? null : (100 * count) / of.rows.pixels[i]));
  }

  function panel(top, height, width, left, right, end, unit, title, lines, root) {
    const y = linear(0, end, top + height, top);
    for (const value of ticks(end, height > 150 ? 5 : 3)) {
      root.append(svg("line", { class: "grid", x1: left, x2: width - right, y1: y(value), y2: y(value) }));
      const text = svg("text", { x: left - 8, y: y(value) + 4, "text-anchor": "end" });
      text.textContent = short(value) + unit;
      root.append(text);
    }
    const head = svg("text", { x: left, y: top - 10, class: "title" });
    head.textContent = title;
    root.append(head);
    for (const line of lines) {
      const ys = line.values.map((v) => (v === null ? NaN : y(v)));
      const xs = line.frames.map(x);
      root.append(svg("path", { class: "line" + (line.other ? " other" : ""), d: path(xs, ys), stroke: line.color, "stroke-dasharray": dash(line.dash) }));
      if (line.values.length === 1 && isFinite(ys[0])) root.append(svg("circle", { cx: xs[0], cy: ys[0], r: 4, fill: line.color }));
    }
  }

  function most(lists, least) {
    return Math.max(least, ...lists.flat().filter((v) => v !== null && isFinite(v))) * 1.04;
  }

  function draw(width) {
    const frames = run.rows.frame;
    area.replaceChildren();
    if (!frames.length) {
      area.append(el("p", { class: "missing" }, "No pair of frames, so nothing over time."));
      return;
    }
    const left = 52, right = 10, tall = width < 560 ? 190 : 250, low = 92, gap = 46;
    const height = 26 + tall + 2 * (gap + low) + 30;
    const root = svg("svg", { class: "plot", viewBox: `0 0 ${width} ${height}`, height, role: "img", "aria-label": "Discarded pixels and camera motion over time" });
    const first = Math.min(...frames), last = Math.max(...frames);
    x = first === last ? () => (left + width - right) / 2 : linear(first, last, left, width - right);
    const others = state.runs.filter((r) => r !== run && r.rows.frame.length);
    const lines = (of, other) => of.measured.map((name) => {
      const column = state.columns.find((c) => c.name === name);
      return { frames: of.rows.frame, values: series(of, name), color: ink(name), dash: column.dash, other };
    });
    const own = lines(run, false);
    const clip = others.flatMap((of) => lines(of, true)).map((line) => {
      const keep = line.frames.map((f) => f >= first && f <= last);
      return { ...line, frames: line.frames.filter((_, i) => keep[i]), values: line.values.filter((_, i) => keep[i]) };
    });
    marks = svg("g");
    root.append(marks);
    panel(26, tall, width, left, right, most([...own, ...clip].map((l) => l.values), 1), " %", "discarded, % of the picture", [...clip, ...own], root);
    let top = 26 + tall + gap;
    for (const [name, title, unit] of [["angle_deg", "camera rotation per frame", "°"], ["translation_m", "camera translation per frame", " m"]]) {
      const values = run.rows[name];
      panel(top, low, width, left, right, most([values], 1e-6), unit, title, [{ frames, values, color: "var(--ink)", dash: "-" }], root);
      top += low + gap;
    }
    const bottom = top - gap;
    const step = ticks(last - first || 1, width < 560 ? 4 : 8);
    for (const offset of step) {
      const frame = first + Math.round(offset);
      if (frame > last) continue;
      const text = svg("text", { x: x(frame), y: bottom + 20, "text-anchor": "middle" });
      text.textContent = frame;
      root.append(text);
    }
    const axis = svg("text", { x: width - right, y: bottom + 20, "text-anchor": "end" });
    if (width > 560) { axis.textContent = "frame"; root.append(axis); }
    run.cuts.forEach((frame, i) => {
      if (frame < first || frame > last) return;
      root.append(svg("line", { class: "cut", x1: x(frame), x2: x(frame), y1: 26, y2: bottom }));
      const text = svg("text", { class: "cutname", x: x(frame) + 4, y: 38 });
      text.textContent = i === 0 || run.cuts.length < 6 ? "cut" : "";
      root.append(text);
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
      const key = el("i");
      const column = state.columns.find((c) => c.name === name);
      key.style.borderTopColor = ink(name);
      key.style.borderTopStyle = { "-": "solid", "--": "dashed", "-.": "dashed", ":": "dotted" }[column.dash];
      readout.append(el("span", {}, key, `${name} ${percent(value)}`));
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
  function nearest(event) {
    const frames = run.rows.frame;
    if (!frames.length) return -1;
    const at = event.clientX - area.getBoundingClientRect().left;
    return frames.reduce((best, f, i) => (Math.abs(x(f) - at) < Math.abs(x(frames[best]) - at) ? i : best), 0);
  }
  area.addEventListener("pointermove", (event) => pick(nearest(event)));
  area.addEventListener("pointerleave", () => pick(-1));
  area.addEventListener("click", (event) => { const i = nearest(event); if (i >= 0) { pick(i); state.goTo(run.rows.frame[i]); } });
  area.addEventListener("keydown", (event) => {
    const count = run.rows.frame.length;
    const to = { ArrowLeft: hover - 1, ArrowRight: hover + 1, Home: 0, End: count - 1 }[event.key];
    if (to === undefined || !count) return;
    event.preventDefault();
    pick(clamp(to, 0, count - 1));
    state.goTo(run.rows.frame[hover]);
  });
  let again = null;
  return {
    setRun(next) { run = next; hover = -1; cursor = null; again ? again() : (again = whenSized(area, draw)); },
    show(frame) { shownAt = frame; mark(); },
  };
}
