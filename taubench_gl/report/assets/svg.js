// Small helpers: elements, numbers, scales and axes.
const NS = "http://www.w3.org/2000/svg";

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

function svg(tag, attributes, ...children) {
  const node = document.createElementNS(NS, tag);
  for (const [name, value] of Object.entries(attributes || {})) {
    if (value !== null && value !== undefined) node.setAttribute(name, value);
  }
  node.append(...children);
  return node;
}

function percent(value) {
  if (value === null || value === undefined || !isFinite(value)) return "–";
  if (value > 0 && value < 0.005) return "<0.01 %";
  return value.toFixed(2) + " %";
}

function short(value, digits = 3) {
  if (value === null || value === undefined || !isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  if (size >= 1000) return value.toFixed(0);
  if (size < 0.0001) return value.toExponential(1).replace("e-", "e−");
  return String(Number(value.toPrecision(digits)));
}

function linear(from, to, a, b) {
  const span = to - from || 1;
  return (value) => a + ((value - from) / span) * (b - a);
}

// Round steps: about `count` of them from 0 to `end`.
function ticks(end, count) {
  if (!(end > 0)) return [0];
  const raw = end / count;
  const power = Math.pow(10, Math.floor(Math.log10(raw)));
  const step = [1, 2, 5, 10].map((m) => m * power).find((s) => s >= raw * 0.999);
  const found = [];
  for (let i = 0; i * step <= end * 1.0001; i++) found.push(Number((i * step).toPrecision(12)));
  return found;
}

function dash(style) {
  return { "-": null, "--": "7 4", "-.": "8 3 2 3", ":": "2 4" }[style];
}

function ink(name) {
  return `var(--c-${name})`;
}

// A path through the points that are numbers; a gap where one is not.
function path(xs, ys) {
  let text = "";
  let pen = false;
  for (let i = 0; i < xs.length; i++) {
    const good = isFinite(xs[i]) && ys[i] !== null && isFinite(ys[i]);
    if (good) text += `${pen ? "L" : "M"}${xs[i].toFixed(2)} ${ys[i].toFixed(2)}`;
    pen = good;
  }
  return text;
}

function clamp(value, low, high) {
  return Math.min(high, Math.max(low, value));
}

// Calls `draw(width)` now and whenever the box gets another width.
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
