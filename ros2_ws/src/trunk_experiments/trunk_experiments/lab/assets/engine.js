"use strict";
// A controller's run, computed by the scenario's loop as WebAssembly: the bits are those of `trunk simulate`.
// An experiment `setup` determines them: { values: {node: {parameter: value}}, branch: null or {at_ns, values},
// pushes: [[stamp_ns, force, torque], ...] }.

// What a parameter may be in a lab: "" or one line that says what is allowed. `present`: the node's other values.
const checkValue = (lab, node, name, value, present = {}) => {
  const where = `${node}.${name} = ${Array.isArray(value) ? `[${value.join(", ")}]` : value}`;
  const knob = Object.hasOwn(lab.knobs, node) && Object.hasOwn(lab.knobs[node], name) && lab.knobs[node][name];
  if (!knob) {
    const reason = lab.declared[node]?.[name]?.refused;
    return `${where}: ${reason ? `no knob: ${reason}: give it to trunk lab` : "there is no such parameter"}`;
  }
  if (knob.labels) return checkRules(where, knob, value);
  const values = knob.array ? value : [value];
  if (!Array.isArray(values) || (knob.array && values.length !== knob.places.length)) return `${where}: ${knob.places.length} numbers are needed`;
  for (const item of values) {
    const number = numberOf(item);
    if (Number.isNaN(number)) return `${where}: it must be a number`;
    if (["integer", "seed"].includes(knob.kind) && !Number.isSafeInteger(number)) return `${where}: it must be an integer`;
    if (!Number.isFinite(number) && knob.kind !== "real") return `${where}: it must be finite`;
    const [low, high] = [numberOf(knob.low), numberOf(knob.high)];
    const beyond = number < low || number > high || (knob.above !== null && number <= knob.above) || (!knob.unbounded && !Number.isFinite(number));
    if (beyond) return `${where}: allowed is ${knob.above !== null && knob.above >= low ? `> ${knob.above}` : `>= ${low}`} and <= ${high}`;
    if (knob.excluded.includes(number)) return `${where}: ${number} changes the form of the equations: give another value`;
  }
  for (const { less, more, strict } of lab.orders[node] ?? []) {
    if (less !== name && more !== name) continue;
    const [a, b] = [less, more].map((key) => numberOf(key === name ? value : present[key] ?? lab.nodes[node].parameters[key]));
    if (strict ? !(a < b) : !(a <= b)) return `${where}: ${less} must be ${strict ? "less than" : "at most"} ${more} (${less === name ? b : a})`;
  }
  return "";
};
const checkRules = (where, knob, rows) => {
  if (!Array.isArray(rows) || rows.length !== knob.rows) return `${where}: ${knob.rows} rows are needed`;
  for (const row of rows) {
    const cells = String(row).split(/\s+/).filter(Boolean);
    if (cells.length !== knob.columns) return `${where}: each row needs ${knob.columns} labels`;
    const unknown = cells.find((cell) => !Object.hasOwn(knob.labels, cell));
    if (unknown !== undefined) return `${where}: ${unknown} is no label: ${Object.keys(knob.labels).join(", ")}`;
  }
  return "";
};
// JSON has no infinities: they are texts.
const numberOf = (value) => {
  if (typeof value === "number") return value;
  return new Map([["inf", Infinity], ["+inf", Infinity], ["-inf", -Infinity]]).get(value) ?? NaN;
};
// The nearest nanosecond, half to even, as Python rounds.
const nanoseconds = (seconds) => {
  const exact = seconds * 1e9;
  const below = Math.floor(exact);
  const rest = exact - below;
  return BigInt(rest > 0.5 || (rest === 0.5 && below % 2 !== 0) ? below + 1 : below);
};
const isObject = (value) => value?.constructor === Object;
// What an experiment may be in a lab, of which a link may have anything: "" or one line.
const checkSetup = (lab, { values, branch, pushes }) => {
  const late = branch === null ? { at_ns: 0, values: {} } : branch;
  if (![values, late, late?.values].every(isObject) || !Array.isArray(pushes)) return "values, branch and pushes are needed";
  for (const part of [values, late.values]) {
    for (const [node, changed] of Object.entries(part)) {
      if (!isObject(changed)) return `${node}: it has no parameters`;
      const present = { ...values[node], ...changed };
      for (const [name, value] of Object.entries(changed)) {
        const problem = checkValue(lab, node, name, value, present);
        if (problem) return problem;
        if (part !== values && lab.declared[node][name].start) return `${node}.${name}: it is fixed when a run starts: a branch cannot change it`;
      }
    }
  }
  const within = (stamp) => Number.isSafeInteger(stamp) && stamp % lab.period_ns === 0 && stamp >= 0 && stamp < lab.states * lab.period_ns;
  const { force, torque } = lab.world.operator;
  let before = -1;
  for (const push of pushes) {
    if (!Array.isArray(push) || push.length !== 3 || !push.every(Number.isFinite)) return "a push is damaged";
    if (!within(push[0]) || push[0] <= before) return "a push is at no time of the run, or not after the one before";
    if (Math.abs(push[1]) > force || Math.abs(push[2]) > torque) return `a push is beyond operator.force, ${force}, or operator.torque, ${torque}`;
    before = push[0];
  }
  return within(late.at_ns) ? "" : "the branch is at no time of the run";
};

