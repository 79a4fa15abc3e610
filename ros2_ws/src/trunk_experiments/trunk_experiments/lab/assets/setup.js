"use strict";
// An experiment as a link, a file and commands: plain data, `engine.js` says which. Nothing here touches the page.
const freshSetup = () => ({ values: {}, branch: null, pushes: [] });
const isDefaultSetup = ({ values, branch, pushes }) => !Object.keys(values).length && !branch && !pushes.length;

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

const setups = (() => {
  const VERSION = 1;
  const LONGEST = 100_000; // letters of a link
  const LARGEST = 2_000_000; // bytes in it

  const squeezed = (data, stream) => new Response(new Blob([data]).stream().pipeThrough(stream));
  // The bytes of a stream, of which no more are taken than are allowed.
  const bounded = async (data) => {
    const reader = new Blob([data]).stream().pipeThrough(new DecompressionStream("deflate-raw")).getReader();
    const parts = [];
    let size = 0;
    for (let { done, value } = await reader.read(); !done; { done, value } = await reader.read()) {
      parts.push(value);
      size += value.length;
      if (size > LARGEST) throw new Error("it holds too much");
    }
    return new Blob(parts).text();
  };

  // Stamps as differences in states.
  const link = async (lab, { values, branch, pushes }) => {
    let before = 0;
    const short = pushes.map(([stamp, force, torque]) => {
      const index = stamp / lab.period_ns;
      const step = index - before;
      before = index;
      return [step, force, torque];
    });
    const text = JSON.stringify([VERSION, values, branch && [branch.at_ns / lab.period_ns, branch.values], short]);
    const bytes = new Uint8Array(await squeezed(text, new CompressionStream("deflate-raw")).arrayBuffer());
    return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
  };
  const isObject = (value) => typeof value === "object" && value !== null && !Array.isArray(value);
  const checkValues = (lab, values) => {
    if (!isObject(values)) throw new Error("it has no parameters");
    for (const [node, changed] of Object.entries(values)) {
      if (!Object.hasOwn(lab.declared, node) || !isObject(changed)) throw new Error(`this lab has no node ${node.slice(0, 40)}`);
      for (const name of Object.keys(changed))
        if (!Object.hasOwn(lab.declared[node], name)) throw new Error(`${node} has no parameter ${name.slice(0, 40)}`);
    }
    return values;
  };
  const index = (lab, value) => {
    if (!Number.isSafeInteger(value) || value < 0 || value >= lab.states) throw new Error("a time is not in the run");
    return value * lab.period_ns;
  };
  // The experiment in a link. Throws Error, one line.
  const open = async (lab, fragment) => {
    let data;
    try {
      if (fragment.length > LONGEST) throw new Error("it is too long");
      const letters = atob(fragment.replaceAll("-", "+").replaceAll("_", "/"));
      data = JSON.parse(await bounded(Uint8Array.from(letters, (letter) => letter.charCodeAt(0))));
    } catch {
      throw new Error("it is damaged");
    }
    if (!Array.isArray(data) || data[0] !== VERSION || !Array.isArray(data[3])) throw new Error("it is not of this lab");
    const [, values, branch, short] = data;
    let at = 0;
    const pushes = short.map((push) => {
      if (!Array.isArray(push) || push.length !== 3 || !push.every(Number.isFinite) || (push[0] <= 0 && at > 0)) throw new Error("a push is damaged");
      at += push[0];
      return [index(lab, at), push[1], push[2]];
    });
    const setup = {
      values: checkValues(lab, values),
      branch: Array.isArray(branch) ? { at_ns: index(lab, branch[0]), values: checkValues(lab, branch[1]) } : null,
      pushes,
    };
    const { force, torque } = lab.world.operator;
    if (pushes.some((push) => Math.abs(push[1]) > force || Math.abs(push[2]) > torque)) throw new Error(`a push is beyond ${force} N or ${torque} N·m`);
    const problem = checkSetup(lab, setup);
    if (problem) throw new Error(problem);
    return setup;
  };

  // A node's parameters, with the experiment's changes.
  const parametersOf = (lab, setup, node) => ({
    ...lab.nodes[node].parameters, ...setup.values[node], ...setup.branch?.values[node],
  });

  const written = (value) => (Array.isArray(value) ? `[${value.map(written).join(", ")}]` : String(value));
  // `--set` for each change; of a rule table for each cell.
  const settings = (lab, values, nodes) => nodes.flatMap((node) => Object.entries(values[node] ?? {}).flatMap(([name, value]) => {
    const { rules, parameters } = lab.nodes[node];
    if (!rules?.tables.some((table) => table.name === name)) return ["--set", `${node}.${name}=${written(value)}`];
    const cells = (row) => row.split(/\s+/).filter(Boolean);
    return value.flatMap((row, i) => cells(row).flatMap((label, j) =>
      (label === cells(parameters[name][i])[j] ? [] : ["--set", `${node}.${name}.${rules.error[i]}.${rules.rate[j]}=${label}`])));
  }));
  const stemOf = (lab, ...names) => [lab.scenario.replace(/^.*\//, "").replace(/\.ya?ml$/, "").replace(/[^\w.-]+/g, "_"), ...names].join("_");
  // SHA-256 of the numbers of all states; null where a browser takes none: on a page without https.
  const digest = async ({ table, width, count }, columns) => {
    if (!globalThis.crypto?.subtle) return null;
    const numbers = new Float64Array(count * columns);
    for (let k = 0; k < count; k++) numbers.set(table.subarray(k * width, k * width + columns), k * columns);
    const bytes = new Uint8Array(await crypto.subtle.digest("SHA-256", numbers));
    return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
  };
  // What `trunk simulate --like` repeats: a controller's run in this experiment, and what came of it.
  const experiment = async (lab, name, run) => {
    const { setup, count } = run;
    const nodes = ["simulator", "disturbance", name].filter((node) => lab.nodes[node]);
    const { branch } = setup;
    const late = branch && branch.at_ns < count * lab.period_ns && Object.entries(branch.values).filter(([node]) => nodes.includes(node));
    return {
      format: lab.experiment.format, scenario: lab.scenario, controller: name, page: lab.digest,
      parameters: Object.fromEntries(nodes.map((node) => [node, parametersOf(lab, { ...setup, branch: null }, node)])),
      branch: late ? { at_ns: branch.at_ns, parameters: Object.fromEntries(late) } : null,
      pushes: setup.pushes, states: count, sha256: await digest(run, lab.experiment.columns),
    };
  };
  // All states as CSV in SI units; a term has its value where the law was updated.
  const csv = (lab, { names, table, width, count }) => {
    const shown = names.filter((name) => name !== "drive");
    const fresh = names.indexOf("fresh");
    const lines = [["t", ...shown].join(",")];
    for (let k = 0; k < count; k++) {
      const row = table.subarray(k * width, k * width + shown.length);
      const cells = Array.from(row, (value, i) => (i < lab.experiment.columns || row[fresh] ? value : ""));
      lines.push([(k * lab.period_ns) / 1e9, ...cells].join(","));
    }
    return `${lines.join("\n")}\n`;
  };
  // The commands that compute a controller's run anew, with the same bits.
  const commands = (lab, name, setup) => {
    const line = (words) => words.map(quoted).join(" ");
    const nodes = ["simulator", "disturbance", name];
    const file = `${stemOf(lab, name)}.mcap`;
    if (setup.pushes.length) {
      return [
        `# the pushes by hand are in the experiment: save that of ${name} first`,
        line(["trunk", "simulate", "--like", `${stemOf(lab, name)}.json`, "-o", file]),
      ];
    }
    const lines = [line([...lab.commands[name], ...settings(lab, setup.values, nodes), "-o", file])];
    const before = Object.fromEntries(nodes.map((node) => [node, { ...lab.nodes[node], parameters: parametersOf(lab, { ...setup, branch: null }, node) }]));
    const late = disturbing.late(lab, setup);
    const changes = setup.branch ? settings({ ...lab, nodes: before }, { ...setup.branch.values, ...(late && { disturbance: late.changed }) }, nodes) : [];
    if (changes.length) lines.push(line(["trunk", "branch", file, "--at", String(setup.branch.at_ns / 1e9), ...changes, "-o", `${stemOf(lab, name, "branch")}.mcap`]));
    return lines;
  };
  return { link, open, parametersOf, commands, experiment, csv, stemOf };
})();
