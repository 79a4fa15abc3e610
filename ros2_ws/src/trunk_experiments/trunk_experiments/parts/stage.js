"use strict";
// The trunk on its hip path, drawn to scale: one instant of a run on a canvas.

// Fit the canvas to its place on the screen. Returns its size in CSS pixels; no width: it is not shown.
const fitCanvas = (canvas, context) => {
  const ratio = document.documentElement.hasAttribute("data-paper") ? 3 : devicePixelRatio || 1;
  const width = canvas.clientWidth;
  const tall = canvas.clientHeight;
  if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(tall * ratio)) {
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(tall * ratio);
  }
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  return { width, tall };
};

// Draw an instant. `scene`: path and its `length` of the trunk in m, `left`, `right`, `low`, `high` in m of what is
// shown, `color`, `fullTorque` in N m of half a turn, `named`: its first line is taken. `now`: `x` in m; `theta`,
// `measured`, `reference` in degrees; `torque` in N m; `pulse`, a text, and `fell`, a time in s, or null;
// `ended`: in place of "fell".
// Returns where things are: `hip` and `tip` in CSS pixels, `scale` in pixels per m.
const paintStage = (context, { width, tall }, scene, now) => {
  const { left, right, low, high, length } = scene;
  const height = (at) => pathHeight(scene.path, at);
  const scale = Math.min(width / (right - left), tall / (high - low));
  const px = (at) => width / 2 + (at - (left + right) / 2) * scale;
  const py = (at) => tall / 2 - (at - (low + high) / 2) * scale;
  context.clearRect(0, 0, width, tall);

  if (now.pulse) {
    context.fillStyle = cssColor("--flash");
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) context.fillRect(0, 0, width, tall);
    context.strokeStyle = cssColor("--run5");
    context.lineWidth = 4;
    context.strokeRect(2, 2, width - 4, tall - 4);
  }
  context.lineCap = "round";
  context.strokeStyle = cssColor("--path");
  context.lineWidth = 1.2;
  context.beginPath();
  for (let i = 0; i <= 160; i++) {
    const at = left - 2 + ((right - left + 4) * i) / 160;
    context.lineTo(px(at), py(height(at)));
  }
  context.stroke();

  const hip = [px(now.x), py(height(now.x))];
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
  if (Number.isFinite(now.reference)) rod(now.reference, cssColor("--reference"), 1.6, [5, 5]);
  if (Math.abs(now.measured - now.theta) > 0.5) rod(now.measured, cssColor("--run5"), 2.5, [2, 5]);
  rod(now.theta, scene.color, 7, []);
  const disc = (at, radius, color) => {
    context.fillStyle = color;
    context.strokeStyle = cssColor("--card");
    context.lineWidth = 2;
    context.beginPath();
    context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  };
  disc(tip(now.theta), Math.max(7, 0.13 * length * scale), scene.color);
  disc(hip, Math.max(6, 0.1 * length * scale), cssColor("--ink"));
  paintTorque(context, hip, Math.max(16, 0.3 * length * scale), now.theta, now.torque / scene.fullTorque);

  context.fillStyle = cssColor("--soft");
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left";
  context.fillText("1 m", 12, tall - 16);
  context.strokeStyle = cssColor("--soft");
  context.lineWidth = 2;
  context.beginPath();
  context.moveTo(12, tall - 10);
  context.lineTo(12 + scale, tall - 10);
  context.stroke();
  const top = scene.named ? 42 : 22; // above a trunk that has fallen
  if (now.pulse) {
    context.fillStyle = cssColor("--ink");
    context.font = "600 14px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(now.pulse, width / 2, top, width - 20);
  }
  if (now.fell !== null) {
    context.fillStyle = cssColor("--limit");
    context.font = "600 14px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(`✕ ${now.ended ?? "fell"} at t = ${showNumber(now.fell, 6)} s`, width / 2, top + (now.pulse ? 20 : 0), width - 20);
  }
  return { hip, tip: tip(now.theta), ghost: tip(now.reference), scale };
};

// An arc about the hip, starting at the trunk; `part`: of half a turn, shown by its root.
const paintTorque = (context, hip, radius, degrees, part) => {
  const cut = Math.max(-1, Math.min(1, part));
  const sweep = Math.sign(cut) * Math.sqrt(Math.abs(cut)) * Math.PI;
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
