// How much of the surface is at or above a value.

/** Area of every triangle, mm². */
function areasOf({ vertices, triangles }) {
  const areas = new Float64Array(triangles.length / 3);
  for (let t = 0; t < areas.length; t++) {
    const [o, p, q] = [0, 1, 2].map((k) => vertices.subarray(3 * triangles[3 * t + k], 3 * triangles[3 * t + k] + 3));
    const [a, b] = [p, q].map((corner) => [0, 1, 2].map((i) => corner[i] - o[i]));
    areas[t] = 0.5 * Math.hypot(a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]);
  }
  return areas;
}

/** Share of a triangle where what is linear between the values at its corners, in rising order, reaches t. */
function shareOfTriangle([low, middle, high], t) {
  if (t <= low) return 1;
  if (t > high) return 0;
  if (t <= middle) return 1 - (t - low) ** 2 / ((middle - low) * (high - low) || 1);
  return (high - t) ** 2 / ((high - low) * (high - middle) || 1);
}

/** Share of the area that is at or above t, of the triangles that have values, and the share that has them. */
function shareAbove({ triangles }, areas, values, t) {
  let above = 0, known = 0, all = 0;
  areas.forEach((area, i) => {
    all += area;
    const corners = [values[triangles[3 * i]], values[triangles[3 * i + 1]], values[triangles[3 * i + 2]]];
    if (!corners.every(Number.isFinite)) return;
    known += area;
    above += area * shareOfTriangle(corners.sort((a, b) => a - b), t);
  });
  return { above: above / known, known: known / all };
}

/** The same as a sentence. */
function tellShare({ above, known }, value, unit) {
  if (!(known > 0)) return "No value anywhere.";
  const percent = (share) => {
    const text = (100 * share).toFixed(1);
    if (share > 0 && text === "0.0") return "less than 0.1";
    return share < 1 && text === "100.0" ? "more than 99.9" : text;
  };
  const of = known < 1 ? `the area that has values (${percent(known)} % of the surface)` : "the area";
  return `${percent(above)} % of ${of} is at or above ${format(value, unit)}.`;
}
