"use strict";
// Which time is shown, the buttons, and one picture after the other.
const view = { time: 0, window: 20, frozen: false, playing: true, speed: 1, frames: 0 };
(() => {
  const at = (id) => document.getElementById(id);
  const LOST = "the gateway does not answer: the page keeps trying; the run goes on";
  const CHARTS_MS = 40; // charts are drawn less often than the trunk
  let before = null;
  let charted = 0;
  let runs = null; // that have been started, as far as the gateway knows

  // ── words ────────────────────────────────────────────────────────────────────────────────────────────
  const link = (state) => {
    at("link").textContent = { open: "connected", closed: "no connection" }[state];
    at("link").dataset.state = state;
    const lost = known.run.ended || known.recorded ? "the server of this page has ended" : LOST;
    if (state === "closed") alarm.say(lost, LOST);
    else alarm.clear(LOST);
  };
  const controllers = () => {
    const place = at("controllers");
    const names = [...known.nodes.values()].filter((node) => node.controller).map((node) => node.name).sort();
    const have = [...place.querySelectorAll("input")].map((input) => input.value);
    if (names.join() !== have.join()) {
      place.querySelectorAll("label").forEach((label) => label.remove());
      for (const name of names) {
        const label = document.createElement("label");
        const input = document.createElement("input");
        input.type = "radio";
        input.name = "acts";
        input.value = name;
        input.addEventListener("change", async () => {
          const { ok, text } = await wire.ask("swap", { to: name });
          if (!ok) alarm.say(text);
          controllers();
        });
        label.append(input, name);
        place.append(label);
      }
    }
    for (const label of place.querySelectorAll("label")) {
      const input = label.querySelector("input");
      const acts = known.run.acting.includes(input.value);
      input.checked = acts && known.run.acting.length === 1;
      input.disabled = !known.control_allowed;
      label.toggleAttribute("data-acts", acts);
    }
    if (known.run.started && !known.run.ended && names.length && !known.run.acting.length) at("mode").textContent = "no controller acts";
    else at("mode").textContent = mode();
  };
  const mode = () => {
    if (known.recorded) return `recording ${known.recorded.file}${known.recorded.complete ? "" : `, incomplete: ${known.recorded.end}`}`;
    if (known.run.ended) return "the run has ended";
    if (!known.run.started) return "waiting for the run to start";
    const pace = known.world?.lockstep ? "lock-step" : "real time";
    return `${known.run.paused ? "paused, " : ""}${pace}, ${known.world?.rate ?? ""} Hz`;
  };
  const SPEEDS = [0.1, 0.2, 0.5, 1, 2, 5, 10];
  const speeds = () => {
    const select = at("lockstep-speed");
    at("speed-label").hidden = !known.world?.lockstep;
    if (!select.options.length) for (const speed of SPEEDS) select.add(new Option(`${speed}×`, speed));
    const now = known.nodes.get("simulator")?.parameters["lockstep.speed"];
    if (now !== undefined && document.activeElement !== select) select.value = String(now);
  };
  at("lockstep-speed").addEventListener("change", async ({ target }) => {
    const { ok, text } = await wire.ask("set", { node: "simulator", values: { "lockstep.speed": Number(target.value) } });
    if (!ok) alarm.say(text);
  });
  wire.listen((kind, values) => {
    if (kind === "link") link(values);
    else if (kind === "refused") alarm.say(values);
    else if (kind === "hello") {
      document.body.dataset.may = values.control ? "control" : "watch";
      document.body.dataset.feed ??= "graph";
      health.anew();
      runs = null;
    } else if (kind === "recorded") {
      document.body.dataset.feed = "recorded";
      for (const store of [known.plant, known.control, known.pushes]) store.forget = false;
      view.time = values.first;
      at("title").textContent = values.file;
      document.title = values.file;
      if (!values.complete) alarm.say(`incomplete: ${values.end}`);
      label();
      controllers();
      knobs.showGains();
    } else if (kind === "node" || kind === "declared") {
      if (kind === "node") controllers();
      knobs.show(values.name);
      rules.show();
      speeds();
      edits.show();
    } else if (kind === "run" || kind === "world") {
      at("pause").textContent = known.run.paused ? "Resume run" : "Pause run";
      controllers();
      rules.show();
      knobs.showGains();
      speeds();
    } else if (kind === "health") health.diagnosed(values);
    else if (kind === "events") {
      const begun = known.events.filter(({ event }) => event === "started").length;
      if (runs !== null && begun > runs) for (const store of [known.plant, known.control, known.pushes]) store.clear();
      runs = begun;
      health.events();
    }
    else if (kind === "gateway") {
      health.served();
      at("stop").hidden = !known.gateway.stoppable;
      if (known.gateway.report) location.assign(known.gateway.report);
    }
    if (kind === "hello") knobs.showAll();
  });

  // ── buttons ──────────────────────────────────────────────────────────────────────────────────────────
  const ask = async (kind, values) => {
    const { ok, text } = await wire.ask(kind, values);
    if (!ok) alarm.say(text);
  };
  at("pause").addEventListener("click", () => ask("pause", { on: !known.run.paused }));
  at("reset").addEventListener("click", () => ask("reset"));
  at("stop").addEventListener("click", () => {
    at("stop").disabled = true;
    at("mode").textContent = "ending the run; its report will open here";
    ask("stop");
  });
  at("window").addEventListener("change", ({ target }) => { view.window = Number(target.value); });
  at("play-speed").addEventListener("change", ({ target }) => { view.speed = Number(target.value); });
  const freeze = (on) => {
    if (known.recorded) view.playing = !on;
    else view.frozen = on;
    label();
  };
  const label = () => { at("play").textContent = known.recorded ? (stands() ? "Play" : "Pause") : stands() ? "Back to live" : "Freeze view"; };
  const stands = () => (known.recorded ? !view.playing : view.frozen);
  at("play").addEventListener("click", () => {
    if (known.recorded && stands() && view.time >= known.recorded.last) view.time = known.recorded.first;
    freeze(!stands());
  });
  at("seek").addEventListener("input", ({ target }) => {
    freeze(true);
    view.time = Number(target.value);
  });
  // A command, not a request: the page names no files.
  const quoted = (text) => (/^[\w./:=+-]+$/.test(text) ? text : `'${text.replaceAll("'", `'\\''`)}'`);
  const actingAt = (time) => {
    const acting = new Set();
    for (const { t, node, event } of known.events) {
      if (t > time) break;
      if (event === "activated") acting.add(node);
      if (event === "deactivated") acting.delete(node);
    }
    return acting;
  };
  at("branch").addEventListener("click", () => {
    const file = known.recorded?.path ?? known.nodes.get("recorder")?.parameters.output ?? "RUN.mcap";
    const others = [...known.nodes.values()].filter((node) => node.controller && !actingAt(view.time).has(node.name));
    const controller = others[0]?.name ?? "pid";
    at("branch-command").textContent =
      `trunk branch ${quoted(file)} --at ${view.time.toFixed(3)} --controller ${controller} -o what_if.mcap`;
    at("branching").hidden = false;
    freeze(true);
  });
  at("branch-copy").addEventListener("click", async () => {
    const range = document.createRange();
    range.selectNodeContents(at("branch-command"));
    getSelection().removeAllRanges();
    getSelection().addRange(range);
    await navigator.clipboard?.writeText(at("branch-command").textContent);
  });
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const choose = (tab) => tabs.forEach((one) => {
    one.setAttribute("aria-selected", one === tab);
    one.tabIndex = one === tab ? 0 : -1;
    at(one.getAttribute("aria-controls")).hidden = one !== tab;
  });
  tabs.forEach((tab) => {
    tab.addEventListener("click", () => choose(tab));
    tab.addEventListener("keydown", (event) => {
      const there = tabs.filter((one) => one.checkVisibility());
      const index = there.indexOf(tab);
      const to = { ArrowLeft: index - 1, ArrowRight: index + 1, Home: 0, End: -1 }[event.key];
      if (to === undefined) return;
      event.preventDefault();
      const next = there.at(to % there.length);
      choose(next);
      next.focus();
    });
  });
  document.addEventListener("keydown", (event) => {
    const typing = event.target.closest("input:not([type=range], [type=checkbox], [type=radio])");
    if (event.key === "z" && (event.ctrlKey || event.metaKey) && !event.shiftKey && !event.altKey && !typing) {
      event.preventDefault();
      edits.undo();
      return;
    }
    if (event.ctrlKey || event.altKey || event.metaKey || event.defaultPrevented) return;
    const { target, key } = event;
    if (target.closest("select, summary, a, [role=tabpanel]") || (target.closest("button, input") && (key === " " || target.id !== "seek"))) return;
    if (key === " ") {
      event.preventDefault();
      at("play").click();
      return;
    }
    if (!known.recorded) return; // the keys of the trunk are grip.js's
    const { t, count } = known.plant;
    const { first, last } = known.recorded;
    const to = timeOfKey(event, { time: view.time, finest: count > 1 ? (t[count - 1] - t[0]) / (count - 1) : 0.001, first, last });
    if (to === undefined) return;
    event.preventDefault();
    freeze(true);
    view.time = to;
  });

  // ── pictures ─────────────────────────────────────────────────────────────────────────────────────────
  const advance = (now) => {
    const step = before === null ? 0 : (now - before) / 1000;
    before = now;
    if (known.recorded) {
      if (!view.playing) return;
      view.time += view.speed * step;
      if (view.time > known.recorded.last) {
        view.time = at("loop").checked ? known.recorded.first : known.recorded.last;
        if (!at("loop").checked) freeze(true);
      }
    } else if (!view.frozen && known.plant.count) view.time = known.plant.last;
  };
  const paint = (now) => {
    advance(now);
    scene.draw(view.time);
    grip.turn();
    if (now - charted >= CHARTS_MS) {
      charted = now;
      strips.draw(view.time);
      rules.draw(view.time);
      const seek = at("seek");
      const { plant } = known;
      if (plant.count) {
        seek.min = known.recorded ? known.recorded.first : plant.t[0];
        seek.max = known.recorded ? known.recorded.last : plant.last;
        seek.value = view.time;
        seek.setAttribute("aria-valuetext", `${view.time.toFixed(2)} seconds`);
        at("time").textContent = `${view.time.toFixed(2)} s`;
        document.documentElement.dataset.ready = "true";
      }
    }
    view.frames += 1;
    requestAnimationFrame(paint);
  };
  wire.open();
  requestAnimationFrame(paint);
})();
