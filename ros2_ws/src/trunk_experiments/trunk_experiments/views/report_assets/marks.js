"use strict";
// What happened in the runs, as lines in all charts over time; named above the first.
const marks = (() => {
  const found = [];
  const several = report.runs.length > 1;
  const add = (at, kind, text, label) => {
    const same = found.find((mark) => mark.at === at && mark.kind === kind && mark.text === text);
    if (same) same.labels.push(label);
    else found.push({ at, kind, text, labels: [label] });
  };
  for (const run of report.runs) {
    for (const turn of run.turns.slice(1)) add(turn.start, "turn", `→ ${turn.controller}`, run.label);
    for (const { t, text } of run.changed) add(t, "change", text, run.label);
    if (run.branch !== null) add(run.branch, "branch", "branch", run.label);
    if (run.fell !== null) add(run.fell, "fall", "fell", run.label);
    for (const push of run.pushes) add(push.start, "push", pushText(push), run.label);
  }
  found.sort((one, other) => one.at - other.at);
  // Whose it is, unless it is everybody's.
  for (const mark of found) {
    mark.name = several && mark.labels.length < report.runs.length ? `${mark.text} (${mark.labels.join(", ")})` : mark.text;
  }
  return found;
})();
function pushText({ force, torque }) {
  const parts = [force && `${showNumber(force, 3)} N`, torque && `${showNumber(torque, 3)} N·m`].filter(Boolean);
  return `push, ${parts.join(" and ")}`;
}

const MARK_LINES = {
  turn: () => ({ color: cssColor("--soft"), width: 1, dash: "5px,2px,1px,2px" }),
  change: () => ({ color: cssColor("--soft"), width: 1, dash: "1px,3px" }),
  branch: () => ({ color: cssColor("--branch"), width: 1.4, dash: "6px,2px" }),
  fall: () => ({ color: cssColor("--limit"), width: 1.6, dash: "2px,3px" }),
  push: () => ({ color: cssColor("--push"), width: 1.4, dash: "1px,2px" }),
};
const MARK_COLORS = { turn: "--soft", change: "--soft", branch: "--branch", fall: "--limit", push: "--push" };

const band = (span, fillcolor) => ({
  type: "rect", xref: "x", yref: "paper", x0: span.start, x1: span.end, y0: 0, y1: 1, line: { width: 0 }, fillcolor, layer: "below",
});
// The runs on which a pulse acts.
const runsWith = (pulse) => report.runs.flatMap(({ pulses }, index) => (pulses.some(({ start, end }) => start === pulse.start && end === pulse.end) ? [index] : []));
// Lines and bands of all charts over time.
const markShapes = () => {
  const spans = (list) => [...new Map(list.map((span) => [`${span.start} ${span.end}`, span])).values()];
  return [
    ...spans(report.runs.flatMap((run) => run.pulses)).flatMap((span) => {
      const whose = runsWith(span);
      if (whose.length === report.runs.length) return [band(span, cssColor("--pulse"))];
      return whose.map((index) => ({ ...band(span, runColor(index)), opacity: 0.25 }));
    }),
    ...spans(report.runs.flatMap((run) => run.pushes)).map((span) => band(span, cssColor("--pushed"))),
    ...marks.map(({ at, kind }) => ({
      type: "line", xref: "x", yref: "paper", x0: at, x1: at, y0: 0, y1: 1, line: MARK_LINES[kind](),
    })),
  ];
};

// The names of what is in sight, in rows above the chart, none over another: at most four rows.
const ROW = 15;
const markNames = (width) => {
  const ends = [];
  const names = [];
  for (const { at, kind, name } of marks) {
    if (at < shownFrom() || at > shownTo()) continue;
    const text = name.length > 44 ? `${name.slice(0, 43)}…` : name;
    const long = text.length * 6.6 + 10;
    const from = Math.min(((at - shownFrom()) / (shownTo() - shownFrom())) * width, Math.max(0, width - long));
    const free = ends.findIndex((end) => end <= from);
    const row = free < 0 ? ends.length : free;
    if (row > 3) continue; // the line stands; closer in there is room for its name
    ends[row] = from + long;
    names.push({
      x: (from / width), xref: "paper", y: 1, yref: "paper", xanchor: "left", yanchor: "bottom", yshift: row * ROW, text: plainText(text),
      showarrow: false, font: { size: 11, color: cssColor(MARK_COLORS[kind]) }, borderpad: 1,
    });
  }
  return { names, rows: ends.length };
};
