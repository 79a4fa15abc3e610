"use strict";
// The trunk at the time that is shown, and the hand that pulls it.
const DEGREES = 180 / Math.PI;
const FALL_S = 3; // for which the picture says that the trunk has fallen
const RING = 1.4; // trunk's lengths from the hip to the reference's handle
const scene = (() => {
  const canvas = document.getElementById("scene");
  const context = canvas.getContext("2d");
  const readout = document.getElementById("readout");
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let middle = null; // of what is shown, m
  let places = null;

  const limits = () => {
    const bounds = known.run.acting.flatMap((name) => {
      const values = known.nodes.get(name)?.parameters ?? {};
      return [values.u_clamp_max, values.u_clamp_min].filter(Number.isFinite).map(Math.abs);
    });
    const plant = known.world?.limit;
    return Math.min(...(Number.isFinite(plant) ? [plant] : []), Math.max(...bounds, 0) || Infinity);
  };
  const put = (name, text) => {
    const value = readout.querySelector(`[data-value=${name}]`);
    if (value.textContent !== text) value.textContent = text;
  };

  const draw = (time) => {
    const size = fitCanvas(canvas, context);
    const { plant, control, world } = known;
    const row = plant.row(time);
    if (!size.width || row < 0 || !world) return;
    const told = control.row(time);
    const x = plant.value("x", row);
    const { path } = world;
    const length = path.length;
    // The hip moves about the middle of the picture before the picture moves with it.
    if (middle === null || Math.abs(x - middle) > 3 * length) middle = x;
    middle += Math.sign(x - middle) * Math.max(0, Math.abs(x - middle) - 1.2 * length);
    const rise = Math.abs(path.amplitude) + path.harmonics.reduce((sum, v) => sum + Math.abs(v), 0);
    const [low, high] = [-rise - 0.5 * length, rise + 1.6 * length];
    const half = Math.max(2.6 * length, ((high - low) * size.width) / size.tall / 2);
    const bound = limits();
    const theta = plant.value("theta", row) * DEGREES;
    const torque = plant.value("torque", row);
    const reference = control.value("reference", told) * DEGREES;
    const fall = known.events.findLast((event) => event.event === "fell" && event.t <= time && event.t > time - FALL_S);
    places = paintStage(
      context, size,
      {
        path, length, left: middle - half, right: middle + half, low, high,
        travelled: null, color: cssColor("--run0"), fullTorque: Number.isFinite(bound) ? bound : 100,
      },
      {
        x, theta, measured: control.value("measurement", told) * DEGREES, reference, torque,
        pulse: null, fell: fall ? fall.t : null,
      },
    );
    places.theta = theta;
    places.rate = plant.value("theta_dot", row);
    if (known.control_allowed && !known.recorded) paintHandles();
    put("t", `${time.toFixed(2)} s`);
    put("theta", `${showNumber(theta)}°`);
    put("reference", `${showNumber(reference)}°`);
    put("torque", `${showNumber(torque)} N·m`);
    put("push", grip.words());
  };

  // A ring where the reference can be dragged, and a line to the pointer where something is held.
  const paintHandles = () => {
    if (Number.isFinite(places.ghost[0])) {
      context.strokeStyle = cssColor("--reference");
      context.lineWidth = 2;
      context.beginPath();
      context.arc(...ring(), 9, 0, 2 * Math.PI);
      context.stroke();
    }
    const held = grip.line();
    if (held) {
      context.strokeStyle = cssColor("--run1");
      context.lineWidth = 3;
      context.setLineDash([4, 4]);
      context.beginPath();
      context.moveTo(...held[0]);
      context.lineTo(...held[1]);
      context.stroke();
      context.setLineDash([]);
    }
  };
  const ring = () => {
    const { hip, ghost } = places;
    return [hip[0] + RING * (ghost[0] - hip[0]), hip[1] + RING * (ghost[1] - hip[1])];
  };
  dark.addEventListener("change", () => draw(view.time));
  return { canvas, draw, places: () => places, ring: () => (places ? ring() : null) };
})();
