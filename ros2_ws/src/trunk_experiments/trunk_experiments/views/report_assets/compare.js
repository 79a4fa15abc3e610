"use strict";
// Comparing runs: hidden and shown by their entries in the legend, and less a base run.
const comparing = (() => {
  // A run's values at another run's times: on the line between two states, or as held since the last one; NaN
  // outside the run.
  const valuesAt = (times, t, y, held) =>
    times.map((time) => {
      if (!t.length || time < t[0] - 1e-10 || time > t[t.length - 1] + 1e-10) return NaN;
      const row = rowAt(t, time);
      if (held || row + 1 >= t.length || Math.abs(t[row] - time) < 1e-10) return y[row];
      return y[row] + ((time - t[row]) / (t[row + 1] - t[row])) * (y[row + 1] - y[row]);
    });

  // Returns the charts of the differences.
  const setBase = (base) => {
    for (const [column, held] of [["theta", false], ["torque", true]]) {
      report.runs.forEach((run, index) => {
        if (base === null || index === base) delete run.columns[`difference-${column}`];
        else {
          const other = report.runs[base].columns;
          const values = valuesAt(run.columns.t, other.t, other[column], held);
          run.columns[`difference-${column}`] = run.columns[column].map((v, i) => v - values[i]);
        }
      });
    }
    document.querySelectorAll(".difference").forEach((figure) => {
      figure.hidden = base === null;
      const title = figure.querySelector("strong");
      title.textContent = base === null ? "" : `${figure.dataset.title} less that of ${report.runs[base].label}`;
    });
    return ["difference-theta", "difference-torque"].map((id) => chartsById.get(id));
  };

  const start = () => {
    document.querySelectorAll("button.toggle").forEach((button) => {
      const index = Number(button.dataset.toggle);
      button.addEventListener("click", () => {
        if (isShown(index)) hiddenRuns.add(index);
        else hiddenRuns.delete(index);
        button.setAttribute("aria-pressed", String(isShown(index)));
        repaintCharts(charts);
      });
    });
    document.getElementById("base")?.addEventListener("change", async ({ target }) => {
      const base = target.value === "" ? null : Number(target.value);
      for (const chart of setBase(base)) {
        const at = charts.indexOf(chart);
        chart.view = null;
        if (base === null && at >= 0) charts.splice(at, 1);
        if (base === null) continue;
        if (at < 0) charts.push(chart);
        if (chart.drawn) repaint(chart);
        else await drawChart(chart);
      }
      target.dataset.drawn = target.value;
    });
  };
  return { start };
})();
