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
      line("θ", "theta", null, { ...ANGLE, several: true }),
      line("measured", "measurement", "--run5", { ...ANGLE, from: "control", dash: [2, 3], width: 1 }),
      line("reference", "reference", "--reference", { ...ANGLE, from: "control", dash: [5, 4], width: 1.2 }),
    ] },
    { id: "torque", title: "Torque, N·m", of: "plant", cut: true, lines: [
      line("τ", "torque", null, { several: true }),
      line("push", "torque", "--push", { from: "pushes", dash: [6, 2], timeout: 0.25 }),
      line("limits", null, "--limit", { dash: [2, 3], width: 1.2, bound: 1 }),
      line("", null, "--limit", { dash: [2, 3], width: 1.2, bound: -1 }),
    ] },
    { id: "terms", title: "Terms, N·m", of: "control", cut: true, lines: [
      line("P", "p_term", "--run0"), line("I", "i_term", "--run1", { dash: [8, 3] }), line("D", "d_term", "--run2", { dash: [3, 2] }),
    ] },
    { id: "gains", title: "Gains, each in its unit", of: "control", lines: [
      line("Kp, N·m/rad", "kp", "--run0"), line("Ki, N·m/(rad·s)", "ki", "--run1", { dash: [8, 3] }),
      line("Kd, N·m·s/rad", "kd", "--run2", { dash: [3, 2] }),
    ] },
    { id: "alpha", title: "Ratio α", of: "control", lines: [line("α", "alpha", "--run0")] },
  ];
  // What a law tells besides these has a chart of its own.
  const ORDINARY = new Set(["t", "reference", "measurement", "error", "error_rate", "effort", "unsaturated",
    "held", "row", "column", "w00", "w01", "w10", "w11", ...KINDS.flatMap((kind) => kind.lines.map((l) => l.column))]);

  const bounds = () => known.run.acting.flatMap((name) => {
    const values = known.nodes.get(name)?.parameters ?? {};
    return [values.u_clamp_max, values.u_clamp_min];
  }).filter(Number.isFinite);

  // The lines of a chart: of what has several, the other runs' beside the shown one's, and what was before a branch.
  const linesOf = (kind) => kind.lines.flatMap((one) => {
    if (!one.several) return [one];
    const { runs, shown } = known;
    const named = (run, more) => ({ ...one, label: run.name || one.label, ...more });
    return [
      ...(runs[shown].before ? [named(runs[shown], { color: "--soft", width: 1, label: "before the branch", of: () => known.runs[shown].before?.plant })] : []),
      ...runs.flatMap((run, index) => (index === shown ? [] : [named(run, { color: `--run${index % 8}`, width: 1.3, of: () => run.plant })])),
      named(runs[shown], { color: `--run${shown % 8}` }),
    ];
  });

  // The rows between two times, at most two for each bucket; the runs have the same times, as far as they come.
  const window = (chart, from, to) => {
    const { kind, lines } = chart;
    const stores = kind.of === "plant" ? known.runs.map((run) => run.plant) : [known[kind.of]];
    const store = stores.reduce((longest, one) => (one.count > longest.count ? one : longest));
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
    return [t, ...lines.map((one) => values(one, one.of?.() ?? known[kind.of], { first, end, size, rows, t }))];
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
      for (let i = 0; i < rows && first + i < store.count; i++) found[i] = column[first + i] * factor;
      return found;
    }
    for (let i = 0; i < rows; i += 2) {
      const begin = first + (i >> 1) * size;
      const stop = Math.min(begin + size, end, store.count);
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
    const target = document.createElement("div");
    target.className = "strip";
    figure.append(caption, target);
    place.append(figure);
    const chart = { kind, figure, caption, title, target, lines: [], keys: [], of: "", plot: null, seen: true };
    new IntersectionObserver(([entry]) => { chart.seen = entry.isIntersecting; }).observe(target);
    build(chart);
    new ResizeObserver(() => chart.plot.setSize({ width: target.clientWidth, height: target.clientHeight })).observe(target);
    const seek = (event) => {
      if (!known.recorded || !event.buttons) return;
      const at = chart.plot.posToVal(event.clientX - chart.plot.over.getBoundingClientRect().left, "x");
      view.seek(Math.min(known.recorded.last, Math.max(known.recorded.first, at)));
    };
    target.addEventListener("pointerdown", seek);
    target.addEventListener("pointermove", seek);
    return chart;
  };
  const keyOf = (one) => {
    const key = document.createElement("span");
    key.className = "key";
    const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
    svg.setAttribute("width", "20");
    svg.setAttribute("height", "8");
    svg.setAttribute("aria-hidden", "true");
    const stroke = document.createElementNS("http://www.w3.org/2000/svg", "line");
    const more = one.dash ? { "stroke-dasharray": one.dash.join(" ") } : {};
    for (const [name, value] of Object.entries({ x1: 0, x2: 20, y1: 4, y2: 4, "stroke-width": 2, stroke: cssColor(one.color), ...more }))
      stroke.setAttribute(name, value);
    svg.append(stroke);
    const text = document.createElement("span");
    key.append(svg, text);
    return { one, key, text };
  };
  const patch = () => {
    const key = document.createElement("span");
    key.className = "key";
    const band = document.createElement("span");
    band.className = "patch pulse";
    key.append(band, "pulse acts");
    return key;
  };
  // What a chart's lines depend on, besides the numbers.
  const composition = () => `${known.shown} ${Boolean(known.pulses.length)} ${known.runs.map(({ name, before }) => `${name} ${Boolean(before)}`).join()}`;
  const build = (chart) => {
    chart.plot?.destroy();
    chart.of = composition();
    chart.drawn = null;
    chart.lines = linesOf(chart.kind);
    chart.keys = chart.lines.filter((one) => one.label).map(keyOf);
    chart.caption.replaceChildren(chart.title, ...chart.keys.map(({ key }) => key));
    if (known.pulses.length && chart.kind.id === "angle") chart.caption.append(patch());
    label(chart, view.time); // before the room for the curves is measured
    const axis = { stroke: cssColor("--ink"), grid: { stroke: cssColor("--grid"), width: 1 }, ticks: { stroke: cssColor("--rule"), width: 1 }, font: "12px system-ui, sans-serif" };
    chart.plot = new uPlot({
      width: Math.max(chart.target.clientWidth, 60), height: chart.target.clientHeight, padding: [8, 8, 0, 0],
      scales: { x: { time: false, auto: false }, y: { range: (plot, low, high) => spread(chart, plot, low, high) } },
      axes: [{ ...axis, size: 26 }, { ...axis, size: 60, space: 20, splits: ticks, values: (_, values) => values.map((value) => showNumber(value)) }],
      legend: { show: false }, cursor: { show: false }, hooks: { drawClear: [bands], draw: [marks] },
      series: [{}, ...chart.lines.map((one) => ({
        stroke: cssColor(one.color), width: one.width ?? 1.8, dash: one.dash, points: { show: false }, auto: !one.bound,
      }))],
    }, [[], ...chart.lines.map(() => [])], chart.target);
  };
  // uPlot's numbers on an axis; where there is room for one only, the first and the last round one.
  const ticks = (_, axis, low, high, step) => {
    const multiples = (unit) => {
      const first = Math.ceil(low / unit);
      return Array.from({ length: Math.max(0, Math.floor(high / unit) - first + 1) }, (__, i) => (first + i) * unit);
    };
    const all = multiples(step);
    if (all.length > 1) return all;
    const finer = multiples(10 ** Math.floor(Math.log10(high - low)) / 2);
    return [finer[0], finer.at(-1)];
  };
  // Where the plan's pulses act, behind the curves.
  const bands = (plot) => {
    const { left, top, width, height } = plot.bbox;
    const place = (t) => Math.max(left, Math.min(left + width, plot.valToPos(t, "x", true)));
    plot.ctx.fillStyle = cssColor("--pulse");
    for (const { start, end } of known.pulses) plot.ctx.fillRect(place(start), top, Math.max(0, place(end) - place(start)), height);
  };
  // A fall is a moment: a line across the charts. So are the time that is shown of a whole run, and where a branch begins.
  const marks = (plot) => {
    const { left, top, width, height } = plot.bbox;
    const { ctx } = plot;
    const ratio = devicePixelRatio;
    const mark = (t, color, words, line) => {
      const x = Math.round(plot.valToPos(t, "x", true)) + 0.5;
      if (x < left || x > left + width) return;
      ctx.strokeStyle = ctx.fillStyle = cssColor(color);
      ctx.setLineDash([2 * ratio, 3 * ratio]);
      if (words === null) ctx.setLineDash([]);
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      if (words) ctx.fillText(words, x + 3 * ratio, top + (11 + 13 * line) * ratio);
    };
    ctx.save();
    ctx.lineWidth = ratio;
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    const first = plot === made.get("angle")?.plot;
    if (known.branch) mark(known.branch.at, "--branch", first ? "branch" : "", known.runs.length);
    known.runs.forEach((run, index) => {
      const words = !run.name ? "fell" : first ? `${run.name} fell` : "";
      for (const { event, t } of run.events) if (event === "fell") mark(t, "--limit", words, index);
    });
    if (known.recorded) mark(view.time, "--accent", null);
    ctx.restore();
  };
  // As in a report: the derivative of a step makes short peaks, and an axis that holds them shows nothing else.
  const spread = (chart, plot, low, high) => {
    if (!Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
    const sizes = !chart.kind.cut ? [] : plot.data.flatMap((column, i) => (plot.series[i].auto && i ? Array.from(column, Math.abs) : [])).filter(Number.isFinite).sort((a, b) => a - b);
    const usual = 1.25 * sizes[Math.floor(0.985 * (sizes.length - 1))];
    const cut = usual > 0 && 4 * usual < 1.25 * Math.max(-low, high);
    chart.title.textContent = `${chart.kind.title}${cut ? " (peaks cut)" : ""}`;
    if (cut) [low, high] = [Math.max(low, -usual), Math.min(high, usual)];
    const edge = Math.max(0.06 * (high - low), 1e-3 * Math.max(Math.abs(low), Math.abs(high))) || 1;
    return [low - edge, high + edge];
  };

  // What is told, with units: by the law that acts; of a recording by all its laws, as their times come.
  const told = () => {
    const laws = [...known.nodes.values()].filter(({ terms }) => terms);
    const acting = known.recorded && !known.runs[0].name ? [] : laws.filter(({ name }) => known.run.acting.includes(name));
    return Object.assign({}, ...(acting.length ? acting : laws).map(({ terms }) => terms));
  };
  // A law's own terms stand before what laws have in common.
  const wantedKinds = () => {
    const terms = told();
    const own = Object.entries(terms).filter(([name]) => !ORDINARY.has(name)).map(([name, unit]) => {
      const words = name.replaceAll("_", " ");
      const title = unit ? `${words}, ${dotted(unit)}` : words;
      return { id: `own-${name}`, title, of: "control", lines: [line(words, name, "--run0")] };
    });
    const common = KINDS.filter((kind) => kind.of === "control" && kind.lines.some((one) => one.column in terms));
    return [...KINDS.filter((kind) => kind.of === "plant"), ...own, ...common];
  };
  const arrange = () => {
    const wanted = wantedKinds();
    for (const kind of wanted) if (!made.has(kind.id)) made.set(kind.id, make(kind));
    const figures = wanted.map(({ id }) => made.get(id).figure);
    if (figures.length !== place.children.length || figures.some((figure, i) => figure !== place.children[i])) place.replaceChildren(...figures);
  };

  const draw = (time) => {
    arrange();
    const { from, until, to } = view.range(time);
    const counts = [known.pushes, ...known.runs.flatMap(({ plant, control }) => [plant, control])].map(({ count }) => count);
    const drawn = [from, until, to, known.version, ...counts].join();
    for (const chart of made.values()) {
      if (chart.of !== composition()) build(chart);
      if (!chart.seen) continue;
      if (chart.drawn === drawn) {
        if (chart.time !== time) chart.plot.redraw(false); // only the time that is shown moves over the same curves
        chart.time = time;
        continue;
      }
      [chart.drawn, chart.time] = [drawn, time];
      const [t, ...columns] = window(chart, from, until);
      chart.plot.batch(() => {
        chart.plot.setData([t, ...columns.map(gaps)], false);
        chart.plot.setScale("x", { min: from, max: to });
      });
    }
    for (const chart of made.values()) if (chart.seen) label(chart, time);
  };
  const label = (chart, time) => {
    for (const { one, text } of chart.keys) {
      const store = one.of?.() ?? known[one.from ?? chart.kind.of];
      const value = one.column ? store.value(one.column, store.row(time)) * (one.scale ?? 1) : NaN;
      const words = one.column && !one.timeout ? `${one.label} ${showNumber(value, 4)}` : one.label;
      if (text.textContent !== words) text.textContent = words;
    }
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => made.forEach(build));
  return { draw, made };
})();
