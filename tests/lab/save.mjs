// Computes experiments and saves their recordings, as the page does: node save.mjs ASSETS FOLDER
import fs from "node:fs";
import path from "node:path";
import { load } from "./assets.mjs";

const [, , assets, folder] = process.argv;
const { openEngine, recordingOf } = load(assets, ["openEngine", "recordingOf"]);
const json = (name) => JSON.parse(fs.readFileSync(path.join(folder, name), "utf8"));
const lab = { ...json("lab.json"), digest: "0" };
for (const [i, [name, setup]] of json("experiments.json").entries()) {
  const engine = await openEngine(lab, name);
  engine.begin(setup);
  engine.advance(lab.states);
  fs.writeFileSync(path.join(folder, `${i}.mcap`), recordingOf(lab, name, engine));
}
