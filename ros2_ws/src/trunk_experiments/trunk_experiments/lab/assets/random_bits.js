"use strict";
// The random bits of the sensors' noise: NumPy's SeedSequence and PCG64, as trunk_sim/noise.py draws them.
const randomBits = (() => {
  const MASK_32 = 0xffffffffn;
  const MASK_64 = (1n << 64n) - 1n;
  const MASK_128 = (1n << 128n) - 1n;
  const MULTIPLIER = 0x2360ed051fc65da44385df649fccf645n;
  const POOL = 4; // words of 32 bits

  // SeedSequence(seed).generate_state(4, uint64)
  const stateOf = (seed) => {
    const entropy = [];
    for (let rest = BigInt(seed); entropy.length === 0 || rest; rest >>= 32n) entropy.push(rest & MASK_32);
    let factor = 0x43b0d7e5n;
    const hashed = (word) => {
      const mixed = word ^ factor;
      factor = (factor * 0x931e8875n) & MASK_32;
      const product = (mixed * factor) & MASK_32;
      return product ^ (product >> 16n);
    };
    const joined = (a, b) => {
      const difference = (a * 0xca01f9ddn - b * 0x4973f715n) & MASK_32;
      return difference ^ (difference >> 16n);
    };
    const pool = Array.from({ length: POOL }, (_, i) => hashed(entropy[i] ?? 0n));
    for (let from = 0; from < POOL; from++)
      for (let to = 0; to < POOL; to++) if (from !== to) pool[to] = joined(pool[to], hashed(pool[from]));
    for (const word of entropy.slice(POOL)) for (let to = 0; to < POOL; to++) pool[to] = joined(pool[to], hashed(word));
    factor = 0x8b51f9ddn;
    const words = Array.from({ length: 8 }, (_, i) => {
      const mixed = pool[i % POOL] ^ factor;
      factor = (factor * 0x58f38dedn) & MASK_32;
      const product = (mixed * factor) & MASK_32;
      return product ^ (product >> 16n);
    });
    return [0, 2, 4, 6].map((i) => words[i] | (words[i + 1] << 32n));
  };

  // A function that returns the highest 53 bits of the next raw integer of PCG64(seed).
  return (seed) => {
    const [high, low, incrementHigh, incrementLow] = stateOf(seed);
    const increment = ((((incrementHigh << 64n) | incrementLow) << 1n) | 1n) & MASK_128;
    let state = 0n;
    const step = () => { state = (state * MULTIPLIER + increment) & MASK_128; };
    step();
    state = (state + ((high << 64n) | low)) & MASK_128;
    step();
    return () => {
      step();
      const word = ((state >> 64n) ^ state) & MASK_64;
      const turn = state >> 122n;
      return (((word >> turn) | (word << (-turn & 63n))) & MASK_64) >> 11n;
    };
  };
})();
