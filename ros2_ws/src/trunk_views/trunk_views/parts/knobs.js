"use strict";
// Every parameter of every node, from its declaration: what it means, in which unit, what is allowed. The gains of the
// controller that acts stand first; the groups below keep their order.
const knobs = (() => {
  const place = document.getElementById("knobs");
  const gains = document.getElementById("gains");
  const made = new Map(); // "node parameter", and "gain node parameter" -> knob
  const groups = new Map();
  const find = document.createElement("input");
  find.type = "text";
  find.className = "find";
  find.placeholder = "find a parameter";
  find.setAttribute("aria-label", "Find a parameter");
  const nothing = document.createElement("p");
  nothing.className = "sub";
  nothing.textContent = "No parameter has such a name.";
  nothing.hidden = true;
  const filter = () => {
    const wanted = find.value.trim().toLowerCase();
    for (const group of groups.values()) group.hidden = true;
    for (const { box, name, node, gain } of made.values()) {
      if (gain) continue;
      box.hidden = !`${node} ${name}`.toLowerCase().includes(wanted);
      if (!box.hidden) groups.get(node).hidden = false;
    }
    nothing.hidden = [...groups.values()].some((group) => !group.hidden);
  };
  find.addEventListener("input", () => {
    filter();
    for (const group of groups.values()) if (find.value && !group.hidden) group.open = true;
  });
  place.before(find);
  place.append(nothing);

  const finite = (value) => (typeof value === "number" && Number.isFinite(value) ? value : null);
  const NICE = [1, 1.2, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10];
  const rounded = (value) => Number(value.toPrecision(6));
  const ceiling = (value) => {
    const power = 10 ** Math.floor(Math.log10(value));
    return rounded(NICE.find((factor) => factor * power >= value * (1 - 1e-12)) * power);
  };
  // A slider's ends: twice the default or the value, whichever is larger, within the bounds.
  const reach = (about, value) => {
    const top = ceiling(2 * Math.max(Math.abs(value), Math.abs(finite(about.default) ?? 0)) || 1);
    return [Math.max(-top, finite(about.low) ?? -Infinity), Math.min(top, finite(about.high) ?? Infinity)];
  };
  const text = (value, digits = (number) => number) => {
    if (Array.isArray(value)) return value.map((item) => text(item, digits)).join("; ");
    return String(typeof value === "number" ? digits(value) : value);
  };
  const parsed = (about, words) => {
    const items = words.split(";").map((item) => item.trim()).filter((item) => item !== "");
    if (about.kind === "string") return words;
    if (about.kind === "string array") return items;
    if (about.kind.endsWith("array")) return items.map(Number);
    if (about.unbounded && /^[+-]?inf$/.test(words.trim())) return words.trim();
    return Number(words);
  };
  const element = (tag, className, content = "") => {
    const made = document.createElement(tag);
    made.className = className;
    made.textContent = content;
    return made;
  };

  const make = (node, name, about, parent, gain) => {
    const box = element("div", "knob");
    const id = `${gain ? "gain" : "knob"}-${node}-${name}`.replace(/[^\w-]/g, "-");
    const label = document.createElement("label");
    label.htmlFor = id;
    const code = document.createElement("code");
    // A long name breaks only after a dot or an underscore.
    code.append(...name.split(/(?<=[._])/).flatMap((part) => [part, document.createElement("wbr")]));
    label.append(code);
    const unit = element("span", "sub unit", dotted(about.unit));
    const whole = `${about.description}; ${about.allowed}${about.fixed && !about.refused ? "; fixed at start" : ""}`;
    const words = element("p", "about");
    words.id = `${id}-about`;
    words.title = gain ? whole : "";
    const refused = element("p", "refused");
    refused.setAttribute("role", "status");
    const reset = element("button", "reset", "↺");
    reset.type = "button";
    reset.title = `Reset to the default, ${text(about.default, rounded)}`;
    reset.setAttribute("aria-label", `Reset ${node} ${name} to its default, ${text(about.default, rounded)}`);
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
      if (number && !about.fixed && !about.refused) {
        slider = document.createElement("input");
        slider.type = "range";
        slider.setAttribute("aria-label", gain ? `Gain ${name}` : `${node} ${name}`);
      }
    }
    input.id = id;
    input.setAttribute("aria-describedby", words.id);
    box.append(label, ...(slider ? [slider] : []), input, unit, reset, words, refused);
    parent.append(box);

    let value;
    let asking = false;
    let next;
    let gesture = null;
    const ask = async (wanted) => {
      next = wanted;
      if (asking) return;
      asking = true;
      while (next !== undefined) {
        const values = { [name]: next };
        next = undefined;
        const { ok, text: why } = await edits.set(node, values, gesture);
        if (ok) refused.textContent = "";
        else update(value, why);
        await new Promise((done) => setTimeout(done, wire.EVERY_MS));
      }
      asking = false;
    };
    const typed = input.type === "text" || input.type === "number";
    slider?.addEventListener("input", () => {
      gesture ??= {};
      input.value = slider.value;
      ask(Number(slider.value));
    });
    slider?.addEventListener("change", () => setTimeout(() => { gesture = null; }, 2 * wire.EVERY_MS));
    reset.addEventListener("click", () => ask(about.default));
    input.addEventListener("change", () => {
      if (typed && input.value === text(value)) return;
      if (number && input.value.trim() === "") {
        update(value, "a number is needed");
        return;
      }
      ask(about.kind === "bool" ? input.checked : parsed(about, input.value));
    });
    // All digits while they are edited.
    if (typed) input.addEventListener("focus", () => { if (!refused.textContent) input.value = text(value); });
    if (typed) input.addEventListener("blur", () => { if (!refused.textContent) input.value = text(value, rounded); });
    // The ends stay while a hand is on the slider, and afterwards; only a value beyond them moves them.
    const range = () => {
      if (finite(value) === null || slider.matches(":active")) return;
      const [low, high] = slider.max === "" ? [Infinity, -Infinity] : [Number(slider.min), Number(slider.max)];
      if (value < low || value > high) {
        const [from, to] = reach(about, value);
        const ends = [Math.min(low, from), Math.max(high, to)];
        const step = 10 ** Math.floor(Math.log10((ends[1] - ends[0]) / 300 || 1));
        slider.step = about.kind === "integer" ? Math.max(1, step) : step;
        [slider.min, slider.max] = ends;
      }
      slider.value = value;
    };
    const update = (now, why = "") => { // what has been refused before is over
      [value, refused.textContent] = [now, why];
      const changed = text(now) !== text(about.default);
      box.toggleAttribute("data-set", changed);
      reset.hidden = !changed || input.disabled;
      if (slider && !changed) slider.max = ""; // the ends of the default
      if (slider) range();
      if (input === document.activeElement && input.type !== "checkbox" && !refused.textContent) return;
      if (input.type === "checkbox") input.checked = now;
      else input.value = typed ? text(now, rounded) : text(now);
    };
    const allow = () => {
      const why = about.refused ? `fixed in this lab: ${about.refused}` : about.start && known.branch ? "only of a whole run, not of a branch" : "";
      words.textContent = [gain ? about.description : whole, ...(why ? [why] : [])].join("; ");
      box.toggleAttribute("data-refused", Boolean(why));
      const no = about.fixed || Boolean(why) || !known.control_allowed;
      input.disabled = no;
      if (slider) slider.disabled = no;
    };
    return { box, node, name, gain, update, allow };
  };

  const knob = (node, name, about, parent, gain) => {
    const key = `${gain ? "gain " : ""}${node} ${name}`;
    if (!made.has(key)) made.set(key, make(node, name, about, parent, gain));
    const one = made.get(key);
    one.allow();
    one.update(known.nodes.get(node).parameters[name]);
    return one;
  };
  // In the order of their names, whoever comes first.
  const groupOf = (node) => {
    if (!groups.has(node)) {
      const group = document.createElement("details");
      group.dataset.node = node;
      group.append(element("summary", "", node));
      groups.set(node, group);
      place.append(...[...groups.keys()].sort().map((name) => groups.get(name)));
    }
    return groups.get(node);
  };
  const show = (node) => {
    const { parameters } = known.nodes.get(node) ?? {};
    const declared = known.declared.get(node);
    if (!parameters || !declared) return;
    const names = Object.keys(parameters).filter((name) => declared[name]);
    const group = groupOf(node);
    for (const name of names) knob(node, name, declared[name], group, false);
    const count = names.filter((name) => !edits.isDefault(node, name)).length;
    group.firstChild.textContent = count ? `${node}, ${count} not at ${count === 1 ? "its default" : "their defaults"}` : node;
    filter();
    showGains();
  };
  let shownOf; // the controller whose gains are shown
  const firstController = () => [...known.nodes.values()].filter((node) => node.controller).map((node) => node.name).sort()[0];
  // Of the controller that acts, or acted last: its gains, or where it calls none so, all numbers of its law.
  const showGains = () => {
    const node = known.run.acting[0] ?? shownOf ?? (known.recorded && firstController());
    const parameters = known.nodes.get(node)?.parameters;
    const declared = known.declared.get(node);
    if (!parameters || !declared) return;
    const own = Object.keys(parameters).filter((name) => declared[name]?.law);
    const called = own.filter((name) => name.startsWith("gains."));
    const names = called.length ? called : own.filter((name) => ["double", "integer"].includes(declared[name].kind));
    const shown = new Set(names.map((name) => knob(node, name, declared[name], gains, true)));
    for (const one of made.values()) if (one.gain) one.box.hidden = !shown.has(one);
    if (known.run.acting.length) shownOf = node;
    document.getElementById("gains-of").textContent = `Gains of ${node}`;
    gains.hidden = !names.length;
  };
  return { show, showGains, showAll: () => [...known.nodes.keys()].forEach(show) };
})();