const openEngine = async (lab, name) => {
  const program = lab.programs[name];
  const packed = Uint8Array.from(atob(program.wasm), (letter) => letter.charCodeAt(0));
  const bytes = await new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
  const { instance } = await WebAssembly.instantiate(bytes, {});
  return new Engine(lab, name, instance.exports);
};

class Engine {
  #code;
  #fresh; // the memory before the first state
  #view;
  #noise = { samples: null, count: 0 };

  constructor(lab, name, code) {
    this.lab = lab;
    this.name = name;
    this.#code = code;
    this.#view = new DataView(code.memory.buffer);
    this.#fresh = new Uint8Array(code.memory.buffer).slice();
    this.names = lab.programs[name].columns;
    this.width = this.names.length;
    this.states = lab.states;
    this.table = new Float64Array(lab.states * this.width);
    this.begin({ values: {}, branch: null, pushes: [] });
  }

  // Take an experiment, of which nothing is computed yet. Throws Error, one line, for what is not allowed.
  begin(setup) {
    const problem = checkSetup(this.lab, setup);
    if (problem) throw new Error(problem);
    this.setup = setup;
    this.count = 0;
    this.ended = "";
    this.falls = [];
    new Uint8Array(this.#code.memory.buffer).set(this.#fresh);
    for (const node of this.#nodes()) this.#write(node, setup.values[node] ?? {});
    this.#code.begin();
    this.#prepareNoise();
    const { branch } = setup;
    this.branchAt = branch ? Math.ceil(branch.at_ns / this.lab.period_ns) : Infinity;
  }

  // Compute until there are `stop` states, or the run has ended; return how many there are.
  advance(stop) {
    const end = Math.min(stop, this.states);
    while (this.count < end && !this.ended) {
      this.#change();
      const next = [this.branchAt, this.branchAt + 1].find((index) => index > this.count) ?? Infinity;
      this.#segment(Math.min(end, next, this.count + this.lab.chunk));
    }
    return this.count;
  }

  column(name) {
    const at = this.names.indexOf(name);
    return Float64Array.from({ length: this.count }, (_, k) => this.table[k * this.width + at]);
  }

  // What disturbs at the stamp after the last state: N, N m, m, rad.
  get ahead() { return this.#doubles(this.#code.disturbance_in(this.count), 4); }

  // { values: {metric: number, null where it is not defined, infinite: never}, failure: "" or why there are none }
  metrics() {
    const { lab, width, count } = this;
    if (!count) return { values: {}, failure: "metrics need at least one state; the run has none" };
    const table = this.#doubles(this.#code.table_of(), lab.chunk * width);
    for (let first = 0; first < count; first += lab.chunk) {
      const rows = Math.min(lab.chunk, count - first);
      table.set(this.table.subarray(first * width, (first + rows) * width));
      this.#code.measure(first, rows, count);
    }
    const numbers = this.#doubles(this.#code.metrics(), lab.metrics.length);
    const values = Object.fromEntries(lab.metrics.map((key, i) => [key, Number.isNaN(numbers[i]) ? null : numbers[i]]));
    const large = lab.metrics.find((key) => values[key] !== null && !Number.isFinite(values[key]) && !key.startsWith("settling"));
    return large ? { values: {}, failure: `${large} is too large for a floating-point number: no metrics` } : { values, failure: "" };
  }

  // Which rules fire at an error in rad and its rate in rad/s: { row, column, w00, w01, w10, w11 }; null without rules.
  rules(error, rate) {
    if (!this.#code.rules) return null;
    const [row, column, w00, w01, w10, w11] = this.#doubles(this.#code.rules(error, rate), 6);
    return { row, column, w00, w01, w10, w11 };
  }

  #nodes() { return ["simulator", "disturbance", this.name]; }

  #doubles(pointer, count) { return new Float64Array(this.#code.memory.buffer, pointer, count); }

  #write(node, values) {
    for (const [name, value] of Object.entries(values)) {
      const knob = this.lab.knobs[node][name];
      if (knob.kind === "seed") continue;
      if (knob.labels) {
        const cells = value.join(" ").split(/\s+/).filter(Boolean);
        cells.forEach((cell, i) => this.#put(knob.first + i, "real", knob.labels[cell]));
      } else {
        const items = knob.array ? value : [value];
        items.forEach((item, i) => knob.places[i].forEach((place) => this.#put(place, knob.kind, numberOf(item))));
      }
    }
  }

  #put(place, kind, number) {
    const pointer = this.#code.place_of(place);
    if (kind === "real") this.#view.setFloat64(pointer, number, true);
    else this.#view.setBigInt64(pointer, kind === "ns" ? nanoseconds(number) : BigInt(number), true);
  }

  // A branch: a controller and the disturbance change before its state, the simulator after it.
  #change() {
    const { branch } = this.setup;
    if (this.count === this.branchAt) {
      const own = branch.values[this.name];
      if (own && Object.keys(own).length) {
        this.#code.remember();
        this.#write(this.name, own);
        this.#code.take_over();
      }
      this.#write("disturbance", branch.values.disturbance ?? {});
    } else if (this.count === this.branchAt + 1) {
      this.#write("simulator", branch.values.simulator ?? {});
      this.#prepareNoise();
    }
  }

  #segment(stop) {
    const { count: first, width } = this;
    const code = this.#code;
    if (this.noisy) this.#doubles(code.noise_of(), 2 * (stop - first)).set(this.#samples(stop).subarray(2 * first, 2 * stop));
    this.#fillPushes(first, stop);
    const end = code.advance(first, stop);
    this.table.set(this.#doubles(code.table_of(), (end - first) * width), first * width);
    const [fallen, torque, drive] = ["fallen", "torque", "drive"].map((name) => this.names.indexOf(name));
    for (let k = first; k < end; k++) {
      // Where the plant has changed in between, the step before this state is not what was foreseen in the last.
      if (k > 0) this.table[(k - 1) * width + drive] = this.table[k * width + torque];
      const before = k > 0 && this.table[(k - 1) * width + fallen] !== 0;
      if (this.table[k * width + fallen] !== 0 && !before) this.falls.push(k);
    }
    this.count = end;
    this.ended = ["", "fell", "diverged"][code.how_it_ended()];
  }

  // A push holds until the next one, or until it is too old.
  #fillPushes(first, stop) {
    const rows = this.#doubles(this.#code.schedule_push_of(), 2 * (stop - first));
    rows.fill(0);
    const { pushes } = this.setup;
    const { period_ns: period, operator_timeout_ns: timeout } = this.lab;
    if (!pushes.length) return;
    let at = pushes.findLastIndex(([stamp]) => stamp <= first * period);
    for (let k = first; k < stop; k++) {
      while (at + 1 < pushes.length && pushes[at + 1][0] <= k * period) at += 1;
      if (at >= 0 && k * period - pushes[at][0] <= timeout) rows.set(pushes[at].slice(1), 2 * (k - first));
    }
  }

  #prepareNoise() {
    const { noise } = this.lab;
    this.noisy = noise.some((place) => this.#view.getFloat64(this.#code.place_of(place), true) !== 0);
    const seed = this.setup.values.simulator?.["sensor.seed"] ?? this.lab.nodes.simulator.parameters["sensor.seed"];
    this.#noise = { samples: new Float64Array(2 * this.states), count: 0 };
    this.#code.seed(seed);
    if (!this.noisy) this.#doubles(this.#code.noise_of(), 2 * this.lab.chunk).fill(0);
  }

  // The samples of the states before `stop`, two for each.
  #samples(stop) {
    const noise = this.#noise;
    const { chunk } = this.lab;
    while (noise.count < stop) {
      const rows = Math.min(chunk, this.states - noise.count);
      this.#code.draw(2 * rows);
      noise.samples.set(this.#doubles(this.#code.noise_of(), 2 * rows), 2 * noise.count);
      noise.count += rows;
    }
    return noise.samples;
  }
}
