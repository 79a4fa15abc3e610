"use strict";
// A hand on the trunk: pull it, knock it, push it with keys; drag the reference. What is asked for is limited by
// the simulator; what has come of it is on the record.
const grip = (() => {
  const { canvas } = scene;
  const REACH = 32; // CSS pixels
  const TAP_MS = 220;
  const KNOCK_MS = 120;
  const SOFT = 0.3; // of the most, with a key
  let held = null; // "trunk", "hip" or "reference"
  let pane = 0; // whose trunk
  let pointer = [0, 0];
  let down = null; // where and when
  let keys = 0;
  let hard = false;
  let knock = null; // { torque, until }
  let last = { force: 0, torque: 0 };

  const most = () => known.world?.operator ?? { force: 0, torque: 0 };
  const may = () => known.control_allowed && !view.stands();
  const places = () => scene.places(pane);
  const clip = (value, bound) => Math.max(-bound, Math.min(bound, value));
  const away = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  const angleOf = (at, pivot) => Math.atan2(at[0] - pivot[0], pivot[1] - at[1]) * DEGREES;
  // How far the pointer is from the bar, in degrees of the coordinate.
  const leanOf = ({ pivot, tip, sense }) => sense * turn(angleOf(pointer, pivot) - angleOf(tip, pivot));
  const turn = (degrees) => ((((degrees + 180) % 360) + 360) % 360) - 180;

  // A spring from the trunk to the pointer: the whole torque at 30 degrees, damped a little.
  const wanted = () => {
    const at = places();
    const bound = most();
    if (knock && performance.now() < knock.until) return { force: 0, torque: knock.torque };
    knock = null;
    if (held === "trunk") {
      return { force: 0, torque: clip((bound.torque / 30) * leanOf(at) - 0.05 * bound.torque * at.rate, bound.torque) };
    }
    if (held === "hip") return { force: clip((bound.force * (pointer[0] - at.hip[0])) / (0.5 * at.scale), bound.force), torque: 0 };
    return { force: 0, torque: keys * (hard ? 1 : SOFT) * bound.torque };
  };

  canvas.addEventListener("pointerdown", (event) => {
    if (!places() || !known.control_allowed || view.frozen) return;
    view.freeze(false); // a push is a push of a run that goes on
    pointer = place(event);
    down = { at: pointer, since: performance.now() };
    const bound = most();
    const handles = scene.panes.flatMap(({ places: at }, index) => {
      if (!at) return [];
      const along = [(at.pivot[0] + at.tip[0]) / 2, (at.pivot[1] + at.tip[1]) / 2];
      const ring = scene.ring(index);
      return [
        ...(ring ? [["reference", ring]] : []), ...(bound.torque ? [["trunk", at.tip], ["trunk", along]] : []), ...(bound.force ? [["hip", at.hip]] : []),
      ].map(([what, where]) => [what, away(pointer, where), index]);
    });
    handles.sort((a, b) => a[1] - b[1]);
    pane = handles[0]?.[2] ?? 0;
    held = handles[0]?.[1] <= REACH ? handles[0][0] : null;
    canvas.setPointerCapture(event.pointerId);
    canvas.classList.toggle("held", held !== null);
    canvas.focus();
    event.preventDefault();
  });
  canvas.addEventListener("pointermove", (event) => { if (down) pointer = place(event); });
  const release = (event) => {
    const at = places();
    if (down && at && event.type === "pointerup" && held !== "reference") {
      const short = performance.now() - down.since < TAP_MS && away(pointer, down.at) <= 6;
      if (short && may()) {
        // A tap on its right sends it to the left.
        knock = { torque: (leanOf(at) > 0 ? -1 : 1) * most().torque, until: performance.now() + KNOCK_MS };
      }
    }
    held = down = null;
    canvas.classList.remove("held");
  };
  canvas.addEventListener("pointerup", release);
  canvas.addEventListener("pointercancel", release);
  const STEP = 2 / DEGREES; // of the reference, by a key
  const key = (event, sign) => {
    if (sign && may() && !known.recorded && (event.key === "ArrowUp" || event.key === "ArrowDown")) {
      event.preventDefault();
      const now = known.control.value("reference", known.control.count - 1) || 0;
      wire.send("reference", { angle: now + (event.key === "ArrowUp" ? STEP : -STEP) });
    }
    if (!known.control_allowed || (event.key !== "ArrowLeft" && event.key !== "ArrowRight")) return;
    event.preventDefault();
    if (sign && known.recorded) view.freeze(false);
    hard = event.shiftKey;
    const side = event.key === "ArrowRight" ? 1 : -1;
    keys = sign * side;
    // Also a key that is up again before the next picture knocks.
    if (sign && !event.repeat) knock = { torque: side * (hard ? 1 : SOFT) * most().torque, until: performance.now() + KNOCK_MS };
  };
  canvas.addEventListener("keydown", (event) => key(event, 1));
  canvas.addEventListener("keyup", (event) => key(event, 0));
  canvas.addEventListener("blur", () => { keys = 0; });

  const EVERY_MS = 12; // a screen may be faster
  let asked = 0;
  return {
    // Ask for what the hand does, once for each picture; nothing is asked for by a hand at rest.
    turn: () => {
      if (performance.now() - asked < EVERY_MS) return;
      asked = performance.now();
      const at = places();
      if (!at || !may()) {
        if (last.force || last.torque) wire.send("push", { force: 0, torque: 0 });
        held = down = knock = null;
        keys = 0;
        last = { force: 0, torque: 0 };
        return;
      }
      if (held === "reference") wire.send("reference", { angle: turn(at.theta + leanOf(at)) / DEGREES });
      const now = wanted();
      // Letting go is said until it has been heard.
      if (now.force || now.torque || last.force || last.torque || known.gateway.operator === known.client) wire.send("push", now);
      last = now;
    },
    words: () => {
      const other = known.gateway.operator && known.gateway.operator !== known.client;
      if (other) return "from somebody else";
      if (last.torque) return `${showNumber(last.torque, 3)} N·m`;
      if (last.force) return `${showNumber(last.force, 3)} N`;
      return "none";
    },
    line: () => {
      const at = places();
      if (held === "trunk") return [at.tip, pointer];
      if (held === "hip") return [at.hip, pointer];
      return null;
    },
    get held() { return held; },
  };
})();
