"use strict";
// Plotly charts: linked zoom, one time cursor over all, values at the cursor in every caption.
const charts = [];
const CONFIG = {
  responsive: true,
  displaylogo: false,
  modeBarButtons: [["zoomIn2d", "zoomOut2d", "resetScale2d"], ["zoom2d", "pan2d"], ["toImage"]],
};
// Touch screens scroll and have no hover: there the buttons always show, in their own row.
const coarse = matchMedia("(pointer: coarse)").matches;
const TOP = coarse ? 34 : 8;

const baseLayout = (xTitle, yTitle) => {
  const axis = {
    gridcolor: cssColor("--grid"), linecolor: cssColor("--rule"), zeroline: false, showline: true, ticks: "outside",
    tickcolor: cssColor("--rule"), automargin: false,
  };
  return {
    margin: { l: 58, r: 14, t: TOP, b: 40 },
    paper_bgcolor: "rgba(0,0,0,0)",
    plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: cssColor("--ink"), family: "system-ui, sans-serif", size: 12 },
    hoverlabel: { font: { size: 12 } },
    showlegend: false,
    dragmode: coarse ? false : "zoom",
    modebar: { orientation: "h", bgcolor: "rgba(0,0,0,0)", color: cssColor("--soft"), activecolor: cssColor("--accent") },
    xaxis: { ...axis, title: { text: xTitle, standoff: 4 } },
    yaxis: { ...axis, title: { text: yTitle, standoff: 4 } },
  };
};
const line = (index, width = 2) => ({ color: runColor(index), dash: runDash(index), width });
const element = (id, kind) => {
  const mark = document.createElement("div");
  mark.className = kind;
  mark.hidden = true;
  mark.setAttribute("aria-hidden", "true");
  document.getElementById(id).append(mark);
  return mark;
};

// ── charts over time ─────────────────────────────────────────────────────────────────────────────────
const timeChart = (id, column, symbol, unit, options = {}) => {
  const target = document.getElementById(`plot-${id}`);
  const traces = () => {
    const found = options.under ? options.under() : [];
    report.runs.forEach((run, index) =>
      found.push({
        x: run.columns.t, y: run.columns[column], name: run.label, type: "scatter", mode: "lines",
        line: { ...line(index), shape: options.shape ?? "linear", simplify: true },
        hovertemplate: `%{y:.10~g} ${unit}<extra></extra>`, meta: { run: index },
      }),
    );
    return found;
  };
  const layout = () => {
    const made = baseLayout("time, s", unit ? `${symbol}, ${unit}` : symbol);
    made.hovermode = "x";
    made.xaxis.range = [report.start, report.end];
    made.xaxis.hoverformat = ".9~f";
    Object.assign(made.yaxis, options.yaxis ? options.yaxis() : {});
    const spans = new Map();
    for (const run of report.runs) for (const p of run.pulses) spans.set(`${p.start} ${p.end}`, p);
    made.shapes = [...spans.values()].map((p) => ({
      type: "rect", xref: "x", yref: "paper", x0: p.start, x1: p.end, y0: 0, y1: 1, line: { width: 0 },
      fillcolor: cssColor("--pulse"), layer: "below",
    }));
    const takeovers = new Set(report.runs.flatMap((run) => run.turns.slice(1).map((turn) => turn.start)));
    made.shapes.push(...[...takeovers].map((at) => ({
      type: "line", xref: "x", yref: "paper", x0: at, x1: at, y0: 0, y1: 1, layer: "below",
      line: { color: cssColor("--soft"), width: 1, dash: "5px,2px,1px,2px" },
    })));
    const branches = new Set(report.runs.map((run) => run.branch).filter((at) => at !== null));
    made.shapes.push(...[...branches].map((at) => ({
      type: "line", xref: "x", yref: "paper", x0: at, x1: at, y0: 0, y1: 1,
      line: { color: cssColor("--branch"), width: 1.4, dash: "6px,2px" },
    })));
    made.shapes.push(...report.runs.filter((run) => run.fell !== null).map((run) => ({
      type: "line", xref: "x", yref: "paper", x0: run.fell, x1: run.fell, y0: 0, y1: 1,
      line: { color: cssColor("--limit"), width: 1.6, dash: "2px,3px" },
    })));
    made.shapes.push(...(options.shapes ? options.shapes() : []));
    return made;
  };
  const chart = { id, target, traces, layout, timed: true };
  const caption = document.querySelector(`.values[data-for=${id}]`);
  const values = report.runs.map((run, index) => {
    const value = document.createElement("span");
    value.style.color = runColor(index);
    caption.append(value);
    return value;
  });
  chart.show = (time) => {
    placeCursor(chart, time);
    report.runs.forEach((run, index) => {
      const value = run.columns[column][rowAt(run.columns.t, time)];
      values[index].textContent = showNumber(value, 5);
      values[index].style.color = runColor(index);
    });
  };
  charts.push(chart);
  return chart;
};

