// node run.mjs ASSETS FOLDER: experiments.json of lab.json, computed; tables to tables.bin, the rest to stdout.
import { closeSync, openSync, readFileSync, writeSync } from "node:fs";
import { join } from "node:path";
import { load } from "./assets.mjs";

const [assets, folder] = process.argv.slice(2);
const bits = readFileSync(new URL("bits.js", import.meta.url), "utf8");
const { openEngine, bitsOf } = load(assets, ["openEngine", "bitsOf"], bits);
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
    const { count, width, ended, falls } = engine;
    writeSync(tables, new Uint8Array(engine.table.buffer, 0, 8 * count * width));
    const ahead = Array.from(engine.ahead);
    return { count, width, ended, falls, metrics: engine.metrics(), ahead, bits: bitsOf(engine, setup) };
});
closeSync(tables);
console.log(JSON.stringify(results));
