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

// Everything that is known: of the plant, of whichever controller acts, of pushes, and words by kind.
const known = {
  plant: new Store(true),
  control: new Store(true),
  pushes: new Store(true),
  streams: [], // number -> { name, columns }
  nodes: new Map(), // name -> { state, controller, parameters }
  declared: new Map(),
  health: new Map(),
  world: null,
  run: { acting: [], started: false, ended: false, paused: false },
  gateway: { clients: 0, operator: "", refused: {}, stoppable: false, report: "" },
  events: [], // all since the page was opened, and those that the gateway still had
  events_before: 0, // how many there were before the first of them
  recorded: null,
  client: "",
  control_allowed: false,
};
const OWN = { plant: "plant", pushes: "pushes" };
const storeOf = (name) => known[OWN[name] ?? "control"];
