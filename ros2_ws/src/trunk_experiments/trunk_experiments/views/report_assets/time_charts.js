"use strict";
// Charts over time: a curve for each run, values at the cursor in the caption.
const chartsById = new Map();

// The range of columns of the runs that are shown, with a margin; null where nothing is finite.
const rangeOf = (columns, { zero = false } = {}) => {
  let [low, high] = zero ? [0, 0] : [Infinity, -Infinity];
  for (const column of columns) {
    for (let i = 0; i < column.length; i++) {
      const v = column[i];
      if (v < low && v !== -Infinity) low = v;
      if (v > high && v !== Infinity) high = v;
    }
  }
  if (!(low <= high)) return null;
  const margin = 0.06 * (high - low) || Math.abs(high) || 1;
  return [zero && low === 0 ? 0 : low - margin, high + margin];
};

// `column` of the runs over time. `options`: `shape`, `under()`, traces below the runs; `range()` of the values;
// `shapes()`; `named`: it names what happened; `later`: it is not drawn yet.
const timeChart = (id, column, symbol, unit, options = {}) => {
  const target = document.getElementById(`plot-${id}`);
  const drawn = (t, y) => thinned(t, y, shownFrom(), shownTo(), plotWidth(target));
  const curve = (index) => report.runs[index].columns[column];
  const shownColumns = () => report.runs.map((_, index) => (isShown(index) ? curve(index) : undefined)).filter(Boolean);
  const traces = () => {
    const found = options.under ? options.under(drawn) : [];
    report.runs.forEach((run, index) => {
      if (!curve(index)) return;
      found.push({
        ...drawn(run.columns.t, curve(index)), name: plainText(run.label), type: "scatter", mode: "lines", visible: isShown(index),
        line: { ...line(index), shape: options.shape ?? "linear" },
        ...hoverOf(index, `${hoverNumber("y")} ${unit}`), meta: { run: index },
      });
    });
    return found;
  };
  let ranged = { columns: [], range: null };
  const everything = () => {
    const columns = shownColumns();
    const same = columns.length === ranged.columns.length && columns.every((column, i) => column === ranged.columns[i]);
    if (!same || !ranged.range) ranged = { columns, range: rangeOf(columns, options) ?? [-1, 1] };
    return ranged.range;
  };
  const layout = () => {
    const made = baseLayout("time, s", unit ? `${symbol}, ${unit}` : symbol);
    made.hovermode = "x";
    made.xaxis.hoverformat = ".9~f";
    made.yaxis.range = options.range?.() ?? everything();
    made.shapes = [...markShapes(), ...(options.shapes ? options.shapes() : [])];
    if (options.named && marks.length) {
      const { names, rows } = markNames(plotWidth(target));
      made.annotations = names;
      made.margin.t = TOP + rows * ROW + 4;
    }
    return made;
  };
  target.classList.toggle("named", Boolean(options.named && marks.length));
  const chart = { id, target, traces, layout, timed: true, everything, view: null };
  const caption = document.querySelector(`.values[data-for=${id}]`);
  const values = report.runs.map((run, index) => {
    const value = document.createElement("span");
    value.className = "value";
    value.innerHTML = `<svg width="22" height="8" aria-hidden="true"><line data-run="${index}" x1="0" y1="4" x2="22" y2="4"/></svg>`;
    value.append(document.createElement("span"));
    caption.append(value);
    return value;
  });
  chart.show = (time) => {
    placeCursor(chart, time);
    report.runs.forEach((run, index) => {
      values[index].hidden = !isShown(index) || !curve(index);
      if (!values[index].hidden) values[index].lastChild.textContent = showNumber(curve(index)[rowAt(run.columns.t, time)], 5);
    });
  };
  if (!options.later) charts.push(chart);
  chartsById.set(id, chart);
  return chart;
};

const legendHas = (name) => document.querySelectorAll(`.if-${name}`).forEach((item) => (item.hidden = false));

