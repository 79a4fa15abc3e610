"use strict";
// What each node says of itself once a second, and the events.
const health = (() => {
  const table = document.getElementById("health");
  const list = document.getElementById("events");
  const gateway = document.getElementById("gateway");
  const count = document.getElementById("event-count");
  const earlier = document.getElementById("earlier");
  const latest = document.getElementById("latest");
  const BAD = new Set(["failed", "stopped"]); // a fall is a moment: it is marked in the charts
  const LATEST_MS = 6000;
  const HIDDEN = new Set(["lifecycle"]);
  const counted = new Map(); // of each node, what it says when something is wrong
  let told = -1; // the last event of which is known whether it is bad; -1: the page has just come
  let fading; // the timer of the words about the latest fall
  const cell = (row, text, bad = false) => {
    const made = row.insertCell();
    made.textContent = text;
    made.classList.toggle("bad", bad);
  };
  const show = () => {
    table.replaceChildren();
    for (const [name, { level, message, values }] of known.health) {
      const row = table.insertRow();
      const state = known.nodes.get(name)?.state ?? "";
      cell(row, name);
      cell(row, state);
      cell(row, message, level > 0);
      cell(row, Object.entries(values).filter(([key]) => !HIDDEN.has(key) && !(message !== "ok" && message.includes(key)))
        .map(([key, value]) => `${key} ${value}`).join(", "));
    }
  };
  // A torque at its limit is in the charts, and nothing is wrong with it.
  const wrong = (message) => message.split(", ").filter((count) => !count.startsWith("commands limited")).join(", ");
  const diagnosed = ({ name, level, message }) => {
    const counts = level > 0 ? wrong(message) : "";
    if (counts && counted.has(name) && counted.get(name) !== counts) alarm.say(`${name}: ${counts}`, name);
    counted.set(name, counts);
    show();
  };
  // Angles of events are in rad; people read degrees.
  const IN_DEGREES = { fell: ["angle", "limit"] };
  const shown = (event, key, value) =>
    IN_DEGREES[event]?.includes(key) ? `${key} ${showNumber(Number(value) * DEGREES)}°` : `${key} ${value}`;
  const described = ({ t, node, event, values, changed }) => {
    const more = Object.entries(values).filter(([key]) => key !== "process").map(([key, value]) => shown(event, key, value)).join(", ");
    return `${t.toFixed(3)} s  ${node}: ${changed || event}${more ? ` (${more})` : ""}`;
  };
  const events = () => {
    list.replaceChildren(...known.events.toReversed().map((one) => {
      const item = document.createElement("li");
      item.textContent = described(one);
      item.classList.toggle("bad", BAD.has(one.event));
      item.classList.toggle("fell", one.event === "fell");
      return item;
    }));
    count.textContent = known.events.length || "";
    earlier.textContent = known.events_before ? `${known.events_before} earlier ones are in the recording` : "";
    for (const one of known.events) {
      const { number, t, node, event, values } = one;
      if (number <= told || told < 0) continue;
      if (BAD.has(event)) alarm.say(`${node}: ${event} at ${t.toFixed(2)} s${values.reason ? `, ${values.reason}` : ""}`);
      if (event !== "fell") continue;
      latest.textContent = described(one);
      clearTimeout(fading);
      fading = setTimeout(() => { latest.textContent = ""; }, LATEST_MS);
    }
    told = known.events.at(-1)?.number ?? told;
  };
  const served = () => {
    const { clients, operator, refused } = known.gateway;
    const counts = Object.entries(refused).map(([what, count]) => `${what} (${count})`).join(", ");
    gateway.textContent = `${clients} ${clients === 1 ? "page" : "pages"} open${operator ? `; ${operator} is pushing` : ""}${counts ? `; refused: ${counts}` : ""}`;
  };
  // Another gateway counts the events anew.
  const anew = () => { told = -1; };
  return { show, diagnosed, events, served, anew };
})();
