"use strict";
// Strip charts over the window that is shown (uPlot). A bucket of many rows is drawn as its least and its greatest
// value, so that no spike is left out. Charts of a whole run are zoomed by dragging, and say each value's digits.
const strips = (() => {
  const place = document.getElementById("live-charts");
  const BUCKETS = 700;
  const ROWS = 4; // of names
  const DRAG_PX = 5; // less is a click
  const made = new Map();
  const line = (label, column, color, more = {}) => ({ label, column, color, ...more });
  const ANGLE = { scale: DEGREES };
  const kindsNow = () => [ // `least`: what an axis spans, so that standing still looks still
    { id: "angle", title: "Angle, °", of: "plant", least: 0.1, lines: [
      line("θ", "theta", null, { ...ANGLE, several: true }),
      line("measured", "measurement", "--run5", { ...ANGLE, from: "control", dash: [2, 3], width: 1 }),
      line("reference", "reference", "--reference", { ...ANGLE, from: "control", dash: [5, 4], width: 1.2 }),
    ] },
    { id: "torque", title: inWords("Torque, N·m"), of: "plant", cut: true, least: 0.1, lines: [
      line("τ", "torque", null, { several: true }),
      line("push", "torque", "--push", { from: "pushes", dash: [6, 2], timeout: 0.25 }),
      line("limits", null, "--limit", { dash: [2, 3], width: 1.2, level: () => Math.max(...bounds()) }),
      line("", null, "--limit", { dash: [2, 3], width: 1.2, level: () => Math.min(...bounds()) }),
    ] },
    { id: "terms", title: inWords("Terms, N·m"), of: "control", cut: true, least: 0.1, lines: [
      line("P", "p_term", "--run0"), line("I", "i_term", "--run1", { dash: [8, 3] }), line("D", "d_term", "--run2", { dash: [3, 2] }),
    ] },
    { id: "gains", title: "Gains, each in its unit", of: "control", lines: [
      line(inWords("Kp, N·m/rad"), "kp", "--run0"), line(inWords("Ki, N·m/(rad·s)"), "ki", "--run1", { dash: [8, 3] }),
      line(inWords("Kd, N·m·s/rad"), "kd", "--run2", { dash: [3, 2] }),
    ] },
    { id: "alpha", title: "Ratio α", of: "control", lines: [line("α", "alpha", "--run0")] },
  ];
  // What a law tells besides these has a chart of its own.
  const ORDINARY = new Set(["t", "reference", "measurement", "error", "error_rate", "effort", "unsaturated",
    "held", "row", "column", "w00", "w01", "w10", "w11", ...kindsNow().flatMap((kind) => kind.lines.map((l) => l.column))]);

  const bounds = () => known.run.acting.flatMap((name) => {
    const values = known.nodes.get(name)?.parameters ?? {};
    return [values.u_clamp_max, values.u_clamp_min];
  }).filter(Number.isFinite);

  // The lines of a chart: of what has several, the other runs' beside the shown one's, and what was before a branch;
  // `alike`: of all runs that are not hidden, each in its own style.
  const linesOf = (kind) => kind.lines.flatMap((one) => {
    const { runs, shown } = known;
    const named = (run, more) => ({ ...one, label: run.name || one.label, of: () => run[kind.of], ...more });
    if (one.alike) return runs.flatMap((run, index) => (run.hidden || index === one.except ? [] : [named(run, { color: `--run${index % 8}`, dash: runDash(index) })]));
    if (!one.several) return [one];
    return [
      ...(runs[shown].before ? [named(runs[shown], { color: "--soft", width: 1, label: "before the branch", of: () => known.runs[shown].before?.plant })] : []),
      ...runs.flatMap((run, index) => (index === shown ? [] : [named(run, { color: `--run${index % 8}`, width: 1.3 })])),
      named(runs[shown], { color: `--run${shown % 8}` }),
    ];
  });

  // The rows between two times, at most two for each bucket, of each line; runs may have times of their own.
  const window = (chart, from, to) => {
    const grids = new Map();
    return uPlot.join(chart.lines.map((one) => {
      const store = one.of?.() ?? known[chart.kind.of];
      if (!grids.has(store)) grids.set(store, gridOf(store, from, to));
      const grid = grids.get(store);
      return [grid.t, gaps(values(one, store, grid))];
    }));
  };
  const gridOf = (store, from, to) => {
    const first = Math.max(0, store.row(from));
    const end = Math.min(store.count, store.row(to) + (known.recorded ? 2 : 1)); // to the edge of a chart that is zoomed
    const count = Math.max(0, end - first);
    const size = Math.max(1, Math.ceil(count / BUCKETS));
    const rows = size === 1 ? count : 2 * Math.ceil(count / size);
    const t = new Float64Array(rows);
    const times = store.columns.get("t");
    for (let i = 0; i < rows; i++) {
      const bucket = size === 1 ? first + i : first + (i >> 1) * size + (i & 1 ? size >> 1 : 0);
      t[i] = times[Math.min(bucket, end - 1)];
    }
    return { first, end, size, rows, t };
  };
  const values = (one, store, { first, end, size, rows, t }) => {
    const found = new Float64Array(rows).fill(NaN);
    const factor = one.scale ?? 1;
    const more = one.plus ?? 0;
    if (one.level) {
      const level = one.level();
      return Number.isFinite(level) ? found.fill(level) : found;
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
      for (let i = 0; i < rows && first + i < store.count; i++) found[i] = column[first + i] * factor + more;
      return found;
    }
    for (let i = 0; i < rows; i += 2) {
      const begin = first + (i >> 1) * size;
      const stop = Math.min(begin + size, end, store.count);
      let low = -1;
      let high = -1;
      for (let k = begin; k < stop; k++) {
        const value = column[k];
        if (low < 0 ? value === value : value < column[low]) low = k;
        if (high < 0 ? value === value : value > column[high]) high = k;
      }
      if (low < 0) continue;
      found[i] = column[Math.min(low, high)] * factor + more; // in the order in which they come
      found[i + 1] = column[Math.max(low, high)] * factor + more;
    }
    return found;
  };

  // What is not a number makes a gap in uPlot only as null.
  const gaps = (column) => (column.some(Number.isNaN) ? Array.from(column, (v) => (Number.isNaN(v) ? null : v)) : column);

  const make = (kind) => {
    const figure = document.createElement("figure");
    figure.className = `card chart${kind.wide ? " wide" : ""}`;
    figure.id = `strip-${kind.id}`;
    figure.setAttribute("role", "group");
    const caption = document.createElement("figcaption");
    const title = document.createElement("strong");
    title.textContent = kind.title;
    const target = document.createElement("div");
    target.className = "strip";
    figure.append(caption, target);
    place.append(figure);
    const told = document.createElement("div");
    told.className = "told";
    told.hidden = true;
    target.append(told);
    const chart = { kind, figure, caption, title, target, told, lines: [], keys: [], of: "", plot: null, seen: true, uncut: false };
    new IntersectionObserver(([entry]) => { chart.seen = entry.isIntersecting; }).observe(figure);
    build(chart);
    new ResizeObserver(() => chart.plot.setSize({ width: target.clientWidth, height: target.clientHeight })).observe(target);
    listen(chart);
    return chart;
  };
  // Of a whole run: drag to zoom, with Shift to move what is shown, Ctrl and the wheel to zoom; a click sets the time.
  let rested = ""; // where the pointer was last
  const listen = (chart) => {
    const { target } = chart;
    const timeAt = ({ clientX }) => {
      const { first, last } = known.recorded;
      return Math.min(last, Math.max(first, chart.plot.posToVal(clientX - chart.plot.over.getBoundingClientRect().left, "x")));
    };
    let down = null; // { x, time, from }
    target.addEventListener("pointerdown", (event) => {
      if (!known.recorded || event.button) return;
      down = { x: event.clientX, time: timeAt(event), from: view.range(view.time).from };
    });
    target.addEventListener("pointermove", (event) => {
      if (!known.recorded) return;
      const place = `${event.clientX} ${event.clientY}`;
      if (place === rested) return; // the page has moved under a pointer that rests
      rested = place;
      if (!down || !event.buttons) {
        point(chart, timeAt(event), event);
        return;
      }
      chart.told.hidden = true;
      const { left, width } = chart.plot.over.getBoundingClientRect();
      if (event.shiftKey) {
        const { from, to } = view.range(view.time);
        const begin = down.from - ((event.clientX - down.x) / width) * (to - from);
        view.zoom(begin, begin + to - from);
      } else if (Math.abs(event.clientX - down.x) > DRAG_PX) {
        const ends = [down.x, event.clientX].map((x) => Math.min(width, Math.max(0, x - left))).sort((a, b) => a - b);
        chart.plot.setSelect({ left: ends[0], width: ends[1] - ends[0], top: 0, height: chart.plot.over.clientHeight }, false);
      }
    });
    target.addEventListener("pointerup", (event) => {
      if (!down) return;
      const [begun, end] = [down, timeAt(event)];
      down = null;
      chart.plot.setSelect({ left: 0, width: 0, top: 0, height: 0 }, false);
      if (event.shiftKey) return;
      if (Math.abs(event.clientX - begun.x) > DRAG_PX) view.zoom(Math.min(begun.time, end), Math.max(begun.time, end));
      else view.seek(stampNear(chart, end) ?? end);
    });
    target.addEventListener("pointerleave", () => { chart.told.hidden = true; });
    target.addEventListener("pointercancel", () => { down = null; });
    target.addEventListener("dblclick", () => {
      if (!known.recorded) return;
      const { from, to } = view.range(view.time);
      chart.uncut = to - from >= known.recorded.last - known.recorded.first && !chart.uncut; // a second one shows peaks whole
      chart.drawn = null;
      view.zoomAbout(view.time, Infinity);
    });
    // The wheel alone scrolls the page. A pinch on a touchpad is Ctrl and the wheel.
    target.addEventListener("wheel", (event) => {
      if (!known.recorded || !(event.ctrlKey || event.metaKey)) return;
      event.preventDefault();
      view.zoomAbout(timeAt(event), Math.exp(Math.max(-50, Math.min(50, event.deltaY)) / 150));
    }, { passive: false });
  };
  const stampNear = (chart, time) => {
    const stores = chart.lines.filter((one) => one.label && one.column).map((one) => one.of?.() ?? known[one.from ?? chart.kind.of]);
    const stamps = stores.flatMap(({ t }) => (t.length ? [t[rowAt(t, time)], t[Math.min(t.length - 1, rowAt(t, time) + 1)]] : []));
    return stamps.length ? stamps.reduce((best, t) => (Math.abs(t - time) < Math.abs(best - time) ? t : best)) : undefined;
  };
  // Say the nearest state's stamp and values with all their digits. Where nothing can be changed the time goes there.
  const point = (chart, time, event) => {
    const stamp = stampNear(chart, time);
    if (stamp === undefined) return;
    if (!known.control_allowed && !view.playing) view.time = stamp;
    const { told, target } = chart;
    told.replaceChildren(...[`t = ${showNumber(stamp, 10)} s`, ...chart.keys.filter(({ one }) => one.column && !one.timeout).map(({ one }) =>
      `${one.label} ${showNumber(valueAt(chart, one, stamp), 10)}`)].map((text) => {
      const row = document.createElement("div");
      row.textContent = text;
      return row;
    }));
    told.hidden = false;
    const box = target.getBoundingClientRect();
    const x = event.clientX - box.left;
    told.style.left = `${x + 14 + told.offsetWidth > box.width ? Math.max(0, x - 14 - told.offsetWidth) : x + 14}px`;
  };
  const valueAt = (chart, one, time) => {
    const store = one.of?.() ?? known[one.from ?? chart.kind.of];
    return store.value(one.column, store.row(time)) * (one.scale ?? 1) + (one.plus ?? 0);
  };
  // A chart as a picture with its caption.
  const picture = (chart) => {
    const [canvas, ratio] = [chart.plot.ctx.canvas, devicePixelRatio];
    const made = document.createElement("canvas");
    [made.width, made.height] = [canvas.width, canvas.height + 24 * ratio];
    const context = made.getContext("2d");
    context.fillStyle = cssColor("--card");
    context.fillRect(0, 0, made.width, made.height);
    context.drawImage(canvas, 0, 24 * ratio);
    context.font = `${13 * ratio}px system-ui, sans-serif`;
    context.textBaseline = "middle";
    let x = 8 * ratio;
    for (const [text, color] of [[chart.title.textContent, "--ink"], ...chart.lines.filter(({ label }) => label).map(({ label, color }) => [label, color])]) {
      context.fillStyle = cssColor(color);
      context.fillText(text, x, 12 * ratio);
      x += context.measureText(text).width + 14 * ratio;
    }
    return made.toDataURL("image/png");
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
  const patch = (words, kind) => {
    const key = document.createElement("span");
    key.className = "key";
    const band = document.createElement("span");
    band.className = `patch ${kind}`;
    key.append(band, words);
    return key;
  };
  const saving = (chart) => {
    const button = document.createElement("button");
    button.type = "button";
    button.className = "png";
    button.textContent = "PNG";
    button.setAttribute("aria-label", `Save as PNG: ${chart.kind.title}`);
    button.addEventListener("click", () => {
      const link = document.createElement("a");
      link.href = picture(chart);
      link.download = `${chart.kind.id}.png`;
      link.click();
    });
    return button;
  };
  // What a chart's lines depend on, besides the numbers.
  const composition = (chart) => `${chart.kind.title} ${chart.kind.lines.map(({ label }) => label)} ${known.shown} ${Boolean(known.pulses.length)} ${known.runs.map(({ name, before, hidden }) => `${name} ${Boolean(before)} ${hidden}`).join()}`;
  const build = (chart) => {
    chart.plot?.destroy();
    chart.of = composition(chart);
    chart.figure.setAttribute("aria-label", chart.kind.title);
    chart.drawn = null;
    chart.lines = linesOf(chart.kind);
    chart.keys = chart.lines.filter((one) => one.label).map(keyOf);
    chart.caption.replaceChildren(chart.title, ...chart.keys.map(({ key }) => key));
    if (known.pulses.length && chart.kind.id === "angle") chart.caption.append(patch(known.pulses.every(({ runs }) => !runs || runs.length === known.runs.length) ? "pulse acts" : "pulse acts, on some runs in their colours", "pulse"));
    if (known.pushed.length && chart.kind.id === "angle") chart.caption.append(patch("an operator pushes", "pushed"));
    if (known.marks) chart.caption.append(saving(chart));
    label(chart, view.time); // before the room for the curves is measured
    const axis = { stroke: cssColor("--ink"), grid: { stroke: cssColor("--grid"), width: 1 }, ticks: { stroke: cssColor("--rule"), width: 1 }, font: "12px system-ui, sans-serif" };
    chart.plot = new uPlot({
      width: Math.max(chart.target.clientWidth, 60), height: chart.target.clientHeight, padding: [8, 14, 0, 0],
      scales: { x: { time: false, auto: false }, y: { range: (plot, low, high) => spread(chart, plot, low, high) } },
      axes: [{ ...axis, size: 26, ...(known.marks ? { label: "time, s", labelSize: 16, labelGap: 0, labelFont: axis.font } : {}) }, { ...axis, size: 60, space: 20, splits: ticks, values: (_, values) => values.map((value) => showNumber(value)) }],
      legend: { show: false }, cursor: { show: false }, hooks: { drawClear: [bands], draw: [marks] },
      bands: chart.lines.flatMap((one, i) => (one.band ? [{ series: [i + 2, i + 1], fill: cssColor("--band") }] : [])),
      series: [{}, ...chart.lines.map((one) => ({
        stroke: cssColor(one.color), width: one.width ?? 1.8, dash: one.dash, points: { show: false }, auto: !one.level,
        ...(one.stepped ? { paths: uPlot.paths.stepped({ align: 1 }) } : {}),
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
  // Where pulses act, on some runs in their colours, and where an operator pushed, behind the curves.
  const bands = (plot) => {
    const { left, top, width, height } = plot.bbox;
    const place = (t) => Math.max(left, Math.min(left + width, plot.valToPos(t, "x", true)));
    const fill = (start, end, color, alpha = 1) => {
      plot.ctx.globalAlpha = alpha;
      plot.ctx.fillStyle = cssColor(color);
      plot.ctx.fillRect(place(start), top, Math.max(0, place(end) - place(start)), height);
      plot.ctx.globalAlpha = 1;
    };
    for (const { start, end, runs } of known.pulses) {
      if (!runs || runs.length === known.runs.length) fill(start, end, "--pulse");
      else for (const index of runs) fill(start, end, `--run${index % 8}`, 0.25);
    }
    for (const [start, end] of known.pushed) fill(start, end, "--pushed");
  };
  const MARKS = { // colour, dashes
    turn: ["--soft", [5, 2, 1, 2]], change: ["--soft", [1, 3]], branch: ["--branch", [6, 2]], fell: ["--limit", [2, 3]], push: ["--push", [1, 2]],
  };
  const happened = () => known.marks ?? [
    ...(known.branch ? [{ t: known.branch.at, kind: "branch", words: "branch" }] : []),
    ...known.runs.flatMap(({ name, events }) => events.filter(({ event }) => event === "fell").map(({ t }) => ({ t, kind: "fell", words: name ? `${name} fell` : "fell" }))),
  ];
  // What happened is a line across the charts, with its name in the first, as far as there is room. So is the time that
  // is shown of a whole run.
  const marks = (plot) => {
    const { left, top, width, height } = plot.bbox;
    const { ctx } = plot;
    const ratio = devicePixelRatio;
    const first = plot === made.get("angle")?.plot;
    const ends = []; // of the names in each row
    const mark = (t, color, dash, words) => {
      const x = Math.round(plot.valToPos(t, "x", true)) + 0.5;
      if (x < left || x > left + width) return;
      ctx.strokeStyle = ctx.fillStyle = cssColor(color);
      ctx.setLineDash(dash.map((length) => length * ratio));
      ctx.beginPath();
      ctx.moveTo(x, top);
      ctx.lineTo(x, top + height);
      ctx.stroke();
      if (!words || (!first && known.runs[0].name) || (!first && known.marks)) return;
      const text = words.length > 44 ? `${words.slice(0, 43)}…` : words;
      const long = ctx.measureText(text).width;
      const from = Math.max(left, Math.min(x + 3 * ratio, left + width - long));
      const free = ends.findIndex((end) => end <= from);
      const row = free < 0 ? ends.length : free;
      if (row >= ROWS) return; // closer in there is room for it
      ends[row] = from + long + 8 * ratio;
      ctx.fillText(text, from, top + (11 + 13 * row) * ratio);
    };
    ctx.save();
    ctx.lineWidth = ratio;
    ctx.font = `${11 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "left";
    for (const { t, kind, words } of happened()) mark(t, ...MARKS[kind], words);
    if (known.recorded) mark(view.time, "--accent", [], "");
    ctx.restore();
  };
  // The derivative of a step makes short peaks, and an axis that holds them shows nothing else.
  const spread = (chart, plot, low, high) => {
    if (!Number.isFinite(low) || !Number.isFinite(high)) return [-1, 1];
    const sizes = !chart.kind.cut || chart.uncut ? [] : plot.data.flatMap((column, i) => (plot.series[i].auto && i ? Array.from(column, Math.abs) : [])).filter(Number.isFinite).sort((a, b) => a - b);
    const usual = 1.25 * sizes[Math.floor(0.985 * (sizes.length - 1))];
    const cut = usual > 0 && 4 * usual < 1.25 * Math.max(-low, high);
    const peak = showNumber(Math.max(-low, high), 5);
    chart.title.textContent = `${chart.kind.title}${!cut ? "" : known.marks ? ` (peaks up to ${peak} off scale; a double-click shows all)` : " (peaks cut)"}`;
    if (chart.kind.zero) [low, high] = [Math.min(low, 0), Math.max(high, 0)];
    if (cut) [low, high] = [Math.max(low, -usual), Math.min(high, usual)];
    const edge = Math.max(0.06 * (high - low), 1e-3 * Math.max(Math.abs(low), Math.abs(high)), ((chart.kind.least ?? 0) - (high - low)) / 2) || 1;
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
    if (wire.kinds) return wire.kinds();
    const terms = told();
    const own = Object.entries(terms).filter(([name]) => !ORDINARY.has(name)).map(([name, unit]) => {
      const words = name.replaceAll("_", " ");
      const title = unit ? `${words}, ${dotted(unit)}` : words;
      return { id: `own-${name}`, title, of: "control", least: 1e-6, lines: [line(words, name, "--run0")] };
    });
    const kinds = kindsNow();
    const common = kinds.filter((kind) => kind.of === "control" && kind.lines.some((one) => one.column in terms));
    return [...kinds.filter((kind) => kind.of === "plant"), ...own, ...common];
  };
  const arrange = () => {
    const wanted = wantedKinds();
    for (const kind of wanted) {
      if (made.has(kind.id)) made.get(kind.id).kind = kind;
      else made.set(kind.id, make(kind));
    }
    const figures = wanted.map(({ id }) => made.get(id).figure);
    if (figures.length !== place.children.length || figures.some((figure, i) => figure !== place.children[i])) place.replaceChildren(...figures);
  };

  // Also those that are not in sight; `anew`: in other colours, at other sizes.
  const drawAll = (time, anew) => {
    arrange();
    for (const chart of made.values()) {
      if (anew) build(chart);
      chart.seen = true;
    }
    draw(time);
  };
  const draw = (time) => {
    arrange();
    const { from, until, to } = view.range(time);
    const counts = [known.pushes, ...known.runs.flatMap(({ plant, control }) => [plant, control])].map(({ count }) => count);
    const drawn = [from, until, to, known.version, ...counts].join();
    for (const chart of made.values()) {
      if (chart.of !== composition(chart)) build(chart);
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
      const value = one.column ? valueAt(chart, one, time) : NaN;
      const words = one.column && !one.timeout ? `${one.label} ${showNumber(value, 4)}` : one.label;
      if (text.textContent !== words) text.textContent = words;
    }
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => made.forEach(build));
  return { draw, drawAll, made, picture };
})();
