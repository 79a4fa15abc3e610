"use strict";
// What only a lab has: the experiment as a whole, its doubts and numbers, and ways to take it away.
(() => {
  const at = (id) => document.getElementById(id);
  const made = (tag, text = "", className = "") => {
    const element = document.createElement(tag);
    element.textContent = text;
    element.className = className;
    return element;
  };
  const seconds = (time) => `${showNumber(time, 6)} s`;

  // ── doubts and numbers ───────────────────────────────────────────────────────────────────────────────
  const limitOf = (name) => {
    const { u_clamp_max: high, u_clamp_min: low } = known.nodes.get(name).parameters;
    const { limit } = known.world;
    const bound = (value) => Math.min(Number.isFinite(limit) ? limit : Infinity, Number.isFinite(value) ? Math.abs(value) : Infinity);
    return [-bound(low), bound(high)];
  };
  // How long a run's torque is at a limit, in s.
  const limited = ({ name, plant }) => {
    const [low, high] = limitOf(name);
    const torque = plant.columns.get("torque");
    let count = 0;
    for (let k = 0; k < plant.count; k++) count += torque[k] >= high || torque[k] <= low;
    return (count * lab.period_ns) / 1e9;
  };
  const doubtsOf = (run, engine) => {
    const degrees = (k) => `${Math.round(run.plant.value("theta", k) * DEGREES)} degrees`.replace("-", "−");
    const last = run.plant.count - 1;
    const bad = [];
    if (engine.ended === "diverged") bad.push(`DIVERGED: at t = ${seconds(run.plant.last)} its numbers end; nothing after it is computed`);
    if (run.events.length) bad.push(`FELL: at t = ${seconds(run.events[0].t)}, ${degrees(rowAt(run.plant.t, run.events[0].t))}`);
    else if (Math.abs(run.plant.value("theta", last)) > Math.PI / 2) bad.push(`BEYOND 90 degrees: it ends at ${degrees(last)}`);
    return bad;
  };
  // As `trunk compare`: what makes the runs' tasks different, and of each number the smallest magnitude.
  const tasks = () => {
    const stages = [{ ...wire.setup, branch: null }, wire.setup];
    const names = Object.keys(lab.nodes[lab.controllers[0]].parameters).filter((name) => name.startsWith("reference."));
    const texts = (name) => lab.controllers.map((node) => JSON.stringify(stages.map((setup) => setups.parametersOf(lab, setup, node)[name])));
    return names.filter((name) => new Set(texts(name)).size > 1).map((name) => `controller.${name}`);
  };
  const bestOf = (values) => {
    const sizes = values.map((value) => Math.abs(value ?? Infinity));
    const least = Math.min(...sizes);
    return sizes.map((size) => sizes.length > 1 && size === least && size < Infinity);
  };
  const cell = (row, tag, text, className) => row.appendChild(made(tag, text, className));
  const results = () => {
    const { runs } = known;
    const doubts = runs.map((run, i) => doubtsOf(run, wire.engines[i]));
    const lines = runs.flatMap(({ name }, i) => doubts[i].map((text) => made("li", `${name} ${text}`, "bad")));
    for (const run of runs) {
      const time = limited(run);
      if (time > 0) lines.push(made("li", `${run.name} is at its ${inWords("torque")} limit for ${showNumber(time, 3)} s`));
    }
    const differing = tasks();
    if (differing.length) lines.push(made("li", `NOT RANKED: the runs have different tasks: ${differing.join(", ")}`));
    at("doubts").replaceChildren(...lines);
    at("doubts").hidden = !lines.length;
    for (const run of runs) {
      const label = at("controllers").querySelector(`input[value="${run.name}"]`).parentElement;
      (label.querySelector("b") ?? label.appendChild(made("b"))).textContent = run.events.length ? " fell" : "";
    }

    const heading = at("numbers-of");
    heading.replaceChildren(made("th", "quantity"));
    heading.firstChild.scope = "col";
    runs.forEach((run, i) => {
      const name = cell(heading, "th", "", "num");
      name.scope = "col";
      const swatch = made("span", "", "swatch");
      swatch.style.background = `var(--run${i % 8})`;
      name.append(swatch, run.name);
    });
    const rows = [];
    const add = (title, texts, bad, best) => {
      const row = document.createElement("tr");
      cell(row, "th", title).scope = "row";
      texts.forEach((text, i) => {
        const value = cell(row, "td", text, bad?.[i] ? "num bad" : best?.[i] ? "num best" : "num");
        if (best?.[i]) value.prepend(made("span", "★", "star"), made("span", "best: ", "hidden"));
      });
      rows.push(row);
    };
    const fell = runs.map((run) => Boolean(run.events.length));
    const diverged = wire.engines.map(({ ended }) => ended === "diverged");
    if (diverged.includes(true)) add("INCOMPLETE", runs.map((run, i) => (diverged[i] ? `diverged at ${seconds(run.plant.last)}` : "no")), diverged);
    add("FELL", runs.map((run) => (run.events.length ? `at ${seconds(run.events[0].t)}` : "no")), fell);
    const measured = wire.engines.map((engine) => engine.metrics());
    const failed = measured.map(({ failure }) => Boolean(failure));
    if (failed.includes(true)) add("no numbers", measured.map(({ failure }) => failure), failed);
    const sound = doubts.map(({ length }) => !length && !differing.length);
    for (const [key, [label, unit, judged]] of Object.entries(lab.quantities)) {
      const best = judged ? bestOf(measured.map(({ values }, i) => (sound[i] && values[key] !== Infinity ? values[key] : null))) : [];
      add(`${label}, ${unit}`, measured.map(({ values }, i) => {
        const value = values[key];
        if (value === undefined || diverged[i]) return "–"; // metrics of a partial run are not comparable
        if (value === null) return "not defined";
        return value === Infinity ? "never" : showNumber(value, 6);
      }), [], best);
    }
    at("numbers-rows").replaceChildren(...rows);
    const longest = wire.engines.reduce((most, engine) => (engine.count > most.count ? engine : most));
    const { pulses, words } = planned.disturbances(lab, longest);
    known.pulses = pulses;
    const references = runs.map(planned.reference);
    if (new Set(references).size === 1) words.push(`Reference: ${references[0]}`);
    else references.forEach((text, i) => words.push(`Reference of ${runs[i].name}: ${text}`));
    if (runs.some(({ events, plant }) => events.length && plant.last > events[0].t)) words.push(inWords("There is no ground: a fallen trunk goes on and may be brought up again"));
    at("acts").textContent = `${words.join(". ")}.`;
    document.documentElement.dataset.whole = "true";
  };

  // ── the experiment ───────────────────────────────────────────────────────────────────────────────────
  // Another experiment: what could be taken back belongs to the one before.
  const take = (setup) => {
    edits.forget();
    return wire.take(setup);
  };
  const chip = (text, title, action) => {
    const button = made("button", `${text} ✕`, "chip");
    button.type = "button";
    button.setAttribute("aria-label", title);
    button.addEventListener("click", action);
    return button;
  };
  const chips = () => {
    const { branch, pushes } = wire.setup;
    const there = [];
    if (branch) {
      const words = `branch at t = ${seconds(branch.at_ns / 1e9)}`;
      there.push(chip(words, `Remove the ${words}`, () => take({ ...wire.setup, branch: null })));
    }
    const hands = pushes.filter(([, force, torque], i) => (force || torque) && !(i && (pushes[i - 1][1] || pushes[i - 1][2]))).length;
    if (hands) {
      const words = `${hands} ${hands === 1 ? "push" : "pushes"} by hand`;
      there.push(chip(words, `Remove ${words}`, () => take({ ...wire.setup, pushes: [] })));
    }
    at("chips").replaceChildren(...there);
    at("chips").hidden = !there.length;
    at("reset-all").disabled = isDefaultSetup(wire.setup);
    at("copying").hidden = true; // what it has is of another experiment
  };
  const selected = () => lab.controllers[known.shown];
  wire.listen((kind) => {
    if (kind === "link") openLink();
    else if (kind === "setup") {
      delete document.documentElement.dataset.whole;
      at("save-experiment").disabled = at("save-csv").disabled = true;
      at("saved").textContent = "";
      chips();
    } else if (kind === "whole") {
      results();
      at("save-experiment").disabled = at("save-csv").disabled = false;
    } else if (kind === "run") {
      at("save-experiment").textContent = `Save experiment of ${selected()}`;
      at("save-csv").textContent = `Save states of ${selected()} as CSV`;
    }
  });
  const openLink = async () => {
    const fragment = location.hash.slice(1);
    let setup = freshSetup();
    alarm.say("", "link");
    try {
      if (fragment) setup = await setups.open(lab, fragment);
    } catch (error) {
      alarm.say(`the link: ${error.message}; this is the default experiment`, "link");
    }
    take(setup);
  };
  addEventListener("hashchange", openLink);

  // ── buttons ──────────────────────────────────────────────────────────────────────────────────────────
  at("branch").addEventListener("click", () => {
    view.freeze(true);
    const { setup } = wire;
    const index = Math.floor(view.time / (lab.period_ns / 1e9) + 1e-6);
    take({ ...setup, branch: { at_ns: index * lab.period_ns, values: setup.branch?.values ?? {} } });
  });
  at("reset-all").addEventListener("click", () => take(freshSetup()));
  // Save a text as a file and say what is in it, and what comes next.
  const save = (text, file, contents, next, command) => {
    const blob = new Blob([text], { type: "text/plain" });
    const link = document.createElement("a");
    link.href = URL.createObjectURL(blob);
    link.download = file;
    link.click();
    URL.revokeObjectURL(link.href);
    at("saved").replaceChildren(`Saved ${file}, ${showNumber(blob.size / 1e3, 3)} kB: ${contents}. ${next}`, made("code", command));
  };
  const computedRun = () => [selected(), wire.engines[known.shown]];
  at("save-experiment").addEventListener("click", async () => {
    const [name, run] = computedRun();
    const file = `${setups.stemOf(lab, name)}.json`;
    const experiment = await setups.experiment(lab, name, run);
    const kept = ["all parameters", ...[...at("chips").children].map(({ textContent }) => textContent.replace(" ✕", ""))];
    const bits = experiment.sha256 ? "and says whether all bits are these" : "without comparing the bits: a page without https takes no digest";
    save(JSON.stringify(experiment, null, 1), file, `the run of ${name}, with ${kept.join(", ")}`,
      `Where trunk is installed, this makes its recording ${bits}: `, `trunk simulate --like ${file}`);
  });
  at("save-csv").addEventListener("click", () => {
    const [name, run] = computedRun();
    const file = `${setups.stemOf(lab, name)}.csv`;
    save(setups.csv(lab, run), file, `all ${run.count} states of the run of ${name}, in SI units and radians`, "A spreadsheet opens it.", "");
  });
  at("glossary").querySelector("dl").append(...Object.values(lab.quantities).flatMap(([label, unit, , meaning]) => [made("dt", `${label}, ${unit}`), made("dd", meaning)]));
  // Show a text that is copied, so that it can be read, and copied by hand.
  const offer = async (title, text) => {
    at("copying-title").textContent = title;
    at("copied").textContent = text;
    at("copying").hidden = false;
    opener = document.activeElement;
    at("copied").focus();
    await copyText(at("copied"));
  };
  at("copy-commands").addEventListener("click", () =>
    offer("The same bits from a shell:", lab.controllers.flatMap((name) => setups.commands(lab, name, wire.setup)).join("\n")));
  at("copy-link").addEventListener("click", async () => {
    const address = location.href.replace(/#.*/, "");
    const link = isDefaultSetup(wire.setup) ? address : `${address}#${await setups.link(lab, wire.setup)}`;
    history.replaceState(null, "", link);
    await offer("The whole experiment as a link to this page:", link);
  });
  at("copy-again").addEventListener("click", () => copyText(at("copied")));
  let opener = null;
  const close = () => {
    at("copying").hidden = true;
    opener?.focus();
  };
  at("copy-close").addEventListener("click", close);
  at("copying").addEventListener("keydown", ({ key }) => { if (key === "Escape") close(); });
  at("mode").textContent = `${lab.end_s} s, ${showNumber(1e9 / lab.period_ns)} Hz`;
})();
