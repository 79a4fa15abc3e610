// Prints BLAKE2b and CRC-32 of a file that is taken piece by piece: node digests.mjs ASSETS FILE SIZE…
import fs from "node:fs";
import { load } from "./assets.mjs";

const [, , assets, file, ...sizes] = process.argv;
const { Blake2b, crc32 } = load(assets, ["Blake2b", "crc32"]);
const bytes = new Uint8Array(fs.readFileSync(file));
const digest = new Blake2b();
let crc = 0;
let from = 0;
for (const size of [...sizes.map(Number), bytes.length]) {
  const piece = bytes.subarray(from, from + size);
  digest.update(piece);
  crc = crc32(piece, crc);
  from += piece.length;
}
console.log(digest.hex(), crc);
