// The run page: the choice of the run, and what links the headlines, the frame viewer, the plots over time
// and the threshold curves.

// Prepares the runs: `at` are the codes of the thresholds in use (planes.js), `counts` the pixels per code once read.
for (const run of data.runs) {
  const planes = run.images && run.images.planes;
  run.at = Object.fromEntries(planes ? planes.features.map((name) => [name, planes.levels[name].home]) : []);
  run.counts = null;
  run.moved = () => Object.entries(run.at).some(([name, code]) => code !== planes.levels[name].home);
}

const state = {
  runs: data.runs, columns: data.columns, features: data.features, bits: data.bits, terms: data.terms, reuse: data.reuse,
  onFrame(frame) { plots.show(frame); curves.showFrame(frame); },
  onPair(frame) { curves.showFrame(frame); },
  onStops(lines) { viewer.setStops(lines); },
  onStop(name, index, words) { viewer.showStop(name, index, words); },
  onPixel(pixel) { curves.showPixel(pixel); },
  onThresholds() { viewer.thresholds(); plots.thresholds(); headlines.get(chosen).thresholds(); },
  goTo: (frame) => viewer.goTo(frame),
};
const headlines = new Map(data.runs.map((run, i) => [run, makeHeadline(document.querySelectorAll(".answer")[i], document.querySelectorAll(".headline")[i], run, state)]));
const viewer = makeViewer(document.getElementById("viewer"), state);
const plots = makePlots(document.getElementById("plots"), state);
const curves = makeCurves(document.getElementById("curves"), state);

let chosen = data.runs[0];
function choose(run) {
  chosen = run;
  plots.setRun(run);
  viewer.setRun(run);
  curves.setRun(run);
}

if (data.runs.length > 1) {
  const select = document.getElementById("run");
  data.runs.forEach((run, i) => select.append(el("option", { value: i }, run.label)));
  select.addEventListener("change", () => choose(data.runs[Number(select.value)]));
  document.getElementById("run-choice").hidden = false;
}
choose(chosen);
if (data.play && !matchMedia("(prefers-reduced-motion: reduce)").matches) viewer.play();

// The counts of the distances arrive later; until then sliders stop at the edges of the recorded bins.
for (const run of data.runs) {
  const planes = run.images && run.images.planes;
  if (!planes) continue;
  readCounts(planes).then((counts) => {
    if (counts.pairs !== run.rows.frame.length) throw new Error("damaged");
    run.counts = counts;
  }).catch(() => {
    run.images.no_planes = "Masks stay at the thresholds of the run: the counts of the distances are damaged, or this browser cannot inflate them.";
  }).finally(() => { if (run === chosen) { curves.setRun(run); viewer.thresholds(); } });
}
