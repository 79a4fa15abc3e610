"use strict";
// Charts over something else than time: phase portrait, hip path, fuzzy surfaces; a dot where each run is.

// The box of a plane that is shown, or else of everything.
const boxOf = (chart, everything) => {
  const [x, y] = [chart.view?.x ?? everything.x, chart.view?.y ?? everything.y];
  return { left: Math.min(...x), right: Math.max(...x), low: Math.min(...y), high: Math.max(...y) };
};
// A way in a plane as Plotly takes it, with its times for the pointer.
const way = (x, y, t, box) => {
  const rows = thinnedWay(x, y, box);
  return { x: rowsOf(rows, x), y: rowsOf(rows, y), customdata: rowsOf(rows, t), type: "scatter", mode: "lines" };
};
const dotChart = (target, traces, layout, positions) => {
  const chart = { target, layout, dots: [], timed: false, view: null };
  chart.traces = () => traces(chart);
  chart.show = (time) => placeDots(chart, positions(time));
  charts.push(chart);
};

// Another robot may have no velocities, and nothing is known of its hip: then the place is missing.
const makePlaneCharts = () => {
  const { runs } = report;
  const phase = document.getElementById("plot-phase");
  if (phase) {
    const whole = { x: rangeOf(runs.map((run) => run.columns.theta)) ?? [0, 1], y: rangeOf(runs.map((run) => run.columns.rate)) ?? [0, 1] };
    dotChart(
      phase,
      (chart) => runs.map((run, index) => ({
        ...way(run.columns.theta, run.columns.rate, run.columns.t, boxOf(chart, whole)),
        line: line(index, 1.6), name: plainText(run.label), visible: isShown(index),
        ...hoverOf(index, `${hoverNumber("x")}°, ${hoverNumber("y")} rad/s<br>t = %{customdata:.9~f} s`),
      })),
      () => ({ ...baseLayout("angle, °", "rate, rad/s"), hovermode: "closest" }),
      (time) => runs.map((run, index) => {
        const row = rowAt(run.columns.t, time);
        return isShown(index) ? [run.columns.theta[row], run.columns.rate[row], runColor(index)] : null;
      }),
    );
  }
  const place = document.getElementById("plot-path");
  if (!place) return;
  const heights = runs.map((run) => run.columns.x.map((x) => pathHeight(run.path, x)));
  const whole = { x: rangeOf(runs.map((run) => run.columns.x)) ?? [0, 1], y: rangeOf(heights) ?? [0, 1] };
  dotChart(
    place,
    (chart) => runs.map((run, index) => ({
      ...way(run.columns.x, heights[index], run.columns.t, boxOf(chart, whole)), visible: isShown(index),
      line: { ...line(index, 2 + 3 * Math.min(4, runs.length - 1 - index)), dash: "solid" }, name: plainText(run.label),
      ...hoverOf(index, `x ${hoverNumber("x")} m<br>y ${hoverNumber("y")} m<br>t = %{customdata:.9~f} s`),
    })),
    () => {
      const made = { ...baseLayout("x, m", "y, m"), hovermode: "closest" };
      if (whole.x[1] - whole.x[0] < 22) made.yaxis.scaleanchor = "x";
      return made;
    },
    (time) => runs.map((run, index) => {
      const row = rowAt(run.columns.t, time);
      return isShown(index) ? [run.columns.x[row], heights[index][row], runColor(index)] : null;
    }),
  );
};

const makeMaps = () => {
  report.runs.forEach((run, index) => {
    const fuzzy = run.fuzzy;
    if (!fuzzy) return;
    const columns = fuzzy.error.length;
    const { t, error, rate } = fuzzy.updates;
    const ways = new Map(); // three surfaces, one way
    const wayIn = (box) => {
      const key = JSON.stringify(box);
      if (!ways.has(key)) {
        ways.clear();
        ways.set(key, way(error, rate, t, box));
      }
      return ways.get(key);
    };
    const whole = { x: [fuzzy.error[0], fuzzy.error[columns - 1]], y: [fuzzy.rate[0], fuzzy.rate[fuzzy.rate.length - 1]] };
    for (const { id, values, range } of fuzzy.outputs) {
      const z = Array.from(fuzzy.rate, (_, i) => values.subarray(i * columns, (i + 1) * columns));
      const surface = () => ({
        type: "heatmap", x: fuzzy.error, y: fuzzy.rate, z, colorscale: "Cividis", zauto: !range,
        zmin: range?.[0], zmax: range?.[1], colorbar: { thickness: 12, len: 1, outlinewidth: 0, xpad: 22, ticklabelposition: "outside", nticks: 6 },
        hovertemplate: "e %{x:.4~g}°, ė %{y:.4~g} rad/s: %{z:.5~g}<extra></extra>",
      });
      const peaks = (values, axis) => values.map((v) => ({
        type: "line", xref: axis === "x" ? "x" : "paper", yref: axis === "x" ? "paper" : "y",
        x0: axis === "x" ? v : 0, x1: axis === "x" ? v : 1, y0: axis === "x" ? 0 : v, y1: axis === "x" ? 1 : v,
        line: { color: "rgba(255,255,255,.45)", width: 1, dash: "dot" },
      }));
      dotChart(
        document.getElementById(`map-${index}-${id}`),
        (chart) => {
          const gone = {
            ...wayIn(boxOf(chart, whole)), line: { color: "#ffffff", width: 1.6 },
            hovertemplate: `e ${hoverNumber("x")}°, ė ${hoverNumber("y")} rad/s<br>t = %{customdata:.9~f} s<extra></extra>`,
          };
          return [surface(), { ...gone, line: { color: "#000000", width: 4 }, hoverinfo: "skip", hovertemplate: null }, gone];
        },
        () => {
          const made = { ...baseLayout("error e, °", "its rate ė, rad/s"), hovermode: "closest" };
          made.xaxis.range = whole.x;
          made.yaxis.range = whole.y;
          made.margin = { l: 50, r: 68, t: TOP + 10, b: 40 };
          made.shapes = [...peaks(fuzzy.errorPeaks, "x"), ...peaks(fuzzy.ratePeaks, "y")];
          const label = { showarrow: false, font: { size: 9 } };
          made.annotations = [
            ...fuzzy.errorLabels.map((text, i) => ({ ...label, text: plainText(text), x: fuzzy.errorPeaks[i], y: 1, yref: "paper", yanchor: "bottom" })),
            ...fuzzy.rateLabels.map((text, i) => ({ ...label, text: plainText(text), y: fuzzy.ratePeaks[i], x: 1, xref: "paper", xanchor: "left" })),
          ];
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
