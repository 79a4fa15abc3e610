// The page's scripts as Node runs them: `load(ASSETS, ["openEngine"])` returns what they define.
import fs from "node:fs";
import path from "node:path";

const FILES = ["engine", "setup"];

export const load = (assets, names, more = "") => {
  const source = FILES.map((name) => fs.readFileSync(path.join(assets, `${name}.js`), "utf8")).join("\n");
  return new Function(`${source}\n${more}\nreturn { ${names} };`)();
};
