// One view with its title, its picture and its legend.

/** Colours of a scale as a gradient, and round numbers along it. */
function drawLegend(figure, { unit }, scale, threshold) {
  const palette = paletteOf(scale, threshold);
  const stops = Array.from({ length: 65 }, (_, i) => {
    const at = 4 * Math.round(i / 64 * (N_COLOURS - 1));
    return `rgb(${palette.subarray(at, at + 3).join(" ")})`;
  });
  figure.querySelector(".gradient").style.background = `linear-gradient(to right, ${stops.join(", ")})`;
  figure.querySelector(".ticks").replaceChildren(...roundNumbers(scale).map((value, i, all) => {
    const tick = document.createElement("span");
    tick.style.left = `${100 * shareOf(value, scale)}%`;
    tick.textContent = format(value, i === all.length - 1 ? unit : "");
    return tick;
  }));
}

/** What the legend says besides. */
function tellRange({ values, unit }, scale) {
  const [low, high] = extent([{ values }]);
  const isShared = scale[0] < low || scale[1] > high ? " Mean and truth share one scale." : "";
  const isVoid = values.some((v) => !Number.isFinite(v)) ? " Grey: no value." : "";
  return `min ${format(low, unit)}, max ${format(high, unit)}.${isShared}${isVoid}`;
}

/** A further view in the list of panes. `newPicture` makes its picture on a canvas. */
function newPane(panes, surface, view, newPicture, read) {
  const figure = document.getElementById("pane").content.firstElementChild.cloneNode(true);
  panes.append(figure);
  const part = (name) => figure.querySelector(name);
  const stage = part(".stage"), canvas = part("canvas");
  const picture = newPicture(canvas);
  view.attach(stage, canvas);
  let shown, range = "";

  /** Says what is seen, to those who do not see it too. */
  const describe = () => {
    const from = view.tell();
    part(".seen").textContent = from;
    canvas.setAttribute("aria-label", `${titleOf(shown)} on the surface, seen ${from}. ${range}`);
  };
  const render = () => {
    if (!shown || figure.hidden) return;
    describe();
    picture.render();
  };
  new ResizeObserver(render).observe(stage);

  const show = (array, scale, threshold, showsSites) => {
    shown = array;
    range = tellRange(array, scale);
    part("figcaption").textContent = titleOf(array);
    part(".range").textContent = range;
    stage.setAttribute("aria-label", `${array.name}: arrow keys turn, plus and minus zoom, 0 resets`);
    part(".share").textContent = threshold ? threshold.tell(array) : "";
    drawLegend(figure, array, scale, threshold);
    describe();
    picture.paint({ values: array.values, scale, threshold, showsSites });
  };

  canvas.addEventListener("pointermove", (event) => {
    if (event.buttons || !shown) return;
    const box = canvas.getBoundingClientRect();
    const hit = picture.pick((event.clientX - box.x) / box.width, (event.clientY - box.y) / box.height);
    read(hit.site === undefined && hit.vertex === undefined ? ""
      : hit.site === undefined ? `${shown.name} ${format(shown.values[hit.vertex], shown.unit)}` : `site ${hit.site}`);
  });

  /** Puts the picture as it is into an image: paper takes no canvas that a graphics card has drawn. */
  const print = () => {
    if (!shown || figure.hidden) return;
    describe();
    picture.draw();
    const image = part(".printed");
    image.src = canvas.toDataURL();
    image.alt = canvas.getAttribute("aria-label");
  };

  return { figure, render, show, print };
}
