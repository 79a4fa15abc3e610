"use strict";
// The plants at the time that is shown, a pane for each run, and the hand that pulls one.
const FALL_S = 3; // for which the picture says that the trunk has fallen; of a whole run to its end
const RING = 1.4; // lengths of the bar from its pivot to the reference's handle
const scene = (() => {
  const canvas = document.getElementById("scene");
  const context = canvas.getContext("2d");
  const readouts = [...document.querySelectorAll(".readout")]; // of each run, or one of the run that is shown
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const NARROW = 150; // CSS pixels, less than a pane has if there is room for two rows
  const panes = []; // of each run: `middle` of what is shown, m; `places` of hip, tip ... in the canvas

  const limits = (run) => {
    if (run.world) return run.world.limit;
    const bounds = (run.name ? [run.name] : known.run.acting).flatMap((name) => {
      const values = known.nodes.get(name)?.parameters ?? {};
      return [values.u_clamp_max, values.u_clamp_min].filter(Number.isFinite).map(Math.abs);
    });
    const plant = known.world?.limit;
    return Math.min(...(Number.isFinite(plant) ? [plant] : []), Math.max(...bounds, 0) || Infinity);
  };
  const put = (readout, name, text) => {
    const value = readout.querySelector(`[data-value=${name}]`);
    if (value && value.textContent !== text) value.textContent = text;
  };

  const draw = (time) => {
    const size = fitCanvas(canvas, context);
    const { runs, world } = known;
    if (!size.width || !(world || runs[0].world) || runs.every(({ plant }) => plant.row(time) < 0)) return;
    const columns = size.width / runs.length < NARROW ? Math.ceil(runs.length / 2) : runs.length;
    const pane = { width: size.width / columns, tall: size.tall / Math.ceil(runs.length / columns) };
    runs.forEach((run, index) => {
      const [left, top] = [(index % columns) * pane.width, Math.floor(index / columns) * pane.tall];
      context.save();
      context.beginPath();
      context.rect(left, top, pane.width, pane.tall);
      context.clip();
      context.translate(left, top);
      panes[index] ??= { middle: null, places: null };
      if (run.plant.row(time) >= 0) drawRun(run, index, time, pane, [left, top]);
      context.restore();
    });
    if (known.control_allowed && panes[known.shown].places) paintHandles();
    readouts.forEach((readout, index) => {
      const { places } = panes[readouts.length > 1 ? index : known.shown];
      if (!places) return;
      put(readout, "t", `${time.toFixed(2)} s`);
      put(readout, "theta", `${showNumber(Math.round(1000 * places.theta) / 1000)}°`);
      put(readout, "reference", `${showNumber(places.reference)}°`);
      const { drive, unit } = runs[readouts.length > 1 ? index : known.shown].world ?? world ?? {};
      put(readout, "torque", `${showNumber(Math.round(1e6 * places.torque) / 1e6)} ${drive || unit === "rad" ? "N·m" : "N"}`);
      put(readout, "x", unit === "rad" ? `${showNumber(places.x * DEGREES)}°` : `${showNumber(places.x)} m`);
      put(readout, "fell", places.fell ? `at ${showNumber(places.fell.t, 6)} s` : "not yet");
      put(readout, "push", grip.words());
    });
  };

  const drawRun = (run, index, time, size, [left, top]) => {
    const { plant, control, events } = run;
    const row = plant.row(time);
    const told = control.row(time);
    const x = plant.value("x", row);
    const { picture, drive } = run.world ?? known.world;
    const reach = reachOf(picture);
    const { amplitude = 0, cosines = [], sines = [] } = picture.track ?? {};
    const rise = [amplitude, ...cosines, ...sines].reduce((sum, v) => sum + Math.abs(v), 0);
    const [low, high] = [-rise - 0.5 * reach, rise + 1.6 * reach];
    const half = Math.max((known.runs.length > 1 ? 1.5 : 2.6) * reach, ((high - low) * size.width) / size.tall / 2);
    // The first frame moves about the middle of the picture before the picture moves with it.
    const at = placed(picture, [x, 0])[picture.frames[0].name].x;
    let { middle } = panes[index];
    if (middle === null || Math.abs(at - middle) > 3 * reach) middle = at;
    const free = Math.max(0.1 * reach, Math.min(1.2 * reach, half - 1.4 * reach));
    middle += Math.sign(at - middle) * Math.max(0, Math.abs(at - middle) - free);
    const bound = limits(run);
    const theta = plant.value("theta", row) * DEGREES;
    const torque = plant.value("torque", row);
    const reference = control.value("reference", told) * DEGREES;
    const fall = events.findLast((event) => event.event === "fell" && event.t <= time && (known.recorded || event.t > time - FALL_S));
    const color = runColor(index);
    const places = paintStage(
      context, size,
      {
        picture, drive, reach, left: middle - half, right: middle + half, low, high,
        color, fullTorque: Number.isFinite(bound) ? bound : 100, named: known.runs.length > 1,
      },
      {
        x, theta, measured: control.value("measurement", told) * DEGREES, reference, torque,
        pulse: known.pulses.find(({ start, end, runs }) => start <= time + 1e-10 && time + 1e-10 < end && (runs ?? [index]).includes(index))?.text ?? null,
        ...(run.ended && time >= plant.last ? { fell: plant.last, ended: run.ended } : { fell: fall ? fall.t : null }),
      },
    );
    if (known.runs.length > 1) paintName(run, color, size, index === known.shown);
    for (const place of ["hip", "pivot", "tip", "ghost"]) places[place] = [places[place][0] + left, places[place][1] + top];
    panes[index] = { middle, places: { ...places, theta, reference, torque, x, fell: fall, rate: plant.value("theta_dot", row) } };
  };
  const paintName = (run, color, { width, tall }, shown) => {
    context.fillStyle = color;
    context.font = `${shown ? 700 : 400} 14px system-ui, sans-serif`;
    context.textAlign = "left";
    context.fillText(run.name, 10, 20, width - 20);
    context.strokeStyle = cssColor("--rule");
    context.lineWidth = 1;
    context.strokeRect(0.5, 0.5, width, tall);
  };

  // A ring where the reference can be dragged, and a line to the pointer where something is held.
  const paintHandles = () => {
    const around = ring(known.shown);
    if (around) {
      context.strokeStyle = cssColor("--reference");
      context.lineWidth = 2;
      context.beginPath();
      context.arc(...around, 9, 0, 2 * Math.PI);
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
  // Where the reference can be dragged; null where it cannot.
  const ring = (pane = 0) => {
    const { pivot, ghost } = panes[pane]?.places ?? {};
    if (known.recorded || !Number.isFinite(ghost?.[0])) return null;
    return [0, 1].map((i) => pivot[i] + RING * (ghost[i] - pivot[i]));
  };
  dark.addEventListener("change", () => draw(view.time));
  return { canvas, draw, ring, panes, places: (pane = 0) => panes[pane]?.places ?? null };
})();
