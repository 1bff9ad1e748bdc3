// The plot module of every page: elements, number formats, scales, axes, lines and marks.

const NS = "http://www.w3.org/2000/svg";

// ---- elements

// An HTML element.  Attributes: "onclick" and the like add listeners; true sets an empty attribute; false, null and
// undefined set none.
function el(tag, attributes, ...children) {
  const node = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (name.startsWith("on")) node.addEventListener(name.slice(2), value);
    else if (value === true) node.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

// An SVG element; children may be strings.
function svg(tag, attributes, ...children) {
  const node = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children.filter((child) => child !== null && child !== undefined));
  return node;
}

// The <svg> of one plot.  `role`: "img" for a drawing, "group" where it holds controls.
function plotRoot(width, height, label, role = "img") {
  return svg("svg", { class: "plot", viewBox: `0 0 ${width} ${height}`, height, role, "aria-label": label });
}

// Calls `draw(width)` now and whenever the box gets another width.  Returns a function that draws again.
function whenSized(box, draw) {
  let last = 0;
  const go = () => {
    const width = Math.round(box.clientWidth);
    if (width > 0 && width !== last) draw((last = width));
  };
  new ResizeObserver(go).observe(box);
  go();
  return () => { last = 0; go(); };
}

// ---- numbers

function isNumber(value) {
  return value !== null && value !== undefined && isFinite(value);
}

function clamp(value, low, high) {
  return Math.min(high, Math.max(low, value));
}

// toFixed with ties to the even digit, as Python rounds: pages and tables agree.
function fixed(value, digits) {
  const scaled = value * 10 ** digits, tie = Math.abs(scaled % 1) === 0.5 && Number.isInteger(value * 2 ** (digits + 1));
  return (tie ? (2 * Math.round(scaled / 2)) / 10 ** digits : value).toFixed(digits);
}

// "12.34 %"; "–" for no value.
function percent(value) {
  if (!isNumber(value)) return "–";
  if (value > 0 && value < 0.005) return "<0.01 %";
  return value.toFixed(2) + " %";
}