const placeCursor = (chart, time) => {
  const layout = chart.target._fullLayout;
  if (!layout) return;
  chart.cursor ??= element(chart.target.id, "cursor");
  const at = layout.xaxis.d2p(time);
  const { l, t, w, h } = layout._size;
  chart.cursor.hidden = at < -0.5 || at > w + 0.5;
  chart.cursor.style.left = `${l + at}px`;
  chart.cursor.style.top = `${t}px`;
  chart.cursor.style.height = `${h}px`;
};

// ── charts over something else: a dot where each run is ──────────────────────────────────────────────
const dotChart = (target, traces, layout, positions) => {
  const chart = { target, traces, layout, dots: [] };
  chart.show = (time) => {
    const full = target._fullLayout;
    if (!full) return;
    positions(time).forEach(([x, y, color], i) => {
      const dot = (chart.dots[i] ??= element(target.id, "dot"));
      const left = full.xaxis.d2p(x);
      const top = full.yaxis.d2p(y);
      const { l, t, w, h } = full._size;
      dot.hidden = !(left >= -1 && left <= w + 1 && top >= -1 && top <= h + 1);
      dot.style.left = `${l + left}px`;
      dot.style.top = `${t + top}px`;
      dot.style.background = color;
    });
  };
  charts.push(chart);
  return chart;
};

// ── what there is ────────────────────────────────────────────────────────────────────────────────────
const legendHas = (name) => document.querySelectorAll(`.if-${name}`).forEach((item) => (item.hidden = false));

const makeTimeCharts = () => {
  const references = new Map();
  for (const run of report.runs) {
    const { t, reference } = run.columns;
    const changes = [];
    reference.forEach((v, i) => { if (i === 0 || v !== reference[i - 1]) changes.push(t[i], v); });
    references.set(changes.join(" "), run);
  }
  const differs = report.runs.filter((run) => run.columns.measured.some((v, i) => Math.abs(v - run.columns.theta[i]) > 1e-9));
  if (differs.length) legendHas("measured");
  if (report.runs.some((run) => run.pulses.length)) legendHas("pulses");
  if (report.runs.some((run) => run.turns.length > 1)) legendHas("turns");
  if (report.runs.some((run) => run.branch !== null)) legendHas("branches");
  if (report.runs.some((run) => run.fell !== null)) legendHas("falls");

  timeChart("angle", "theta", "θ", "°", {
    under: () => {
      const found = [];
      for (const { columns: { t, reference } } of references.values()) {
        const edge = { x: t, type: "scatter", mode: "lines", line: { width: 0 }, hoverinfo: "skip" };
        found.push({ ...edge, y: reference.map((v) => v - 6) });
        found.push({ ...edge, y: reference.map((v) => v + 6), fill: "tonexty", fillcolor: cssColor("--band") });
        found.push({ ...edge, y: reference, line: { color: cssColor("--reference"), width: 1.2, dash: "3px,3px" } });
      }
      for (const run of differs) {
        found.push({
          x: run.columns.t, y: run.columns.measured, type: "scatter", mode: "lines", hoverinfo: "skip",
          line: { color: cssColor("--soft"), width: 1, dash: "1px,2px" },
        });
      }
      return found;
    },
  });

  const bounds = [...new Set(report.runs.flatMap((run) => run.limits.filter((v) => v !== null)))];
  if (bounds.length) legendHas("limits");
  const peak = (run) => run.columns.torque.reduce((most, v) => Math.max(most, Math.abs(v)), 0);
  const cut = report.runs.some((run) => run.torqueRange !== null);
  const range = Math.max(...report.runs.map((run) => run.torqueRange ?? peak(run)));
  if (cut) {
    const most = Math.max(...report.runs.map(peak));
    document.querySelector(".note[data-for=torque]").textContent =
      `short peaks up to ${Math.round(most).toLocaleString("en")} N·m off scale; double-click shows all`;
  }
  timeChart("torque", "torque", "τ", "N·m", {
    shape: "hv",
    yaxis: () => (cut ? { range: [-range, range] } : {}),
    shapes: () => bounds.map((bound) => ({
      type: "line", xref: "paper", yref: "y", x0: 0, x1: 1, y0: bound, y1: bound,
      line: { color: cssColor("--limit"), width: 1.4 },
    })),
  });
  const gains = [["kp", "Kp", "N·m/rad"], ["ki", "Ki", "N·m/(rad·s)"], ["kd", "Kd", "N·m·s/rad"], ["alpha", "α", ""]];
  for (const { id, name, unit } of report.own) timeChart(id, id, name.replaceAll("_", " "), unit, { shape: "hv" });
  for (const [id, symbol, unit] of report.gains ? gains : []) {
    timeChart(id, id, symbol, unit, { shape: "hv", yaxis: () => ({ rangemode: "tozero" }) });
  }
};

