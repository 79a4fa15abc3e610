"use strict";
// What all charts share: their look, the time cursor, zooming together, drawing and drawing again.
const charts = [];
// The span of time that all charts over time show; null where it is the whole.
const zoom = { from: null, to: null };
const shownFrom = () => zoom.from ?? report.start;
const shownTo = () => zoom.to ?? report.end;
const hiddenRuns = new Set();
const isShown = (index) => !hiddenRuns.has(index);
const CONFIG = {
  responsive: true,
  displaylogo: false,
  doubleClick: false,
  modeBarButtons: [["zoomIn2d", "zoomOut2d", "resetScale2d"], ["zoom2d", "pan2d"], ["toImage"]],
};
// Touch screens scroll and have no hover: there the buttons always show, in their own row.
const coarse = matchMedia("(pointer: coarse)").matches;
const TOP = coarse ? 34 : 8;
// Digits at the pointer: as many as the data have.
const digits = () => ({ 24: 7, 20: 6, 16: 5 })[report.bits] ?? 10;
const hoverNumber = (name) => `%{${name}:.${digits()}~g}`;

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
    // In the page's ink, not on the runs' colours: those are for lines, too pale for text.
    hoverlabel: { font: { size: 12, color: cssColor("--ink") }, bgcolor: cssColor("--card") },
    showlegend: false,
    dragmode: coarse ? false : "zoom",
    modebar: { orientation: "h", bgcolor: "rgba(0,0,0,0)", color: cssColor("--soft"), activecolor: cssColor("--accent") },
    xaxis: { ...axis, title: { text: xTitle, standoff: 4 } },
    yaxis: { ...axis, title: { text: yTitle, standoff: 4 } },
  };
};
// At the pointer, which run it is where there are several.
const hoverOf = (index, text) => {
  const name = report.runs[index].label;
  const short = name.length > 20 ? `${name.slice(0, 19)}…` : name;
  return {
    hovertemplate: `${report.runs.length > 1 ? `${plainText(short)}: ` : ""}${text}<extra></extra>`,
    hoverlabel: { bordercolor: runColor(index) },
  };
};
// Plotly reads some tags in texts, and %{…} in templates; a name is only a name.
const plainText = (text) =>
  text.replaceAll("&", "&amp;").replaceAll("<", "&lt;").replaceAll(">", "&gt;").replaceAll("%{", "%\u200b{");
const line = (index, width = 2) => ({ color: runColor(index), dash: runDash(index), width });
const plotWidth = (target) => Math.max(200, target.clientWidth - 72);

// What moves with the clock stands on the chart, not in it: nothing is drawn again for it.
const element = (target, kind) => {
  const mark = document.createElement("div");
  mark.className = kind;
  mark.hidden = true;
  mark.setAttribute("aria-hidden", "true");
  target.append(mark);
  return mark;
};
const placeCursor = (chart, time) => {
  const layout = chart.target._fullLayout;
  if (!layout) return;
  chart.cursor ??= element(chart.target, "cursor");
  const at = layout.xaxis.d2p(time);
  const { l, t, w, h } = layout._size;
  chart.cursor.hidden = at < -0.5 || at > w + 0.5;
  chart.cursor.style.left = `${l + at}px`;
  chart.cursor.style.top = `${t}px`;
  chart.cursor.style.height = `${h}px`;
};
const placeDots = (chart, places) => {
  const full = chart.target._fullLayout;
  if (!full) return;
  const { l, t, w, h } = full._size;
  places.forEach((place, i) => {
    const dot = (chart.dots[i] ??= element(chart.target, "dot"));
    const [x, y, color] = place ?? [NaN, NaN, ""];
    const left = full.xaxis.d2p(x);
    const top = full.yaxis.d2p(y);
    dot.hidden = !(left >= -1 && left <= w + 1 && top >= -1 && top <= h + 1);
    dot.style.left = `${l + left}px`;
    dot.style.top = `${t + top}px`;
    dot.style.background = color;
  });
};

