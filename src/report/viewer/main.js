// Puts the views and their controls together, and draws the small views of a page.

const element = (id) => document.getElementById(id);
if (!("DecompressionStream" in window)) {
  element("viewer").hidden = true;
  element("trouble").textContent = "This browser is too old to unpack the maps (it has no DecompressionStream); "
    + "fields.vtp beside this file holds them.";
  return;
}
const surface = await decode(JSON.parse(element("data").textContent));
const { arrays, sites } = surface;
const areas = areasOf(surface);

// ---- views ----------------------------------------------------------------------------------------------------
const panes = [];
let isAsked = false;
const renderAll = () => panes.forEach((pane) => pane.render());
// many movements may come between two frames of the screen
const view = newCamera(surface, () => {
  if (!isAsked) requestAnimationFrame(() => { isAsked = false; renderAll(); });
  isAsked = true;
});
// All sites together cover as much of the surface as forty of full size, so that they do not hide the map.
view.siteRadius = 0.025 * view.radius * Math.min(1, Math.sqrt(40 / Math.max(sites.length, 1)));

const shape = newShape(surface, view.siteRadius);
let hasWebgl = true;
function newPicture(canvas) {
  if (hasWebgl) {
    try {
      return webglPicture(canvas, surface, shape, view);
    } catch {
      hasWebgl = false;
      element("hint").prepend("This browser has no WebGL: the maps are drawn without it, more slowly. ");
    }
  }
  return canvasPicture(canvas, surface, view);
}
const read = (text) => { element("readout").textContent = text; };
const paneAt = (i) => panes[i] ??= newPane(element("panes"), surface, view, newPicture, read);

// ---- what is chosen -------------------------------------------------------------------------------------------
const threshold = { isOn: false, value: NaN, of: undefined };

/** The threshold as it holds for an array: only for the one that is chosen, and one comparable with it. */
function thresholdOf(array, first) {
  if (!threshold.isOn) return undefined;
  if (!areComparable(array, first)) return { tell: () => `The threshold is for ${first.name} only.` };
  const tell = ({ values, unit }) =>
    tellShare(shareAbove(surface, areas, values, threshold.value), threshold.value, unit);
  return { value: threshold.value, fades: element("fades").value, tell };
}

/** Another field has another range: its threshold begins in the middle. */
function fitThreshold(array) {
  const [low, high] = scaleOf(array, arrays);
  if (!threshold.of || !areComparable(array, threshold.of)) threshold.value = (low + high) / 2;
  threshold.of = array;
  const slider = element("threshold-slider");
  slider.value = 1000 * shareOf(threshold.value, [low, high]);
  slider.setAttribute("aria-valuetext", format(threshold.value, array.unit));
  element("threshold-unit").textContent = array.unit;
  const number = element("threshold-number");
  if (number !== document.activeElement) number.value = Number(threshold.value.toPrecision(4));
  element("threshold").disabled = !Number.isFinite(low);
  element("threshold-settings").hidden = !threshold.isOn;
}

function update() {
  const first = arrays[element("quantity").value];
  const second = arrays[element("beside").value];
  fitThreshold(first);
  element("panes").classList.toggle("two", second !== undefined);
  [first, second].forEach((array, i) => {
    if (!array && !panes[i]) return;
    const pane = paneAt(i);
    pane.figure.hidden = !array;
    if (array) pane.show(array, scaleOf(array, arrays), thresholdOf(array, first), element("sites").checked);
  });
}

for (const list of [element("quantity"), element("beside")]) {
  arrays.forEach((array, i) => list.add(new Option(titleOf(array), i)));
}
for (const id of ["quantity", "beside", "sites", "fades"]) element(id).addEventListener("change", update);
element("threshold").addEventListener("change", ({ target }) => {
  threshold.isOn = target.checked;
  update();
});
element("threshold-slider").addEventListener("input", ({ target }) => {
  const [low, high] = scaleOf(threshold.of, arrays);
  threshold.value = low + target.value / 1000 * (high - low);
  update();
});
element("threshold-number").addEventListener("input", ({ target }) => {
  if (Number.isFinite(target.valueAsNumber)) threshold.value = target.valueAsNumber;
  update();
});

for (const standard of [...view.standard, undefined]) {
  const button = document.createElement("button");
  button.type = "button";
  [button.textContent, button.title] = standard ?? ["reset", "as at the beginning"];
  button.setAttribute("aria-label", button.title);
  button.addEventListener("click", () => (standard ? view.stand(standard) : view.reset()));
  element("standard").append(button);
}
element("view-keys").textContent = surface.axes === "patient"
  ? "A P L R S I look from the front, the back, the left, the right, above and below"
  : "x y z look along an axis, with Shift from its other end";
element("site-count").textContent = sites.length === 1 ? "1 measurement site" : `${sites.length} measurement sites`;
element("with-sites").hidden = sites.length === 0;
if (arrays.length) update();
addEventListener("beforeprint", () => panes.forEach((pane) => pane.print()));

// ---- small views ----------------------------------------------------------------------------------------------
/** Front and back side by side. */
function paintBoth(canvas, array, scale) {
  const [width, height] = [canvas.clientWidth, 2 * canvas.clientHeight];
  [canvas.width, canvas.height] = [2 * width, height];
  const own = newCamera(surface, () => {});
  own.siteRadius = view.siteRadius;
  [0, 180].forEach((azimuth, i) => {
    own.place({ azimuth, elevation: 0, distance: 3.8 });
    const what = { values: array.values, scale, showsSites: element("sites").checked };
    canvas.getContext("2d").putImageData(rasterised(width, height, surface, own, what).pixels, i * width, 0);
  });
}
for (const canvas of document.querySelectorAll("canvas[data-array]")) {
  const array = arrays.find(({ name }) => name === canvas.dataset.array);
  const scale = scaleOf(array, arrays);
  const [from, to] = scale.map((end) => format(end, ""));
  canvas.nextElementSibling.textContent = `dark ${from} … yellow ${to} ${array.unit}`;
  // one after the other, so that the page is there meanwhile
  setTimeout(() => paintBoth(canvas, array, scale));
}
