"use strict";
// The trunk on its hip path, drawn to scale, one canvas per run.
const makeStage = (run, index) => {
  const canvas = document.getElementById(`stage-${index}`);
  const context = canvas.getContext("2d");
  const readout = document.getElementById(`readout-${index}`);
  const { t, x, theta, measured, reference, torque } = run.columns;
  const { length } = run.path;
  const height = (at) => pathHeight(run.path, at);
  const extent = x.reduce(([low, high], v) => [Math.min(low, v), Math.max(high, v)], [Infinity, -Infinity]);
  // A hip that travels far is followed; otherwise the whole path fits.
  const follows = extent[1] - extent[0] > 9;
  const largest = () => {
    const bound = Math.max(...run.limits.map((v) => (v === null ? 0 : Math.abs(v))));
    return bound || run.torqueRange || torque.reduce((most, v) => Math.max(most, Math.abs(v)), 1e-9);
  };
  const fullTorque = largest();
  // The full extent of hip, trunk and measured trunk, plus a margin.
  const span = { left: extent[0], right: extent[1], low: Infinity, high: -Infinity };
  for (let i = 0; i < t.length; i++) {
    const angles = [theta[i], measured[i], reference[i]].filter(Number.isFinite).map((v) => (v * Math.PI) / 180);
    const y = height(x[i]);
    const heights = [y, ...angles.map((v) => y + length * Math.cos(v))];
    span.low = Math.min(span.low, ...heights);
    span.high = Math.max(span.high, ...heights);
    for (const v of angles) {
      span.left = Math.min(span.left, x[i] + length * Math.sin(v));
      span.right = Math.max(span.right, x[i] + length * Math.sin(v));
    }
  }
  span.left -= 0.3 * length;
  span.right += 0.3 * length;
  span.low -= 0.45 * length;
  span.high += 0.4 * length;
  const fallen = () => run.fell !== null && t[row] >= run.fell - 1e-10;
  const still = matchMedia("(prefers-reduced-motion: reduce)");
  let row = 0;

  const draw = () => {
    const ratio = devicePixelRatio || 1;
    const width = canvas.clientWidth;
    const tall = canvas.clientHeight;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(tall * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(tall * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, tall);

    const left = follows ? x[row] - 5 : span.left;
    const right = follows ? x[row] + 5 : span.right;
    const { low, high } = span;
    const scale = Math.min(width / (right - left), tall / (high - low));
    const px = (at) => width / 2 + (at - (left + right) / 2) * scale;
    const py = (at) => tall / 2 - (at - (low + high) / 2) * scale;
    const pulse = run.pulses.find((p) => p.start <= t[row] + 1e-10 && t[row] + 1e-10 < p.end);

    if (pulse) {
      context.fillStyle = cssColor("--flash");
      if (!still.matches) context.fillRect(0, 0, width, tall);
      context.strokeStyle = cssColor("--run5");
      context.lineWidth = 4;
      context.strokeRect(2, 2, width - 4, tall - 4);
    }
    const curve = (from, to) => {
      context.beginPath();
      for (let i = 0; i <= 160; i++) {
        const at = from + ((to - from) * i) / 160;
        context.lineTo(px(at), py(height(at)));
      }
      context.stroke();
    };
    context.lineCap = "round";
    context.strokeStyle = cssColor("--path");
    context.lineWidth = 1.2;
    curve(left - 2, right + 2);
    context.globalAlpha = 0.3;
    context.strokeStyle = runColor(index);
    context.lineWidth = 7;
    curve(Math.max(extent[0], left - 2), Math.min(extent[1], right + 2));
    context.globalAlpha = 1;

    const hip = [px(x[row]), py(height(x[row]))];
    const tip = (degrees, part = 1) => {
      const angle = (degrees * Math.PI) / 180;
      return [hip[0] + part * length * scale * Math.sin(angle), hip[1] - part * length * scale * Math.cos(angle)];
    };
    const rod = (degrees, color, thick, dashes) => {
      context.strokeStyle = color;
      context.lineWidth = thick;
      context.setLineDash(dashes);
      context.beginPath();
      context.moveTo(...hip);
      context.lineTo(...tip(degrees));
      context.stroke();
      context.setLineDash([]);
    };
    if (Number.isFinite(reference[row])) rod(reference[row], cssColor("--reference"), 1.6, [5, 5]);
    if (Math.abs(measured[row] - theta[row]) > 0.5) rod(measured[row], cssColor("--run5"), 2.5, [2, 5]);
    rod(theta[row], runColor(index), 7, []);
    const disc = (at, radius, color) => {
      context.fillStyle = color;
      context.strokeStyle = cssColor("--card");
      context.lineWidth = 2;
      context.beginPath();
      context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    };
    disc(tip(theta[row]), Math.max(7, 0.13 * length * scale), runColor(index));
    disc(hip, Math.max(6, 0.1 * length * scale), cssColor("--ink"));
    drawTorque(hip, Math.max(16, 0.3 * length * scale), theta[row], torque[row]);

    context.fillStyle = cssColor("--soft");
    context.font = "12px system-ui, sans-serif";
    context.textAlign = "left";
    context.fillText(`1 m`, 12, tall - 16);
    context.strokeStyle = cssColor("--soft");
    context.lineWidth = 2;
    context.beginPath();
    context.moveTo(12, tall - 10);
    context.lineTo(12 + scale, tall - 10);
    context.stroke();
    if (pulse) {
      context.fillStyle = cssColor("--ink");
      context.font = "600 14px system-ui, sans-serif";
      context.textAlign = "center";
      context.fillText(`pulse: ${pulse.text}`, width / 2, 22, width - 20);
    }
    if (fallen()) {
      context.fillStyle = cssColor("--limit");
      context.font = "600 14px system-ui, sans-serif";
      context.textAlign = "center";
      context.fillText(`✕ fell at t = ${showNumber(run.fell, 6)} s`, width / 2, tall - 12, width - 20);
    }
  };

  // An arc about the hip, starting at the trunk, its length proportional to the torque, at most half a turn.
  const drawTorque = (hip, radius, degrees, value) => {
    const part = Math.max(-1, Math.min(1, value / fullTorque));
    const sweep = Math.sign(part) * Math.sqrt(Math.abs(part)) * Math.PI;
    if (Math.abs(sweep) < 0.04) return;
    const from = (degrees * Math.PI) / 180 - Math.PI / 2;
    const to = from + sweep;
    context.strokeStyle = context.fillStyle = cssColor("--limit");
    context.lineWidth = 3;
    context.beginPath();
    context.arc(hip[0], hip[1], radius, from, to, sweep < 0);
    context.stroke();
    const sign = Math.sign(sweep);
    const end = [hip[0] + radius * Math.cos(to), hip[1] + radius * Math.sin(to)];
    const along = [-Math.sin(to) * sign, Math.cos(to) * sign];
    const across = [Math.cos(to), Math.sin(to)];
    context.beginPath();
    context.moveTo(end[0] + 8 * along[0], end[1] + 8 * along[1]);
    context.lineTo(end[0] + 5 * across[0], end[1] + 5 * across[1]);
    context.lineTo(end[0] - 5 * across[0], end[1] - 5 * across[1]);
    context.fill();
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
