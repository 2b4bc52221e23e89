// Colours, the ranges that they cover, and how numbers are written.

// Viridis (matplotlib, CC0) at sixteenths.
const VIRIDIS = ["440154", "481a6c", "472f7d", "414487", "39568c", "31688e", "2a788e", "23888e", "1f988b",
  "22a884", "35b779", "54c568", "7ad151", "a5db36", "d2e21b", "ece51b", "fde725"]
  .map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16)));
const VOID = [184, 184, 184];
const FADED = [226, 226, 226];
const SITE = [216, 27, 60];
/** Entries of a palette: a threshold is drawn as sharp as this part of the range. */
const N_COLOURS = 1024;

/** Colour (sRGB, 0 to 255) at a share of the scale. */
function colour(share) {
  const at = share * (VIRIDIS.length - 1);
  const below = Math.min(Math.floor(at), VIRIDIS.length - 2);
  return VIRIDIS[below].map((c, i) => c + (at - below) * (VIRIDIS[below + 1][i] - c));
}

/** Where a value stands between the ends of a range, 0 to 1. */
function shareOf(value, [low, high]) {
  return high > low ? Math.min(Math.max((value - low) / (high - low), 0), 1) : 0.5;
}

/** RGBA of every colour of a scale; those on the far side of a threshold, if there is one, are faded. */
function paletteOf([low, high], threshold) {
  const palette = new Uint8Array(4 * N_COLOURS);
  for (let i = 0; i < N_COLOURS; i++) {
    const share = i / (N_COLOURS - 1);
    const isFaded = threshold?.fades
      && (low + share * (high - low) < threshold.value) === (threshold.fades === "below");
    const own = colour(share);
    palette.set(isFaded ? own.map((c, k) => 0.12 * c + 0.88 * FADED[k]) : own, 4 * i);
    palette[4 * i + 3] = 255;
  }
  return palette;
}

/** Smallest and largest finite value of some arrays. */
function extent(list) {
  let [low, high] = [Infinity, -Infinity];
  for (const { values } of list) {
    for (const v of values) {
      if (v < low) low = v;
      if (v > high) high = v;
    }
  }
  return low <= high ? [low, high] : [NaN, NaN];
}

/** A mean and the truth that it estimates share one scale, so that their colours can be compared. */
function areComparable(a, b) {
  const estimates = /_(mean|true)$/;
  const stem = ({ name }) => name.replace(estimates, "");
  const areBoth = estimates.test(a.name) && estimates.test(b.name);
  return a === b || areBoth && a.unit === b.unit && stem(a) === stem(b);
}

const scaleOf = (array, arrays) => extent(arrays.filter((other) => areComparable(array, other)));

/** A number with four digits and its unit. */
function format(v, unit) {
  if (!Number.isFinite(v)) return "no value";
  const isSmall = v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5);
  const text = isSmall ? v.toExponential(2) : String(Number(v.toPrecision(4)));
  return text.replace("-", "−") + (unit ? " " + unit : "");
}

const titleOf = ({ name, unit }) => (unit ? `${name} [${unit}]` : name);

/** Round numbers between the ends of a range, about five. */
function roundNumbers([low, high]) {
  if (!(high > low)) return Number.isFinite(low) ? [low] : [];
  const power = 10 ** Math.floor(Math.log10((high - low) / 4));
  const step = power * [1, 2, 2.5, 5, 10].find((multiple) => multiple * power >= (high - low) / 5);
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => (first + i) * step);
}
