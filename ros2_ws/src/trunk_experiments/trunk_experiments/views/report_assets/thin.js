"use strict";
// Curves with as many points as a screen can show. Each point is one of the recording's: none is averaged.

// A curve over time from `from` to `to`, with as much again on both sides for a pan. Where there are more rows than
// four per bucket, of each bucket its first, least, greatest and last: no peak is lost, and drawn it looks the same.
const thinned = (t, y, from, to, buckets) => {
  const span = to - from;
  const first = rowAt(t, from - span);
  const last = Math.min(t.length - 1, rowAt(t, to + span) + 1);
  const all = Math.ceil(buckets * Math.min(3, span > 0 ? (t[last] - t[first]) / span : 1)) || 1;
  if (last - first + 1 <= 4 * all) return { x: t.subarray(first, last + 1), y: y.subarray(first, last + 1) };
  const rows = [];
  const wide = (t[last] - t[first]) / all;
  let row = first;
  for (let bucket = 1; bucket <= all; bucket++) {
    const end = bucket === all ? Infinity : t[first] + bucket * wide;
    const begin = row;
    let least = row;
    let most = row;
    for (; row <= last && t[row] < end; row++) {
      if (y[row] < y[least] || y[least] !== y[least]) least = row;
      if (y[row] > y[most] || y[most] !== y[most]) most = row;
    }
    if (row === begin) continue;
    for (const one of [begin, Math.min(least, most), Math.max(least, most), row - 1]) {
      if (rows[rows.length - 1] !== one && (rows.length === 0 || one > rows[rows.length - 1])) rows.push(one);
    }
  }
  return { x: Float64Array.from(rows, (i) => t[i]), y: Float64Array.from(rows, (i) => y[i]) };
};

// A way in a plane, over cells of the box that is shown: what stays within a cell is left out, and so is what goes
// where the way has gone before. Rows; -1 is a gap.
const thinnedWay = (x, y, { left, right, low, high }, cells = 800) => {
  if (x.length < 2000) return Int32Array.from(x, (_, i) => i);
  const wide = (right - left) / cells || 1;
  const tall = (high - low) / cells || 1;
  const COLUMNS = 3 * cells + 3; // the box, and as much again on all sides
  const part = (v, from, size) => Math.min(COLUMNS - 2, Math.max(0, Math.floor((v - from) / size) + cells));
  const cell = (i) => part(x[i], left, wide) + COLUMNS * part(y[i], low, tall);
  const rows = [];
  const gone = new Set();
  const keep = (i) => { if (rows[rows.length - 1] !== i) rows.push(i); };
  const most = [0, 0, 0, 0];
  let before = -1;
  for (let i = 0; i < x.length; i++) {
    if (x[i] < x[most[0]]) most[0] = i;
    if (x[i] > x[most[1]]) most[1] = i;
    if (y[i] < y[most[2]]) most[2] = i;
    if (y[i] > y[most[3]]) most[3] = i;
    if (!Number.isFinite(x[i]) || !Number.isFinite(y[i])) {
      keep(-1);
      before = -1;
      continue;
    }
    const at = cell(i);
    if (at === before) continue;
    const step = before * COLUMNS * COLUMNS + at;
    if (before >= 0 && gone.has(step)) keep(-1);
    else {
      if (before >= 0 && rows[rows.length - 1] === -1) rows.push(i - 1);
      rows.push(i);
      gone.add(step);
    }
    before = at;
  }
  rows.push(-1, ...most.flatMap((i) => [i, -1])); // the extreme points themselves
  return Int32Array.from(rows);
};
const rowsOf = (rows, column) => Float64Array.from(rows, (i) => (i < 0 ? NaN : column[i]));
