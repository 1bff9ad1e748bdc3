// A demo's page: images of the pair in turn, a guess before the number, a parameter that redraws, and one step per screen.

const $ = (id) => document.getElementById(id);

// ---- the pair

const screen = document.querySelector(".screen");
let flickering = 0;

function showScreen(name) {
  screen.dataset.shown = name;
  screen.setAttribute("aria-label", { previous: "Previous frame", current: "Current frame", answer: "Answer in the current frame" }[name]);
  for (const input of document.querySelectorAll("input[name=screen]")) input.checked = input.value === name;
}

function setFlicker(running) {
  clearInterval(flickering);
  flickering = running ? setInterval(() => showScreen(screen.dataset.shown === "previous" ? "current" : "previous"), 500) : 0;
  $("flicker").setAttribute("aria-pressed", String(running));
}

for (const input of document.querySelectorAll("input[name=screen]")) {
  input.addEventListener("change", () => { setFlicker(false); showScreen(input.value); });
}
$("flicker").addEventListener("click", () => setFlicker(!flickering));

// ---- the guess

const asked = data.question, guess = $("guess");
let guessed = false, answered = false;
const guessedNumber = () => asked.low + (guess.value / guess.max) * (asked.high - asked.low);
const withUnit = (number, digits, unit) => `${fixed(number, digits)} ${unit}`.trim();
const showGuess = () => {
  $("guessed").textContent = withUnit(guessedNumber(), asked.guess_digits, asked.unit);
  guess.setAttribute("aria-valuetext", $("guessed").textContent);
};

guess.value = guess.max / 2;
guess.addEventListener("input", () => {
  guessed = true;
  $("reveal").textContent = "Reveal the number";
  showGuess();
  if (answered) reveal();
});
showGuess();

// A line from low to high with the range of theory, the guess and the measured number.
function drawAnswer() {
  const width = Math.min($("answer").clientWidth || 600, 900), height = 84, root = plotRoot(width, height, "Guess, measured number and theory");
  const x = linearScale(asked.low, asked.high, 40, width - 40), within = (value) => clamp(x(value), 40, width - 40);
  root.append(svg("line", { class: "axis", x1: 40, x2: width - 40, y1: 40, y2: 40 }));
  for (const [end, anchor] of [[asked.low, "start"], [asked.high, "end"]]) root.append(text(x(end), 80, `${short(end)} ${asked.unit}`.trim(), { "text-anchor": anchor }));
  const start = within(asked.expected[0]), end = within(asked.expected[1]);
  root.append(svg("rect", { class: "band", x: start - 2, width: Math.max(end - start, 0) + 4, y: 30, height: 20, rx: 3 }));
  root.append(svg("circle", { class: "dot", cx: within(asked.measured), cy: 40, r: 7 }));
  root.append(text(within(asked.measured), 20, "measured", { "text-anchor": "middle" }));
  const at = within(guessedNumber());
  if (guessed) root.append(svg("path", { class: "guessmark", d: `M${at} 52l7 14h-14z` }), text(at, 82, "guess", { "text-anchor": "middle" }));
  return root;
}

// Shows the number, the image of the answer, and all that follows the question (demo.css hides it before).
function reveal() {
  root.classList.add("answered");
  document.querySelector("input[value=answer]").disabled = false;
  $("reveal").hidden = true;
  const words = el("p", {}, el("b", { class: "big" }, asked.text), ` ${asked.meaning}. Theory: ${asked.theory}.`);
  $("answer").replaceChildren(words, drawAnswer());
  if (answered) return;
  answered = true;
  setFlicker(false);
  showScreen("answer");
}

$("reveal").addEventListener("click", reveal);

// ---- the parameter

const p = data.parameter, canvas = $("drawn"), pen = canvas.getContext("2d", { willReadFrequently: true });
const slider = $("value");
let plane = null, base = null;
const pictures = [];

function load(uri) {
  const image = new Image();
  image.src = uri;
  return image.decode().then(() => image);
}

function pixelsOf(image) {
  pen.drawImage(image, 0, 0, canvas.width, canvas.height);
  return pen.getImageData(0, 0, canvas.width, canvas.height);
}

