// Body of a probe: text and curves whose contrast with what lies behind them is too small (WCAG 2: 4.5 for text).
const channels = (colour) => colour.match(/[\d.]+/g).map(Number);
const luminance = (colour) => {
  const linear = (c) => (c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
  const [r, g, b] = channels(colour).map((c) => linear(c / 255));
  return 0.2126 * r + 0.7152 * g + 0.0722 * b;
};
const contrast = (a, b) => {
  const [low, high] = [luminance(a), luminance(b)].sort((p, q) => p - q);
  return (high + 0.05) / (low + 0.05);
};
const behind = (e) => {
  const { backgroundColor } = getComputedStyle(e);
  return (channels(backgroundColor)[3] ?? 1) > 0.5 ? backgroundColor : behind(e.parentElement);
};
const faint = [];
let checked = 0;
const check = (e, colour, least) => {
  checked++;
  const ratio = contrast(colour, behind(e));
  if (ratio < least) faint.push(`${e.tagName}.${e.getAttribute("class")} ${e.textContent.slice(0, 30)}: ${ratio.toFixed(2)}`);
};
for (const details of all("details")) details.open = true;
one("#threshold").click();
for (const e of all("main *")) {
  const hasText = [...e.childNodes].some((node) => node.nodeType === 3 && node.data.trim());
  if (!e.checkVisibility() || !hasText || e.closest("option, style, noscript")) continue;
  const { color, fill } = getComputedStyle(e);
  check(e, e.closest("svg") ? fill : color, 4.5);
}
for (const e of all("svg .chain")) check(e, getComputedStyle(e).stroke, 2);
return { page: luminance(getComputedStyle(document.body).backgroundColor), checked, faint };
