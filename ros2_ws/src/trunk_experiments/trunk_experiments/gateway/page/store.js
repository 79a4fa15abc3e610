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

  // `values`: rows one after the other, a number for each name. A time before the last one begins anew.
  add(names, values) {
    const width = names.length;
    const at = names.indexOf("t");
    const target = names.map((name) => this.column(name));
    for (let from = 0; from + width <= values.length; from += width) {
      const t = values[from + at];
      if (t <= this.last) {
        if (this.last - t < 1) continue; // seen already, after a new connection
        this.count = 0;
      }
      if (this.count === this.columns.get("t").length) {
        this.makeRoom();
        names.forEach((name, i) => { target[i] = this.column(name); });
      }
      for (const column of this.columns.values()) column[this.count] = NaN;
      for (let i = 0; i < width; i++) target[i][this.count] = values[from + i];
      this.count++;
    }
  }

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
  events: [],
  recorded: null,
  client: "",
  control_allowed: false,
};
const OWN = { plant: "plant", pushes: "pushes" };
const storeOf = (name) => known[OWN[name] ?? "control"];
