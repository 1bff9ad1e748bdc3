// The reusable surface pixels at the thresholds of the page, from the stored distances of every frame with images: the
// sentence, the rates and the bars of the reasons.  The words are those of report/reusable.py and run.html.

const KEPT_BYTES = 2 ** 27; // of decoded frames, so that dragging does not decode them again
const SLICE_MS = 12;

// Pixels per reason word, of each frame at the thresholds in use: {frames: [{pixels, counts: [[word, pixels]]}], unknown,
// damaged}.  Null once `wanted()` is false; `progress(done)` runs after each frame.
async function countFrames(run, bits, wanted, progress) {
  const set = run.images, kept = (run.decoded ||= new Map()), out = { frames: [], unknown: 0, damaged: 0 };
  const most = KEPT_BYTES / (set.width * set.height * (set.planes.names.length + 2));
  let since = performance.now();
  for (let i = 0; i < set.items.length; i++) {
    const stored = kept.get(i) || (await storedFrame(set, i, bits).catch(() => ({ codes: null })));
    if (kept.size < most) kept.set(i, stored);
    if (performance.now() - since > SLICE_MS) {
      progress(i);
      await new Promise((done) => setTimeout(done));
      since = performance.now();
    }
    if (!wanted()) return null;
    if (!stored.codes) { out.damaged++; continue; }
    const { words, unknown } = wordsAt(stored.words, stored.codes, set.planes, run.at, bits);
    const counts = [...countWords(words).entries()].filter(([, pixels]) => pixels);
    out.frames.push({ pixels: words.length, counts });
    out.unknown |= unknown;
  }
  return out;
}

// Totals over the frames in % of surface pixels: {rates: {rate: {mean, low, high, whole}}, rate, sky, shares: {reason: %}},
// where `whole` and `sky` are in % of all pixels, and `rate` is the one that the disjoint reasons refer to, null where no
// pixel shows a surface.
function summarizeFrames(frames, run, state) {
  const { sky } = state.bits, total = (values) => values.reduce((sum, v) => sum + v, 0);
  const pixelsOf = (frame, without) => total(frame.counts.map(([word, n]) => (word & without ? 0 : n)));
  const rates = {}, surface = frames.map((f) => pixelsOf(f, sky)), surfaces = total(surface), pixels = total(frames.map((f) => f.pixels));
  let last = null;
  for (const reason of surfaces ? run.reasons.filter((r) => r.of) : []) {
    const kept = frames.map((f) => pixelsOf(f, sky | reason.bits));
    const shares = kept.map((n, i) => (100 * n) / surface[i]).filter((_, i) => surface[i]);
    rates[reason.of] = { mean: (100 * total(kept)) / surfaces, low: Math.min(...shares), high: Math.max(...shares), whole: (100 * total(kept)) / pixels };
    last = reason;
  }
  if (!last) return { rates, rate: null };
  const terms = state.reuse.terms.filter((term) => last.of === "shading" || !term.light);
  const shares = Object.fromEntries(terms.map((term) => [term.name, 0]));
  for (const frame of frames) {
    for (const [word, pixels] of frame.counts) {
      if (word & sky || !(word & last.bits)) continue;
      shares[terms.find((term) => word & term.bits).name] += (100 * pixels) / surfaces;
    }
  }
  return { rates, rate: last.of, sky: (100 * (pixels - surfaces)) / pixels, shares };
}

// report/reusable.py, sentence.
function reuseSentence(found, reuse) {
  const text = rateAndReasons(found, reuse), by = found.rate === "shading" ? text : `by geometry ${text} (light was not measured)`;
  return found.sky ? `${by}; sky fills ${percentText(found.sky)} of the image` : by;
}
function rateAndReasons({ rates, rate, shares }, { terms, merged }) {
  const share = rates[rate].mean, text = `${percentText(share)} of surface pixels can be reused`;
  const groups = new Map();
  for (const { name } of terms) {
    const group = merged.find((names) => names.includes(name)) || [name];
    groups.set(group.join(), (groups.get(group.join()) || 0) + (shares[name] || 0));
  }
  const ranked = [...groups].filter(([, s]) => s > 0).sort((a, b) => b[1] - a[1]);
  if (!ranked.length) return text;
  const named = ranked.length === 3 ? ranked : ranked.slice(0, 2);
  const label = (key) => key.split(",").filter((name) => shares[name]).map((name) => terms.find((t) => t.name === name).label).join(" or ");
  const reasons = named.map(([key, s]) => `${label(key)} (${percentText(s)})`).join(" or ");
  const covered = named.reduce((sum, [, s]) => sum + s, 0) / Math.max(100 - share, 1e-30);
  if (named.length === ranked.length) return `${text}; the rest is ${reasons}`;
  return covered > 0.5 ? `${text}; most of the rest is ${reasons}` : `${text}; the largest reasons are ${reasons}`;
}
function percentText(value) {
  if (value > 0 && value < 0.05) return "less than 0.1 %";
  if (value >= 99.95 && value < 100) return "more than 99.9 %";
  return `${fixed(value, value === 0 || value === 100 ? 0 : 1)} %`;
}

