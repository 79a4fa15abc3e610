"use strict";
// The page's data: columns decoded to Float64Arrays once, shared by plots and animation.
const report = (() => {
  const unpack = (column) => {
    if ("constant" in column) return new Float64Array(column.count).fill(column.constant);
    const text = atob(column.f8);
    const bytes = new Uint8Array(text.length);
    for (let i = 0; i < text.length; i++) bytes[i] = text.charCodeAt(i);
    return new Float64Array(bytes.buffer);
  };
  const unpackAll = (columns) =>
    Object.fromEntries(Object.entries(columns).map(([name, column]) => [name, unpack(column)]));

  const data = JSON.parse(document.getElementById("data").textContent);
  for (const run of data.runs) {
    run.columns = unpackAll(run.columns);
    const fuzzy = run.fuzzy;
    if (fuzzy) {
      for (const name of ["error", "rate", "kp", "kd", "alpha"]) fuzzy[name] = unpack(fuzzy[name]);
      fuzzy.updates = unpackAll(fuzzy.updates);
    }
  }
  data.start = Math.min(...data.runs.map((run) => run.columns.t[0]));
  data.end = Math.max(...data.runs.map((run) => run.columns.t[run.columns.t.length - 1]));
  return data;
})();

// One clock for everything on the page. Listeners get the time in s.
const clock = {
  time: report.start,
  playing: false,
  speed: 1,
  listeners: [],
  set(time) {
    this.time = Math.min(report.end, Math.max(report.start, time));
    for (const listener of this.listeners) listener(this.time);
  },
  play() {
    if (this.playing) return;
    if (this.time >= report.end) this.set(report.start);
    this.playing = true;
    let before = null;
    const tick = (now) => {
      if (!this.playing) return;
      if (before !== null) this.set(this.time + (this.speed * (now - before)) / 1000);
      before = now;
      if (this.time >= report.end) this.pause();
      else requestAnimationFrame(tick);
    };
    requestAnimationFrame(tick);
    this.told();
  },
  pause() {
    this.playing = false;
    this.told();
  },
  told: () => {},
};
