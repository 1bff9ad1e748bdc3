// The values of one pixel: its reasons with their definitions, and its distances beside the thresholds.

// `info`: {terms, columns}, as in the data of the page.
function makeProbe(info) {
  const box = el("div", { class: "probe", role: "group", "aria-label": "Pixel probe" });
  const head = el("p", { class: "pixelname", "aria-live": "polite" });
  const reasons = el("ul", {});
  const table = el("table", {});
  box.append(head, table, reasons);

  // The distance of a code in words: between two levels.
  function range(levels, code, unit) {
    if (code === 0) return `below ${short(levels.values[0], 3)}${unit}`;
    if (code === levels.values.length) return `${short(levels.values[code - 1], 3)}${unit} or more`;
    const [low, high] = [short(levels.values[code - 1], 3), short(levels.values[code], 3)];
    return low === high ? `about ${low}${unit}` : `${low} to ${high}${unit}`;
  }

  function fill(pixel, run, at) {
    const { word, codes, index } = pixel;
    const found = info.terms.filter((term) => word & term.bits);
    const why = found.filter((term) => !term.quiet);
    const columns = codes && !(word & info.bits.not_comparable) ? run.images.planes.features : [];
    const sky = Boolean(word & info.bits.sky) !== Boolean(word & info.bits.history_sky);
    head.replaceChildren(el("b", {}, `pixel (${pixel.x}, ${pixel.y})`), ` ${why.length ? why.map((term) => term.label).join(", ") : word & info.bits.sky ? "sky: no column discards it" : "reusable: no column discards it"}`);
    reasons.replaceChildren(...found.map((term) => {
      const swatch = el("i", { class: "swatch" });
      swatch.style.background = term.color;
      return el("li", {}, swatch, el("b", {}, term.label), ` ${term.definition}`);
    }));
    table.hidden = !columns.length;
    const rows = columns.map((name) => {
      const levels = run.images.planes.levels[name], code = codes[name][index];
      const unit = info.columns.find((column) => column.name === name).unit ? " m" : "";
      const limit = at[name] === levels.home ? run.thresholds[name] : levels.values[at[name] - 1];
      const over = code >= at[name];
      const surface = (name === "position" || name === "normal") && (sky || word & info.bits.sky);
      const swatch = el("i", { class: "swatch" });
      swatch.style.background = ink(name);
      return el("tr", { "data-probe": name, "data-code": code }, el("th", { scope: "row" }, swatch, " ", name),
        el("td", {}, !surface ? range(levels, code, unit) : sky ? "sky against surface" : "sky"), el("td", {}, short(limit, 4) + unit),
        el("td", { class: over ? "over" : "" }, over ? "discarded" : "reusable"));
    });
    table.replaceChildren(el("thead", {}, el("tr", {}, ...["feature", "distance", "threshold", ""].map((text) => el("th", { scope: "col" }, text)))),
      el("tbody", {}, ...rows));
  }

  return {
    box,
    // `pixel`: {x, y, index, word, codes}, codes may be null; null shows how to use the probe.
    show(pixel, run, at) {
      if (pixel) return fill(pixel, run, at);
      head.textContent = "Point at a pixel or tap it to read its values. Arrow keys move the probe when the image has the focus; a click pins it, Escape releases it.";
      reasons.replaceChildren();
      table.hidden = true;
    },
  };
}
