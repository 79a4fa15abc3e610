"use strict";
// What a connection is for a running graph: recorded runs that the page itself holds, exact to the last bit.
const report = JSON.parse(document.getElementById("report-data").textContent);
// Paper has more pixels than a screen.
const pixels = Math.max(2, devicePixelRatio);
Object.defineProperty(window, "devicePixelRatio", { get: () => pixels });
const wire = (() => {
  const listeners = [];
  const say = (kind, values) => listeners.forEach((listener) => listener(kind, values));
  const several = report.runs.length > 1;

  // ── columns ──────────────────────────────────────────────────────────────────────────────────────────
  // `packed` in report_data.py wrote them: the bytes of all numbers by their weight, and of their bits the differences.
  const unpacked = async ({ places, count, differences, data }) => {
    const gzip = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
    const planes = new Uint8Array(await new Response(new Blob([gzip]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer());
    const bytes = new Uint8Array(planes.length);
    const all = planes.length / 8;
    for (let plane = 0; plane < 8; plane++) for (let i = 0; i < all; i++) bytes[8 * i + plane] = planes[plane * all + i];
    const bits = new BigInt64Array(bytes.buffer);
    for (let pass = 0; pass < differences; pass++)
      for (let i = 0; i < all; i++) if (i % count) bits[i] += bits[i - 1]; // which wraps around, as it should
    return new Map(Object.entries(places).map(([name, place]) => [name, new Float64Array(bytes.buffer, 8 * place * count, count)]));
  };
  const runOf = async ({ name, world, fell, columns }) => {
    const run = new Run(name);
    run.plant.columns = await unpacked(columns);
    run.plant.count = columns.count;
    run.plant.forget = false;
    run.control = run.plant; // a row for each state
    run.world = world;
    run.events = fell === null ? [] : [{ event: "fell", t: fell }];
    const { columns: own } = run.plant;
    if (several) own.set("error", own.get("reference").map((angle, i) => angle - own.get("theta")[i]));
    return run;
  };

  // ── charts ───────────────────────────────────────────────────────────────────────────────────────────
  const line = (label, column, more = {}) => ({ label, column, alike: true, ...more });
  const angles = { scale: 180 / Math.PI };
  const steps = { stepped: true };
  const chart = (id, title, lines, more = {}) => ({ id, title, of: "plant", lines, ...more });
  let base = null; // the run of which the others are the difference
  const angleLines = () => {
    const references = [...new Set(report.runs.map(({ reference }) => reference))].flatMap((index, i) => {
      const shown = { label: "", column: "reference", ...angles, color: "--reference", of: () => known.runs[index].plant };
      return [
        { ...shown, plus: -report.band, width: 0, band: true }, { ...shown, plus: report.band, width: 0 },
        { ...shown, label: i ? "" : `reference ±${report.band}°`, width: 1.2, dash: [3, 3] },
      ];
    });
    const measured = report.runs.flatMap((run, index) => (run.measured && !known.runs[index].hidden ? [index] : [])).map((index, i) => (
      { label: i ? "" : "as measured", column: "measurement", ...angles, color: "--soft", width: 1, dash: [1, 2], of: () => known.runs[index].plant }));
    return [...references, ...measured, line("θ", "theta", angles)];
  };
  const difference = (column, title, unit, more) => (base === null ? [] : [chart(`difference-${column}`, `${title} less that of ${known.runs[base].name}, ${unit}`,
    [line("", `difference_${column}`, { ...more, except: base })], { wide: true })]);
  const limits = () => report.limits.map((level, i) => ({ label: i ? "" : "limits", color: "--limit", width: 1.4, level: () => level }));
  const gains = () => [["kp", "Kp", inWords("Gain Kp, N·m/rad")], ["ki", "Ki", inWords("Gain Ki, N·m/(rad·s)")], ["kd", "Kd", inWords("Gain Kd, N·m·s/rad")], ["alpha", "α", "Ratio α = Kp²/(Ki Kd)"]];
  const kinds = () => (!known.recorded ? [] : [
    chart("angle", "Angle θ, °", angleLines(), { wide: true }),
    ...(several ? [chart("error", "Error e = reference − angle, °", [line("e", "error", angles)], { wide: true })] : []),
    ...difference("theta", "Angle", "°", angles),
    chart("torque", inWords("Torque τ, N·m"), [...limits(), line("τ", "torque", steps)], { wide: true, cut: true }),
    ...difference("torque", inWords("Torque"), inWords("N·m"), steps),
    ...report.own.map(({ name, unit }) => {
      const words = name.replaceAll("_", " ");
      return chart(`own-${name}`, unit ? `${words}, ${unit}` : words, [line(words, name, steps)]);
    }),
    ...(report.gains ? gains().map(([id, label, title]) => chart(id, title, [line(label, id, steps)], { zero: true })) : []),
  ]);
  // A run's values at another run's times: on the line between two states, or as held since the last one; NaN outside.
  const valuesAt = (times, t, y, held) => times.map((time) => {
    if (!t.length || time < t[0] - 1e-10 || time > t[t.length - 1] + 1e-10) return NaN;
    const row = rowAt(t, time);
    if (held || row + 1 >= t.length || Math.abs(t[row] - time) < 1e-10) return y[row];
    return y[row] + ((time - t[row]) / (t[row + 1] - t[row])) * (y[row + 1] - y[row]);
  });
  const subtract = (index) => {
    base = index;
    for (const column of ["theta", "torque"]) for (const { plant } of base === null ? [] : known.runs) {
      const other = known.runs[base].plant;
      const values = valuesAt(plant.t, other.t, other.columns.get(column), column === "torque");
      plant.columns.set(`difference_${column}`, plant.columns.get(column).map((value, i) => value - values[i]));
    }
  };

  const open = async () => {
    known.runs = await Promise.all(report.runs.map(runOf));
    Object.assign(known, { pulses: report.pulses, pushed: report.pushed, marks: report.marks });
    const ends = known.runs.map(({ plant }) => [plant.t[0], plant.last]);
    known.recorded = { first: Math.min(...ends.map(([first]) => first)), last: Math.max(...ends.map(([, last]) => last)) };
    view.zoom(known.recorded.first, known.recorded.last);
    if (report.words) speakOf(report.words);
    say("recorded", known.recorded);
  };
  return { open, kinds, subtract, listen: (listener) => listeners.push(listener) };
})();
// Nothing of a report can be changed or pushed.
const grip = { turn: () => {}, words: () => "", line: () => null };
const [edits, rules, knobs] = [{ show: () => {}, undo: () => {} }, { show: () => {}, draw: () => {} }, { show: () => {}, showAll: () => {}, showGains: () => {} }];
