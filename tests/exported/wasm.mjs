// node wasm.mjs MODULE STATES: as replay.c says it.
import { readFileSync } from "node:fs";

const [module, states] = process.argv.slice(2);
const { instance } = await WebAssembly.instantiate(readFileSync(module), {});
const code = instance.exports;
if (code.self_test() !== 0) {
    console.log(`self-test: fault ${code.self_test()}`);
    process.exit(1);
}
const file = readFileSync(states);
const rows = Number(file.readBigInt64LE(8));
const most = 1000;
let different = 0, compared = 0;
code.reset();
for (let first = 0; first < rows; first += most) {
    const count = Math.min(most, rows - first);
    const part = file.subarray(16 + 80 * first, 16 + 80 * (first + count));
    new Uint8Array(code.memory.buffer).set(part, code.memory_of());
    different += code.different(count);
    for (let i = 0; i < count; i++) compared += Number(part.readBigInt64LE(80 * i + 72));
}
console.log(`${compared - different} of ${compared} commands equal`);
process.exit(different === 0 ? 0 : 1);
