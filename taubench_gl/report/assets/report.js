// Puts the parts together: which run, light or dark, everything open on paper.
const data = JSON.parse(document.getElementById("data").textContent);
const state = {
  runs: data.runs, columns: data.columns, features: data.features,
  onFrame: (frame) => plots.show(frame),
  goTo: (frame) => viewer.goTo(frame),
};
const viewer = makeViewer(document.getElementById("viewer"), state);
const plots = makePlots(document.getElementById("plots"), state);
const curves = makeCurves(document.getElementById("curves"), state);

function choose(run) {
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

const root = document.documentElement;
document.getElementById("theme").addEventListener("click", () => {
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
});

const paper = matchMedia("print");
const folded = [];
function unfold(printing) {
  if (printing) {
    for (const part of document.querySelectorAll("details:not([open])")) { part.open = true; folded.push(part); }
  } else {
    while (folded.length) folded.pop().open = false;
  }
}
paper.addEventListener("change", () => unfold(paper.matches));
addEventListener("beforeprint", () => unfold(true));
addEventListener("afterprint", () => unfold(false));

choose(data.runs[0]);
if (paper.matches) unfold(true);
