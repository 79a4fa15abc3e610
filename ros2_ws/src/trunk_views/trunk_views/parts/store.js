"use strict";
// What has come of each stream: columns of doubles that grow, and of a live run forget what is old.
const KEPT_S = 75; // a little more than the widest window

class Store {
  constructor(forget) {
    this.forget = forget;
    this.columns = new Map([["t", new Float64Array(4096)]]);
    this.count = 0;
  }

  column(name) {
    if (!this.columns.has(name)) this.columns.set(name, new Float64Array(this.columns.get("t").length).fill(NaN));
    return this.columns.get(name);
  }

  get t() { return this.columns.get("t").subarray(0, this.count); }

  get last() { return this.count ? this.columns.get("t")[this.count - 1] : NaN; }

  // `values`: rows one after the other, a number for each name.
  // Rows may come late: of another controller, or once more after a new connection.
  add(names, values) {
    const before = this.last;
    const width = names.length;
    const at = names.indexOf("t");
    const target = names.map((name) => this.column(name));
    for (let from = 0; from + width <= values.length; from += width) {
      const t = values[from + at];
      if (this.count === this.columns.get("t").length) {
        this.makeRoom();
        names.forEach((name, i) => { target[i] = this.column(name); });
      }
      for (const column of this.columns.values()) column[this.count] = NaN;
      for (let i = 0; i < width; i++) target[i][this.count] = values[from + i];
      this.count++;
    }
    if (values[at] <= before) this.sort();
  }

  // Bring the rows into the order of their times, each time once.
  sort() {
    const t = this.t.slice();
    const rows = Array.from(t.keys()).sort((a, b) => t[a] - t[b] || a - b);
    const once = rows.filter((row, i) => i === 0 || t[row] !== t[rows[i - 1]]);
    for (const column of this.columns.values()) {
      const values = column.slice(0, this.count);
      once.forEach((row, i) => { column[i] = values[row]; });
    }
    this.count = once.length;
  }

  clear() { this.count = 0; }

  makeRoom() {
    const drop = this.forget ? rowAt(this.t, this.last - KEPT_S) : 0;
    const size = drop > this.count / 4 ? this.columns.get("t").length : 2 * this.columns.get("t").length;
    for (const [name, column] of this.columns) {
      const larger = size === column.length ? column : new Float64Array(size).fill(NaN);
      larger.set(column.subarray(drop, this.count));
      this.columns.set(name, larger);
    }
    this.count -= drop;
  }

  // The row in force at a time; -1 where there is none.
  row(time) { return this.count && this.columns.get("t")[0] <= time + 1e-9 ? rowAt(this.t, time) : -1; }

  value(name, row) { return row < 0 || !this.columns.has(name) ? NaN : this.columns.get(name)[row]; }
}

// A run as far as it has come. Of several side by side, each has a name.
class Run {
  constructor(name = "") {
    this.name = name;
    this.plant = new Store(true);
    this.control = new Store(true);
    this.events = []; // all since the page was opened, and those that the gateway still had
    this.ended = ""; // how, before its time: "diverged"
    this.hidden = false; // its curves are
    this.world = null; // its own picture and limit, where runs have different ones
    this.before = null; // { plant, control, events } of the run without its branch
  }
}

// Everything that is known: of the plant, of whichever controller acts, of pushes, and words by kind.
const known = {
  runs: [new Run()],
  shown: 0, // which of them charts, rules and gains show
  pushes: new Store(true),
  pulses: [], // of the plan: { start, end in s, text }, as far as they are known; `runs`: on which alone they act
  pushed: [], // [from, to] in s: when an operator pushed, where that is known
  marks: null, // { t, kind, words } of what happened, where a feed has them all; otherwise falls and the branch
  streams: [], // number -> { name, columns }
  nodes: new Map(), // name -> { state, controller, parameters }
  declared: new Map(),
  health: new Map(),
  world: null,
  run: { acting: [], started: false, ended: false, paused: false },
  gateway: { clients: 0, operator: "", refused: {}, stoppable: false, report: "", ended: "" },
  events_before: 0, // how many there were before the first of the events
  recorded: null, // `first`, `last` in s: the run is there as a whole, to be played
  branch: null, // `at` in s: from there on the runs are a branch
  client: "",
  control_allowed: false, // alone decides what can be changed
  version: 0, // rises with all that changes besides the rows' counts
  get plant() { return this.runs[this.shown].plant; },
  get control() { return this.runs[this.shown].control; },
  get events() { return this.runs[this.shown].events; },
  set events(events) { this.runs[this.shown].events = events; },
  // Where the four rules begin that fire in a row of the shown run's `control`, and their weights.
  firing(row) {
    return Object.fromEntries(["row", "column", "w00", "w01", "w10", "w11"].map((name) => [name, this.control.value(name, row)]));
  },
};
const OWN = { plant: "plant", pushes: "pushes" };
const storeOf = (name) => known[OWN[name] ?? "control"];