// The bars of run.html: the disjoint reasons, the largest first, and the line below them.
function reasonBars({ shares }, { terms }) {
  const rows = terms.filter(({ name }) => shares[name] > 0).sort((a, b) => shares[b.name] - shares[a.name]);
  const most = rows.length ? shares[rows[0].name] : 1;
  const table = el("table", { class: "bars", "aria-label": "Why pixels are not reusable" }, el("tbody", {}, ...rows.map(({ name, label, color }) => {
    const bar = el("i");
    bar.style.width = `${(100 * shares[name]) / most}%`;
    bar.style.background = color;
    return el("tr", {}, el("th", { scope: "row" }, label), el("td", {}, `${exact(shares[name])} %`), el("td", { class: "bar" }, bar));
  })));
  const words = rows.length ? "Why surface pixels are not reusable, % of surface pixels. A pixel counts once, under its first reason." : "Every surface pixel is reusable.";
  return [...(rows.length ? [table] : []), el("figcaption", { class: "muted" }, words)];
}
function exact(value) { return value > 0 && value < 0.005 ? "<0.01" : fixed(value, 2); }

// Links the sentence of a run in `answer` and its rates and bars in `box`: thresholds() counts again; at the thresholds of
// the run it shows the recorded values.
function makeHeadline(answer, box, run, state) {
  const note = el("p", { class: "muted live", role: "status", hidden: true });
  const sentence = answer.querySelector(".sentence"), figure = box.querySelector(".reasons");
  sentence.after(note);
  sentence.setAttribute("aria-live", "polite");
  const parts = [sentence, figure, ...box.querySelectorAll("[data-rate] dd, .sky .big")];
  const recorded = parts.map((part) => [...part.childNodes]);
  let turn = 0;

  function coverage({ frames, unknown, damaged }) {
    const set = run.images, bits = state.bits, lines = [];
    lines.push(frames.length === run.pairs ? `At these thresholds, mean of ${frames.length === 1 ? "the pair" : `all ${frames.length} pairs`}`
      : `At these thresholds, mean of the ${frames.length} of ${run.pairs} pairs with images${run.sampled ? ", all with one weight" : ""}`);
    if (set.step > 1) lines[0] += `, one of ${set.step} rows and columns`;
    if (run.preview) lines.push("Light is that of the preview");
    if (damaged) lines.push(`The distances of ${damaged} frames are damaged`);
    if (unknown & bits.disoccluded) lines.push("So far below the threshold of the run, disoccluded and newly occluding pixels count as changed in position");
    if (unknown & bits.lit) lines.push("So far below the threshold of the run, brightened and darkened pixels count as changed in light color");
    return `${lines.join(". ")}.`;
  }

  function show(counted) {
    const found = summarizeFrames(counted.frames, run, state);
    if (!found.rate) { note.textContent = "No pixel of the frames with images shows a surface."; return; }
    const line = `${reuseSentence(found, state.reuse)}.`;
    sentence.textContent = line[0].toUpperCase() + line.slice(1);
    for (const [rate, { mean, low, high, whole }] of Object.entries(found.rates)) {
      const of = box.querySelector(`[data-rate="${rate}"]`);
      of.querySelector(".big").replaceChildren(exact(mean), el("small", {}, " %"));
      of.querySelector(".range").textContent = `${exact(low)} to ${exact(high)} %`;
      of.querySelector(".of-all").textContent = `${exact(whole)} % of all pixels`;
    }
    box.querySelector(".sky .big").replaceChildren(exact(found.sky), el("small", {}, " %"));
    figure.replaceChildren(...reasonBars(found, state.reuse));
    note.textContent = coverage(counted);
  }

  return {
    async thresholds() {
      const mine = ++turn, wanted = () => mine === turn;
      const moved = run.moved();
      note.hidden = !moved;
      for (const part of [answer, box]) part.classList.toggle("counting", moved);
      delete box.dataset.counted;
      if (!moved) { parts.forEach((part, i) => part.replaceChildren(...recorded[i])); return; }
      const total = run.images.items.length;
      const counted = await countFrames(run, state.bits, wanted, (done) => { if (wanted()) note.textContent = `Counting frame ${done + 1} of ${total} at these thresholds.`; });
      if (!counted) return;
      if (counted.frames.length) show(counted); else note.textContent = "These values are at the thresholds of the run: the distances of its frames are damaged.";
      for (const part of [answer, box]) part.classList.remove("counting");
      box.dataset.counted = counted.frames.length;
    },
  };
}
