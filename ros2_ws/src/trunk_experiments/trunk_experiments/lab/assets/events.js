"use strict";
// What acts on a run besides its controller, read from its table: spans of a disturbance, and the reference.
const planned = (() => {
  const MOST = 40; // more values in a run are a curve, no pulses or steps
  const LISTED = 8; // times in a line
  const number = (value, unit) => `${showNumber(value)}${unit === "°" ? "" : " "}${unit}`;
  const listed = (items) => {
    const shown = items.length > LISTED ? [...items.slice(0, LISTED), `${items.length - LISTED} more times`] : items;
    return shown.length > 1 ? `${shown.slice(0, -1).join(", ")} and ${shown.at(-1)}` : shown[0];
  };

  // The longest spans of states with the same value of a column, where it is not 0: [first, after the last, value].
  const spansOf = ({ names, table, width, count }, column) => {
    const at = names.indexOf(column);
    const spans = [];
    for (let k = 0; k < count; k++) {
      const value = table[k * width + at];
      const last = spans.at(-1);
      if (last && last[1] === k && last[2] === value) last[1] = k + 1;
      else if (value) spans.push([k, k + 1, value]);
    }
    return spans;
  };

  // { pulses: [{ start, end, text }] in s, words: a line for each kind of disturbance }
  const disturbances = (lab, engine) => {
    const pulses = [];
    const words = [];
    for (const [column, where, unit] of lab.channels) {
      const factor = unit === "°" ? DEGREES : 1;
      const spans = spansOf(engine, column);
      if (spans.length > MOST) {
        words.push(`A disturbance that varies ${where}, up to ${number(factor * Math.max(...spans.map(([, , value]) => Math.abs(value))), unit)}`);
        continue;
      }
      const alike = new Map();
      for (const [first, after, value] of spans) {
        const [start, end] = [first, after].map((k) => (k * lab.period_ns) / 1e9);
        const text = `${value > 0 ? "+" : ""}${number(factor * value, unit)} ${where}`;
        pulses.push({ start, end, text });
        const kind = `${text}, for ${showNumber(end - start)} s`;
        alike.set(kind, [...(alike.get(kind) ?? []), `${showNumber(start, 6)} s`]);
      }
      for (const [kind, times] of alike) words.push(`At ${listed(times)}: ${kind}`);
    }
    return { pulses, words };
  };

  // A run's reference as words: its levels, or between which values it varies.
  const reference = ({ control }) => {
    const values = control.columns.get("reference").subarray(0, control.count);
    const steps = Array.from(values.keys()).filter((k) => !k || values[k] !== values[k - 1]);
    const angle = (value) => number(value * DEGREES, "°");
    if (steps.length <= MOST) return steps.map((k, i) => `${i ? `from ${showNumber(control.t[k], 6)} s ` : ""}${angle(values[k])}`).join(", ");
    const [low, high] = [Math.min, Math.max].map((end) => steps.reduce((found, k) => end(found, values[k]), values[0]));
    return `varies from ${angle(low)} to ${angle(high)}`;
  };
  return { disturbances, reference };
})();
