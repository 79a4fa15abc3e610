"use strict";
// The connection to the gateway: words and rows in, requests out; it comes back by itself.
const wire = (() => {
  // Out of the address, so that nobody copies it from there by accident; kept for when the page is loaded anew.
  const token = location.hash.slice(1) || sessionStorage.getItem("token") || "";
  sessionStorage.setItem("token", token);
  history.replaceState(null, "", location.pathname);
  const listeners = [];
  const waiting = new Map(); // number of a request -> what to do with its answer
  let socket = null;
  let number = 0;
  let wait = 250;
  const ENDED = 4000; // the server will not come back
  const LATE_MS = 2000; // from then on a page says that it waits
  const late = new Map(); // the kinds of such requests, by number
  const tell = (kinds) => alarm.say(kinds.size ? `${[...new Set(kinds.values())].join(", ")}: no answer yet` : "", "late");
  const say = (kind, values) => listeners.forEach((listener) => listener(kind, values));

  const rows = (data) => {
    const values = new Float64Array(data);
    const stream = known.streams[values[0]];
    if (!stream) return;
    storeOf(stream.name).add(stream.columns, values.subarray(3));
    say("rows", stream);
  };
  const words = (text) => {
    const { kind, ...values } = JSON.parse(text);
    if (kind === "answer") {
      const done = waiting.get(values.number);
      waiting.delete(values.number);
      if (done) done(values);
      else if (!values.ok) say("refused", values.text);
      return;
    }
    if (kind === "hello") {
      wait = 250;
      known.client = values.client;
      known.control_allowed = values.control;
      known.streams = [];
      known.events = [];
    } else if (kind === "stream") {
      known.streams[values.stream] = values;
      for (const name of values.columns) storeOf(values.name).column(name);
    } else if (kind === "node") known.nodes.set(values.name, values);
    else if (kind === "declared") known.declared.set(values.name, values.parameters);
    else if (kind === "health") known.health.set(values.name, values);
    else if (kind === "events") {
      // The gateway keeps the latest only; the page keeps what it has had before them.
      const first = values.events[0]?.number ?? 0;
      known.events = [...known.events.filter(({ number }) => number < first), ...values.events];
      if (known.events.length === values.events.length) known.events_before = values.before;
    }
    else known[kind] = values;
    say(kind, values);
  };
  const open = () => {
    socket = new WebSocket(`${location.origin.replace("http", "ws")}/live`, ["trunk.live.1", token]);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => say("link", "open");
    socket.onmessage = ({ data }) => (typeof data === "string" ? words(data) : rows(data));
    socket.onclose = ({ code }) => {
      say("link", code === ENDED ? "ended" : "closed");
      for (const done of waiting.values()) done({ ok: false, text: "the connection was lost" });
      waiting.clear();
      if (code === ENDED) return;
      setTimeout(open, wait);
      wait = Math.min(2 * wait, 4000);
    };
  };
  return {
    EVERY_MS: 120, // a slider that is dragged asks no more often
    open,
    listen: (listener) => listeners.push(listener),
    // Send without an answer; what cannot be sent now is not sent later.
    send: (kind, values = {}) => {
      if (socket?.readyState === WebSocket.OPEN && socket.bufferedAmount < 65536)
        socket.send(JSON.stringify({ kind, ...values }));
    },
    // Send, and hear whether it was done.
    ask: (kind, values = {}) => new Promise((done) => {
      if (socket?.readyState !== WebSocket.OPEN) {
        done({ ok: false, text: "not connected" });
        return;
      }
      number += 1;
      const own = number;
      const timer = setTimeout(() => tell(late.set(own, kind)), LATE_MS);
      waiting.set(own, (answer) => {
        clearTimeout(timer);
        if (late.delete(own)) tell(late);
        done(answer);
      });
      socket.send(JSON.stringify({ kind, number, ...values }));
    }),
  };
})();
