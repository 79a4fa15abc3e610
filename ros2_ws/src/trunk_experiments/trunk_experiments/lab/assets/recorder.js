"use strict";
// What disturbs when a run starts, and what a branch makes of it, as `trunk simulate` and `trunk branch` have it.
const disturbing = (() => {
  const SHARED = ["update_rate", "joints"]; // with the simulator
  // Whether any signal is not zero: the node runs only then.
  const active = (values) => {
    const pulses = values["pulse.start_times"].length || values["pulse.random_count"];
    return Boolean((pulses && values["pulse.magnitude"] && values["pulse.duration"])
      || values["sine.amplitude"] || values["noise.rms"] || values["table.values"].some(Boolean));
  };
  // The parameters of a node that comes with a branch, before the branch changes them.
  const fresh = (lab) => Object.fromEntries(Object.entries(lab.declared.disturbance).map(
    ([name, { default: usual }]) => [name, SHARED.includes(name) ? lab.nodes.disturbance.parameters[name] : usual],
  ));
  // null, or a run that nothing disturbs when it starts: what a branch starts from, and what it changes.
  const late = (lab, { values, branch }) => {
    if (!lab.nodes.disturbance) return null;
    const first = { ...lab.nodes.disturbance.parameters, ...values.disturbance };
    if (active(first)) return null;
    const before = fresh(lab);
    const after = Object.keys(branch?.values.disturbance ?? {}).length ? { ...first, ...branch.values.disturbance } : before;
    return { before, changed: Object.fromEntries(Object.entries(after).filter(([name, value]) => JSON.stringify(value) !== JSON.stringify(before[name]))) };
  };
  return { late };
})();

