// node run.mjs ASSETS FOLDER: experiments.json of lab.json, computed; tables to tables.bin, the rest to stdout.
import { closeSync, openSync, readFileSync, writeSync } from "node:fs";
import { join } from "node:path";
import { load } from "./assets.mjs";

const [assets, folder] = process.argv.slice(2);
<<<<<<< HEAD
const text = (name) => readFileSync(join(assets, name), "utf8").replace('"use strict";', "");
const bits = readFileSync(new URL("bits.js", import.meta.url), "utf8").replace('"use strict";', "");
const code = `${text("random_bits.js")}\n${text("engine.js")}\n${bits}\nreturn { openEngine, bitsOf };`;
const { openEngine, bitsOf } = new Function(code)();
=======
const { openEngine } = load(assets, "openEngine");
>>>>>>> 1f9610ff (Give the reason of a diverging run in a lab, as the command gives it)
const json = (name) => JSON.parse(readFileSync(join(folder, name), "utf8"));
const lab = json("lab.json");
const engines = {};
for (const name of lab.controllers) engines[name] = await openEngine(lab, name);
const tables = openSync(join(folder, "tables.bin"), "w");
const results = json("experiments.json").map(([name, setup]) => {
    const engine = engines[name];
    try {
        engine.begin(setup);
    } catch (error) {
        return { error: error.message };
    }
    engine.advance(lab.states);
    const { count, width, ended, falls, reason } = engine;
    writeSync(tables, new Uint8Array(engine.table.buffer, 0, 8 * count * width));
<<<<<<< HEAD
    const ahead = Array.from(engine.ahead);
    return { count, width, ended, falls, metrics: engine.metrics(), ahead, bits: bitsOf(engine, setup) };
=======
    return { count, width, ended, falls, reason, metrics: engine.metrics(), ahead: Array.from(engine.ahead) };
>>>>>>> 1f9610ff (Give the reason of a diverging run in a lab, as the command gives it)
});
closeSync(tables);
console.log(JSON.stringify(results));
