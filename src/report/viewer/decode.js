// Unpacks the surface and its values, which src/report/packed.rs wrote and describes.

/** The bytes that a text in base64 stands for, inflated. */
async function inflate(text) {
  const characters = atob(text);
  const bytes = new Uint8Array(characters.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = characters.charCodeAt(i);
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** Triangles in the order of the walk, and for each vertex the three earlier ones from which it is guessed. */
function unwalk(bytes, nVertices, nTriangles) {
  const triangles = new Uint32Array(3 * nTriangles);
  const guesses = new Uint32Array(3 * nVertices);
  const gates = [];
  let at = 0, met = 0, filled = 0;
  const read = () => {
    let number = 0;
    for (let shift = 0; ; shift += 7) {
      const byte = bytes[at++];
      number += (byte & 127) * 2 ** shift;
      if (byte < 128) return number;
    }
  };
  const meet = (a, b, c) => {
    guesses.set([a, b, c], 3 * met);
    return met++;
  };
  while (filled < triangles.length) {
    if (gates.length === 0) {
      const corner = () => {
        const code = read(), last = Math.max(met - 1, 0);
        return code === 0 ? meet(last, last, last) : met - code;
      };
      const [a, b, c] = [corner(), corner(), corner()];
      triangles.set([a, b, c], filled);
      filled += 3;
      gates.push([a, b, c], [b, c, a], [c, a, b]);
      continue;
    }
    const [a, b, opposite] = gates.pop();
    const code = read();
    if (code === 0) continue;
    const c = code === 1 ? meet(a, b, opposite) : met + 1 - code;
    triangles.set([b, a, c], filled);
    filled += 3;
    gates.push([a, c, b], [c, b, a]);
  }
  return { triangles, guesses };
}

/** How far the guesses are off, from all low bytes and then all high bytes. */
function offsets(bytes, count) {
  return Int32Array.from({ length: count }, (_, i) => {
    const zigzag = bytes[i] | bytes[count + i] << 8;
    return zigzag >> 1 ^ -(zigzag & 1);
  });
}

const limited = (guess) => Math.min(Math.max(Math.floor(guess + 0.5), 0), 65535);

/** Whole coordinates (3 per vertex): each guessed as the fourth corner of a parallelogram. */
function unpackCoordinates(bytes, guesses) {
  const count = guesses.length / 3;
  const whole = new Float64Array(3 * count);
  for (let axis = 0; axis < 3; axis++) {
    const off = offsets(bytes.subarray(2 * count * axis, 2 * count * (axis + 1)), count);
    for (let i = 0; i < count; i++) {
      const [a, b, opposite] = [0, 1, 2].map((k) => whole[3 * guesses[3 * i + k] + axis]);
      whole[3 * i + axis] = limited(a + b - opposite) + off[i] & 65535;
    }
  }
  return whole;
}

/** Weights (3 per vertex) of the plane through the three earlier vertices, at the vertex. */
function planes(whole, guesses) {
  const weights = new Float64Array(guesses.length);
  for (let i = 0; i < guesses.length; i += 3) {
    const [a, b, c] = [3 * guesses[i], 3 * guesses[i + 1], 3 * guesses[i + 2]];
    let uu = 0, uw = 0, ww = 0, pu = 0, pw = 0;
    for (let axis = 0; axis < 3; axis++) {
      const from = whole[a + axis];
      const u = whole[b + axis] - from, w = whole[c + axis] - from, p = whole[i + axis] - from;
      uu += u * u;
      uw += u * w;
      ww += w * w;
      pu += p * u;
      pw += p * w;
    }
    const determinant = uu * ww - uw * uw;
    const s = (ww * pu - uw * pw) / determinant, t = (uu * pw - uw * pu) / determinant;
    // a thin triangle says nothing about the plane: then as for coordinates
    const isSound = Math.abs(s) < 4 && Math.abs(t) < 4;
    weights.set(isSound ? [1 - s - t, s, t] : [1, 1, -1], i);
  }
  return weights;
}

/** Values (one per vertex), NaN where there is none. */
function unpackValues(bytes, guesses, weights, [smallest, largest]) {
  const count = guesses.length / 3;
  const off = offsets(bytes, count);
  const codes = new Uint16Array(count);
  for (let i = 0, k = 0; i < count; i++, k += 3) {
    const guess = weights[k] * codes[guesses[k]] + weights[k + 1] * codes[guesses[k + 1]]
      + weights[k + 2] * codes[guesses[k + 2]];
    codes[i] = limited(guess) + off[i] & 65535;
  }
  const step = (largest - smallest) / 65534;
  return Float32Array.from(codes, (code) => (code === 0 ? NaN : smallest + (code - 1) * step));
}

/** Everything that the page shows: vertices (mm), triangles, arrays, sites, axes. */
async function decode(data) {
  const { triangles, guesses } = unwalk(await inflate(data.walk), data.n_vertices, data.n_triangles);
  const whole = unpackCoordinates(await inflate(data.coordinates), guesses);
  const weights = planes(whole, guesses);
  const arrays = await Promise.all(data.arrays.map(async ({ name, unit, range, values }) => {
    const inflated = await inflate(values);
    return { name, unit, values: unpackValues(inflated, guesses, weights, range ?? [NaN, NaN]) };
  }));
  const vertices = Float32Array.from(whole, (w, i) => data.corner[i % 3] + w * data.step);
  return { vertices, triangles, arrays, sites: data.sites, axes: data.axes };
}
