// The page of a reuse evaluation: a measure of every method over the frames, and its mean against the time of the method.

const chooser = document.getElementById("measure"), definition = document.getElementById("definition");
const framesBox = document.getElementById("frames"), scatterBox = document.getElementById("scatter");
const status = document.getElementById("status");
const area = el("div", { tabindex: "0", role: "application", "aria-label": "Values per frame; the left and right arrow keys select a frame, which the viewer shows" });
const readout = el("p", { class: "readout", "aria-live": "polite" });
framesBox.append(area, readout);

// A measure that follows the class filter of the viewer.
const FILTERED = "classes shown";
let x = null, cursor = null, here = null, picked = -1, atFrame = null;
const viewer = data.images && makeComparison(document.getElementById("viewer"), data.images, data.viewer, (frame) => { atFrame = frame; markFrame(); });
if (viewer) data.measures.push({ name: FILTERED, label: FILTERED, unit: "", better: "lower", doc: `mean ${data.viewer.error} over the pixel classes that the viewer shows` });
const measure = () => data.measures.find((m) => m.name === chooser.value);
const filtered = () => chooser.value === FILTERED;
const values = (method) => (filtered() ? viewer.values(method.label, data.frames) : method.rows[chooser.value]);
// The mean over all frames but the first ones that means leave out.
function mean(method) {
  if (!filtered()) return method.mean[chooser.value];
  const found = values(method).slice(data.viewer.warmup).filter(isNumber);
  return found.length ? found.reduce((a, b) => a + b, 0) / found.length : null;
}

function drawFrames(width) {
  const { unit } = measure(), frames = data.frames;
  const bounds = { left: 60, right: width - 10, top: 26, bottom: 26 + (width < 560 ? 190 : 260) };
  const root = plotRoot(width, bounds.bottom + 34, `${measure().label} of each method over the frames`);
  const first = frames[0], last = frames[frames.length - 1];
  x = first === last ? () => (bounds.left + bounds.right) / 2 : linearScale(first, last, bounds.left, bounds.right);
  const [start, end] = spanOf(data.methods.map(values), measure().better);
  linePanel(root, bounds, {
    start, end, count: 5, format: short, title: `${measure().label}${unit ? `, ${unit}` : ""}`,
    lines: data.methods.map((m) => ({ xs: frames.map(x), values: values(m), color: m.color, dash: m.dash })),
  });
  for (const offset of evenTicks(0, last - first || 1, width < 560 ? 4 : 8)) {
    const frame = first + Math.round(offset);
    if (frame <= last) root.append(text(x(frame), bounds.bottom + 20, frame, { "text-anchor": "middle" }));
  }
  cursor = svg("line", { class: "cursor", y1: bounds.top, y2: bounds.bottom });
  here = svg("line", { class: "shown", y1: bounds.top, y2: bounds.bottom });
  root.append(here, cursor);
  markFrame();
  area.replaceChildren(root);
  pick(picked);
}

// The line at the frame that the viewer shows.
function markFrame() {
  if (!here) return;
  here.setAttribute("visibility", atFrame === null ? "hidden" : "visible");
  if (atFrame !== null) for (const end of ["x1", "x2"]) here.setAttribute(end, x(atFrame));
}

// The values of one frame; the means for -1.
function pick(index) {
  picked = index;
  cursor.setAttribute("visibility", index < 0 ? "hidden" : "visible");
  if (index >= 0) for (const end of ["x1", "x2"]) cursor.setAttribute(end, x(data.frames[index]));
  readout.replaceChildren(el("span", {}, el("b", {}, index < 0 ? "mean" : `frame ${data.frames[index]}`)));
  for (const m of data.methods) {
    readout.append(lineEntry(m.color, m.dash, `${m.label} ${short(index < 0 ? mean(m) : values(m)[index], 4)}`));
  }
}

function drawScatter(width) {
  const timed = data.methods.filter((m) => m.time_ms > 0 && isNumber(mean(m)));
  if (!timed.length) {
    scatterBox.replaceChildren(el("p", { class: "missing" }, "No method has both a time and this measure."));
    status.textContent = "";
    return;
  }
  const height = Math.max(260, Math.round(0.4 * width));
  const bounds = { left: 76, right: width - 20, top: 16, bottom: height - 52 };
  const root = plotRoot(width, height, `${measure().label} against time, one mark per method`, "group");
  const times = timed.map((m) => m.time_ms);
  const at = logScale(Math.min(...times) * 0.7, Math.max(...times) * 1.4, bounds.left, bounds.right);
  const y = linearScale(...spanOf([timed.map(mean)], measure().better), bounds.bottom, bounds.top);
  drawAxes(root, bounds, {
    x: { scale: at, ticks: at.ticks(width < 600 ? 4 : 8), label: "ms per frame, median (log)" },
    y: { scale: y, ticks: y.ticks(5), label: `${measure().label} (${measure().better} is better)` },
  });
  for (const m of timed) {
    const words = `${m.label}: ${measure().label} ${short(mean(m), 4)}, ${short(m.time_ms)} ms per frame; clock: ${data.clock}`;
    addMark(root, { shape: "circle", x: at(m.time_ms), y: y(mean(m)), fill: m.color, label: words, title: m.label, name: m.label },
      () => { status.textContent = words; });
    const right = at(m.time_ms) < 0.75 * width;
    root.append(text(at(m.time_ms) + (right ? 11 : -11), y(mean(m)) + 4, m.label, { "text-anchor": right ? "start" : "end" }));
  }
  scatterBox.replaceChildren(root);
  status.textContent = "Point at a mark, or reach it with Tab and the arrow keys.";
}

for (const m of data.measures) chooser.append(el("option", { value: m.name }, m.label));
selectAlong(area, { positions: () => (x ? data.frames.map(x) : []), current: () => picked, pick, choose: (index) => viewer?.goTo(data.frames[index]) });
walkMarks(scatterBox, (name) => data.methods.find((m) => m.label === name).time_ms);
const redraw = [whenSized(area, drawFrames), whenSized(scatterBox, drawScatter)];
function choose() {
  definition.textContent = measure().doc;
  for (const again of redraw) again();
}
chooser.addEventListener("change", choose);
viewer?.whenFiltered(() => { if (filtered()) choose(); });
choose();
