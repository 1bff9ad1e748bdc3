"use strict";
// Error against time of one column.  Everything is in the page: no library, no network.
const study = JSON.parse(document.getElementById("study").textContent);
const plot = document.getElementById("plot"), told = document.getElementById("told");
const chooser = document.getElementById("column"), roles = document.getElementById("roles");
const LEFT = 76, RIGHT = 20, TOP = 16, BOTTOM = 52;
let W = 1000, H = 520;  // CSS pixels, as wide as the page has room: letters stay readable on a phone
const SHAPES = { base: "square", best: "star", one: "circle", combined: "triangle", rung: "diamond", method: "circle" };
const NAMES = { base: "as asked", best: "all at their best", one: "one dial turned", combined: "several dials", rung: "path-traced", method: "reuse method" };

function element(name, attributes, parent, text) {
  const made = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text !== undefined) made.textContent = text;
  parent.appendChild(made);
  return made;
}

const digits = (x) => x === 0 ? "0" : Math.abs(x) >= 1000 ? x.toFixed(0) : String(Number(x.toPrecision(3)));

function shown(column) {
  const on = new Set([...roles.querySelectorAll("input:checked")].map((box) => box.value));
  return study.points.filter((p) => on.has(p.role) && p.ms && (p.columns[column]?.error ?? null) !== null);
}

// Logarithm above ``linear``, straight below it, so that an error of 0 has a place; infinite: straight throughout.
function scaleOf(values, linear) {
  const most = Math.max(...values) || 1;
  if (linear === Infinity) return (v) => H - BOTTOM - v / (1.08 * most) * (H - TOP - BOTTOM);
  const bend = (v) => v <= linear ? v / linear : 1 + Math.log10(v / linear);
  const top = bend(Math.max(linear, ...values)) * 1.06;
  return (v) => H - BOTTOM - (bend(v) + 0.06) / (top + 0.06) * (H - TOP - BOTTOM);
}

function evenTicks(low, high, count) {
  const raw = (high - low) / count, decade = 10 ** Math.floor(Math.log10(raw));
  const step = decade * [1, 2, 5, 10].find((s) => s * decade >= raw);
  const ticks = [];
  for (let i = Math.ceil(low / step); i * step <= high; ++i) ticks.push(Number((i * step).toPrecision(6)));
  return ticks;
}

function ticksBetween(low, high) {
  if (high / low < 4) return evenTicks(low, high, 6);
  const ticks = [];
  const steps = high / low > 300 || (W < 600 && high / low > 20) ? [1] : [1, 2, 5];
  for (let decade = Math.floor(Math.log10(low)); decade <= Math.ceil(Math.log10(high)); ++decade)
    for (const step of steps) {
      const value = step * 10 ** decade;
      if (value >= low * 0.999 && value <= high * 1.001) ticks.push(Number(value.toPrecision(3)));
    }
  return ticks;
}

function shapePath(role, x, y) {
  const r = role === "best" ? 9 : 6;
  const at = (angle, k) => `${x + k * r * Math.sin(angle)},${y - k * r * Math.cos(angle)}`;
  const corners = (n, turn, k) => Array.from({ length: n }, (_, i) => at(turn + 2 * Math.PI * i / n, k)).join("L");
  switch (SHAPES[role]) {
    case "square": return `M${corners(4, Math.PI / 4, 1.3)}Z`;
    case "diamond": return `M${corners(4, 0, 1.2)}Z`;
    case "wedge": return `M${corners(3, Math.PI, 1.25)}Z`;
    case "triangle": return `M${corners(3, 0, 1.25)}Z`;
    case "star": return "M" + Array.from({ length: 10 }, (_, i) => at(Math.PI * i / 5, i % 2 ? 0.45 : 1.2)).join("L") + "Z";
    default: return `M${x - r},${y}a${r},${r} 0 1 0 ${2 * r},0a${r},${r} 0 1 0 ${-2 * r},0Z`;
  }
}

function describe(p, column) {
  const e = p.columns[column];
  const half = e.half_width === null ? "" : ` (± ${digits(e.half_width)}, 95 % interval)`;
  const spread = p.ms.spread === null ? "" : ` ± ${digits(p.ms.spread)}`;
  const base = p.role === "method" ? "no reuse" : "the base";
  const against = p.against_base === null || p.against_base.ratio === 1 ? "" : p.against_base.different ? `, ${digits(p.against_base.ratio)}x ${base}` : `, no difference from ${base}`;
  const wrong = p.role === "method" ? `${column}: ${digits(e.error)}` :
    e.worst !== undefined ? `worst of ${study.front_columns[column].join(", ")}: ${e.worst}, ${digits(e.error)} points from the reference` :
    `${column}: ${digits(e.percent)} %, ${e.points >= 0 ? "+" : ""}${digits(e.points)} points from the reference${half}`;
  const lines = [
    `${p.label}${study.fronts[column].includes(p.name) ? "  [on the front]" : ""}`,
    wrong,
    `${digits(p.ms.median)}${spread} ms per frame, ${p.ms.samples} samples${against}; clock: ${p.clock}`,
  ];
  const passes = Object.entries(p.passes).filter(([, ms]) => ms > 0).map(([name, ms]) => `${name} ${digits(ms)}`);
  if (passes.length) lines.push(`ms by pass: ${passes.join(", ")}`);
  const features = Object.entries(p.features).map(([name, f]) => `${name.replace("_", " ")} ${digits(f.median)} / ${digits(f.p95)}`);
  if (features.length) lines.push(`per pixel, median / 95th percentile: ${features.join(", ")}`);
  if (p.bytes !== null) lines.push(`${digits(p.bytes / 1e6)} MB allocated`);
  return lines.join("\n");
}

