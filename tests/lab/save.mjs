// Computes experiments and saves them and their states, as the page does: node save.mjs ASSETS FOLDER
import fs from "node:fs";
import path from "node:path";
import { load } from "./assets.mjs";

const [, , assets, folder] = process.argv;
const { openEngine, setups } = load(assets, ["openEngine", "setups"]);
const json = (name) => JSON.parse(fs.readFileSync(path.join(folder, name), "utf8"));
const write = (name, text) => fs.writeFileSync(path.join(folder, name), text);
const lab = { ...json("lab.json"), digest: "0123456789abcdef" };
for (const [i, [name, setup]] of json("experiments.json").entries()) {
  const engine = await openEngine(lab, name);
  engine.begin(setup);
  engine.advance(lab.states);
  write(`${i}.json`, JSON.stringify(await setups.experiment(lab, name, engine)));
  write(`${i}.csv`, setups.csv(lab, engine));
}