// Paints the image at value i from the stored data; returns the share of marked pixels, percent, or null for images.
function paint(i) {
  if (!plane) { pen.drawImage(pictures[i], 0, 0, canvas.width, canvas.height); return null; }
  const out = new ImageData(new Uint8ClampedArray(base.data), canvas.width, canvas.height);
  let marked = 0;
  for (let at = 0; at < plane.data.length; at += 4) {
    if (plane.data[at] <= i) continue;
    marked += 1;
    out.data[at] = p.mark[0]; out.data[at + 1] = p.mark[1]; out.data[at + 2] = p.mark[2];
  }
  pen.putImageData(out, 0, 0);
  return (400 * marked) / plane.data.length;
}

function drawCurve(width) {
  const height = clamp(Math.round(0.55 * width), 200, 340), area = { left: 62, right: width - 14, top: 32, bottom: height - 50 };
  const root = plotRoot(width, height, `${p.name} against the number`);
  const values = p.values, positive = Math.min(...values) > 0 && Math.max(...values) / Math.min(...values) > 20;
  const x = (positive ? logScale : linearScale)(Math.min(...values), Math.max(...values), area.left + 8, area.right - 8);
  const numbers = [...p.measured, ...p.expected.filter(isNumber)], least = Math.min(0, ...numbers), most = Math.max(...numbers);
  const spread = Math.min(...numbers) > 0 && most / Math.min(...numbers) > 200;
  const y = spread ? logScale(Math.min(...numbers), 1.3 * most, area.bottom, area.top) : linearScale(least, 1.06 * most || 1, area.bottom, area.top);
  drawAxes(root, area, {
    x: { scale: x, ticks: x.ticks(width < 420 ? 4 : 6), label: p.unit ? `${p.name}, ${p.unit}` : p.name },
    y: { scale: y, ticks: y.ticks(5), label: p.number_unit },
  });
  const theory = values.map((value, i) => [value, p.expected[i]]).filter(([, number]) => isNumber(number));
  root.append(svg("path", { class: "line theory", d: theory.map(([value, number], i) => `${i ? "L" : "M"}${x(value)} ${y(number)}`).join("") }));
  values.forEach((value, i) => root.append(svg("circle", { class: "dot", cx: x(value), cy: y(p.measured[i]), r: values.length > 30 ? 2.5 : 4 })));
  const at = Number(slider.value);
  root.append(svg("line", { class: "cursor", x1: x(values[at]), x2: x(values[at]), y1: area.top, y2: area.bottom }));
  root.append(svg("circle", { class: "dot here", cx: x(values[at]), cy: y(p.measured[at]), r: 7 }));
  root.append(text(area.right, 14, "dots: measured, line: theory", { "text-anchor": "end" }));
  $("curve").replaceChildren(root);
}

function setValue() {
  const i = Number(slider.value), counted = paint(i), number = counted ?? p.measured[i];
  $("valued").textContent = p.texts[i];
  slider.setAttribute("aria-valuetext", p.texts[i]);
  canvas.setAttribute("aria-label", `Image at ${p.name} ${p.texts[i]}`);
  const theory = isNumber(p.expected[i]) ? `; theory ${fixed(p.expected[i], p.digits)} ± ${fixed(p.tolerance[i], p.digits)}` : "";
  $("reading").replaceChildren(el("b", {}, withUnit(number, p.digits, p.number_unit)), ` ${p.meaning}${theory}`);
  canvas.dataset.value = String(i);
  redrawCurve();
}

let redrawCurve = () => {};
Promise.all(p.plane ? [load(p.base), load(p.plane)] : p.images.map(load)).then((images) => {
  if (p.plane) { base = pixelsOf(images[0]); plane = pixelsOf(images[1]); } else pictures.push(...images);
  redrawCurve = whenSized($("curve"), drawCurve);
  slider.addEventListener("input", setValue);
  setValue();
});

// ---- one step per screen

