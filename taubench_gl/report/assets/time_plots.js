// Discards over time at the thresholds of the page: point at a pair to read its values, click to show it in the viewer.

function makePlots(box, state) {
  const area = el("div", { tabindex: "0", role: "application", "aria-label": "Discarded pixels per pair; the left and right arrow keys select a pair" });
  const readout = el("p", { class: "readout", "aria-live": "polite" });
  box.append(area, readout);
  let run, cursor = null, shownAt = null, x, cursors = [], hover = -1;

  // Per pair, % of all pixels; `live`: at the thresholds of the page, which the distances tell.
  function series(of, name, live = true) {
    const moved = live && of.counts && name in of.at && of.at[name] !== of.images.planes.levels[name].home;
    return of.rows[name].map((count, i) => {
      if (count === null) return null;
      return (100 * (moved ? of.counts.above(name, of.at[name], i) : count)) / of.rows.pixels[i];
    });
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
    const lines = (of, other, live) => of.measured.map((name) => {
      const column = state.columns.find((c) => c.name === name);
      return { frames: of.rows.frame, values: series(of, name, live), color: ink(name), dash: column.dash, other };
    });
    const recorded = run.moved() ? lines(run, true, false) : [];
    const shown = [...others.flatMap((of) => lines(of, true, false)), ...recorded, ...lines(run, false, true)].map((line) => {
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
    if (width > 560) root.append(text(left - 16, bottom + 20, "frame", { "text-anchor": "end" }));
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
      const values = series(run, name).filter(isNumber);
      const value = !mean ? series(run, name)[index] : run.moved() ? values.reduce((sum, v) => sum + v, 0) / values.length : run.discard[name].mean_percent;
      readout.append(lineEntry(ink(name), state.columns.find((c) => c.name === name).dash, `${name} ${percent(value)}`));
    }
    if (run.moved()) readout.append(el("span", {}, "faint: at the thresholds of the run"));
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
    state.onPair(cursor === null ? shownAt : cursor);
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
    thresholds() { if (again) again(); },
  };
}
