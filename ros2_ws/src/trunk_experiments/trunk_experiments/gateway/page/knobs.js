"use strict";
// Every parameter of every node, from its declaration: what it means, in which unit, what is allowed.
const knobs = (() => {
  const place = document.getElementById("knobs");
  const EVERY_MS = 120; // a slider that is dragged asks no more often
  const made = new Map(); // "node parameter" -> { update }
  const groups = new Map();
  const find = document.createElement("input");
  find.type = "text";
  find.className = "find";
  find.placeholder = "find a parameter";
  find.setAttribute("aria-label", "Find a parameter");
  find.addEventListener("input", () => {
    const wanted = find.value.toLowerCase();
    for (const { box, name, node } of made.values()) box.hidden = !`${node} ${name}`.toLowerCase().includes(wanted);
    for (const group of groups.values()) if (wanted) group.open = true;
  });
  place.append(find);

  const finite = (value) => (typeof value === "number" && Number.isFinite(value) ? value : null);
  // A slider reaches as far from the value as the value is from zero, within the bounds.
  const reach = (about, value) => {
    const span = Math.max(Math.abs(value), Math.abs(finite(about.default) ?? 0)) || 1;
    return [Math.max(value - span, finite(about.low) ?? -Infinity), Math.min(value + span, finite(about.high) ?? Infinity)];
  };
  const text = (value) => (Array.isArray(value) ? value.join("; ") : String(value));
  const parsed = (about, words) => {
    const items = words.split(";").map((item) => item.trim()).filter((item) => item !== "");
    if (about.kind === "string") return words;
    if (about.kind === "string array") return items;
    if (about.kind.endsWith("array")) return items.map(Number);
    if (about.unbounded && /^[+-]?inf$/.test(words.trim())) return words.trim();
    return Number(words);
  };

  const make = (node, name, about) => {
    const box = document.createElement("div");
    box.className = "knob";
    const id = `knob-${node}-${name}`.replace(/[^\w-]/g, "-");
    const label = document.createElement("label");
    label.htmlFor = id;
    const code = document.createElement("code");
    code.textContent = name;
    label.append(code);
    const unit = document.createElement("span");
    unit.className = "sub";
    unit.textContent = about.unit;
    const words = document.createElement("p");
    words.className = "about";
    words.textContent = `${about.description}; ${about.allowed}${about.fixed ? "; fixed at start" : ""}`;
    const refused = document.createElement("p");
    refused.className = "refused";
    refused.setAttribute("role", "status");
    const number = (about.kind === "double" || about.kind === "integer") && !about.unbounded;
    let input;
    let slider = null;
    if (about.kind === "bool") {
      input = document.createElement("input");
      input.type = "checkbox";
    } else if (about.choices.length && about.kind === "string") {
      input = document.createElement("select");
      for (const choice of about.choices) input.add(new Option(choice, choice));
    } else {
      input = document.createElement("input");
      input.type = number ? "number" : "text";
      if (number) input.step = about.kind === "integer" ? "1" : "any";
      if (number && !about.fixed) {
        slider = document.createElement("input");
        slider.type = "range";
        slider.step = about.kind === "integer" ? "1" : "any";
        slider.setAttribute("aria-label", `${node} ${name}`);
      }
    }
    input.id = id;
    box.append(label, ...(slider ? [slider] : []), input, unit, words, refused);
    groups.get(node).append(box);

    let value;
    let asking = false;
    let next;
    const ask = async (wanted) => {
      next = wanted;
      if (asking) return;
      asking = true;
      while (next !== undefined) {
        const values = { [name]: next };
        next = undefined;
        const { ok, text: why } = await wire.ask("set", { node, values });
        refused.textContent = ok ? "" : why;
        if (!ok) {
          alarm.say(why);
          update(value);
        }
        await new Promise((done) => setTimeout(done, EVERY_MS));
      }
      asking = false;
    };
    slider?.addEventListener("input", () => {
      input.value = slider.value;
      ask(Number(slider.value));
    });
    slider?.addEventListener("change", () => setTimeout(() => range(), 2 * EVERY_MS));
    input.addEventListener("change", () => ask(about.kind === "bool" ? input.checked : parsed(about, input.value)));
    const range = () => {
      if (!slider || finite(value) === null || slider.matches(":active")) return;
      const [low, high] = reach(about, value);
      slider.min = low;
      slider.max = high;
      slider.value = value;
    };
    const update = (now) => {
      value = now;
      box.toggleAttribute("data-set", text(now) !== text(about.default));
      if (input === document.activeElement && input.type !== "checkbox" && !refused.textContent) return;
      if (input.type === "checkbox") input.checked = now;
      else input.value = text(now);
      if (slider && !slider.matches(":active")) range();
    };
    const allow = () => {
      const no = about.fixed || !known.control_allowed || Boolean(known.recorded);
      input.disabled = no;
      if (slider) slider.disabled = no;
    };
    return { box, node, name, update, allow };
  };

  const show = (node) => {
    const { parameters } = known.nodes.get(node) ?? {};
    const declared = known.declared.get(node);
    if (!parameters || !declared) return;
    if (!groups.has(node)) {
      const group = document.createElement("details");
      const summary = document.createElement("summary");
      summary.textContent = node;
      group.append(summary);
      place.append(group);
      groups.set(node, group);
    }
    for (const [name, value] of Object.entries(parameters)) {
      if (!declared[name]) continue;
      const key = `${node} ${name}`;
      if (!made.has(key)) made.set(key, make(node, name, declared[name]));
      made.get(key).update(value);
      made.get(key).allow();
    }
  };
  return { show, showAll: () => [...known.nodes.keys()].forEach(show) };
})();
