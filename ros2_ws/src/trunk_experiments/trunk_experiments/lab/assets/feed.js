"use strict";
// What a connection is for a running graph: engines that compute the experiment in the page, with the same words and rows.
const lab = JSON.parse(document.getElementById("lab-data").textContent);
const wire = (() => {
  const PIECE_MS = 6; // of computing, between which the page answers
  const CHUNK = 256; // states
  const SHORTEST_NS = Math.ceil(50e6 / lab.period_ns) * lab.period_ns; // of a push
  const PERIOD_S = lab.period_ns / 1e9;
  const PLANT = { x: "x", theta: "theta", x_dot: "x_dot", theta_dot: "theta_dot", torque: "torque" };
  const BEFORE_TERMS = "fallen"; // the last column before those of the law
  const listeners = [];
  const say = (kind, values) => listeners.forEach((listener) => listener(kind, values));
  const engines = [];
  const copied = []; // rows of each engine that the page has; -1: it still shows what was before
  let setup = freshSetup();
  let goal = lab.states; // states to compute
  let hand = null; // { force, torque } that pushes while the run goes on
  let begun = 0; // the stamp of the push that is going on, ns
  let waiting = []; // for the whole run

  // ── rows ─────────────────────────────────────────────────────────────────────────────────────────────
  const rowOf = (time) => Math.floor(time / PERIOD_S + 1e-6);
  const over = (engine) => Boolean(engine.ended) || engine.count >= lab.states;
  const column = (store, name) => {
    if (store.column(name).length < lab.states) store.columns.set(name, new Float64Array(lab.states));
    return store.columns.get(name);
  };
  const publish = (engine, index) => {
    const run = known.runs[index];
    if (copied[index] < 0) {
      // The old run stays until the new one has come to the time that is shown.
      if (engine.count <= rowOf(view.time) && !over(engine)) return;
      copied[index] = run.control.count = 0;
    }
    const { names, width, table, count } = engine;
    const at = (name) => names.indexOf(name);
    const from = copied[index];
    const t = column(run.plant, "t");
    for (let k = from; k < count; k++) t[k] = k * PERIOD_S;
    for (const [name, source] of Object.entries(PLANT)) {
      const [target, place] = [column(run.plant, name), at(source)];
      for (let k = from; k < count; k++) target[k] = table[k * width + place];
    }
    run.plant.count = count;
    run.ended = engine.ended === "diverged" ? engine.ended : "";
    // Of the controller, a row for each update.
    const terms = names.slice(at(BEFORE_TERMS) + 1).filter((name) => name !== "drive");
    const targets = terms.map((name) => [column(run.control, name), at(name)]);
    const times = column(run.control, "t");
    const fresh = at("fresh");
    let row = run.control.count;
    for (let k = from; k < count; k++) {
      if (table[k * width + fresh] !== 1) continue;
      times[row] = k * PERIOD_S;
      for (const [target, place] of targets) target[row] = table[k * width + place];
      row += 1;
    }
    run.control.count = row;
    run.events = engine.falls.map((k, number) => ({ number, t: k * PERIOD_S, node: "simulator", event: "fell", values: { angle: table[k * width + at("theta")] } }));
    if (count > from) known.version += 1;
    copied[index] = count;
  };
  const pushed = () => {
    known.pushes.clear();
    if (setup.pushes.length) known.pushes.add(["t", "force", "torque"], setup.pushes.flatMap(([stamp, force, torque]) => [stamp / 1e9, force, torque]));
  };

  // ── computing, in pieces ─────────────────────────────────────────────────────────────────────────────
  const channel = new MessageChannel();
  let queued = false;
  const schedule = () => {
    if (queued) return;
    queued = true;
    channel.port2.postMessage(null);
  };
  const lagging = () => engines.filter((engine) => !engine.ended && engine.count < goal).sort((a, b) => a.count - b.count)[0];
  const compute = (until) => {
    for (let engine = lagging(); engine && performance.now() < until; engine = lagging()) engine.advance(Math.min(goal, engine.count + CHUNK));
    engines.forEach(publish);
    if (lagging()) schedule();
    else if (!hand) done();
  };
  channel.port1.onmessage = () => {
    queued = false;
    compute(performance.now() + PIECE_MS);
  };
  const done = () => {
    say("whole");
    const waited = waiting;
    waiting = [];
    waited.forEach((resolve) => resolve());
  };
  const whole = () => new Promise((resolve) => {
    waiting.push(resolve);
    schedule();
  });
  const begin = () => {
    goal = hand ? rowOf(view.time) + 1 : lab.states;
    engines.forEach((engine, index) => {
      engine.begin({ ...setup, pushes: [...setup.pushes] });
      copied[index] = -1;
    });
    pushed();
    say("setup");
    schedule();
  };

  // ── pushes by hand ───────────────────────────────────────────────────────────────────────────────────
  // What the hand does acts from the next state on, in all runs, also where they are still on the way to it.
  const push = () => {
    const { force, torque } = hand;
    const last = setup.pushes.at(-1);
    let stamp = goal * lab.period_ns;
    if (force || torque) {
      if (last && last[1] === force && last[2] === torque && stamp - last[0] < lab.operator_timeout_ns / 2) return;
      if (!last?.[1] && !last?.[2]) begun = stamp;
    } else {
      if (!last?.[1] && !last?.[2]) return;
      stamp = Math.max(stamp, begun + SHORTEST_NS);
    }
    if (stamp >= lab.states * lab.period_ns) return;
    const earlier = setup.pushes.filter(([at]) => at < stamp);
    setup.pushes = [...earlier, [stamp, force, torque]];
    for (const engine of engines) engine.setup.pushes = setup.pushes;
    pushed();
  };
  const feel = ({ force, torque }) => {
    const { operator } = lab.world;
    const clip = (value, bound) => Math.max(-bound, Math.min(Number(value.toPrecision(4)), bound));
    const rests = !view.playing || (!force && !torque);
    if (rests && !hand) return;
    const grabbed = !hand;
    hand = rests ? { force: 0, torque: 0 } : { force: clip(force, operator.force), torque: clip(torque, operator.torque) };
    if (grabbed) {
      setup = { ...setup, pushes: setup.pushes.filter(([stamp]) => stamp <= rowOf(view.time) * lab.period_ns) };
      begin();
    }
    push();
    if (rests) release();
  };
  const release = () => {
    if (!hand) return;
    hand = null;
    goal = lab.states;
    say("setup");
    schedule();
  };
  // Time goes on, as far as there are states. While a hand pushes they are computed as they are shown.
  const reach = (time) => {
    if (hand) {
      if (lagging()) return view.time;
      goal = Math.min(lab.states, rowOf(time) + 1);
      for (const engine of engines) engine.advance(goal);
      engines.forEach(publish);
      if (goal === lab.states || engines.every(over)) release();
      return time;
    }
    const there = engines.map((engine, index) => (copied[index] < 0 ? view.time : over(engine) ? Infinity : (copied[index] - 1) * PERIOD_S));
    return Math.max(view.time, Math.min(time, ...there));
  };

  // ── words ────────────────────────────────────────────────────────────────────────────────────────────
  const words = (nodes = Object.keys(lab.nodes)) => {
    for (const name of nodes) {
      known.nodes.set(name, { ...lab.nodes[name], state: "active", parameters: setups.parametersOf(lab, setup, name) });
      say("node", known.nodes.get(name));
    }
    const now = setups.parametersOf(lab, setup, "simulator");
    // A name with a dot stands for the parameter's value; with a factor it is a part of that.
    const value = (_, part) => (part?.factor !== undefined ? part.name * part.factor : part?.includes?.(".") ? now[part] : part);
    known.world = { ...lab.world, limit: now.max_effort, picture: JSON.parse(JSON.stringify(lab.picture), value) };
    say("world", known.world);
  };
  const select = (name) => {
    known.shown = Math.max(0, lab.controllers.indexOf(name));
    known.run = { acting: [lab.controllers[known.shown]], started: true, ended: false, paused: false };
    say("run", known.run);
  };
  const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
  const changed = (node, values) => {
    const now = setups.parametersOf(lab, setup, node);
    for (const [name, value] of Object.entries(values)) {
      const problem = checkValue(lab, node, name, value, { ...now, ...values });
      if (problem) return problem;
      if (setup.branch && lab.declared[node][name].start) return `${node}.${name}: fixed when a run starts: remove the branch first`;
    }
    // Only what differs is part of an experiment.
    const target = structuredClone((setup.branch ?? setup).values);
    const usual = setup.branch ? setups.parametersOf(lab, { ...setup, branch: null }, node) : lab.nodes[node].parameters;
    target[node] = Object.fromEntries(Object.entries({ ...target[node], ...values }).filter(([name, value]) => !same(value, usual[name])));
    if (!Object.keys(target[node]).length) delete target[node];
    setup = setup.branch ? { ...setup, branch: { ...setup.branch, values: target } } : { ...setup, values: target };
    words([node]);
    begin();
    return "";
  };

  // ── whole experiments ────────────────────────────────────────────────────────────────────────────────
  const remembered = (run) => {
    const plant = new Store(false);
    for (const [name, values] of run.plant.columns) plant.columns.set(name, values.slice());
    plant.count = run.plant.count;
    return { plant };
  };
  // Take an experiment; of one with a branch the run without it is computed first, and stays in sight.
  const take = async (next) => {
    hand = null;
    const { branch } = next;
    const parent = { ...next, branch: null };
    const kept = branch && setup.branch && same({ ...setup, branch: null }, parent);
    if (branch && !kept) {
      setup = structuredClone(parent);
      known.branch = null;
      begin();
      await whole();
      for (const run of known.runs) run.before = remembered(run);
    } else if (!branch) for (const run of known.runs) run.before = null;
    setup = structuredClone(next);
    known.branch = branch ? { at: branch.at_ns / 1e9 } : null;
    words();
    begin();
  };
  const answers = {
    set: ({ node, values }) => changed(node, values),
    swap: ({ to }) => {
      select(to);
      return "";
    },
  };
  const open = async () => {
    known.runs = lab.controllers.map((name) => new Run(name));
    known.client = "lab";
    known.control_allowed = true;
    known.firing = (row) => {
      const at = (name) => known.control.value(name, row);
      return (Number.isFinite(at("error")) && engines[known.shown]?.rules(at("error"), at("error_rate"))) || { row: NaN, column: NaN };
    };
    // A default here is a value of the unchanged experiment.
    for (const [node, declared] of Object.entries(lab.declared)) {
      const { parameters } = lab.nodes[node];
      known.declared.set(node, Object.fromEntries(Object.entries(declared).map(([name, about]) => [name, { ...about, default: parameters[name] }])));
    }
    say("hello", { control: true });
    known.recorded = { first: 0, last: lab.end_s };
    select(lab.controllers.at(-1));
    words();
    say("recorded", known.recorded);
    try {
      engines.push(...await Promise.all(lab.controllers.map((name) => openEngine(lab, name))));
    } catch (error) {
      alarm.say(`this page cannot compute here: ${error.message}; its server's policy must allow 'wasm-unsafe-eval'`);
      return;
    }
    say("link", "open");
  };
  return {
    EVERY_MS: 16, // a slider that is dragged asks no more often
    open,
    listen: (listener) => listeners.push(listener),
    send: (kind, values = {}) => { if (kind === "push" && engines.length) feel(values); },
    ask: async (kind, values = {}) => {
      if (!engines.length) return { ok: false, text: "the lab is still opening" };
      const text = answers[kind]?.(values) ?? "a lab has no such thing";
      return { ok: !text, text };
    },
    finish: () => { if (lagging()) compute(Infinity); },
    reach, take, whole, engines,
    get setup() { return setup; },
  };
})();