// `digits` significant digits; "–" for no value.
function short(value, digits = 3) {
  if (!isNumber(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1000) return value.toFixed(0);
  if (size < 0.0001) return value.toExponential(1).replace("e-", "e−");
  return String(Number(value.toPrecision(digits)));
}

// ---- scales: functions from a value to a position in pixels, between `a` and `b`

function linearScale(from, to, a, b) {
  const span = to - from || 1;
  const scale = (value) => a + ((value - from) / span) * (b - a);
  scale.ticks = (count) => evenTicks(from, to, count);
  return scale;
}

// Values outside from .. to are placed at the nearer end.
function logScale(from, to, a, b) {
  const inner = linearScale(Math.log10(from), Math.log10(to), a, b);
  const scale = (value) => inner(Math.log10(clamp(value, from, to)));
  scale.ticks = (count) => logTicks(from, to, count);
  scale.invert = (position) => Math.pow(10, Math.log10(from) + clamp((position - a) / (b - a), 0, 1) * Math.log10(to / from));
  return scale;
}

// Linear from 0 to `bend`, logarithmic above it: 0 has a place.
function symlogScale(bend, to, a, b) {
  const part = (value) => (value <= bend ? value / bend : 1 + Math.log10(value / bend));
  const inner = linearScale(-0.06, part(Math.max(bend, to)) * 1.06, a, b);
  const scale = (value) => inner(part(value));
  scale.ticks = (count) => [0, ...logTicks(bend, Math.max(bend, to), count)];
  return scale;
}

// Multiples of 1, 2 or 5 times a power of ten: about `count` of them between `from` and `to`.
function evenTicks(from, to, count) {
  if (!(to > from)) return [from];
  const raw = (to - from) / count;
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
  const found = [];
  for (let i = Math.ceil(from / step - 1e-9); i * step <= to * (1 + 1e-4); i++) found.push(Number((i * step).toPrecision(12)));
  return found;
}

// Powers of ten; 1, 2 and 5 times them where these are few; even steps within less than a decade.
function logTicks(from, to, count = 8) {
  if (to / from < 4) return evenTicks(from, to, 6);
  const decades = Math.log10(to / from);
  const steps = 3 * decades > count ? [1] : [1, 2, 5];
  const found = [];
  for (let power = Math.floor(Math.log10(from)); power <= Math.ceil(Math.log10(to)); power++) {
    for (const step of steps) {
      const value = step * Math.pow(10, power);
      if (value >= from * 0.999 && value <= to * 1.001) found.push(Number(value.toPrecision(3)));
    }
  }
  return found;
}

// ---- axes, lines, marks

function text(x, y, words, attributes) {
  return svg("text", { x, y, ...attributes }, String(words));
}

// Grid lines and tick labels into `root`.  `area`: {left, right, top, bottom} in pixels; `x`, `y`: {scale, ticks, format,
// label, grid}, either may be left out.  `grid: false` draws the tick labels alone.
function drawAxes(root, area, { x, y }) {
  for (const value of x?.ticks ?? []) {
    const at = x.scale(value);
    if (x.grid !== false) root.append(svg("line", { class: "grid", x1: at, x2: at, y1: area.top, y2: area.bottom }));
    root.append(text(at, area.bottom + 19, (x.format ?? short)(value), { "text-anchor": "middle" }));
  }
  for (const value of y?.ticks ?? []) {
    const at = y.scale(value);
    root.append(svg("line", { class: "grid", x1: area.left, x2: area.right, y1: at, y2: at }));
    root.append(text(area.left - 8, at + 4, (y.format ?? short)(value), { "text-anchor": "end" }));
  }
  const middle = (area.top + area.bottom) / 2;
  if (x?.label) root.append(text((area.left + area.right) / 2, area.bottom + 42, x.label, { "text-anchor": "middle" }));
  if (y?.label) root.append(text(14, middle, y.label, { "text-anchor": "middle", transform: `rotate(-90 14 ${middle})` }));
}

// Path data through the points that are numbers, with a gap where one is not.
function linePath(xs, ys) {
  let data = "";
  let pen = false;
  for (let i = 0; i < xs.length; i++) {
    const good = isNumber(xs[i]) && isNumber(ys[i]);
    if (good) data += `${pen ? "L" : "M"}${xs[i].toFixed(2)} ${ys[i].toFixed(2)}`;
    pen = good;
  }
  return data;
}

// Lines over one x axis, with the grid and labels of y.  `lines`: {xs, values, color, dash, other}, where xs are pixels,
// a null value is a gap, and `other` draws the line lighter.  The y axis spans `start` (0) to `end`.
function linePanel(root, area, { start = 0, end, count, format, title, lines }) {
  const y = linearScale(start, end, area.bottom, area.top);
  drawAxes(root, area, { y: { scale: y, ticks: y.ticks(count), format } });
  root.append(text(area.left, area.top - 10, title, { class: "title" }));
  for (const line of lines) {
    const ys = line.values.map((value) => (isNumber(value) ? y(value) : NaN));
    root.append(svg("path", { class: "line" + (line.other ? " other" : ""), d: linePath(line.xs, ys), stroke: line.color, "stroke-dasharray": dashArray(line.dash) }));
    if (ys.length === 1 && isFinite(ys[0])) root.append(svg("circle", { cx: line.xs[0], cy: ys[0], r: 4, fill: line.color }));
  }
}

// The largest number in `lists`, at least `least`, with a margin.
function topOf(lists, least) {
  return Math.max(least, ...lists.flat().filter(isNumber)) * 1.04;
}

// The span of an axis for the numbers in `lists`: from 0 where less is better; around them where more is better, as in
// decibels, whose zero means nothing.
function spanOf(lists, better) {
  const found = lists.flat().filter(isNumber);
  if (better !== "higher" || !found.length) return [0, topOf(lists, 1e-9)];
  const low = Math.min(...found), high = Math.max(...found), margin = 0.08 * (high - low || 1);
  return [low - margin, high + margin];
}

// Path data of a staircase through points sorted by x: each value holds until the next point.
function stepPath(xs, ys) {
  return xs.map((x, i) => (i ? `H${x}V${ys[i]}` : `M${x},${ys[i]}`)).join("");
}

// Path data of a mark at (x, y): square, diamond, wedge (triangle pointing down), triangle, star or circle.
function markPath(shape, x, y) {
  const r = shape === "star" ? 9 : 6;
  const at = (angle, k) => `${x + k * r * Math.sin(angle)},${y - k * r * Math.cos(angle)}`;
  const corners = (n, turn, k) => `M${Array.from({ length: n }, (_, i) => at(turn + (2 * Math.PI * i) / n, k)).join("L")}Z`;
  switch (shape) {
    case "square": return corners(4, Math.PI / 4, 1.3);
    case "diamond": return corners(4, 0, 1.2);
    case "wedge": return corners(3, Math.PI, 1.25);
    case "triangle": return corners(3, 0, 1.25);
    case "star": return `M${Array.from({ length: 10 }, (_, i) => at((Math.PI * i) / 5, i % 2 ? 0.45 : 1.2)).join("L")}Z`;
    default: return `M${x - r},${y}a${r},${r} 0 1 0 ${2 * r},0a${r},${r} 0 1 0 ${-2 * r},0Z`;
  }
}

// A Matplotlib line style as stroke-dasharray, and as border style of a legend entry.
function dashArray(style) {
  return { "-": null, "--": "7 4", "-.": "8 3 2 3", ":": "2 4" }[style];
}
function dashBorder(style) {
  return { "-": "solid", "--": "dashed", "-.": "dashed", ":": "dotted" }[style];
}

// The color of a column of Table 4 (page.py).
function ink(name) {
  return `var(--c-${name})`;
}

// A mark that takes the focus.  `show` runs when it is pointed at or focused.
function addMark(root, { shape, x, y, fill, label, title, name, dim }, show) {
  const mark = svg("path", {
    class: dim ? "mark dim" : "mark", d: markPath(shape, x, y), fill, tabindex: 0, role: "img", "aria-label": label, "data-name": name,
  }, svg("title", {}, title));
  mark.addEventListener("mouseenter", show);
  mark.addEventListener("focus", show);
  root.append(mark);
}

// An entry of a legend or readout: a short line in the color and dashes of a series, and words.
function lineEntry(color, dash, words) {
  const key = el("i");
  key.style.borderTopColor = color;
  key.style.borderTopStyle = dashBorder(dash);
  return el("span", {}, key, words);
}

// ---- controls

// Arrow keys move the focus among the marks in `box`, in the order of `position(name)`.
function walkMarks(box, position) {
  box.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    const marks = [...box.querySelectorAll(".mark")].sort((a, b) => position(a.dataset.name) - position(b.dataset.name));
    if (marks.length) marks[(marks.indexOf(document.activeElement) + step + marks.length) % marks.length].focus();
  });
}