// References, each once, with the band that a settled run keeps to; and angles as measured where they are others.
const underAngles = () => {
  const references = new Map();
  for (const run of report.runs) {
    const { t, reference } = run.columns;
    const changes = [];
    reference.forEach((v, i) => { if (i === 0 || v !== reference[i - 1]) changes.push(t[i], v); });
    references.set(changes.join(" "), run);
  }
  const differs = new Set(report.runs.filter(({ columns: { measured, theta } }) => measured.some((v, i) => Math.abs(v - theta[i]) > 1e-9)));
  if (differs.size) legendHas("measured");
  return (drawn) => {
    const found = [];
    for (const { columns: { t, reference } } of references.values()) {
      const { x, y } = drawn(t, reference);
      const edge = { x, type: "scatter", mode: "lines", line: { width: 0 }, hoverinfo: "skip" };
      found.push({ ...edge, y: y.map((v) => v - 6) });
      found.push({ ...edge, y: y.map((v) => v + 6), fill: "tonexty", fillcolor: cssColor("--band") });
      found.push({ ...edge, y, line: { color: cssColor("--reference"), width: 1.2, dash: "3px,3px" } });
    }
    report.runs.forEach((run, index) => {
      if (!differs.has(run)) return;
      found.push({
        ...drawn(run.columns.t, run.columns.measured), type: "scatter", mode: "lines", hoverinfo: "skip", visible: isShown(index),
        line: { color: cssColor("--soft"), width: 1, dash: "1px,2px" },
      });
    });
    return found;
  };
};

const makeTimeCharts = () => {
  const has = { pulses: (run) => run.pulses.length, "own-pulses": (run) => run.pulses.some((pulse) => runsWith(pulse).length < report.runs.length), pushes: (run) => run.pushes.length, turns: (run) => run.turns.length > 1,
    branches: (run) => run.branch !== null, falls: (run) => run.fell !== null };
  for (const [name, test] of Object.entries(has)) if (report.runs.some(test)) legendHas(name);

  const within = rangeOf(report.runs.map((run) => run.columns.reference)) ?? [0, 0];
  timeChart("angle", "theta", "θ", "°", {
    under: underAngles(), named: true,
    range: () => {
      const own = chartsById.get("angle").everything();
      return [Math.min(own[0], within[0] - 6), Math.max(own[1], within[1] + 6)];
    },
  });
  if (report.runs.length > 1) timeChart("error", "error", "e", "°");
  timeChart("difference-theta", "difference-theta", "Δθ", "°", { later: true });

  const bounds = [...new Set(report.runs.flatMap((run) => run.limits.filter((v) => v !== null)))];
  if (bounds.length) legendHas("limits");
  const peak = (run) => run.columns.torque.reduce((most, v) => Math.max(most, Math.abs(v)), 0);
  const peaks = report.runs.map(peak);
  const cut = report.runs.some((run) => run.torqueRange !== null);
  if (cut) {
    document.querySelector(".note[data-for=torque]").textContent =
      `short peaks up to ${Math.round(Math.max(...peaks)).toLocaleString("en")} N·m off scale; double-click shows all`;
  }
  timeChart("torque", "torque", "τ", "N·m", {
    shape: "hv",
    range: () => {
      const most = Math.max(...report.runs.map((run, index) => (isShown(index) ? run.torqueRange ?? peaks[index] : 0)));
      return cut && most > 0 ? [-most, most] : null;
    },
    shapes: () => bounds.map((bound) => ({
      type: "line", xref: "paper", yref: "y", x0: 0, x1: 1, y0: bound, y1: bound,
      line: { color: cssColor("--limit"), width: 1.4 },
    })),
  });
  timeChart("difference-torque", "difference-torque", "Δτ", "N·m", { shape: "hv", later: true });
  const gains = [["kp", "Kp", "N·m/rad"], ["ki", "Ki", "N·m/(rad·s)"], ["kd", "Kd", "N·m·s/rad"], ["alpha", "α", ""]];
  for (const { id, name, unit } of report.own) timeChart(id, id, name.replaceAll("_", " "), unit, { shape: "hv" });
  for (const [id, symbol, unit] of report.gains ? gains : []) timeChart(id, id, symbol, unit, { shape: "hv", zero: true });
};
