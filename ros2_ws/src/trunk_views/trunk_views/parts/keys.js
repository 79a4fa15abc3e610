"use strict";
// The keys of a player.

// The time that a key leads to, in s, undefined for any other key. `finest`: from one state to the next, in s.
const timeOfKey = (event, { time, finest, first, last }) => {
  const step = event.shiftKey ? 0.1 : 0.01;
  const to = {
    ArrowLeft: time - step, ArrowRight: time + step, ",": time - finest, ".": time + finest, Home: first, End: last,
  }[event.key];
  return to === undefined ? undefined : Math.min(last, Math.max(first, Math.round(to * 1e9) / 1e9));
};