// A run as its recording: what the nodes would have published, in the order of an offline run.
const recordingOf = (() => {
  // A parameter is [name, kind, value].
  const read = (kind, value) => {
    if (Array.isArray(value)) return value.map((element) => read(kind.split(" ")[0], element));
    return kind === "double" ? numberOf(value) : value;
  };
  const withValues = (parameters, values = {}) => parameters.map(
    ([name, kind, value]) => [name, kind, read(kind, values[name] ?? value)],
  );
  const valueOf = (parameters, name) => parameters.find(([known]) => known === name)[2];
  const equal = (a, b) => (Array.isArray(a) ? a.length === b.length && a.every((v, i) => v === b[i]) : a === b);

  // Every node's parameters at the start; without a signal nobody waits for a node that disturbs: it comes with a
  // branch that changes it, or not at all.
  const nodesOf = (lab, names, values, late) => {
    const nodes = {};
    for (const node of names) {
      const parameters = Object.entries(lab.nodes[node].parameters).map(([name, value]) => [name, lab.declared[node][name].kind, value]);
      nodes[node] = withValues(parameters, values[node]);
    }
    if (late) {
      if (Object.keys(late.changed).length) nodes.disturbance = withValues(nodes.disturbance, late.before);
      else delete nodes.disturbance;
      const waited = valueOf(nodes.simulator, "wait_for").filter((topic) => topic !== "disturbance");
      nodes.simulator = withValues(nodes.simulator, { wait_for: waited });
    }
    return nodes;
  };

  // What a branch changes, in the order in which it is recorded: it takes effect after the state with index `after`.
  const changesOf = (nodes, { at_ns, values }, period) => Object.keys(nodes).sort().map((node) => {
    const after = Math.ceil(at_ns / period) - (node === "simulator" ? 0 : 1);
    const present = withValues(nodes[node], values[node]);
    const changed = present.filter(([, , value], i) => !equal(value, nodes[node][i][2]));
    return { node, after, ns: after < 0 ? -1 : after * period, changed, present };
  }).filter(({ changed }) => changed.length).sort((a, b) => a.after - b.after);

  // The MCAP file of a controller's whole run: an engine that has computed it, or its data.
  return (lab, name, run) => {
    const { recording, period_ns: period } = lab;
    const { words, topics, columns } = recording;
    const { count, width, table, setup } = run;
    if (!run.ended && count < lab.states) throw new Error(`the run has not ended: ${count} of ${lab.states} states are computed`);
    const plan = recording.runs[name];
    const branch = setup.branch && setup.branch.at_ns < count * period ? setup.branch : null;
    const late = disturbing.late(lab, { values: setup.values, branch });
    const nodes = nodesOf(lab, plan.nodes, setup.values, late);
    const values = late && branch ? { ...branch.values, disturbance: late.changed } : branch?.values;
    const changes = branch ? changesOf(nodes, { ...branch, values }, period) : [];
    const disturbedFrom = late && branch ? Math.ceil(branch.at_ns / period) : 0;
    const pushes = [...setup.pushes];
    const writer = new RecordingWriter(recording);
    let last = -1; // the last state's stamp, ns

    const event = (word, values = {}, { node = "simulator", level = 0, ns = last } = {}) => {
      writer.add(topics.events, ns, cdr.event(ns, `/${node}`, words[word], values, level));
    };

    // Messages with the values of a row of the table, or of other doubles.
    const halves = new Uint32Array(table.buffer, table.byteOffset, 2 * table.length);
    const joints = (stream) => {
      const messages = new JointStates(plan.streams[stream]);
      return (ns, first, doubles = halves) => writer.add(plan.streams[stream].topic, ns, messages.at(ns, doubles, first));
    };
    const [truth, measured, command, terms, push, disturbance] = ["truth", "measured", "command", "terms", "push", "disturbance"].map(joints);

    // The changes that take effect before a state, and an operator's pushes from it on.
    const outside = (row, ns) => {
      while (changes.length && changes[0].after < row) {
        const { node, ns: at, changed, present } = changes.shift();
        event("retuned", {}, { node, ns: at });
        writer.add(topics.parameters, at, cdr.parameters(at, `/${node}`, [], changed));
        nodes[node] = present;
      }
      while (pushes.length && pushes[0][0] <= ns) {
        const [at, ...efforts] = pushes.shift();
        writer.addTopic(plan.streams.push.topic, plan.channels[0][1]);
        push(at, 0, new Uint32Array(Float64Array.from(efforts).buffer));
      }
    };

    const states = () => {
      const falls = new Set(run.falls);
      const ahead = new Float64Array(width); // as a row after the last
      columns.disturbance.forEach((column, i) => { ahead[column] = run.ahead[i]; });
      for (let row = 0; row < count; row++) {
        const ns = row * period;
        const first = row * width;
        outside(row, ns);
        truth(ns, first);
        if (nodes.disturbance && row >= disturbedFrom) {
          if (row === disturbedFrom) disturbance(ns, first);
          if (row + 1 < count) disturbance(ns + period, first + width);
          else disturbance(ns + period, 0, new Uint32Array(ahead.buffer));
        }
        measured(ns, first);
        command(ns, first);
        if (table[first + columns.updated]) terms(ns, first);
        last = ns;
        if (falls.has(row)) {
          const [angle, limit] = [table[first + columns.angle], valueOf(nodes.simulator, "fall.angle")].map(pythonNumbers.repr);
          event("fell", { angle, limit }, { level: 1 });
        }
      }
      outside(Infinity, last);
    };

    writer.addMetadata(RecordingWriter.PROVENANCE, {
      started_utc: new Date().toISOString().replace(/\..*/, "+00:00"),
      ...plan.provenance,
      platform: globalThis.navigator?.userAgent ?? "unknown",
      page: lab.digest,
    });
    for (const [topic, type] of plan.channels) writer.addTopic(topic, type);
    for (const [node, parameters] of Object.entries(nodes)) {
      writer.add(topics.parameters, 0, cdr.parameters(0, `/${node}`, parameters, []));
    }
    event("started", { rate: plan.rate });
    states();
    const fallen = run.falls.at(-1) === count - 1 && valueOf(nodes.simulator, "fall.stop");
    const diverged = run.ended === "diverged";
    const reason = diverged ? run.reason : recording.reasons[fallen ? "fell" : "end"];
    event(diverged ? "failed" : "finished", { reason, states: String(count) }, { level: diverged ? 2 : 0 });
    return writer.finish(!diverged, reason);
  };
})();