// Another robot may have no velocities, and nothing is known of its hip: then the place is missing.
const makePlaneCharts = () => {
  const phase = document.getElementById("plot-phase");
  if (phase) dotChart(
    phase,
    () => report.runs.map((run, index) => ({
      x: run.columns.theta, y: run.columns.rate, customdata: run.columns.t, type: "scatter", mode: "lines",
      line: line(index, 1.6), name: run.label,
      hovertemplate: "%{x:.10~g}°, %{y:.10~g} rad/s<br>t = %{customdata:.9~f} s<extra></extra>",
    })),
    () => ({ ...baseLayout("angle, °", "rate, rad/s"), hovermode: "closest" }),
    (time) => report.runs.map((run, index) => {
      const row = rowAt(run.columns.t, time);
      return [run.columns.theta[row], run.columns.rate[row], runColor(index)];
    }),
  );
  const place = document.getElementById("plot-path");
  if (!place) return;
  const height = (run, x) => pathHeight(run.path, x);
  dotChart(
    place,
    () => report.runs.map((run, index) => ({
      x: run.columns.x, y: run.columns.x.map((x) => height(run, x)), customdata: run.columns.t, type: "scatter",
      mode: "lines", line: { ...line(index, 2 + 3 * (report.runs.length - 1 - index)), dash: "solid" }, name: run.label,
      hovertemplate: "x %{x:.10~g} m<br>y %{y:.10~g} m<br>t = %{customdata:.9~f} s<extra></extra>",
    })),
    () => {
      const made = { ...baseLayout("x, m", "y, m"), hovermode: "closest" };
      const all = report.runs.flatMap((run) => [run.columns.x.reduce((a, b) => Math.min(a, b)), run.columns.x.reduce((a, b) => Math.max(a, b))]);
      if (Math.max(...all) - Math.min(...all) < 20) made.yaxis.scaleanchor = "x";
      return made;
    },
    (time) => report.runs.map((run, index) => {
      const x = run.columns.x[rowAt(run.columns.t, time)];
      return [x, height(run, x), runColor(index)];
    }),
  );
};

