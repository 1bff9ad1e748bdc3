// Every page with scripts: its data, the theme button, and all details unfolded in print.

const data = JSON.parse(document.getElementById("data").textContent);

const root = document.documentElement;
document.getElementById("theme").addEventListener("click", () => {
  const dark = root.dataset.theme ? root.dataset.theme === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
  root.dataset.theme = dark ? "light" : "dark";
});

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
