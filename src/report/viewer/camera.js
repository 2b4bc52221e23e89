// The one camera of all views: standard views, keys, pointer and touch, and words for where it stands.

/** Middle and radius of the surface, mm. */
function measure(vertices) {
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
  return { centre, radius };
}

// Standard views: key, name, and where the camera stands as azimuth (0 at −y, 90 at +x) and elevation, degrees.
const ANATOMICAL = [
  ["A", "anterior: from the front", 0, 0], ["P", "posterior: from the back", 180, 0],
  ["L", "from the patient's left", 90, 0], ["R", "from the patient's right", -90, 0],
  ["S", "superior: from the head, the back at the top", 0, 90],
  ["I", "inferior: from the feet, the front at the top", 0, -90],
];
const BY_AXES = [
  ["+x", "from +x", 90, 0], ["−x", "from −x", -90, 0], ["+y", "from +y", 180, 0], ["−y", "from −y", 0, 0],
  ["+z", "from +z", 0, 90], ["−z", "from −z", 0, -90],
];
// What lies towards +x, −x, +y, −y, +z, −z.
const SIDES = {
  patient: ["the left", "the right", "the back", "the front", "above", "below"],
  unknown: ["+x", "−x", "+y", "−y", "+z", "−z"],
};
// distances are in radii of the surface
const HOME = { azimuth: 24.2, elevation: 15.3, distance: 2.9 };
const [NEAREST, FARTHEST] = [0.3, 12];
const DEGREES = 180 / Math.PI;

/** A camera around the surface. `onTurn` is called after each movement. */
function newCamera({ vertices, axes }, onTurn) {
  const { centre, radius } = measure(vertices);
  const camera = new THREE.PerspectiveCamera(32, 1, 0.05 * radius, 20 * radius);
  const target = new THREE.Vector3().fromArray(centre);
  const controls = [];
  camera.up.set(0, 0, 1);

  const place = ({ azimuth, elevation, distance }) => {
    const [a, e] = [azimuth / DEGREES, Math.min(Math.max(elevation, -89.999), 89.999) / DEGREES];
    const r = radius * Math.min(Math.max(distance, NEAREST), FARTHEST);
    camera.position.set(Math.sin(a) * Math.cos(e), -Math.cos(a) * Math.cos(e), Math.sin(e));
    camera.position.multiplyScalar(r).add(target);
    camera.lookAt(target);
    controls.forEach((control) => control.update());
    onTurn();
  };
  const direction = () => camera.position.clone().sub(target);
  const where = () => {
    const [x, y, z] = direction().toArray(), r = Math.hypot(x, y, z);
    return { azimuth: Math.atan2(x, -y) * DEGREES, elevation: Math.asin(z / r) * DEGREES, distance: r / radius };
  };
  const turn = (azimuth, elevation) => {
    const at = where();
    place({ azimuth: at.azimuth + azimuth, elevation: at.elevation + elevation, distance: at.distance });
  };
  const zoom = (factor) => place({ ...where(), distance: where().distance * factor });
  const reset = () => {
    target.fromArray(centre);
    place(HOME);
  };
  const standard = axes === "patient" ? ANATOMICAL : BY_AXES;
  const stand = ([, , azimuth, elevation]) => place({ azimuth, elevation, distance: where().distance });

  /** Where the camera stands, in words. */
  const tell = () => {
    const along = direction().normalize().toArray();
    const parts = along.map((share, axis) => [Math.abs(share), SIDES[axes][2 * axis + (share < 0)]]);
    const named = parts.filter(([share]) => share > 0.2).sort(([a], [b]) => b - a);
    return "from " + named.map(([, side]) => side).join(", ");
  };

  /** What a key does; none for keys that are not the view's. */
  const actionOf = ({ key, shiftKey }) => {
    const step = shiftKey ? 2 : 10;
    const moves = {
      ArrowLeft: () => turn(-step, 0), ArrowRight: () => turn(step, 0),
      ArrowUp: () => turn(0, step), ArrowDown: () => turn(0, -step),
      "+": () => zoom(0.9), "=": () => zoom(0.9), "-": () => zoom(1 / 0.9), "−": () => zoom(1 / 0.9),
      0: reset, Home: reset,
    };
    const letter = axes === "patient" ? key.toUpperCase() : (shiftKey ? "−" : "+") + key.toLowerCase();
    const view = standard.find(([name]) => name === letter);
    return view ? () => stand(view) : moves[key];
  };

  /** Lets a stage turn the camera by pointer, touch and keys. */
  const attach = (stage, canvas) => {
    const control = new THREE.OrbitControls(camera, canvas);
    // all stages turn about one point, which each of them may move
    control.target = target;
    [control.minDistance, control.maxDistance] = [NEAREST * radius, FARTHEST * radius];
    control.touches = { ONE: THREE.TOUCH.ROTATE, TWO: THREE.TOUCH.DOLLY_ROTATE };
    // one finger up or down scrolls the page, sideways it turns
    canvas.style.touchAction = "pan-y";
    control.addEventListener("change", onTurn);
    controls.push(control);
    control.update();
    // the wheel scrolls the page until the stage was chosen
    const isChosen = () => document.activeElement === stage;
    stage.addEventListener("wheel", (event) => { if (!isChosen()) event.stopPropagation(); }, { capture: true });
    stage.addEventListener("pointerdown", () => stage.focus({ preventScroll: true }));
    stage.addEventListener("keydown", (event) => {
      const action = event.ctrlKey || event.metaKey || event.altKey ? undefined : actionOf(event);
      if (!action) return;
      event.preventDefault();
      action();
    });
  };

  /** Sets the camera up for a picture of this shape: a narrow one shows as much of the width as a wide one. */
  const frame = (width, height) => {
    camera.aspect = width / height;
    camera.fov = 2 * DEGREES * Math.atan(Math.tan(16 / DEGREES) * Math.max(1, 1.1 / camera.aspect));
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  };

  place(HOME);
  return { camera, radius, standard, frame, attach, reset, stand, place, where, tell };
}