const makeMaps = () => {
  report.runs.forEach((run, index) => {
    const fuzzy = run.fuzzy;
    if (!fuzzy) return;
    const columns = fuzzy.error.length;
    const { t, error, rate } = fuzzy.updates;
    for (const name of ["kp", "kd", "alpha"]) {
      const z = Array.from(fuzzy.rate, (_, i) => fuzzy[name].subarray(i * columns, (i + 1) * columns));
      const [low, high] = name === "alpha" ? [2, 5] : [0, 1];
      const surface = () => ({
        type: "heatmap", x: fuzzy.error, y: fuzzy.rate, z, colorscale: "Cividis", zauto: name === "alpha",
        zmin: low, zmax: high, colorbar: { thickness: 12, len: 1, outlinewidth: 0 },
        hovertemplate: "e %{x:.4~g}°, ė %{y:.4~g} rad/s: %{z:.5~g}<extra></extra>",
      });
      const way = () => ({
        type: "scatter", mode: "lines", x: error, y: rate, customdata: t, line: { color: "#ffffff", width: 1.6 },
        hovertemplate: "e %{x:.10~g}°, ė %{y:.10~g} rad/s<br>t = %{customdata:.9~f} s<extra></extra>",
      });
      const edge = () => ({ ...way(), line: { color: "#000000", width: 4 }, hoverinfo: "skip", hovertemplate: null });
      const peaks = (values, axis) => values.map((v) => ({
        type: "line", xref: axis === "x" ? "x" : "paper", yref: axis === "x" ? "paper" : "y",
        x0: axis === "x" ? v : 0, x1: axis === "x" ? v : 1, y0: axis === "x" ? 0 : v, y1: axis === "x" ? 1 : v,
        line: { color: "rgba(255,255,255,.45)", width: 1, dash: "dot" },
      }));
      dotChart(
        document.getElementById(`map-${index}-${name}`),
        () => [surface(), edge(), way()],
        () => {
          const made = { ...baseLayout("error e, °", "its rate ė, rad/s"), hovermode: "closest" };
          made.xaxis.range = [fuzzy.error[0], fuzzy.error[columns - 1]];
          made.yaxis.range = [fuzzy.rate[0], fuzzy.rate[fuzzy.rate.length - 1]];
          made.margin = { l: 50, r: 8, t: TOP, b: 40 };
          made.shapes = [...peaks(fuzzy.errorPeaks, "x"), ...peaks(fuzzy.ratePeaks, "y")];
          return made;
        },
        (time) => {
          const row = rowAt(t, time);
          const clamp = (v, all) => Math.min(all[all.length - 1], Math.max(all[0], v));
          return t.length ? [[clamp(error[row], fuzzy.error), clamp(rate[row], fuzzy.rate), runColor(index)]] : [];
        },
      );
    }
  });
};

// ── drawing, linking ─────────────────────────────────────────────────────────────────────────────────
let linking = false;
const link = (chart) => {
  chart.target.on("plotly_relayout", (change) => {
    chart.show(clock.time);
    if (!chart.timed || linking) return;
    const range = change["xaxis.range"] ?? (("xaxis.range[0]" in change) ? [change["xaxis.range[0]"], change["xaxis.range[1]"]] : null);
    const whole = change["xaxis.autorange"];
    if (!range && !whole) return;
    linking = true;
    const wanted = { "xaxis.range": range ?? [report.start, report.end] };
    const others = charts.filter((other) => other.timed && (other !== chart || whole));
    Promise.all(others.map((other) => Plotly.relayout(other.target, wanted))).then(() => {
      linking = false;
      clock.set(clock.time);
    });
  });
  const seek = (event) => {
    const point = event.points[0];
    const time = chart.timed ? point.x : point.customdata;
    if (Number.isFinite(time)) clock.set(time);
  };
  chart.target.on("plotly_hover", (event) => { if (!clock.playing) seek(event); });
  chart.target.on("plotly_click", seek);
  chart.target.on("plotly_afterplot", () => chart.show(clock.time));
};

const drawCharts = async () => {
  for (const chart of charts) {
    await Plotly.newPlot(chart.target, chart.traces(), chart.layout(), CONFIG);
    link(chart);
    chart.show(clock.time);
    await new Promise(requestAnimationFrame); // the page stays alive while it fills
  }
};

const repaintCharts = () => {
  for (const chart of charts) Plotly.react(chart.target, chart.traces(), chart.layout(), CONFIG);
};
