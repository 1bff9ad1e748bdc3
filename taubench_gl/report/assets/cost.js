// The cost page: mask error against time, both logarithmic, one mark per configuration, the Pareto front as steps.

const SHAPES = { baseline: "square", highest_quality: "star", single: "circle", combined: "triangle", path_traced: "diamond", render: "star" };
const NAMES = { baseline: "baseline", highest_quality: "highest quality", single: "one parameter changed", combined: "several changed", path_traced: "path-traced", render: "renders" };
const NAMED = ["baseline", "highest_quality", "path_traced", "render"];
const box = document.getElementById("plot"), status = document.getElementById("status");
const chooser = document.getElementById("column"), roles = document.getElementById("roles");

function shownPoints(column) {
  const enabled = new Set([...roles.querySelectorAll("input:checked")].map((input) => input.value));
  return data.points.filter((p) => enabled.has(p.role) && p.ms && p.masks[column] !== undefined);
}

// The lines below the plot for one configuration.
function describe(p, column) {
  const e = p.masks[column];
  const spread = p.ms.spread === null ? "" : ` ± ${short(p.ms.spread)}`;
  const against = p.against_baseline === null || p.against_baseline.ratio === 1 ? ""
    : p.against_baseline.different ? `, ${short(p.against_baseline.ratio)}x the baseline` : ", statistically indistinguishable from the baseline";
  const on = [p.name === data.chosen ? "recommended" : "", data.fronts[column].includes(p.name) ? "on the Pareto front" : ""].filter(Boolean);
  const lines = [
    `${p.label}${on.length ? ` [${on.join(", ")}]` : ""}`,
    `${column}: ${short(e.percent)} % of the masks are wrong: ${short(e.false_positive)} % discarded wrongly, ${short(e.false_negative)} % kept wrongly; difference ${e.points >= 0 ? "+" : ""}${short(e.points)} points`,
    `${short(p.ms.median)}${spread} ms per frame, ${p.ms.samples} rounds${against}; clock: ${p.clock}`,
  ];
  if (p.bytes !== null) lines.push(`${short(p.bytes / 1e6)} MB allocated`);
  return lines.join("\n");
}

// Names beside marks, inside the area, without those that would cover an earlier one.
function writeNames(plot, names, area) {
  const kept = [];
  for (const name of names) {
    const text = svg("text", { class: "name", x: name.x, y: name.y }, name.text);
    plot.append(text);
    let b = text.getBBox();
    if (b.x + b.width > area.right) {
      text.setAttribute("x", name.x - 18);
      text.setAttribute("text-anchor", "end");
      b = text.getBBox();
    }
    if (kept.some((k) => b.x < k.x + k.width && k.x < b.x + b.width && b.y < k.y + k.height && k.y < b.y + b.height)) text.remove();
    else kept.push(b);
  }
}

function draw() {
  const column = chooser.value, points = shownPoints(column);
  box.replaceChildren();
  if (!points.length) { status.textContent = "Nothing to show."; return; }
  const width = clamp(box.clientWidth || 1000, 300, 1200), height = Math.max(320, Math.round(0.4 * width));
  const area = { left: 76, right: width - 20, top: 20, bottom: height - 52 };
  const plot = plotRoot(width, height, "Error against time, one mark per configuration", "group");
  const floor = data.floor[column] || 0, positive = points.map((p) => p.masks[column].percent).filter((e) => e > 0);
  const least = Math.min(...positive, ...(floor ? [floor] : [])), most = Math.max(...positive, floor);
  const bottom = Number.isFinite(least) ? 0.5 * least : 0.01, error = (p) => Math.max(p.masks[column].percent, bottom);  // 0 is drawn at the bottom
  const times = points.map((p) => p.ms.median);
  const x = logScale(Math.min(...times) * 0.8, Math.max(...times) * 1.6, area.left, area.right);
  const y = logScale(bottom, 1.6 * (most > bottom ? most : 10 * bottom), area.bottom, area.top);
  drawAxes(plot, area, {
    x: { scale: x, ticks: x.ticks(width < 600 ? 4 : 8), label: "ms per frame (log)" },
    y: { scale: y, ticks: y.ticks(5), label: "wrong masks, % of the pixels (log)" },
  });
  if (floor) {
    plot.append(svg("line", { class: "floor", x1: area.left, x2: area.right, y1: y(floor), y2: y(floor) }));
    plot.append(svg("text", { class: "name", x: area.right - 4, y: y(floor) - 4, "text-anchor": "end" }, "noise floor of the reference"));
  }
  const front = data.fronts[column].map((name) => points.find((p) => p.name === name)).filter(Boolean);
  plot.append(svg("path", { class: "front", d: stepPath(front.map((p) => x(p.ms.median)), front.map((p) => y(error(p)))) }));
  box.append(plot);
  const order = [...points].sort((a, b) => front.includes(a) - front.includes(b) || a.ms.median - b.ms.median);  // front on top
  for (const p of order) {
    const px = x(p.ms.median), py = y(error(p));
    if (p.ms.spread) plot.append(svg("line", { class: "spread", x1: x(Math.max(p.ms.median - p.ms.spread, 0.5 * p.ms.median)), x2: x(p.ms.median + p.ms.spread), y1: py, y2: py }));
    if (p.name === data.chosen) plot.append(svg("circle", { class: "chosen", cx: px, cy: py, r: 12 }));
    addMark(plot, {
      shape: SHAPES[p.role], x: px, y: py, fill: data.colors[column], label: describe(p, column), title: p.label, name: p.name, dim: !front.includes(p),
    }, () => { status.textContent = describe(p, column); });
  }
  const named = points.filter((p) => NAMED.includes(p.role) || p.name === data.chosen).sort((a, b) => (b.name === data.chosen) - (a.name === data.chosen));
  writeNames(plot, named.map((p) => ({ text: NAMED.includes(p.role) ? p.label : "recommended", x: x(p.ms.median) + 9, y: y(error(p)) - 7 })), area);
  status.textContent = "Point at a mark, or reach it with Tab and the arrow keys.";
}

walkMarks(box, (name) => data.points.find((p) => p.name === name).ms.median);
for (const name of data.columns) chooser.append(el("option", { value: name }, name === "overall" ? "overall: in any column" : name));
for (const role of Object.keys(NAMES)) {
  if (!data.points.some((p) => p.role === role && p.ms)) continue;
  const input = el("input", { type: "checkbox", value: role, checked: true, onchange: () => draw() });
  roles.append(el("label", {}, input, ` ${NAMES[role]} (${SHAPES[role]})`));
}
chooser.addEventListener("change", () => draw());
whenSized(box, () => draw());
