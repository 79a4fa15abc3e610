"use strict";
// Numbers, colours and rows: what all pages share.

// A track's height in m over x in m.
const pathHeight = ({ amplitude, wavenumber, cosines, sines }, x) => {
  const harmonics = (factors, wave) => factors.reduce((sum, factor, i) => sum + factor * wave((i + 1) * wavenumber * x), 0);
  return amplitude * Math.sin(wavenumber * x) + harmonics(cosines, Math.cos) + harmonics(sines, Math.sin);
};

// The row in force at a time: the last stamp at or before it, 0 before the first.
const rowAt = (times, time) => {
  let low = 0;
  let high = times.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time + 1e-10) low = middle;
    else high = middle;
  }
  return low;
};

const showNumber = (value, digits = 4) => {
  if (!Number.isFinite(value)) return "–";
  const text = Number(value.toPrecision(digits)).toString();
  return text.replaceAll("-", "−");
};

// A unit as the pages spell it: N·m.
const dotted = (unit) => unit.replace(/(?<!or) (?!or)/g, "·");

// Looking a colour up costs more than drawing with it: each is kept until the theme changes.
const [cssColor, forgetColors] = (() => {
  const kept = new Map();
  for (const theme of ["(prefers-color-scheme: dark)", "print"]) matchMedia(theme).addEventListener("change", () => kept.clear());
  const color = (name) => {
    if (!kept.has(name)) kept.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
    return kept.get(name);
  };
  return [color, () => kept.clear()];
})();
const runColor = (index) => cssColor(`--run${index % 8}`);
const DASHES = [[], [8, 3], [9, 3, 2, 3], [2, 2], [12, 3, 4, 3]];
const runDash = (index) => DASHES[index % DASHES.length];
