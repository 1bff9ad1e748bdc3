// Every page with scripts: its data, the theme button, and all details unfolded in print.

const data = JSON.parse(document.getElementById("data").textContent);

const root = document.documentElement;
document.getElementById("theme").addEventListener("click", () => {
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
});

// The height of the bar, below which other parts stick.
const topBar = document.querySelector(".top");
new ResizeObserver(() => root.style.setProperty("--top", `${topBar.offsetHeight}px`)).observe(topBar);

const print = matchMedia("print");
const folded = [];
function unfold(printing) {
  if (printing) {
    for (const part of document.querySelectorAll("details:not([open])")) { part.open = true; folded.push(part); }
  } else {
    while (folded.length) folded.pop().open = false;
  }
}
print.addEventListener("change", () => unfold(print.matches));
addEventListener("beforeprint", () => unfold(true));
addEventListener("afterprint", () => unfold(false));
if (print.matches) unfold(true);

// ---- explanations: a button after the label of each element with a title shows the title, for touch and keys too

const tip = document.createElement("div");
tip.className = "tipbox";
tip.id = "tip";
tip.hidden = true;
tip.setAttribute("role", "status");
document.body.append(tip);
let tipped = null;

function hideTip() {
  if (tipped) tipped.setAttribute("aria-expanded", "false");
  tipped = null;
  tip.hidden = true;
}

function showTip(button, words) {
  hideTip();
  tipped = button;
  button.setAttribute("aria-expanded", "true");
  tip.textContent = words;
  tip.hidden = false;
  const at = button.getBoundingClientRect(), width = document.documentElement.clientWidth;
  const left = Math.max(8, Math.min(at.left - 12, width - tip.offsetWidth - 8));
  const below = at.bottom + tip.offsetHeight + 8 < innerHeight;
  tip.style.left = `${left + scrollX}px`;
  tip.style.top = `${(below ? at.bottom + 6 : at.top - tip.offsetHeight - 6) + scrollY}px`;
}

// A button that shows `words` about `label`.
function tipButton(label, words) {
  const button = document.createElement("button");
  button.type = "button";
  button.className = "tip";
  button.textContent = "?";
  button.setAttribute("aria-label", `What is ${label}?`);
  button.setAttribute("aria-expanded", "false");
  button.setAttribute("aria-controls", "tip");
  button.addEventListener("click", (event) => {
    event.stopPropagation();
    if (tipped === button) hideTip(); else showTip(button, words);
  });
  return button;
}
for (const host of document.querySelectorAll("main [title]:not(button)")) {
  const label = host.matches("dl") ? host.querySelector("dt") : host;
  label.append(" ", tipButton(label.textContent.trim(), host.title));
}
addEventListener("click", hideTip);
addEventListener("resize", hideTip);
addEventListener("keydown", (event) => { if (event.key === "Escape") hideTip(); });
