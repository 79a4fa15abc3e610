"use strict";
// An experiment as a link, a file and commands: plain data, `engine.js` says which. Nothing here touches the page.
const freshSetup = () => ({ values: {}, branch: null, pushes: [] });
const isDefaultSetup = ({ values, branch, pushes }) => !Object.keys(values).length && !branch && !pushes.length;

const setups = (() => {
  const LONGEST = 100_000; // letters of a link
  const LARGEST = 2_000_000; // bytes in it

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

  // What is changed, as a link has it, and a file with more.
  const changes = (lab, setup) => ({ format: lab.experiment.format, ...setup });
  const link = async (lab, setup) => {
    const packed = new Blob([JSON.stringify(changes(lab, setup))]).stream().pipeThrough(new CompressionStream("deflate-raw"));
    const bytes = new Uint8Array(await new Response(packed).arrayBuffer());
    return btoa(String.fromCharCode(...bytes)).replaceAll("+", "-").replaceAll("/", "_").replaceAll("=", "");
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
    if (data?.format !== lab.experiment.format) throw new Error("it is not of this lab");
    const { values, branch, pushes } = data;
    const problem = checkSetup(lab, { values, branch, pushes });
    if (problem) throw new Error(problem);
    return { values, branch: branch && { at_ns: branch.at_ns, values: branch.values }, pushes };
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
    return {
      ...changes(lab, setup), scenario: lab.scenario, controller: name, page: lab.digest,
      parameters: Object.fromEntries(nodes.map((node) => [node, lab.nodes[node].parameters])),
      branch: setup.branch?.at_ns < count * lab.period_ns ? setup.branch : null,
      states: count, sha256: await digest(run, lab.experiment.columns),
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
  // What a branch sets; of a disturbance, which may begin with it, all that is not as it is declared.
  const given = (lab, setup) => {
    const { disturbance, ...values } = setup.branch?.values ?? {};
    if (!disturbance) return values;
    const usual = (name) => JSON.stringify(lab.declared.disturbance[name].default);
    const all = Object.entries(parametersOf(lab, setup, "disturbance"));
    return { ...values, disturbance: Object.fromEntries(all.filter(([name, value]) => Object.hasOwn(disturbance, name) || JSON.stringify(value) !== usual(name))) };
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
    const late = settings({ ...lab, nodes: before }, given(lab, setup), nodes);
    if (late.length) lines.push(line(["trunk", "branch", file, "--at", String(setup.branch.at_ns / 1e9), ...late, "-o", `${stemOf(lab, name, "branch")}.mcap`]));
    return lines;
  };
  return { link, open, parametersOf, commands, experiment, csv, stemOf };
})();
