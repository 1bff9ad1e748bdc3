// The cost page: error against time of one column or measure, one mark per configuration, the Pareto front as steps.

const SHAPES = { baseline: "square", highest_quality: "star", single: "circle", combined: "triangle", path_traced: "diamond", method: "circle" };
const NAMES = { baseline: "baseline", highest_quality: "highest quality", single: "one parameter changed", combined: "several parameters changed", path_traced: "path-traced", method: "reuse method" };
const box = document.getElementById("plot"), status = document.getElementById("status");
const chooser = document.getElementById("column"), roles = document.getElementById("roles");

function shownPoints(column) {
  const enabled = new Set([...roles.querySelectorAll("input:checked")].map((input) => input.value));
  return data.points.filter((p) => enabled.has(p.role) && p.ms && (p.columns[column]?.error ?? null) !== null);
}

// The lines below the plot for one configuration.
function describe(p, column) {
  const e = p.columns[column];
  const half = e.half_width === null ? "" : ` (± ${short(e.half_width)} pp, 95 % interval)`;
  const spread = p.ms.spread === null ? "" : ` ± ${short(p.ms.spread)}`;
  const base = p.role === "method" ? "no reuse" : "the baseline";
  const against = p.against_baseline === null || p.against_baseline.ratio === 1 ? ""
    : p.against_baseline.different ? `, ${short(p.against_baseline.ratio)}x ${base}` : `, statistically indistinguishable from ${base}`;
  const error = p.role === "method" ? `${column}: ${short(e.error)}`
    : e.worst !== undefined ? `worst of ${data.front_columns[column].join(", ")}: ${e.worst}, ${short(e.error)} pp from the reference`
    : `${column}: ${short(e.percent)} %, ${e.points >= 0 ? "+" : ""}${short(e.points)} pp from the reference${half}`;
  const lines = [
    `${p.label}${data.fronts[column].includes(p.name) ? "  [on the Pareto front]" : ""}`,
    error,
    `${short(p.ms.median)}${spread} ms per frame, ${p.ms.samples} samples${against}; clock: ${p.clock}`,
  ];
  const passes = Object.entries(p.passes).filter(([, ms]) => ms > 0).map(([name, ms]) => `${name} ${short(ms)}`);
  if (passes.length) lines.push(`ms by pass: ${passes.join(", ")}`);
  const features = Object.entries(p.features).map(([name, f]) => `${name.replace("_", " ")} ${short(f.median)} / ${short(f.p95)}`);
  if (features.length) lines.push(`per pixel, median / 95th percentile: ${features.join(", ")}`);
  if (p.bytes !== null) lines.push(`${short(p.bytes / 1e6)} MB allocated`);
  return lines.join("\n");
}

// Logarithmic with 0 at the bottom for errors of columns; linear for measures of images.
function errorScale(errors, column, area) {
  const most = Math.max(...errors);
  if (data.measures.includes(column)) return linearScale(0, 1.08 * (most || 1), area.bottom, area.top);
  const least = Math.min(...errors.filter((error) => error > 1e-9));
  return symlogScale(Number.isFinite(least) ? Math.max(1e-3, least) : 1e-3, most, area.bottom, area.top);
}

function draw() {
  const column = chooser.value, points = shownPoints(column), isMeasure = data.measures.includes(column);
  box.replaceChildren();
  if (!points.length) { status.textContent = "Nothing to show."; return; }
  const width = clamp(box.clientWidth || 1000, 300, 1200), height = Math.max(300, Math.round(0.5 * width));
  const area = { left: 76, right: width - 20, top: 16, bottom: height - 52 };
  const plot = plotRoot(width, height, "Error against time, one mark per configuration", "group");
  const times = points.map((p) => p.ms.median), errors = points.map((p) => p.columns[column].error);
  const low = Math.min(...times) * 0.8, high = Math.max(...times) * 1.25;
  const x = logScale(low, high, area.left, area.right), y = errorScale(errors, column, area);
  drawAxes(plot, area, {
    x: { scale: x, ticks: x.ticks(width < 600 ? 4 : 8), label: isMeasure ? "ms per frame, shading and method (log)" : "ms per frame (log)" },
    y: { scale: y, ticks: y.ticks(5), label: isMeasure ? column : "error, pp" },
  });
  const floor = data.reference.floor[column]?.points;
  if (floor) plot.append(svg("line", { class: "floor", x1: area.left, x2: area.right, y1: y(floor), y2: y(floor) }));
  const front = data.fronts[column].map((name) => points.find((p) => p.name === name)).filter(Boolean);
  plot.append(svg("path", { class: "front", d: stepPath(front.map((p) => x(p.ms.median)), front.map((p) => y(p.columns[column].error))) }));
  box.append(plot);
  const order = [...points].sort((a, b) => front.includes(a) - front.includes(b) || a.ms.median - b.ms.median);  // front on top
  for (const p of order) {
    const px = x(p.ms.median), py = y(p.columns[column].error);
    if (p.ms.spread) plot.append(svg("line", { class: "spread", x1: x(p.ms.median - p.ms.spread), x2: x(p.ms.median + p.ms.spread), y1: py, y2: py }));
    addMark(plot, {
      shape: SHAPES[p.role], x: px, y: py, fill: data.colors[column], label: describe(p, column), title: p.label, name: p.name, dim: !front.includes(p),
    }, () => { status.textContent = describe(p, column); });
  }
  status.textContent = "Point at a mark, or reach it with Tab and the arrow keys.";
}

walkMarks(box, (name) => data.points.find((p) => p.name === name).ms.median);
for (const [name, columns] of Object.entries(data.front_columns))
  chooser.append(el("option", { value: name }, data.columns.includes(name) ? name : `worst of ${columns.length < 4 ? columns.join(", ") : `${columns.length} columns`}`));
chooser.value = Object.keys(data.front_columns).find((name) => !data.columns.includes(name)) ?? chooser.value;
for (const measure of data.measures) chooser.append(el("option", { value: measure }, `${measure} of reuse methods`));
for (const role of Object.keys(NAMES)) {
  if (!data.points.some((p) => p.role === role)) continue;
  const input = el("input", { type: "checkbox", value: role, checked: true, onchange: () => draw() });
  roles.append(el("label", {}, input, ` ${NAMES[role]} (${SHAPES[role]})`));
}
chooser.addEventListener("change", () => draw());
whenSized(box, () => draw());
