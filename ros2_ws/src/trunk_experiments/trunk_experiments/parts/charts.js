"use strict";
// Strip charts over the window that is shown (uPlot). A bucket of many rows is drawn as its least and its greatest
// value, so that no spike is left out.
const strips = (() => {
  const place = document.getElementById("live-charts");
  const BUCKETS = 700;
  const made = new Map();
  const line = (label, column, color, more = {}) => ({ label, column, color, ...more });
  const ANGLE = { scale: DEGREES };
  const KINDS = [
    { id: "angle", title: "Angle, °", of: "plant", lines: [
      line("θ", "theta", "--run0", ANGLE),
      line("measured", "measurement", "--run5", { ...ANGLE, from: "control", dash: [2, 3], width: 1 }),
      line("reference", "reference", "--reference", { ...ANGLE, from: "control", dash: [5, 4], width: 1.2 }),
    ] },
    { id: "torque", title: "Torque, N·m", of: "plant", lines: [
      line("τ", "torque", "--run0"),
      line("push", "torque", "--run1", { from: "pushes", dash: [6, 2], timeout: 0.25 }),
      line("limits", null, "--limit", { dash: [2, 3], width: 1.2, bound: 1 }),
      line("", null, "--limit", { dash: [2, 3], width: 1.2, bound: -1 }),
    ] },
    { id: "terms", title: "Terms, N·m", of: "control", lines: [
      line("P", "p_term", "--run0"), line("I", "i_term", "--run1", { dash: [8, 3] }), line("D", "d_term", "--run2", { dash: [3, 2] }),
    ] },
    { id: "gains", title: "Gains", of: "control", lines: [
      line("Kp, N·m/rad", "kp", "--run0"), line("Ki, N·m/(rad·s)", "ki", "--run1", { dash: [8, 3] }),
      line("Kd, N·m·s/rad", "kd", "--run2", { dash: [3, 2] }),
    ] },
    { id: "alpha", title: "Ratio α", of: "control", lines: [line("α", "alpha", "--run0")] },
  ];
  // What a law tells besides these has a chart of its own.
  const ORDINARY = new Set(["t", "reference", "measurement", "error", "error_rate", "effort", "unsaturated",
    "row", "column", "w00", "w01", "w10", "w11", ...KINDS.flatMap((kind) => kind.lines.map((l) => l.column))]);

  const bounds = () => known.run.acting.flatMap((name) => {
    const values = known.nodes.get(name)?.parameters ?? {};
    return [values.u_clamp_max, values.u_clamp_min];
  }).filter(Number.isFinite);

  // The rows of a store between two times, at most two for each bucket.
  const window = (kind, from, to) => {
    const store = known[kind.of];
    const first = Math.max(0, store.row(from));
    const end = store.row(to) + 1;
    const count = Math.max(0, end - first);
    const size = Math.max(1, Math.ceil(count / BUCKETS));
    const rows = size === 1 ? count : 2 * Math.ceil(count / size);
    const t = new Float64Array(rows);
    const times = store.columns.get("t");
    for (let i = 0; i < rows; i++) {
      const bucket = size === 1 ? first + i : first + (i >> 1) * size + (i & 1 ? size >> 1 : 0);
      t[i] = times[Math.min(bucket, end - 1)];
    }
    return [t, ...kind.lines.map((one) => values(one, store, { first, end, size, rows, t }))];
  };
  const values = (one, store, { first, end, size, rows, t }) => {
    const found = new Float64Array(rows).fill(NaN);
    const factor = one.scale ?? 1;
    if (one.bound) {
      const [high, low] = [Math.max(...bounds()), Math.min(...bounds())];
      const at = one.bound > 0 ? high : low;
      return Number.isFinite(at) ? found.fill(at) : found;
    }
    if (one.from) {
      const other = known[one.from];
      const column = other.columns.get(one.column);
      const times = other.t;
      let at = -1;
      for (let i = 0; column && i < rows; i++) {
        while (at + 1 < other.count && times[at + 1] <= t[i] + 1e-9) at += 1;
        if (at >= 0 && !(one.timeout && t[i] - times[at] > one.timeout)) found[i] = column[at] * factor;
      }
      return found;
    }
    const column = store.columns.get(one.column);
    if (!column) return found;
    if (size === 1) {
      for (let i = 0; i < rows; i++) found[i] = column[first + i] * factor;
      return found;
    }
    for (let i = 0; i < rows; i += 2) {
      const begin = first + (i >> 1) * size;
      const stop = Math.min(begin + size, end);
      let low = Infinity;
      let high = -Infinity;
      for (let k = begin; k < stop; k++) {
        const value = column[k];
        if (value < low) low = value;
        if (value > high) high = value;
      }
      if (low <= high) {
        found[i] = low * factor;
        found[i + 1] = high * factor;
      }
    }
    return found;
  };

  // What is not a number makes a gap in uPlot only as null.
  const gaps = (column) => (column.some(Number.isNaN) ? Array.from(column, (v) => (Number.isNaN(v) ? null : v)) : column);

  const make = (kind) => {
    const figure = document.createElement("figure");
    figure.className = "card chart";
    figure.id = `strip-${kind.id}`;
    figure.setAttribute("role", "group");
    figure.setAttribute("aria-label", kind.title);
    const caption = document.createElement("figcaption");
    const title = document.createElement("strong");
    title.textContent = kind.title;
    caption.append(title);
    const keys = kind.lines.map((one) => {
      const key = document.createElement("span");
      key.className = "key";
      const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
      svg.setAttribute("width", "26");
      svg.setAttribute("height", "8");
      svg.setAttribute("aria-hidden", "true");
      const stroke = document.createElementNS("http://www.w3.org/2000/svg", "line");
      for (const [name, value] of Object.entries({ x1: 0, x2: 26, y1: 4, y2: 4, "stroke-width": 2 })) stroke.setAttribute(name, value);
      if (one.dash) stroke.setAttribute("stroke-dasharray", one.dash.join(" "));
      svg.append(stroke);
      const text = document.createElement("span");
      key.append(svg, text);
      if (one.label) caption.append(key);
      return { one, stroke, text };
    });
    const target = document.createElement("div");
    target.className = "strip";
    figure.append(caption, target);
    place.append(figure);
    const chart = { kind, figure, target, keys, plot: null, seen: true };
    new IntersectionObserver(([entry]) => { chart.seen = entry.isIntersecting; }).observe(target);
    build(chart);
    new ResizeObserver(() => chart.plot.setSize({ width: target.clientWidth, height: target.clientHeight })).observe(target);
    return chart;
  };
  const build = (chart) => {
    chart.plot?.destroy();
    const axis = { stroke: cssColor("--ink"), grid: { stroke: cssColor("--grid"), width: 1 }, ticks: { stroke: cssColor("--rule"), width: 1 }, font: "12px system-ui, sans-serif" };
    chart.plot = new uPlot({
      width: Math.max(chart.target.clientWidth, 60), height: chart.target.clientHeight, padding: [8, 8, 0, 0],
      scales: { x: { time: false, auto: false }, y: { range: (_, low, high) => spread(low, high) } },
      axes: [{ ...axis, size: 28 }, { ...axis, size: 52 }],
      legend: { show: false }, cursor: { show: false }, hooks: { draw: [marks] },
      series: [{}, ...chart.kind.lines.map((one) => ({
        stroke: cssColor(one.color), width: one.width ?? 1.8, dash: one.dash, points: { show: false },
      }))],
    }, [[], ...chart.kind.lines.map(() => [])], chart.target);
    for (const { one, stroke } of chart.keys) stroke.setAttribute("stroke", cssColor(one.color));
  };
  // A fall is a moment: a line across the charts.
  const marks = (plot) => {
    const { left, top, width, height } = plot.bbox;
    const { ctx } = plot;
    ctx.save();
    ctx.strokeStyle = ctx.fillStyle = cssColor("--limit");
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash([2 * devicePixelRatio, 3 * devicePixelRatio]);
    ctx.font = `${11 * devicePixelRatio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    for (const { event, t } of known.events) {
      const x = Math.round(plot.valToPos(t, "x", true)) + 0.5;
      if (event !== "fell" || x < left || x > left + width) continue;
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      ctx.fillText("fell", x + 3 * devicePixelRatio, top + 11 * devicePixelRatio);
    }
    ctx.restore();
  };
  const spread = (low, high) => {
    if (!Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
    const edge = Math.max(0.06 * (high - low), 1e-3 * Math.max(Math.abs(low), Math.abs(high)), 1e-6);
    return [low - edge, high + edge];
  };

  const wantedKinds = () => {
    const own = [...known.control.columns.keys()].filter((name) => !ORDINARY.has(name));
    const there = KINDS.filter((kind) => kind.of === "plant" || kind.lines.some((one) => known.control.columns.has(one.column)));
    return [...there, ...own.map((name) => ({ id: `own-${name}`, title: name.replaceAll("_", " "), of: "control", lines: [line(name.replaceAll("_", " "), name, "--run0")] }))];
  };

  const draw = (time) => {
    for (const kind of wantedKinds()) if (!made.has(kind.id)) made.set(kind.id, make(kind));
    const from = Math.max(time - view.window, 0);
    for (const chart of made.values()) {
      if (!chart.seen) continue;
      const [t, ...columns] = window(chart.kind, from, time);
      chart.plot.batch(() => {
        chart.plot.setData([t, ...columns.map(gaps)], false);
        chart.plot.setScale("x", { min: from, max: from + view.window });
      });
      for (const { one, text } of chart.keys) {
        const store = known[one.from ?? chart.kind.of];
        const value = one.column ? store.value(one.column, store.row(time)) * (one.scale ?? 1) : NaN;
        const words = one.column && !one.timeout ? `${one.label} ${showNumber(value, 4)}` : one.label;
        if (text.textContent !== words) text.textContent = words;
      }
    }
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => made.forEach(build));
  return { draw, made };
})();
