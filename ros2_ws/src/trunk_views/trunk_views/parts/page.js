"use strict";
// Which time is shown, the buttons of the view, and one picture after the other.
const view = (() => {
  const at = (id) => document.getElementById(id);
  const CHARTS_MS = 40; // charts are drawn less often than the trunk
  const LONGEST_S = 0.1; // between two pictures: a page in the background does not jump
  const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
  let before = null;
  let charted = 0;
  const view = { time: 0, window: 20, from: null, digits: 2, frozen: false, playing: !still, speed: 1, frames: 0 };

  // ── words ────────────────────────────────────────────────────────────────────────────────────────────
  const controllers = () => {
    const place = at("controllers");
    if (!place) return; // a report shows all its runs
    const several = Boolean(known.runs[0].name);
    const names = several ? known.runs.map((run) => run.name) : [...known.nodes.values()].filter((node) => node.controller).map((node) => node.name).sort();
    const made = new Map([...place.querySelectorAll("label")].map((label) => [label.firstChild.value, label]));
    made.forEach((label, name) => names.includes(name) || label.remove());
    for (const [index, name] of names.entries()) {
      if (made.has(name)) continue;
      const label = document.createElement("label");
      const input = document.createElement("input");
      input.type = "radio";
      input.name = "acts";
      input.value = name;
      input.addEventListener("change", async () => {
        await view.ask("swap", { to: name });
        controllers();
      });
      const swatch = document.createElement("span");
      swatch.className = "swatch";
      label.append(input, ...(several ? [swatch] : []), name);
      place.insertBefore(label, made.get(names.slice(index).find((later) => made.has(later))) ?? null);
    }
    for (const [index, label] of place.querySelectorAll("label").entries()) {
      const input = label.firstChild;
      const acts = known.run.acting.includes(input.value);
      input.checked = acts && known.run.acting.length === 1;
      input.disabled = !known.control_allowed;
      label.toggleAttribute("data-acts", acts);
      label.querySelector(".swatch")?.style.setProperty("background", `var(--run${index % 8})`);
    }
  };
  wire.listen((kind, values) => {
    if (kind !== "rows") known.version += 1;
    if (kind === "refused") alarm.say(values);
    else if (kind === "hello") {
      document.body.dataset.may = values.control ? "control" : "watch";
      knobs.showAll();
    } else if (kind === "recorded") {
      view.time = values.first;
      label();
      controllers();
      knobs.showGains();
    } else if (kind === "node" || kind === "declared") {
      if (kind === "node") controllers();
      knobs.show(values.name);
      rules.show();
      edits.show();
    } else if (kind === "run" || kind === "world") {
      if (kind === "world" && values?.words && !known.spoken) speakOf((known.spoken = values.words));
      controllers();
      rules.show();
      knobs.showGains();
    }
  });

  // ── buttons ──────────────────────────────────────────────────────────────────────────────────────────
  // A page that moves between press and release, as for an alarm, takes a button from under a hand that rests on it.
  let pressed = null;
  addEventListener("pointerdown", ({ button, target, clientX, clientY }) => {
    const control = target.closest("label") ?? target.closest("button, input, summary");
    pressed = button ? null : { control, clientX, clientY };
  }, true);
  addEventListener("pointerup", ({ target, clientX, clientY }) => {
    const moved = pressed && Math.hypot(clientX - pressed.clientX, clientY - pressed.clientY);
    if (moved < 4 && pressed?.control?.isConnected && !pressed.control.contains(target)) pressed.control.click();
    pressed = null;
  }, true);
  view.ask = async (kind, values) => {
    const { ok, text } = await wire.ask(kind, values);
    alarm.say(ok ? "" : text, "asked"); // until the next request of this page
    return ok;
  };
  view.stands = () => (known.recorded ? !view.playing : view.frozen);
  view.freeze = (on) => {
    if (!on && known.recorded && view.stands() && view.time >= known.recorded.last) view.time = known.recorded.first;
    if (known.recorded) view.playing = !on;
    else view.frozen = on;
    label();
  };
  view.seek = (time) => {
    view.freeze(true);
    view.time = time;
  };
  // What the charts show, in s: from, to, and until when there are curves. A whole run is there before it is played:
  // its window stands where it was put until the time leaves it, or keeps the time in its middle.
  view.range = (time) => {
    if (!known.recorded) {
      const from = Math.max(time - view.window, 0);
      return { from, to: from + view.window, until: time };
    }
    const { first, last } = known.recorded;
    const within = view.from !== null && view.from <= time && time <= view.from + view.window;
    if (!within && view.from !== null) view.from = time - view.window / 2;
    const from = Math.max(first, Math.min(view.from ?? time - view.window / 2, last - view.window));
    const to = Math.min(from + view.window, last);
    return { from, to, until: to };
  };
  // Zoom the charts of a whole run to a span, or show `times` as much about a time.
  view.zoom = (from, to) => {
    if (!(from <= to)) return; // a chart that is not drawn yet has no times
    const { first, last } = known.recorded;
    view.window = Math.min(Math.max(to - from, 1e-6), last - first);
    view.from = view.window < last - first ? Math.max(first, Math.min(from, last - view.window)) : null;
    if (view.from !== null && (view.time < view.from || view.time > view.from + view.window)) view.time = view.from;
    const shown = at("window");
    shown.value = String(view.window === last - first ? Infinity : view.window);
    if (shown.selectedIndex < 0) shown.value = "";
  };
  view.zoomAbout = (time, times) => {
    const { first, last } = known.recorded;
    const { from, to } = view.range(view.time);
    const span = (to - from) * times;
    const begin = time - ((time - from) / (to - from)) * span;
    if (span < last - first) view.zoom(begin, begin + span);
    else view.zoom(first, last);
  };
  const label = () => { at("play").textContent = known.recorded ? (view.stands() ? "Play" : "Pause") : view.stands() ? "Back to live" : "Freeze view"; };
  at("window").addEventListener("change", ({ target }) => { [view.window, view.from] = [Number(target.value), null]; });
  at("play-speed")?.addEventListener("change", ({ target }) => { view.speed = Number(target.value); });
  at("play").addEventListener("click", () => view.freeze(!view.stands()));
  at("seek").addEventListener("input", ({ target }) => view.seek(Number(target.value)));
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
    const times = { "+": 0.5, "=": 0.5, "-": 2, 0: Infinity }[key];
    if (times) view.zoomAbout(view.time, times);
    const to = timeOfKey(event, { time: view.time, finest: count > 1 ? (t[count - 1] - t[0]) / (count - 1) : 0.001, first, last });
    if (to === undefined) return;
    event.preventDefault();
    view.seek(to);
  });

  // ── pictures ─────────────────────────────────────────────────────────────────────────────────────────
  const advance = (now) => {
    const step = before === null ? 0 : Math.min((now - before) / 1000, LONGEST_S);
    before = now;
    if (known.recorded) {
      if (!view.playing) return;
      view.time = wire.reach?.(view.time + view.speed * step) ?? view.time + view.speed * step;
      if (view.time >= known.recorded.last) {
        view.time = at("loop").checked ? known.recorded.first : known.recorded.last;
        if (!at("loop").checked) view.freeze(true);
      }
    } else if (!view.frozen && known.plant.count) view.time = known.plant.last;
  };
  const paint = (now) => {
    advance(now);
    scene.draw(view.time);
    grip.turn();
    if (now - charted >= CHARTS_MS) {
      charted = now;
      wire.at?.(view.time);
      rules.draw(view.time);
      strips.draw(view.time);
      const seek = at("seek");
      const { plant } = known;
      if (plant.count) {
        seek.min = known.recorded ? known.recorded.first : plant.t[0];
        seek.max = known.recorded ? known.recorded.last : plant.last;
        seek.value = view.time;
        seek.setAttribute("aria-valuetext", `${view.time.toFixed(view.digits)} seconds`);
        at("time").textContent = `${view.time.toFixed(view.digits)} s`;
        document.documentElement.dataset.ready = "true";
      }
    }
    view.frames += 1;
    requestAnimationFrame(paint);
  };
  requestAnimationFrame(paint);

  // ── paper ────────────────────────────────────────────────────────────────────────────────────────────
  const lay = (on) => {
    document.documentElement.toggleAttribute("data-paper", on); // the style sheet's width and colours of paper
    forgetColors();
    if (on) wire.finish?.();
    strips.drawAll(view.time, true);
    for (const one of [scene, rules]) one.draw(view.time);
  };
  addEventListener("beforeprint", () => lay(true));
  addEventListener("afterprint", () => lay(false));
  matchMedia("print").addEventListener("change", ({ matches }) => lay(matches));
  return view;
})();
wire.open();
