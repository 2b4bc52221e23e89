// Appended to a page by viewer.rs, which puts what is to be done into it: what that returns is left in #told.
(async () => {
  const one = (selector) => document.querySelector(selector);
  const all = (selector) => [...document.querySelectorAll(selector)];
  const wait = (ms) => new Promise((done) => setTimeout(done, ms));
  const choose = (id, text) => {
    const option = [...one(id).options].find((option) => option.text === text);
    one(id).value = option.value;
    one(id).dispatchEvent(new Event("change"));
  };
  const enter = (id, value) => {
    one(id).value = value;
    one(id).dispatchEvent(new Event("input"));
  };
  const press = (key, pane = 0) => {
    const shiftKey = /^[A-Z]$/.test(key);
    all(".stage")[pane].dispatchEvent(new KeyboardEvent("keydown", { key, shiftKey, bubbles: true, cancelable: true }));
  };
  /** RGBA of a view as paper would show it, 128 × 128. */
  const picture = async (pane) => {
    window.dispatchEvent(new Event("beforeprint"));
    const image = new Image();
    image.src = all(".printed")[pane].src;
    for (let i = 0; i < 500 && !(image.complete && image.naturalWidth); i++) await wait(10);
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 128;
    const context = canvas.getContext("2d");
    context.imageSmoothingEnabled = false;
    context.drawImage(image, 0, 0, 128, 128);
    const { data } = context.getImageData(0, 0, 128, 128);
    return Array.from({ length: 128 * 128 }, (_, i) => [...data.subarray(4 * i, 4 * i + 4)]);
  };
  /** Where the surface is in a view. */
  const outline = async (pane) => (await picture(pane)).map(([, , , alpha]) => alpha > 127);
  const covered = (a) => a.filter((is) => is).length / a.length;
  const differ = (a, b) => a.filter((is, i) => is !== b[i]).length / a.length;
  for (let i = 0; i < 200 && !one(".pane figcaption:not(:empty)"); i++) await wait(20);
  await wait(100);
  const told = await (async () => { BODY })();
  one("#data").remove();
  if (parent !== window) return parent.postMessage(JSON.stringify(told), "*");
  const out = document.createElement("script");
  out.type = "application/json";
  out.id = "told";
  out.textContent = JSON.stringify(told).replaceAll("<", "\\u003c");
  document.body.append(out);
})().catch((error) => { document.body.dataset.failed = error.stack; });
