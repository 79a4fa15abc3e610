"use strict";
// A canvas for each run of the report, at the clock's time.
const makeStage = (run, index) => {
  const canvas = document.getElementById(`stage-${index}`);
  const context = canvas.getContext("2d");
  const readout = document.getElementById(`readout-${index}`);
  const { t, x, theta, measured, reference, torque } = run.columns;
  const { length } = run.path;
  const extent = [x.reduce((low, v) => Math.min(low, v), Infinity), x.reduce((high, v) => Math.max(high, v), -Infinity)];
  // A hip that travels far is followed; otherwise the whole path fits.
  const follows = extent[1] - extent[0] > 9;
  const largest = () => {
    const bound = Math.max(...run.limits.map((v) => (v === null ? 0 : Math.abs(v))));
    return bound || run.torqueRange || torque.reduce((most, v) => Math.max(most, Math.abs(v)), 1e-9);
  };
  const fullTorque = largest();
  // The full extent of hip, trunk and measured trunk, plus a margin.
  const span = { left: extent[0], right: extent[1], low: Infinity, high: -Infinity };
  const hip = x.map((v) => pathHeight(run.path, v));
  const include = (angles) => {
    for (let i = 0; i < t.length; i++) {
      const angle = (angles[i] * Math.PI) / 180;
      if (!Number.isFinite(angle)) continue;
      const side = x[i] + length * Math.sin(angle);
      const top = hip[i] + length * Math.cos(angle);
      if (side < span.left) span.left = side;
      if (side > span.right) span.right = side;
      span.low = Math.min(span.low, hip[i], top);
      span.high = Math.max(span.high, hip[i], top);
    }
  };
  new Set([theta, measured, reference]).forEach(include);
  span.left -= 0.3 * length;
  span.right += 0.3 * length;
  span.low -= 0.45 * length;
  span.high += 0.4 * length;
  const fallen = () => run.fell !== null && t[row] >= run.fell - 1e-10;
  let row = 0;

  const draw = () => {
    const size = fitCanvas(canvas, context);
    if (!size.width) return;
    const place = follows ? { ...span, left: x[row] - 5, right: x[row] + 5 } : span;
    const pulse = run.pulses.find((p) => p.start <= t[row] + 1e-10 && t[row] + 1e-10 < p.end);
    paintStage(
      context, size, { ...place, path: run.path, length, travelled: extent, color: runColor(index), fullTorque },
      {
        x: x[row], theta: theta[row], measured: measured[row], reference: reference[row], torque: torque[row],
        pulse: pulse ? `pulse: ${pulse.text}` : null, fell: fallen() ? run.fell : null,
      },
    );
  };

  const say = (name, text) => {
    const value = readout.querySelector(`[data-value=${name}]`);
    if (value) value.textContent = text;
  };
  const show = (time) => {
    row = rowAt(t, time);
    draw();
    say("fell", fallen() ? `at ${showNumber(run.fell, 6)} s` : "not yet");
    say("theta", `${showNumber(theta[row])}°`);
    say("reference", `${showNumber(reference[row])}°`);
    say("torque", `${showNumber(torque[row])} N·m`);
    say("x", `${showNumber(x[row])} m`);
  };
  clock.listeners.push(show);
  new ResizeObserver(draw).observe(canvas);
  return { draw };
};
