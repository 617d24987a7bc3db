const words = "svg text, h1, h2, p, dt, dd, td, th, figcaption, #calib-labels span";
const texts = [...document.querySelectorAll(words)]
  .filter((node) => node.getClientRects().length && node.textContent.trim());
const boxes = texts.map((node) => node.getBoundingClientRect());
const found = [];
boxes.forEach((a, i) => boxes.slice(i + 1).forEach((b, k) => {
  const other = texts[i + 1 + k];
  if (texts[i].contains(other) || other.contains(texts[i])) return;
  if (texts[i].closest("aside") || other.closest("aside")) return;
  const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  if (wide > 1 && high > 3) found.push(`${texts[i].textContent} | ${other.textContent}`);
}));
const bottom = (css) => Math.max(0, ...[...document.querySelectorAll(css)]
  .map((node) => node.getBoundingClientRect().bottom));
const report = {
  name: window.name,
  overlaps: found,
  sideways: document.documentElement.scrollWidth - window.innerWidth,
  bottoms: [bottom(".lead"), bottom("dl.first"), bottom("#accuracy svg"), bottom("#causes svg")],
  texts: texts.length,
  exponents: texts.map((node) => node.textContent).filter((text) => /\de[-+]?\d/.test(text)),
  labels: document.querySelectorAll("#calib-labels span").length,
};
parent.postMessage(JSON.stringify(report), "*");
