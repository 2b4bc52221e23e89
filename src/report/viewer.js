// Field maps on the surface: three.js where there is WebGL, two fixed views on a plain canvas where there is not.
// Reads the element #data (vertices, triangles, arrays, sites); needs three.js as a global.
"use strict";
(() => {
  const decode = (text, kind) => new kind(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
  const data = JSON.parse(document.getElementById("data").textContent);
  const vertices = decode(data.vertices, Float32Array);
  const triangles = decode(data.triangles, Uint32Array);
  const arrays = data.arrays.map((a) => ({ ...a, values: decode(a.values, Float32Array) }));
  const element = (id) => document.getElementById(id);
  const stage = element("stage");

  // ---- colour -------------------------------------------------------------------------------------------------
  // Viridis (matplotlib, CC0) at sixteenths.
  const VIRIDIS = ["440154", "481a6c", "472f7d", "414487", "39568c", "31688e", "2a788e", "23888e", "1f988b",
    "22a884", "35b779", "54c568", "7ad151", "a5db36", "d2e21b", "ece51b", "fde725"]
    .map((hex) => [0, 2, 4].map((at) => parseInt(hex.slice(at, at + 2), 16) / 255));
  const VOID = [0.72, 0.72, 0.72];
  const SITE = "#d81b3c";

  /** Colour (sRGB, 0 to 1) of a value between the ends of a range. */
  function colour(value, [low, high]) {
    if (!Number.isFinite(value)) return VOID;
    const share = high > low ? (value - low) / (high - low) : 0.5;
    const at = Math.min(Math.max(share, 0), 1) * (VIRIDIS.length - 1);
    const below = Math.min(Math.floor(at), VIRIDIS.length - 2);
    return VIRIDIS[below].map((c, i) => c + (at - below) * (VIRIDIS[below + 1][i] - c));
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
  function scaleOf(array) {
    const estimates = /_(mean|true)$/;
    const stem = (a) => a.name.replace(estimates, "");
    const comparable = (a) => estimates.test(a.name) && estimates.test(array.name) && stem(a) === stem(array);
    return extent(arrays.filter((a) => a === array || comparable(a)));
  }

  // ---- numbers and the legend ---------------------------------------------------------------------------------
  const format = (v, unit) => {
    if (!Number.isFinite(v)) return "no value";
    const small = v !== 0 && (Math.abs(v) < 1e-3 || Math.abs(v) >= 1e5);
    const text = small ? v.toExponential(2) : String(Number(v.toPrecision(4)));
    return text.replace("-", "−") + (unit ? " " + unit : "");
  };

  /** Round numbers between the ends of a range, about five. */
  function roundNumbers([low, high]) {
    if (!(high > low)) return Number.isFinite(low) ? [low] : [];
    const power = 10 ** Math.floor(Math.log10((high - low) / 4));
    const step = power * [1, 2, 2.5, 5, 10].find((multiple) => multiple * power >= (high - low) / 5);
    const first = Math.ceil(low / step);
    return Array.from({ length: Math.floor(high / step) - first + 1 }, (_, i) => (first + i) * step);
  }

  function drawLegend(array, scale) {
    const stops = VIRIDIS.map((c) => `rgb(${c.map((x) => Math.round(255 * x)).join(" ")})`);
    element("gradient").style.background = `linear-gradient(to top, ${stops.join(", ")})`;
    element("ticks").replaceChildren(...roundNumbers(scale).map((value) => {
      const tick = document.createElement("span");
      const share = scale[1] > scale[0] ? (value - scale[0]) / (scale[1] - scale[0]) : 0.5;
      tick.style.bottom = `${100 * share}%`;
      tick.textContent = format(value, array.unit);
      return tick;
    }));
    const [low, high] = extent([array]);
    const isShared = scale[0] < low || scale[1] > high ? " Mean and truth share one scale." : "";
    const isVoid = array.values.some((v) => !Number.isFinite(v)) ? " Grey: no value." : "";
    element("range").textContent = `min ${format(low, array.unit)}, max ${format(high, array.unit)}.${isShared}${isVoid}`;
  }

  // ---- the size of things -------------------------------------------------------------------------------------
  const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
  vertices.forEach((v, i) => {
    low[i % 3] = Math.min(low[i % 3], v);
    high[i % 3] = Math.max(high[i % 3], v);
  });
  const centre = low.map((l, i) => (l + high[i]) / 2);
  let radius = 0;
  for (let i = 0; i < vertices.length; i += 3) {
    radius = Math.max(radius, Math.hypot(...centre.map((c, axis) => vertices[i + axis] - c)));
  }
  // All sites together cover as much of the surface as this many of full size, so that they do not hide the map.
  const FULL_SIZE = 40;
  const N_SITES = data.sites.length;
  const SITE_RADIUS = 0.025 * radius * Math.min(1, Math.sqrt(FULL_SIZE / Math.max(N_SITES, 1)));
  const sitesAreShown = () => element("sites").checked;

  // ---- with WebGL ---------------------------------------------------------------------------------------------
  /** Builds the scene; returns a function that shows an array. Throws where there is no WebGL. */
  function webgl() {
    const renderer = new THREE.WebGLRenderer({ antialias: true, alpha: true });
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    stage.append(renderer.domElement);

    const geometry = new THREE.BufferGeometry();
    const colours = new THREE.BufferAttribute(new Float32Array(vertices.length), 3);
    geometry.setAttribute("position", new THREE.BufferAttribute(vertices, 3));
    geometry.setAttribute("color", colours);
    geometry.setIndex(new THREE.BufferAttribute(triangles, 1));
    geometry.computeVertexNormals();
    const surface = new THREE.Mesh(geometry, new THREE.MeshLambertMaterial({ vertexColors: true, side: THREE.DoubleSide }));

    const ball = new THREE.SphereGeometry(SITE_RADIUS, ...(N_SITES > 10 * FULL_SIZE ? [8, 6] : [24, 16]));
    const red = new THREE.MeshLambertMaterial({ color: SITE });
    const sites = data.sites.map((at) => {
      const site = new THREE.Mesh(ball, red);
      site.position.fromArray(at);
      return site;
    });

    const camera = new THREE.PerspectiveCamera(32, 1, 0.05 * radius, 20 * radius);
    camera.up.set(0, 0, 1);
    camera.position.fromArray(centre).addScaledVector(new THREE.Vector3(0.45, -1, 0.3).normalize(), 2.9 * radius);
    // Light from the eye: a part of the surface seen from the front has exactly the colour of the legend.
    const eye = new THREE.DirectionalLight(0xffffff, 0.4 * Math.PI);
    camera.add(eye);
    const scene = new THREE.Scene();
    scene.add(surface, ...sites, camera, new THREE.AmbientLight(0xffffff, 0.6 * Math.PI));

    const controls = new THREE.OrbitControls(camera, renderer.domElement);
    controls.target.fromArray(centre);
    controls.update();
    const render = () => renderer.render(scene, camera);
    controls.addEventListener("change", render);
    new ResizeObserver(() => {
      renderer.setSize(stage.clientWidth, stage.clientHeight, false);
      camera.aspect = stage.clientWidth / stage.clientHeight;
      camera.updateProjectionMatrix();
      render();
    }).observe(stage);

    let shown = arrays[0];
    const picker = new THREE.Raycaster();
    renderer.domElement.addEventListener("pointermove", (event) => {
      if (event.buttons) return;
      const box = renderer.domElement.getBoundingClientRect();
      const at = new THREE.Vector2((event.clientX - box.x) / box.width, (event.clientY - box.y) / box.height);
      picker.setFromCamera(at.multiplyScalar(2).subScalar(1).multiply(new THREE.Vector2(1, -1)), camera);
      const hit = picker.intersectObjects([surface, ...(sitesAreShown() ? sites : [])])[0];
      element("readout").textContent = hit ? describe(hit) : "";
    });

    function describe({ object, face, point }) {
      const site = sites.indexOf(object);
      if (site >= 0) return `site ${site}`;
      const distance = (i) => point.distanceTo(new THREE.Vector3().fromBufferAttribute(geometry.attributes.position, i));
      const nearest = [face.a, face.b, face.c].sort((a, b) => distance(a) - distance(b))[0];
      return format(shown.values[nearest], shown.unit);
    }

    return (array, scale) => {
      shown = array;
      sites.forEach((site) => { site.visible = sitesAreShown(); });
      const linear = new THREE.Color();
      array.values.forEach((value, vertex) => {
        linear.setRGB(...colour(value, scale), THREE.SRGBColorSpace).toArray(colours.array, 3 * vertex);
      });
      colours.needsUpdate = true;
      render();
    };
  }

  // ---- without WebGL ------------------------------------------------------------------------------------------
  /** Two orthographic views, triangles painted from far to near; returns a function that shows an array. */
  function flat() {
    element("hint").textContent = "This browser has no WebGL: two fixed views, front and back, instead of a model to turn.";
    const canvas = document.createElement("canvas");
    stage.append(canvas);
    return (array, scale) => paintBoth(canvas, array, scale);
  }

  /** Paints the surface as seen along y, from the front and from the back, side by side. */
  function paintBoth(canvas, array, scale) {
    canvas.width = 2 * canvas.parentElement.clientWidth;
    canvas.height = 2 * canvas.clientHeight;
    paint(canvas.getContext("2d"), array, scale, -1, 0.25 * canvas.width);
    paint(canvas.getContext("2d"), array, scale, 1, 0.75 * canvas.width);
  }

  /** Triangles and sites as seen from the front (side −1) or from the back (side 1), in mm, from far to near. */
  function arrange(side) {
    const project = ([x, y, z]) => [-side * (x - centre[0]), centre[2] - z, side * (y - centre[1])];
    const shapes = data.sites.map((at) => {
      const [x, y, depth] = project(at);
      return { depth: depth + SITE_RADIUS, site: [x, y] };
    });
    for (let t = 0; t < triangles.length; t += 3) {
      const indices = triangles.subarray(t, t + 3);
      const corners = [...indices].map((i) => project(vertices.subarray(3 * i, 3 * i + 3)));
      const depth = corners.reduce((sum, c) => sum + c[2] / 3, 0);
      shapes.push({ depth, indices, corners, shade: 0.6 + 0.4 * facing(corners) });
    }
    return shapes.sort((a, b) => a.depth - b.depth);
  }
  const arranged = new Map();

  /** Paints one of the two views, its middle at the given x. */
  function paint(context, array, scale, side, middle) {
    if (!arranged.has(side)) arranged.set(side, arrange(side));
    const { width, height } = context.canvas;
    const zoom = Math.min(width / 4, height / 2) / (1.02 * radius);
    const place = ([x, y]) => [middle + zoom * x, height / 2 + zoom * y];
    context.lineWidth = 1;
    for (const { site, indices, corners, shade } of arranged.get(side)) {
      if (site && !sitesAreShown()) continue;
      let fill = SITE;
      context.beginPath();
      if (site) {
        context.arc(...place(site), zoom * SITE_RADIUS, 0, 7);
      } else {
        const value = indices.reduce((sum, i) => sum + array.values[i] / 3, 0);
        fill = `rgb(${colour(value, scale).map((c) => Math.round(255 * c * shade)).join(" ")})`;
        corners.forEach((corner, i) => context[i ? "lineTo" : "moveTo"](...place(corner)));
      }
      context.fillStyle = context.strokeStyle = fill;
      context.closePath();
      context.fill();
      context.stroke();
    }
  }

  // ---- small views --------------------------------------------------------------------------------------------
  for (const canvas of document.querySelectorAll("canvas[data-array]")) {
    const array = arrays.find((a) => a.name === canvas.dataset.array);
    const scale = scaleOf(array);
    const [from, to] = scale.map((end) => format(end, ""));
    canvas.nextElementSibling.textContent = `dark ${from} … yellow ${to} ${array.unit}`;
    // one after the other, so that the page is there meanwhile
    setTimeout(() => paintBoth(canvas, array, scale));
  }

  /** Cosine of the angle between a triangle's normal and the line of sight. */
  function facing([o, p, q]) {
    const [a, b] = [p, q].map((corner) => corner.map((x, i) => x - o[i]));
    const normal = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    return Math.abs(normal[2]) / (Math.hypot(...normal) || 1);
  }

  // ---- together -----------------------------------------------------------------------------------------------
  let show;
  try {
    show = webgl();
  } catch {
    stage.replaceChildren();
    show = flat();
  }
  const quantity = element("quantity");
  arrays.forEach((array, i) => quantity.add(new Option(array.unit ? `${array.name} [${array.unit}]` : array.name, i)));
  const update = () => {
    const array = arrays[quantity.value];
    const scale = scaleOf(array);
    drawLegend(array, scale);
    show(array, scale);
  };
  quantity.addEventListener("change", update);
  element("sites").addEventListener("change", update);
  element("site-count").textContent = N_SITES === 1 ? "1 measurement site" : `${N_SITES} measurement sites`;
  element("with-sites").hidden = N_SITES === 0;
  if (arrays.length) update();
})();
