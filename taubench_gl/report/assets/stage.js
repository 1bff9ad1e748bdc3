// Parts of image viewers: images loaded on demand, a divider between two images, and a slider over frames that plays.

// A function (key, uri, what) that loads an image once; the last `most` are kept.  A damaged image is an error that
// names `what`.
function imageLoader(most) {
  const cache = new Map();
  return (key, uri, what) => {
    if (!cache.has(key)) {
      const image = new Image();
      // Not decode(): the load event of the page waits for this image, so a page printed at once shows it.
      cache.set(key, new Promise((done, failed) => {
        image.onload = () => done(image);
        image.onerror = () => failed(new Error(`${what} is damaged`));
        image.src = uri;
      }));
      if (cache.size > most) cache.delete(cache.keys().next().value);
    }
    return cache.get(key);
  };
}

// The bytes of an image, 4 per pixel.
function pixelsOf(image, width, height) {
  const canvas = new OffscreenCanvas(width, height);
  const pen = canvas.getContext("2d", { willReadFrequently: true });
  pen.drawImage(image, 0, 0);
  return pen.getImageData(0, 0, width, height).data;
}

// A divider on `stage`: an element with the position `at`, 0 .. 1 of the width; `moved()` runs after a change.
function makeDivider(stage, moved) {
  const divider = el("div", {
    class: "divider", tabindex: "0", role: "slider", "aria-label": "Divider between the two images",
    "aria-valuemin": "0", "aria-valuemax": "100",
  });
  divider.at = 0.5;
  divider.place = () => {
    divider.style.left = `${100 * divider.at}%`;
    divider.setAttribute("aria-valuenow", Math.round(100 * divider.at));
  };
  const move = (value) => {
    divider.at = clamp(value, 0, 1);
    divider.place();
    moved();
  };
  slide(divider, {
    drag: (event) => {
      const area = stage.getBoundingClientRect();
      move((event.clientX - area.left) / area.width);
    },
    step: (by) => move(divider.at + 0.02 * by),
    end: (last) => move(last ? 1 : 0),
    page: 5,
  });
  divider.place();
  return divider;
}

// A play button, a slider and a caption.  `go(index)` shows a frame; `milliseconds` between frames while playing.
// `set(count, index)`: for a series of `count` frames; `show(index, caption)` after a frame is shown; `play()`; `stop()`.
function makeScrubber(go, milliseconds = 160) {
  const slider = el("input", { type: "range", id: "frame", min: "0", value: "0", "aria-label": "Frame" });
  const caption = el("output", { for: "frame" });
  const play = el("button", { type: "button", "aria-label": "Play" }, "▶");
  let count = 0, timer = 0;
  const stop = () => {
    clearInterval(timer);
    timer = 0;
    play.textContent = "▶";
    play.setAttribute("aria-label", "Play");
  };
  slider.addEventListener("input", () => go(Number(slider.value)));
  play.addEventListener("click", () => {
    if (timer) return stop();
    timer = setInterval(() => go((Number(slider.value) + 1) % count), milliseconds);
    play.textContent = "❚❚";
    play.setAttribute("aria-label", "Pause");
  });
  return {
    stop, play: () => { if (!timer) play.click(); }, bar: el("div", { class: "bar" }, play, slider, caption),
    set(number) { count = number; slider.max = number - 1; },
    show(index, words) {
      slider.value = index;
      caption.textContent = words;
      slider.setAttribute("aria-valuetext", words);
    },
  };
}
