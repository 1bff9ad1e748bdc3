// Distances of every pixel as codes (report/distance_planes.py): decoding, and reason words at other thresholds.  A pixel
// exceeds the level with the code j where its own code is at least j; `at` maps features to such codes.

// Inflates base64 text.  Returns a promise of an ArrayBuffer.
function inflated(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
}

// The pixels at or above each code, of every pair: above(feature, code, pair), or of all pairs without `pair`.
async function readCounts(planes) {
  const codes = new Uint32Array(await inflated(planes.counts));
  const rows = codes.length / 256;
  const sums = new Float64Array(codes.length);
  for (let row = 0; row < rows; row++) {
    for (let code = 255, sum = 0; code >= 0; code--) sums[256 * row + code] = sum += codes[256 * row + code];
  }
  const features = planes.features.length, pairs = rows / features;
  const total = new Float64Array(256 * features);
  for (let i = 0; i < sums.length; i++) total[i % total.length] += sums[i];
  return {
    pairs,
    above(feature, code, pair) {
      const at = 256 * planes.features.indexOf(feature) + code;
      return pair === undefined ? total[at] : sums[256 * features * pair + at];
    },
  };
}

// Codes of one frame: {step, color, position, ..., depth, signs}, each a Uint8Array with an entry per pixel.
function decodePlanes(image, planes, step, width, height) {
  const parts = Math.ceil(planes.names.length / 3);
  const bytes = pixelsOf(image, width, parts * height);
  const found = { step };
  planes.names.forEach((name, k) => {
    const levels = planes.levels[name === "depth" ? "position" : name];
    let codes = Uint8Array.from({ length: 256 }, (_, i) => i);
    if (levels) {
      const low = name === "depth" ? levels.near[step] : 0;
      codes = Uint8Array.from([0, ...levels.kept[step].filter((code) => code >= low)]);
    }
    const plane = (found[name] = new Uint8Array(width * height));
    const start = 4 * Math.floor(k / 3) * width * height + (k % 3);
    for (let i = 0; i < plane.length; i++) plane[i] = codes[bytes[start + 4 * i]];
  });
  return found;
}

// Whether codes give the reason words of the run at its thresholds.
function planesFit(codes, words, planes, bits) {
  return planes.features.every((name) => {
    const plane = codes[name], bit = bits.features[name], home = planes.levels[name].home;
    for (let i = 0; i < words.length; i++) {
      if (!(words[i] & bits.not_comparable) && plane[i] >= home !== Boolean(words[i] & bit)) return false;
    }
    return true;
  });
}

// Reason words at the levels `at`: {words, unknown}, where `unknown` are bits that these planes do not tell.
function wordsAt(words, codes, planes, at, bits) {
  const found = Uint32Array.from(words);
  const { position, direct } = planes.levels;
  const depth = at.position >= position.near[codes.step] && at.position;
  const luminance = direct && at.direct >= direct.near[codes.step] && at.direct;
  const features = planes.features.map((name) => [codes[name], at[name], bits.features[name]]);
  const kept = ~(features.reduce((sum, [, , bit]) => sum | bit, bits.disoccluded | bits.occluding | (direct ? bits.lit | bits.shadowed : 0)));
  const { nearer, rose, fell } = planes.signs;
  for (let i = 0; i < found.length; i++) {
    let word = found[i];
    if (word & bits.not_comparable) continue;
    word &= kept;
    for (const [plane, code, bit] of features) if (plane[i] >= code) word |= bit;
    const signs = codes.signs[i];
    if (depth && codes.depth[i] >= depth) word |= signs & nearer ? bits.disoccluded : bits.occluding;
    if (luminance && codes.direct[i] >= luminance) word |= signs & rose ? bits.lit : signs & fell ? bits.shadowed : 0;
    found[i] = word;
  }
  let unknown = depth ? 0 : bits.disoccluded | bits.occluding;
  if (direct && !luminance) unknown |= bits.lit | bits.shadowed;
  return { words: found, unknown };
}

// Pixels per reason word.
function countWords(words) {
  const counts = new Uint32Array(1 + words.reduce((most, word) => Math.max(most, word), 0));
  for (let i = 0; i < words.length; i++) counts[words[i]]++;
  return counts;
}

// Pixels whose reason word `has` something.
function pixelsWith(counts, has) {
  let sum = 0;
  for (let word = 0; word < counts.length; word++) if (counts[word] && has(word)) sum += counts[word];
  return sum;
}

// ---- images of one frame of a run: part "frame", "previous", "mask" or "planes"

function framePart(set, index, part) {
  if (!set.load) set.load = imageLoader(90);
  const item = set.items[index];
  return set.load(part + item.n, item[part], `${part} of frame ${item.n}`);
}

// Reason words and distances of a frame: {words, codes}; codes are null where they are not stored or damaged.
async function storedFrame(set, index, bits) {
  const { width, height, planes } = set;
  const [mask, packed] = await Promise.all([framePart(set, index, "mask"), planes ? framePart(set, index, "planes").catch(() => null) : null]);
  const bytes = pixelsOf(mask, width, height);
  const words = new Uint32Array(width * height);
  for (let i = 0; i < words.length; i++) words[i] = bytes[4 * i] | (bytes[4 * i + 1] << 8) | (bytes[4 * i + 2] << 16);
  const codes = packed && decodePlanes(packed, planes, planes.steps[set.items[index].n], width, height);
  return { words, codes: codes && planesFit(codes, words, planes, bits) ? codes : null };
}
