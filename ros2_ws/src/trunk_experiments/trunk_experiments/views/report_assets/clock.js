"use strict";
// One clock for everything on the report. Listeners get the time in s.
const clock = {
  time: 0,
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
