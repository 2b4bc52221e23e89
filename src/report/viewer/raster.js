// Draws the surface without WebGL: triangles into a picture with a depth for every pixel.

/** An empty picture of this size. */
function newCanvasBuffer(width, height) {
  return {
    width, height, pixels: new ImageData(width, height),
    // 1 / distance of what a pixel shows, and the triangle (from 0) or the site (−2 − number); −1 is nothing
    nearness: new Float32Array(width * height), shown: new Int32Array(width * height).fill(-1),
  };
}

/** Places of points (3 numbers each) in a picture: x and y in pixels, 1 / distance; 0 if not in front. */
function project(points, { width, height }, camera) {
  const m = new THREE.Matrix4().multiplyMatrices(camera.projectionMatrix, camera.matrixWorldInverse).elements;
  const places = new Float32Array(points.length);
  for (let i = 0; i < points.length; i += 3) {
    const [x, y, z] = [points[i], points[i + 1], points[i + 2]];
    const w = m[3] * x + m[7] * y + m[11] * z + m[15];
    if (w <= camera.near) continue;
    places[i] = (0.5 + 0.5 * (m[0] * x + m[4] * y + m[8] * z + m[12]) / w) * width;
    places[i + 1] = (0.5 - 0.5 * (m[1] * x + m[5] * y + m[9] * z + m[13]) / w) * height;
    places[i + 2] = 1 / w;
  }
  return places;
}

/** Colours the pixels of every triangle that lie nearer than what is there. */
function drawSurface(buffer, { vertices, triangles }, camera, { values, scale, threshold }) {
  const { width, height, nearness, shown } = buffer;
  const data = buffer.pixels.data;
  const places = project(vertices, buffer, camera);
  const palette = paletteOf(scale, threshold);
  const eye = camera.position.toArray();
  for (let t = 0; t < triangles.length; t += 3) {
    const [i, j, k] = [triangles[t], triangles[t + 1], triangles[t + 2]];
    const [ax, ay, an] = [places[3 * i], places[3 * i + 1], places[3 * i + 2]];
    const [bx, by, bn] = [places[3 * j], places[3 * j + 1], places[3 * j + 2]];
    const [cx, cy, cn] = [places[3 * k], places[3 * k + 1], places[3 * k + 2]];
    const doubled = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
    if (!an || !bn || !cn || !doubled) continue;
    const isKnown = Number.isFinite(values[i] + values[j] + values[k]);
    const [va, vb, vc] = [values[i], values[j], values[k]].map((v) => (isKnown ? shareOf(v, scale) : 0));
    const shade = 0.6 + 0.4 * facing(vertices, i, j, k, eye);
    const [left, right] = [Math.max(Math.ceil(Math.min(ax, bx, cx) - 0.5), 0), Math.min(Math.max(ax, bx, cx), width)];
    const [top, bottom] = [Math.max(Math.ceil(Math.min(ay, by, cy) - 0.5), 0), Math.min(Math.max(ay, by, cy), height)];
    for (let y = top; y + 0.5 <= bottom; y++) {
      for (let x = left; x + 0.5 <= right; x++) {
        const wb = ((x + 0.5 - ax) * (cy - ay) - (y + 0.5 - ay) * (cx - ax)) / doubled;
        const wc = ((bx - ax) * (y + 0.5 - ay) - (by - ay) * (x + 0.5 - ax)) / doubled;
        const wa = 1 - wb - wc;
        const near = wa * an + wb * bn + wc * cn, at = y * width + x;
        if (wa < 0 || wb < 0 || wc < 0 || near <= nearness[at]) continue;
        nearness[at] = near;
        shown[at] = t / 3;
        const entry = 4 * Math.round((wa * va + wb * vb + wc * vc) * (N_COLOURS - 1));
        for (let c = 0; c < 3; c++) data[4 * at + c] = shade * (isKnown ? palette[entry + c] : VOID[c]);
        data[4 * at + 3] = 255;
      }
    }
  }
}

/** Cosine of the angle between a triangle's normal and the line of sight. */
function facing(v, i, j, k, eye) {
  const [ox, oy, oz] = [v[3 * i], v[3 * i + 1], v[3 * i + 2]];
  const [ax, ay, az] = [v[3 * j] - ox, v[3 * j + 1] - oy, v[3 * j + 2] - oz];
  const [bx, by, bz] = [v[3 * k] - ox, v[3 * k + 1] - oy, v[3 * k + 2] - oz];
  const [nx, ny, nz] = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
  const [ex, ey, ez] = [eye[0] - ox, eye[1] - oy, eye[2] - oz];
  const lengths = Math.sqrt((nx * nx + ny * ny + nz * nz) * (ex * ex + ey * ey + ez * ez));
  return Math.abs(nx * ex + ny * ey + nz * ez) / (lengths || 1);
}

/** Sites as discs where nothing lies before them. */
function drawSites(buffer, sites, siteRadius, camera) {
  const { width, height, nearness, shown } = buffer;
  const data = buffer.pixels.data;
  const places = project(sites.flat(), buffer, camera);
  const pixelsPerRadian = 0.5 * height / Math.tan(camera.fov / 2 / DEGREES);
  sites.forEach((_, site) => {
    const [cx, cy, centre] = places.subarray(3 * site, 3 * site + 3);
    if (!centre) return;
    const near = 1 / (1 / centre - siteRadius);
    const r = Math.max(siteRadius * centre * pixelsPerRadian, 1);
    for (let y = Math.max(Math.ceil(cy - r), 0); y <= Math.min(cy + r, height - 1); y++) {
      for (let x = Math.max(Math.ceil(cx - r), 0); x <= Math.min(cx + r, width - 1); x++) {
        const at = y * width + x;
        if ((x - cx) ** 2 + (y - cy) ** 2 > r * r || near <= nearness[at]) continue;
        nearness[at] = near;
        shown[at] = -2 - site;
        data.set([...SITE, 255], 4 * at);
      }
    }
  });
}

/** The surface as a picture of this size, seen by the view's camera. */
function rasterised(width, height, surface, view, what) {
  const buffer = newCanvasBuffer(width, height);
  view.frame(width, height);
  drawSurface(buffer, surface, view.camera, what);
  if (what.showsSites) drawSites(buffer, surface.sites, view.siteRadius, view.camera);
  return buffer;
}

/** A picture on a canvas, twice as fine as the screen, as `webglPicture` gives it. */
function canvasPicture(canvas, surface, view) {
  let what, buffer, isAsked = false;
  const draw = () => {
    isAsked = false;
    [canvas.width, canvas.height] = [2 * canvas.parentElement.clientWidth, 2 * canvas.parentElement.clientHeight];
    if (!what || !canvas.width || !canvas.height) return;
    buffer = rasterised(canvas.width, canvas.height, surface, view, what);
    canvas.getContext("2d").putImageData(buffer.pixels, 0, 0);
  };
  // many movements may come between two frames of the screen
  const render = () => {
    if (!isAsked) requestAnimationFrame(draw);
    isAsked = true;
  };
  const paint = (asked) => {
    what = asked;
    draw();
  };
  const pick = (x, y) => {
    const at = Math.floor(y * buffer.height) * buffer.width + Math.floor(x * buffer.width);
    const shown = buffer.shown[at] ?? -1;
    if (shown < -1) return { site: -2 - shown };
    return shown < 0 ? {} : { vertex: surface.triangles[3 * shown] };
  };
  return { render, paint, pick, draw };
}