// ── drawing ──────────────────────────────────────────────────────────────────────────────────────────
// A chart: `target`, `traces()`, `layout()`, `show(time)`, `timed`, and `view`, the ranges that the reader chose:
// {x, y} in a plane, {y} over time.
const withView = (chart) => {
  const layout = chart.layout();
  const { view } = chart;
  if (chart.timed) layout.xaxis.range = [shownFrom(), shownTo()];
  else if (view?.x) Object.assign(layout.xaxis, { range: view.x, autorange: false });
  if (view?.y) Object.assign(layout.yaxis, { range: view.y, autorange: false });
  // Once on paper, and back on the screen, Plotly has to be told.
  if (report.paper !== undefined) Object.assign(layout, { width: chart.target.clientWidth, height: chart.target.clientHeight });
  return layout;
};
// Every point that a chart is given is a vertex; Plotly alone would leave out what is nearly on a line.
const tracesOf = (chart) => chart.traces().map((trace) => (trace.mode === "lines" ? { ...trace, line: { ...trace.line, simplify: false } } : trace));
const repaint = (chart) => {
  if (!chart.drawn) return;
  Plotly.react(chart.target, tracesOf(chart), withView(chart), CONFIG);
  chart.show(clock.time);
};
const repaintCharts = (some = charts) => some.forEach(repaint);
const later = new Set();
const repaintLater = (some) => {
  if (!later.size) requestAnimationFrame(() => {
    const all = [...later];
    later.clear();
    repaintCharts(all);
  });
  some.forEach((chart) => later.add(chart));
};
const timedCharts = () => charts.filter((chart) => chart.timed);

// ── zooming ──────────────────────────────────────────────────────────────────────────────────────────
const zoomTo = (from, to) => {
  const whole = !(from > report.start || to < report.end);
  Object.assign(zoom, whole ? { from: null, to: null } : { from, to });
  repaintLater(timedCharts());
};
// Of what is shown, `times` as much, about a time.
const zoomAbout = (time, times) => {
  const span = Math.min(report.end - report.start, Math.max(1e-6, (shownTo() - shownFrom()) * times));
  const part = (time - shownFrom()) / (shownTo() - shownFrom());
  const from = Math.max(report.start, Math.min(report.end - span, time - part * span));
  zoomTo(from, Math.min(report.end, from + span));
};
const rangeIn = (change, axis) =>
  change[`${axis}.range`] ?? (`${axis}.range[0]` in change ? [change[`${axis}.range[0]`], change[`${axis}.range[1]`]] : null);

const link = (chart) => {
  const { target } = chart;
  target.on("plotly_relayout", (change) => {
    chart.show(clock.time);
    const [x, y] = [rangeIn(change, "xaxis"), rangeIn(change, "yaxis")];
    if (!x && !y) return;
    chart.view = { ...chart.view, ...(y ? { y } : {}), ...(x && !chart.timed ? { x } : {}) };
    if (chart.timed && x) zoomTo(...x);
    else repaintLater([chart]);
  });
  target.on("plotly_doubleclick", () => {
    const whole = !chart.view && zoom.from === null;
    // A second one shows short peaks that are off the scale, too.
    chart.view = whole && chart.everything ? { y: chart.everything() } : null;
    if (chart.timed) zoomTo(report.start, report.end);
    else repaintLater([chart]);
  });
  // Ctrl and the wheel, as on maps in pages: the wheel alone scrolls the page. A pinch on a touchpad is the same.
  target.addEventListener("wheel", (event) => {
    if (!chart.timed || !(event.ctrlKey || event.metaKey)) return;
    event.preventDefault();
    const { _size, xaxis } = target._fullLayout;
    const time = xaxis.p2d(event.clientX - target.getBoundingClientRect().left - _size.l);
    zoomAbout(Math.min(shownTo(), Math.max(shownFrom(), time)), Math.exp(Math.max(-50, Math.min(50, event.deltaY)) / 150));
  }, { passive: false });
  const seek = (event) => {
    const point = event.points[0];
    const time = chart.timed ? point.x : point.customdata;
    if (Number.isFinite(time)) clock.set(time);
  };
  target.on("plotly_hover", (event) => { if (!clock.playing) seek(event); });
  target.on("plotly_click", seek);
  target.on("plotly_afterplot", () => {
    oneTabStop(target);
    chart.show(clock.time);
  });
};
// The buttons of a chart are one stop of the Tab key; arrows go from one to the next. Those of surfaces are none:
// eight runs have 24 of them.
const oneTabStop = (target) => {
  const buttons = [...target.querySelectorAll(".modebar-btn")];
  buttons.forEach((button, i) => { button.tabIndex = i === 0 && !target.closest(".map") ? 0 : -1; });
  if (target.dataset.arrows) return;
  target.dataset.arrows = "true";
  target.addEventListener("keydown", (event) => {
    const now = [...target.querySelectorAll(".modebar-btn")];
    const at = now.indexOf(event.target);
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (at < 0 || step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    now[(at + step + now.length) % now.length].focus();
  });
};

const drawChart = async (chart) => {
  await Plotly.newPlot(chart.target, tracesOf(chart), withView(chart), CONFIG);
  chart.drawn = true;
  link(chart);
  oneTabStop(chart.target);
  chart.show(clock.time);
};
const drawCharts = async () => {
  for (const chart of charts) {
    await drawChart(chart);
    await new Promise(requestAnimationFrame); // the page stays alive while it fills
  }
};