// Selects one of `positions()`, pixels from the left edge of `area`: pick(index) when the pointer moves, -1 when it
// leaves; pick and choose(index) on a click and on the left and right arrow, Home and End.  `current()`: the index picked.
function selectAlong(area, { positions, current, pick, choose }) {
  const nearest = (event) => {
    const found = positions(), at = event.clientX - area.getBoundingClientRect().left;
    return found.reduce((best, x, i) => (best < 0 || Math.abs(x - at) < Math.abs(found[best] - at) ? i : best), -1);
  };
  const both = (index) => { pick(index); choose(index); };
  area.addEventListener("pointermove", (event) => pick(nearest(event)));
  area.addEventListener("pointerleave", () => pick(-1));
  area.addEventListener("click", (event) => { const index = nearest(event); if (index >= 0) both(index); });
  area.addEventListener("keydown", (event) => {
    const count = positions().length;
    const to = { ArrowLeft: current() - 1, ArrowRight: current() + 1, Home: 0, End: count - 1 }[event.key];
    if (to === undefined || !count) return;
    event.preventDefault();
    both(clamp(to, 0, count - 1));
  });
}

// Makes `node` a slider: `drag(event)` while the pointer is held, `step(n)` for arrow and page keys, `end(last)` for Home
// and End.
function slide(node, { drag, step, end, page = 8 }) {
  node.addEventListener("pointerdown", (event) => {
    node.setPointerCapture(event.pointerId);
    node.focus({ preventScroll: true });
    event.preventDefault();
  });
  node.addEventListener("pointermove", (event) => { if (node.hasPointerCapture(event.pointerId)) drag(event); });
  node.addEventListener("keydown", (event) => {
    const by = { ArrowLeft: -1, ArrowDown: -1, ArrowRight: 1, ArrowUp: 1, PageDown: -page, PageUp: page }[event.key];
    if (by === undefined && event.key !== "Home" && event.key !== "End") return;
    event.preventDefault();
    if (by === undefined) end(event.key === "End");
    else step(by);
  });
}
