"use strict";
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

  // Whether any signal is not zero: the node runs only then.
  const disturbs = (parameters) => {
    const value = (name) => valueOf(parameters, name);
    const pulses = value("pulse.start_times").length || value("pulse.random_count");
    return Boolean((pulses && value("pulse.magnitude") && value("pulse.duration"))
      || value("sine.amplitude") || value("noise.rms") || value("table.values").some(Boolean));
  };

  // Every node's parameters at the start; without a signal there is no node that disturbs, and nobody waits for it.
  const nodesOf = (lab, names, { values, branch }) => {
    const nodes = {};
    for (const node of names) {
      const parameters = Object.entries(lab.nodes[node].parameters).map(([name, value]) => [name, lab.declared[node][name].kind, value]);
      nodes[node] = withValues(parameters, values[node]);
    }
    const changes = Object.keys(branch?.values.disturbance ?? {}).length;
    if (nodes.disturbance && !changes && !disturbs(nodes.disturbance)) {
      delete nodes.disturbance;
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

  class Recorder {
    constructor(lab, name, run) {
      const { recording, period_ns: period } = lab;
      const { table, setup } = run;
      this.words = recording.words;
      this.reasons = recording.reasons;
      this.topics = recording.topics;
      this.columns = recording.columns;
      this.plan = recording.runs[name];
      this.run = run;
      this.period = period;
      this.nodes = nodesOf(lab, this.plan.nodes, setup);
      const reached = setup.branch && setup.branch.at_ns < run.count * period;
      this.changes = reached ? changesOf(this.nodes, setup.branch, period) : [];
      this.pushes = [...setup.pushes];
      this.halves = new Uint32Array(table.buffer, table.byteOffset, 2 * table.length);
      this.streams = {};
      for (const [stream, { topic, ...layout }] of Object.entries(this.plan.streams)) {
        if (stream !== "disturbance" || this.nodes.disturbance) this.streams[stream] = { topic, messages: new JointStates(layout) };
      }
      this.writer = new RecordingWriter(recording);
      this.last = -1; // the last state's stamp, ns
      this.writer.addMetadata(RecordingWriter.PROVENANCE, {
        started_utc: new Date().toISOString().replace(/\..*/, "+00:00"),
        ...this.plan.provenance,
        platform: globalThis.navigator?.userAgent ?? "unknown",
        page: lab.digest,
      });
    }

    event(words, values = {}, { node = "simulator", level = 0, ns = this.last } = {}) {
      this.writer.add(this.topics.events, ns, cdr.event(ns, `/${node}`, words, values, level));
    }

    // A message with the values of a row of the table, or of other doubles.
    joints(stream, ns, first, halves = this.halves) {
      const { topic, messages } = this.streams[stream];
      this.writer.add(topic, ns, messages.at(ns, halves, first));
    }

    begin() {
      for (const [topic, type] of this.plan.channels) this.writer.addTopic(topic, type);
      for (const [node, parameters] of Object.entries(this.nodes)) {
        this.writer.add(this.topics.parameters, 0, cdr.parameters(0, `/${node}`, parameters, []));
      }
      this.event(this.words.started, { rate: this.plan.rate });
    }

    // The changes that take effect before a state, and an operator's pushes from it on.
    outside(row, ns) {
      while (this.changes.length && this.changes[0].after < row) {
        const { node, ns: at, changed, present } = this.changes.shift();
        this.event(this.words.retuned, {}, { node, ns: at });
        this.writer.add(this.topics.parameters, at, cdr.parameters(at, `/${node}`, [], changed));
        this.nodes[node] = present;
      }
      while (this.pushes.length && this.pushes[0][0] <= ns) {
        const [at, ...efforts] = this.pushes.shift();
        const { topic } = this.streams.push;
        if (!this.writer.topics.has(topic)) this.writer.addTopic(topic, this.plan.channels[0][1]);
        this.joints("push", at, 0, new Uint32Array(Float64Array.from(efforts).buffer));
      }
    }

    states() {
      const { run, streams, columns, period } = this;
      const { count, width, table } = run;
      const falls = new Set(run.falls);
      const ahead = new Float64Array(width); // as a row after the last
      columns.disturbance.forEach((column, i) => { ahead[column] = run.ahead[i]; });
      const after = new Uint32Array(ahead.buffer);
      for (let row = 0; row < count; row++) {
        const ns = row * period;
        const first = row * width;
        this.outside(row, ns);
        this.joints("truth", ns, first);
        if (streams.disturbance) {
          if (row === 0) this.joints("disturbance", ns, first);
          if (row + 1 < count) this.joints("disturbance", ns + period, first + width);
          else this.joints("disturbance", ns + period, 0, after);
        }
        this.joints("measured", ns, first);
        this.joints("command", ns, first);
        if (table[first + columns.updated] === 1) this.joints("terms", ns, first);
        this.last = ns;
        if (falls.has(row)) {
          const limit = valueOf(this.nodes.simulator, "fall.angle");
          this.event(this.words.fell, { angle: pythonNumbers.repr(table[first + columns.angle]), limit: pythonNumbers.repr(limit) }, { level: 1 });
        }
      }
      this.outside(Infinity, this.last);
    }

    // Write how the run ended; return the file.
    end() {
      const { count, ended, falls } = this.run;
      const fallen = falls.at(-1) === count - 1 && valueOf(this.nodes.simulator, "fall.stop");
      const diverged = ended === "diverged";
      const reason = diverged ? this.run.reason : this.reasons[fallen ? "fell" : "end"];
      this.event(this.words[diverged ? "failed" : "finished"], { reason, states: String(count) }, { level: diverged ? 2 : 0 });
      return this.writer.finish(!diverged, reason);
    }
  }

  // The MCAP file of a controller's whole run: an engine that has computed it, or its data.
  return (lab, name, run) => {
    if (!run.ended && run.count < lab.states) {
      throw new Error(`the run has not ended: ${run.count} of ${lab.states} states are computed`);
    }
    const recorder = new Recorder(lab, name, run);
    recorder.begin();
    recorder.states();
    return recorder.end();
  };
})();
