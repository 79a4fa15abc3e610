"use strict";
// What an experiment gives, as a text: two hashes over the bits of its table, NaN as one value.
const bitsOf = (engine, setup) => {
  try {
    engine.begin(setup);
  } catch (error) {
    return error.message;
  }
  engine.advance(engine.states);
  const count = engine.count * engine.width;
  const words = new Uint32Array(engine.table.buffer, 0, 2 * count);
  let [a, b] = [0x811c9dc5, 0x9747b28c];
  const add = (word) => {
    a = Math.imul(a ^ word, 16777619);
    b = Math.imul(b + word, 0x85ebca6b) ^ (b >>> 13);
  };
  for (let i = 0; i < count; i++) {
    const number = !Number.isNaN(engine.table[i]);
    add(number ? words[2 * i] : 0);
    add(number ? words[2 * i + 1] : 0x7ff80000);
  }
  return [engine.count, a >>> 0, b >>> 0, engine.ended, JSON.stringify(engine.metrics())].join(" ");
};
