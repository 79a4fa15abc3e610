"use strict";
// BLAKE2b with 32 bytes (RFC 7693), of bytes that come piece by piece.
const Blake2b = (() => {
  const BLOCK = 128;
  // Initial words: their low halves, their high halves.
  const IV_LOW = Int32Array.of(
    0xf3bcc908, 0x84caa73b, 0xfe94f82b, 0x5f1d36f1, 0xade682d1, 0x2b3e6c1f, 0xfb41bd6b, 0x137e2179,
  );
  const IV_HIGH = Int32Array.of(
    0x6a09e667, 0xbb67ae85, 0x3c6ef372, 0xa54ff53a, 0x510e527f, 0x9b05688c, 0x1f83d9ab, 0x5be0cd19,
  );
  // In each round, the words of the message in the order in which eight mixings take two of them.
  const ROUNDS = [
    "0123456789abcdef", "ea489fd61c02b753", "b8c052fdae367194", "7931dcbe265a40f8", "905724afe1bc683d", "2c6a0b834d75fe19",
    "c51fed4a0763928b", "db7ec13950f4862a", "6fe9b308c2d714a5", "a2847615fb9e3cd0", "0123456789abcdef", "ea489fd61c02b753",
  ];
  // Columns, then diagonals of the state, four words each.
  const QUARTERS = ["048c", "159d", "26ae", "37bf", "05af", "16bc", "278d", "349e"];
  // All mixings one after the other: four words of the state, two of the message, which follow the state's.
  const numbers = (digits, first) => Array.from(digits, (digit) => first + parseInt(digit, 16));
  const MIXINGS = Uint8Array.from(ROUNDS.flatMap((order) => QUARTERS.flatMap(
    (words, i) => [...numbers(words, 0), ...numbers(order.slice(2 * i, 2 * i + 2), 16)],
  )));
  const low = new Int32Array(32);
  const high = new Int32Array(32);
  const carry = (a, b, sum) => ((a & b) | ((a | b) & ~sum)) >>> 31;

  const mixAll = () => {
    for (let i = 0; i < MIXINGS.length; i += 6) {
      const a = MIXINGS[i], b = MIXINGS[i + 1], c = MIXINGS[i + 2], d = MIXINGS[i + 3];
      const x = MIXINGS[i + 4], y = MIXINGS[i + 5];
      // a += b + x; d = (d ^ a) turned by 32; c += d; b = (b ^ c) turned by 24
      const al = low[a], bl = low[b], bh = high[b], cl = low[c], xl = low[x], yl = low[y];
      let half = (al + bl) | 0;
      const al1 = (half + xl) | 0;
      const ah1 = (high[a] + bh + high[x] + carry(al, bl, half) + carry(half, xl, al1)) | 0;
      const dl1 = high[d] ^ ah1, dh1 = low[d] ^ al1;
      const cl1 = (cl + dl1) | 0;
      const ch1 = (high[c] + dh1 + carry(cl, dl1, cl1)) | 0;
      let l = bl ^ cl1, h = bh ^ ch1;
      const bl1 = (l >>> 24) | (h << 8), bh1 = (h >>> 24) | (l << 8);
      // a += b + y; d = (d ^ a) turned by 16; c += d; b = (b ^ c) turned by 63
      half = (al1 + bl1) | 0;
      const al2 = (half + yl) | 0;
      const ah2 = (ah1 + bh1 + high[y] + carry(al1, bl1, half) + carry(half, yl, al2)) | 0;
      l = dl1 ^ al2;
      h = dh1 ^ ah2;
      const dl2 = (l >>> 16) | (h << 16), dh2 = (h >>> 16) | (l << 16);
      const cl2 = (cl1 + dl2) | 0;
      const ch2 = (ch1 + dh2 + carry(cl1, dl2, cl2)) | 0;
      l = bl1 ^ cl2;
      h = bh1 ^ ch2;
      low[a] = al2;
      high[a] = ah2;
      low[b] = (h >>> 31) | (l << 1);
      high[b] = (l >>> 31) | (h << 1);
      low[c] = cl2;
      high[c] = ch2;
      low[d] = dl2;
      high[d] = dh2;
    }
  };

  return class {
    constructor() {
      this.low = IV_LOW.slice();
      this.high = IV_HIGH.slice();
      this.low[0] ^= 0x01010020; // no key, 32 bytes
      this.block = new Uint8Array(BLOCK);
      this.halves = new Int32Array(this.block.buffer);
      this.filled = 0;
      this.length = 0;
    }

    update(bytes) {
      for (let from = 0; from < bytes.length;) {
        if (this.filled === BLOCK) this.compress(0); // the last block waits for the end
        const { block, filled } = this;
        const count = Math.min(BLOCK - filled, bytes.length - from);
        for (let i = 0; i < count; i++) block[filled + i] = bytes[from + i]; // sooner than `set` for so few
        this.filled += count;
        from += count;
      }
      return this;
    }

    // Take the block in; `last`: -1 for the last one, else 0.
    compress(last) {
      this.length += this.filled;
      this.block.fill(0, this.filled);
      this.filled = 0;
      low.set(this.low);
      low.set(IV_LOW, 8);
      high.set(this.high);
      high.set(IV_HIGH, 8);
      low[12] ^= this.length;
      high[12] ^= this.length / 2 ** 32;
      low[14] ^= last;
      high[14] ^= last;
      for (let word = 0; word < 16; word++) {
        low[16 + word] = this.halves[2 * word];
        high[16 + word] = this.halves[2 * word + 1];
      }
      mixAll();
      for (let i = 0; i < 8; i++) {
        this.low[i] ^= low[i] ^ low[i + 8];
        this.high[i] ^= high[i] ^ high[i + 8];
      }
    }

    // The digest in hexadecimal digits; nothing may follow.
    hex() {
      this.compress(-1);
      const halves = Int32Array.from({ length: 8 }, (_, i) => (i % 2 ? this.high : this.low)[i >> 1]);
      return hexOf(new Uint8Array(halves.buffer));
    }
  };
})();