const steps = [...document.querySelectorAll(".step")], bar = document.querySelector(".steps");
const asking = steps.findIndex((step) => step.id === "question");
const lectureIn = (hash) => /^#lecture(?:-(\d+))?(?:@(\d+))?(n)?$/.exec(hash);
const opened = lectureIn(location.hash);
let now = -1;  // index of the step; -1 outside a lecture
let started = Number(opened?.[2] ?? 0);  // when the lecture began, milliseconds; the address takes it to the next lesson

const address = (place) => `#lecture${place ? `-${place + 1}` : ""}${data.lecture ? `@${started}` : ""}${root.classList.contains("noted") ? "n" : ""}`;

function go(index) {
  if (!answered) index = Math.min(index, asking);
  const beyond = index < 0 ? data.previous : index >= steps.length ? data.next : null;
  if (beyond) { location.href = beyond + address(0); return; }
  now = clamp(index, 0, steps.length - 1);
  if (flickering && now !== asking) setFlicker(false);
  steps.forEach((step, i) => step.classList.toggle("now", i === now));
  $("place").textContent = `${now + 1} / ${steps.length}`;
  if (!bar.contains(document.activeElement)) steps[now].focus({ preventScroll: true });  // a screen reader reads its name
  scrollTo(0, 0);
  history.replaceState(null, "", address(now));
}

// The next step; on the question first its answer.
function next() {
  if (now === asking && !answered) reveal(); else go(now + 1);
}

function enter(index) {
  started ||= Date.now();
  root.classList.add("lecture");
  bar.hidden = false;
  go(index);
}

function leave() {
  const step = steps[now];
  now = -1;
  root.classList.remove("lecture");
  bar.hidden = true;
  if (document.fullscreenElement) document.exitFullscreen();
  history.replaceState(null, "", "#" + step.id);
  step.scrollIntoView({ behavior: "instant" });
  $("lecture").focus({ preventScroll: true });
}

$("lecture").addEventListener("click", () => {
  enter(0);
  root.requestFullscreen?.().catch(() => {});  // the steps fill the window where full screen is refused
});
$("back").addEventListener("click", () => go(now - 1));
$("on").addEventListener("click", next);
$("leave").addEventListener("click", leave);
document.addEventListener("fullscreenchange", () => { if (!document.fullscreenElement && now >= 0) leave(); });

document.addEventListener("keydown", (event) => {
  if (event.altKey || event.ctrlKey || event.metaKey) return;
  const arrows = event.target.matches("input") && event.key.startsWith("Arrow");  // of the slider or the radio buttons
  const screens = { 1: "previous", 2: "current", 3: answered && "answer" }, lesson = { ArrowRight: data.next, ArrowLeft: data.previous }[event.key];
  if (screens[event.key]) { setFlicker(false); showScreen(screens[event.key]); }
  else if (event.key === "f" || event.key === "F") setFlicker(!flickering);
  else if (event.key === "n" || event.key === "N") setNotes(!root.classList.contains("noted"));
  else if (now < 0 || arrows) return;
  else if (event.shiftKey && lesson) location.href = lesson + address(0);
  else if (event.key === "ArrowRight" || event.key === "PageDown") next();
  else if (event.key === "ArrowLeft" || event.key === "PageUp") go(now - 1);
  else if (event.key === "Home" && !event.target.matches("input")) go(0);
  else if (event.key === "End" && !event.target.matches("input")) go(steps.length - 1);
  else if (event.key === "Escape") leave();
  else return;
  event.preventDefault();
});

// ---- notes for the speaker, with the minutes since the lecture began

function setNotes(shown) {
  root.classList.toggle("noted", shown && data.lecture);
  if (now >= 0) history.replaceState(null, "", address(now));
}

setInterval(() => {
  const seconds = Math.floor((Date.now() - started) / 1000), clock = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
  if (now >= 0) for (const part of document.querySelectorAll(".clock")) part.textContent = `; now ${clock}`;
}, 1000);

setNotes(Boolean(opened?.[3]));
if (opened) enter(Number(opened[1] ?? 1) - 1);
addEventListener("hashchange", () => {  // typed, or a link: go() replaces the address without this event
  const typed = lectureIn(location.hash);
  if (typed) enter(Number(typed[1] ?? 1) - 1);
});
