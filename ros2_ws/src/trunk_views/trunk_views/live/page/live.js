"use strict";
// What only a running graph has: the connection, the run's own pause, and a branch as a command.
(() => {
  const at = (id) => document.getElementById(id);
  const LOST = "the gateway does not answer: the page keeps trying; the run goes on";
  let runs = null; // that have been started, as far as the gateway knows
  let stopping = false; // by request from this page
  let leaving = ""; // for the report at this path: to ask for it anew would break off the first request
  const stores = () => [known.plant, known.control, known.pushes];

  const link = (state) => {
    at("link").textContent = state === "open" ? "connected" : "no connection";
    at("link").dataset.state = state === "open" ? "open" : "closed";
    const ended = state === "ended" || known.run.ended;
    const why = known.gateway.ended ? `: ${known.gateway.ended}` : "";
    alarm.say(state === "open" ? "" : ended ? `the server of this page has ended${why}` : LOST, LOST);
  };
  const mode = () => {
    if (known.gateway.ended) return known.gateway.ended;
    if (stopping) return `${known.run.ended ? "making the report, which" : "ending the run; its report"} will open here`;
    if (known.run.ended) return "the run has ended";
    if (!known.run.started) return "waiting for the run to start";
    if (!known.run.acting.length && [...known.nodes.values()].some((node) => node.controller)) return "no controller acts";
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
  at("lockstep-speed").addEventListener("change", ({ target }) =>
    view.ask("set", { node: "simulator", values: { "lockstep.speed": Number(target.value) } }));
  wire.listen((kind, values) => {
    if (kind === "link") link(values);
    else if (kind === "hello") {
      health.anew();
      runs = null;
    } else if (kind === "run") at("pause").textContent = known.run.paused ? "Resume run" : "Pause run";
    else if (kind === "health") health.diagnosed(values);
    else if (kind === "events") {
      const begun = known.events.filter(({ event }) => event === "started").length;
      if (runs !== null && begun > runs) for (const store of stores()) store.clear();
      runs = begun;
      health.events();
    } else if (kind === "gateway") {
      health.served();
      at("stop").hidden = !known.gateway.stoppable;
      if (known.gateway.report !== leaving) location.assign((leaving = known.gateway.report));
      if (known.gateway.ended) at("mode").textContent = mode();
    }
    if (["node", "run", "world"].includes(kind)) at("mode").textContent = mode();
    if (["node", "declared", "run", "world"].includes(kind)) speeds();
  });

  at("pause").addEventListener("click", () => view.ask("pause", { on: !known.run.paused }));
  at("reset").addEventListener("click", () => view.ask("reset"));
  const stop = (on) => {
    stopping = on;
    for (const id of ["stop", "pause", "reset"]) at(id).disabled = on;
    at("mode").textContent = mode();
  };
  at("stop").addEventListener("click", async () => {
    stop(true);
    if (!(await view.ask("stop"))) stop(false);
  });
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
    const file = known.nodes.get("recorder")?.parameters.output ?? "RUN.mcap";
    const others = [...known.nodes.values()].filter((node) => node.controller && !actingAt(view.time).has(node.name));
    const controller = others[0]?.name ?? "pid";
    at("branch-command").textContent =
      `trunk branch ${quoted(file)} --at ${view.time.toFixed(3)} --controller ${controller} -o what_if.mcap`;
    at("branching").hidden = false;
    view.freeze(true);
  });
  at("branch-copy").addEventListener("click", () => copyText(at("branch-command")));
})();
