// Writes a recording as the page does: node record.mjs ASSETS JOB.json
import fs from "node:fs";
import { load } from "./assets.mjs";

const [, , assets, job] = process.argv;
const { recordingOf } = load(assets, ["recordingOf"]);
const { lab, name, run, table, output } = JSON.parse(fs.readFileSync(job, "utf8"));
const bytes = fs.readFileSync(table);
run.table = new Float64Array(bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.length));
fs.writeFileSync(output, recordingOf(lab, name, run));