function draw(keep) {
  const column = chooser.value, points = shown(column);
  plot.replaceChildren();
  W = Math.max(320, Math.min(1200, plot.clientWidth || 1000));
  H = Math.max(300, Math.round(0.5 * W));
  plot.setAttribute("viewBox", `0 0 ${W} ${H}`);
  if (!points.length) { told.textContent = "nothing to show"; return; }
  const times = points.map((p) => p.ms.median);
  const low = Math.min(...times) * 0.8, high = Math.max(...times) * 1.25;
  const x = (ms) => LEFT + Math.log(ms / low) / Math.log(high / low) * (W - LEFT - RIGHT);
  const errors = points.map((p) => p.columns[column].error);
  const linear = Math.max(1e-3, Math.min(...errors.filter((e) => e > 1e-9), Infinity) || 1e-3);
  const pictures = study.measures.includes(column);
  const base = pictures ? Infinity : Number.isFinite(linear) ? linear : 1e-3;
  const y = scaleOf(errors, base);
  for (const tick of ticksBetween(low, high)) {
    element("line", { class: "grid", x1: x(tick), x2: x(tick), y1: TOP, y2: H - BOTTOM }, plot);
    element("text", { x: x(tick), y: H - BOTTOM + 18, "text-anchor": "middle" }, plot, digits(tick));
  }
  for (const tick of pictures ? evenTicks(0, Math.max(...errors), 5) : [0, ...ticksBetween(base, Math.max(base, ...errors))]) {
    element("line", { class: "grid", x1: LEFT, x2: W - RIGHT, y1: y(tick), y2: y(tick) }, plot);
    element("text", { x: LEFT - 8, y: y(tick) + 4, "text-anchor": "end" }, plot, digits(tick));
  }
  element("text", { x: (LEFT + W) / 2, y: H - 10, "text-anchor": "middle" }, plot, pictures ? W < 600 ? "ms per frame, with shading (log)" : "ms per frame, shading and method, logarithmic" : "ms per frame, logarithmic");
  element("text", { x: 14, y: (H - BOTTOM) / 2, "text-anchor": "middle", transform: `rotate(-90 14 ${(H - BOTTOM) / 2})` }, plot, pictures ? column : "error, points");
  const floor = study.reference.floor[column]?.points;
  if (floor) element("line", { class: "floor", x1: LEFT, x2: W - RIGHT, y1: y(floor), y2: y(floor) }, plot);
  const front = study.fronts[column].map((name) => points.find((p) => p.name === name)).filter(Boolean);
  let path = "";
  front.forEach((p, i) => {
    const px = x(p.ms.median), py = y(p.columns[column].error);
    path += i ? `H${px}V${py}` : `M${px},${py}`;
  });
  element("path", { class: "front", d: path }, plot);
  const order = [...points].sort((a, b) => front.includes(a) - front.includes(b) || a.ms.median - b.ms.median);  // front on top
  for (const p of order) {
    const px = x(p.ms.median), py = y(p.columns[column].error), on = front.includes(p);
    if (p.ms.spread) element("line", { class: "spread", x1: x(Math.max(low, p.ms.median - p.ms.spread)), x2: x(Math.min(high, p.ms.median + p.ms.spread)), y1: py, y2: py }, plot);
    const mark = element("path", {
      class: on ? "mark" : "mark off", d: shapePath(p.role, px, py), fill: study.colors[column], tabindex: 0, role: "img",
      "aria-label": describe(p, column), "data-name": p.name,
    }, plot);
    element("title", {}, mark, p.label);
    const tell = () => { told.textContent = describe(p, column); };
    mark.addEventListener("mouseenter", tell);
    mark.addEventListener("focus", tell);
    if (p.name === keep) mark.focus();
  }
  if (!keep) told.textContent = "Point at a mark, or reach it with Tab and the arrow keys.";
}

plot.addEventListener("keydown", (event) => {
  const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
  if (!step) return;
  event.preventDefault();
  const place = new Map(study.points.map((p) => [p.name, p.ms?.median]));
  const marks = [...plot.querySelectorAll(".mark")].sort((a, b) => place.get(a.dataset.name) - place.get(b.dataset.name));
  const at = marks.indexOf(document.activeElement);
  marks[(at + step + marks.length) % marks.length].focus();
});

for (const [name, columns] of Object.entries(study.front_columns))
  chooser.append(new Option(study.columns.includes(name) ? name : `worst of ${columns.length < 4 ? columns.join(", ") : `${columns.length} columns`}`, name));
chooser.value = Object.keys(study.front_columns).find((name) => !study.columns.includes(name)) ?? chooser.value;
for (const measure of study.measures) chooser.append(new Option(`${measure} of reuse methods`, measure));
for (const role of Object.keys(NAMES)) {
  if (!study.points.some((p) => p.role === role)) continue;
  const label = document.createElement("label"), box = document.createElement("input");
  Object.assign(box, { type: "checkbox", value: role, checked: true });
  box.addEventListener("change", () => draw());
  label.append(box, ` ${NAMES[role]} (${SHAPES[role]})`);
  roles.append(label);
}
chooser.addEventListener("change", () => draw());
window.addEventListener("resize", () => draw());
draw();
