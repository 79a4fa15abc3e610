"use strict";
// A plant's picture, drawn to scale: one instant of a run on a canvas.
const DEGREES = 180 / Math.PI;

// Where a picture's frames are, by name: their origins in m, how far they are turned, rad, from z towards x, and in which sense.
const placed = ({ frames, track }, position) => {
  const places = { "": { x: 0, z: 0, turn: 0 } };
  for (const { name, on, at, slides, turns, sense } of frames) {
    const [along, base] = [at[0] + (position[slides] ?? 0), places[on]];
    const [x, z] = spotIn(base, [along, at[1] + (track && slides >= 0 && !on ? pathHeight(track, along) : 0)]);
    places[name] = { x, z, turn: base.turn + sense * (position[turns] ?? 0), sense };
  }
  return places;
};
const spotIn = ({ x, z, turn }, [right, up]) =>
  [x + right * Math.cos(turn) + up * Math.sin(turn), z + up * Math.cos(turn) - right * Math.sin(turn)];
// The last bar of a frame that turns with a coordinate.
const barOf = ({ frames, visuals }, coordinate) =>
  visuals.findLast(({ frame, points }) => points.length > 1 && frames.some(({ name, turns }) => name === frame && turns === coordinate));
// How far from the world's origin something is seen at rest on level ground, in m.
const reachOf = ({ frames, visuals }) => {
  const places = placed({ frames }, []);
  return Math.max(...visuals.flatMap(({ frame, points }) => points.map((point) => Math.hypot(...spotIn(places[frame], point)))));
};

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

// Draw an instant. `scene`: `picture`, its `reach`, `left`, `right`, `low`, `high` in m of what is shown, the coordinate
// that `drive` pushes, `color`, `fullTorque` of half a turn, `named`: its first line is taken. `now`: `x`; `theta`,
// `measured`, `reference` in degrees; `torque`; `pulse`, a text, and `fell`, a time in s, or null; `ended`: in place of "fell".
// Returns where things are: `hip`, `pivot` and `tip` of the bar that is held in CSS pixels, `scale` in pixels per m, `sense`.
const paintStage = (context, { width, tall }, scene, now) => {
  const { left, right, low, high, picture, reach } = scene;
  const scale = Math.min(width / (right - left), tall / (high - low));
  const pixel = ([x, z]) => [width / 2 + (x - (left + right) / 2) * scale, tall / 2 - (z - (low + high) / 2) * scale];
  context.clearRect(0, 0, width, tall);

  if (now.pulse) {
    context.fillStyle = cssColor("--flash");
    if (!matchMedia("(prefers-reduced-motion: reduce)").matches) context.fillRect(0, 0, width, tall);
    context.strokeStyle = cssColor("--run5");
    context.lineWidth = 4;
    context.strokeRect(2, 2, width - 4, tall - 4);
  }
  context.lineCap = "round";
  const line = (points, color, thick, dashes = []) => {
    context.strokeStyle = color;
    context.lineWidth = thick;
    context.setLineDash(dashes);
    context.beginPath();
    for (const point of points) context.lineTo(...point);
    context.stroke();
    context.setLineDash([]);
  };
  const grid = Array.from({ length: 161 }, (_, i) => left - 2 + ((right - left + 4) * i) / 160);
  if (picture.track) line(grid.map((at) => pixel([at, pathHeight(picture.track, at)])), cssColor("--path"), 1.2);

  const places = (degrees) => placed(picture, [now.x, degrees / DEGREES]);
  const seen = ({ frame, points }, at = places(now.theta)) => points.map((point) => pixel(spotIn(at[frame], point)));
  const origin = (frame) => seen({ frame, points: [[0, 0]] })[0];
  const held = barOf(picture, 1);
  if (Number.isFinite(now.reference)) line(seen(held, places(now.reference)), cssColor("--reference"), 1.6, [5, 5]);
  if (Math.abs(now.measured - now.theta) > 0.5) line(seen(held, places(now.measured)), cssColor("--run5"), 2.5, [2, 5]);
  const disc = (at, radius, color) => {
    context.fillStyle = color;
    context.strokeStyle = cssColor("--card");
    context.lineWidth = 2;
    context.beginPath();
    context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
    context.fill();
    context.stroke();
  };
  for (const visual of picture.visuals) {
    const [points, size, base] = [seen(visual), (visual.page ?? visual.size) * scale, visual.role === "base"];
    const color = base ? cssColor("--ink") : scene.color;
    if (points.length > 1) line(points, color, Math.max(7, size));
    else disc(points[0], Math.max(base ? 6 : 7, size / 2), color);
  }
  const [hip, driven] = [origin(picture.frames[0].name), barOf(picture, scene.drive)];
  const { sense } = places(0)[held.frame];
  paintDrive(context, driven ? origin(driven.frame) : hip, Math.max(16, 0.3 * reach * scale), driven && seen(driven).at(-1),
    (now.torque / scene.fullTorque) * (driven ? places(0)[driven.frame].sense : 1));

  context.fillStyle = cssColor("--soft");
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "left";
  context.fillText("1 m", 12, tall - 16);
  line([[12, tall - 10], [12 + scale, tall - 10]], cssColor("--soft"), 2);
  let top = scene.named ? 22 : 2; // above a plant that has fallen
  const say = (words, color) => {
    context.fillStyle = cssColor(color);
    context.font = "600 14px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText(words, width / 2, (top += 20), width - 20);
  };
  if (now.pulse) say(now.pulse, "--ink");
  if (now.fell !== null) say(`✕ ${now.ended ?? "fell"} at t = ${showNumber(now.fell, 6)} s`, "--limit");
  return { hip, pivot: origin(held.frame), tip: seen(held).at(-1), ghost: seen(held, places(now.reference)).at(-1), scale, sense };
};

// An arc about `pivot`, starting at the bar that ends at `tip`; without one an arrow to where it is pushed.
// `part`: of half a turn, shown by its root.
const paintDrive = (context, [x, y], radius, tip, part) => {
  const cut = Math.max(-1, Math.min(1, part));
  const sign = Math.sign(cut);
  const sweep = sign * Math.sqrt(Math.abs(cut)) * Math.PI;
  if (Math.abs(sweep) < 0.04) return;
  const from = tip ? Math.atan2(tip[1] - y, tip[0] - x) : 0;
  const to = tip ? from + sweep : -Math.PI / 2;
  context.strokeStyle = context.fillStyle = cssColor("--limit");
  context.lineWidth = 3;
  context.beginPath();
  if (tip) context.arc(x, y, radius, from, to, sweep < 0);
  else context.moveTo(x, y);
  const end = tip ? [x + radius * Math.cos(to), y + radius * Math.sin(to)] : [x + radius * sweep, y];
  context.lineTo(...end);
  context.stroke();
  const along = [-Math.sin(to) * sign, Math.cos(to) * sign];
  const across = [Math.cos(to), Math.sin(to)];
  context.beginPath();
  for (const [a, b] of [[8, 0], [0, 5], [0, -5]]) context.lineTo(...end.map((at, i) => at + a * along[i] + b * across[i]));
  context.fill();
};
