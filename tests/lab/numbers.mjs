// Prints doubles as the page does for Python: node numbers.mjs ASSETS HEX…
import { load } from "./assets.mjs";

const [, , assets, ...bits] = process.argv;
const { pythonNumbers } = load(assets, ["pythonNumbers"]);
for (const hex of bits) {
  const value = new Float64Array(BigUint64Array.of(BigInt(`0x${hex}`)).buffer)[0];
  console.log(pythonNumbers.format("{v:g} {v:.3g}", { v: value }));
}
