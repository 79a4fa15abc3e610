"use strict";
// Changes of parameters by this page: made, undone, compared with the defaults, saved as a parameter file.
const edits = (() => {
  const MOST = 200; // changes that can be undone
  const undoing = document.getElementById("undo");
  const saving = document.getElementById("save");
  const changes = []; // { node, before, gesture }, the latest last
  const first = new Map(); // "node parameter" -> its value before this page changed it

  const same = (a, b) => JSON.stringify(a) === JSON.stringify(b);
  const parameters = (node) => known.nodes.get(node)?.parameters ?? {};
  const isDefault = (node, name) => {
    const about = known.declared.get(node)?.[name];
    return !about || same(parameters(node)[name], about.default);
  };

  // Set values together; `gesture`: several changes with the same one, such as a drag, are undone as one.
  const set = async (node, wanted, gesture = null) => {
    const now = parameters(node);
    const values = Object.fromEntries(Object.entries(wanted).filter(([name, value]) => !same(now[name], value)));
    const names = Object.keys(values);
    if (!names.length) return { ok: true, text: "" };
    const before = Object.fromEntries(names.map((name) => [name, now[name]]));
    const answer = await wire.ask("set", { node, values });
    alarm.say("", "asked"); // where it was refused, who asked says so
    if (answer.ok) {
      for (const name of names) if (!first.has(`${node} ${name}`)) first.set(`${node} ${name}`, before[name]);
      if (!gesture || changes.at(-1)?.gesture !== gesture) changes.push({ node, before, gesture });
      if (changes.length > MOST) changes.shift();
    }
    show();
    return answer;
  };
  const undo = async () => {
    const last = changes.pop();
    if (!last) return;
    undoing.disabled = true;
    const { ok, text } = await wire.ask("set", { node: last.node, values: last.before });
    if (!ok) changes.push(last);
    alarm.say(ok ? "" : text, "asked");
    show();
  };

  // What a file holds: of controllers all that is not the default, but not the scenario's reference; of other nodes
  // what was changed here.
  const kept = () => [...known.nodes.values()].flatMap(({ name: node, controller, parameters: values }) => {
    const names = Object.keys(values).filter((name) => {
      const about = known.declared.get(node)?.[name];
      if (!about || about.fixed) return false;
      const key = `${node} ${name}`;
      if (first.has(key) && !same(first.get(key), values[name])) return true;
      return controller && !name.startsWith("reference.") && !isDefault(node, name);
    });
    return names.length ? [[node, names]] : [];
  }).sort(([a], [b]) => (a < b ? -1 : 1));
  const scalar = (value) => {
    if (typeof value === "string" && /^[+-]?inf$/.test(value)) return value.replace("inf", ".inf");
    return Array.isArray(value) ? `[${value.map(scalar).join(", ")}]` : JSON.stringify(value);
  };
  const yaml = () => [
    `# From the live page, at t = ${view.time.toFixed(3)} s. trunk simulate SCENARIO --params FILE, or trunk params apply NODE FILE`,
    ...kept().flatMap(([node, names]) => [
      `${JSON.stringify(node)}:`, "  ros__parameters:",
      ...names.map((name) => `    ${JSON.stringify(name)}: ${scalar(parameters(node)[name])}`),
    ]),
    "",
  ].join("\n");
  saving?.addEventListener("click", () => {
    const link = document.createElement("a");
    link.href = URL.createObjectURL(new Blob([yaml()], { type: "application/yaml" }));
    link.download = "trunk_live.yaml";
    link.click();
    URL.revokeObjectURL(link.href);
  });
  undoing.addEventListener("click", undo);

  const show = () => {
    const last = changes.at(-1);
    undoing.disabled = !last;
    undoing.title = last ? `${last.node}: ${Object.keys(last.before).join(", ")} as before` : "";
    if (!saving) return; // a lab has commands instead
    const count = kept().reduce((sum, [, names]) => sum + names.length, 0);
    saving.disabled = !count;
    saving.textContent = count ? `Save as YAML (${count})` : "Save as YAML";
  };
  // What was before is of another experiment.
  const forget = () => {
    changes.length = 0;
    show();
  };
  return { set, undo, forget, isDefault, yaml, show };
})();
