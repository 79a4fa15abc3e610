"use strict";
// The page's data: columns become Float64Arrays once, shared by plots and animation; `packing.py` wrote them.
const report = JSON.parse(document.getElementById("data").textContent);

const unpackReport = (() => {
  const inflated = async (text) => {
    const letters = atob(text);
    const bytes = new Uint8Array(letters.length);
    for (let i = 0; i < letters.length; i++) bytes[i] = letters.charCodeAt(i);
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate-raw"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };
  // A plane holds one byte of each number; sums of differences wrap around.
  const words = (bytes, count, plane) => {
    const found = new Int32Array(count);
    for (let i = 0; i < count; i++) {
      const at = plane * count + i;
      found[i] = bytes[at] | (bytes[at + count] << 8) | (bytes[at + 2 * count] << 16) | (bytes[at + 3 * count] << 24);
    }
    return found;
  };
  const inSteps = (bytes, { count, differences, low, high, step }) => {
    const steps = words(bytes, count, 0);
    for (let pass = 0; pass < differences; pass++) {
      for (let i = 1; i < count; i++) steps[i] = (steps[i] + steps[i - 1]) | 0;
    }
    const top = steps.reduce((most, v) => (v > most ? v : most), 0);
    const found = new Float64Array(count);
    for (let i = 0; i < count; i++) found[i] = steps[i] < 0 ? NaN : steps[i] === top ? high : low + steps[i] * step;
    return found;
  };
  const inBits = (bytes, { count, differences }) => {
    const [low, high] = [new Uint32Array(words(bytes, count, 0).buffer), words(bytes, count, 4)];
    for (let pass = 0; pass < differences; pass++) {
      for (let i = 1; i < count; i++) {
        const sum = low[i] + low[i - 1];
        low[i] = sum;
        high[i] = (high[i] + high[i - 1] + (sum > 0xffffffff ? 1 : 0)) | 0;
      }
    }
    const both = new Uint32Array(2 * count);
    for (let i = 0; i < count; i++) {
      both[2 * i] = low[i];
      both[2 * i + 1] = high[i];
    }
    return new Float64Array(both.buffer);
  };
  const unpack = async (column) => {
    if ("constant" in column) return new Float64Array(column.count).fill(column.constant);
    const bytes = await inflated(column.packed);
    return "step" in column ? inSteps(bytes, column) : inBits(bytes, column);
  };
  const unpackAll = async (columns) => {
    const found = {};
    for (const [name, column] of Object.entries(columns)) {
      found[name] = "same" in column ? found[column.same] : await unpack(column);
    }
    return found;
  };

  return async () => {
    for (const run of report.runs) {
      run.columns = await unpackAll(run.columns);
      const { reference, theta } = run.columns;
      run.columns.error = theta.map((v, i) => reference[i] - v);
      const { fuzzy } = run;
      if (!fuzzy) continue;
      for (const name of ["error", "rate"]) fuzzy[name] = await unpack(fuzzy[name]);
      for (const output of fuzzy.outputs) output.values = await unpack(output.values);
      fuzzy.updates = await unpackAll(fuzzy.updates);
    }
    report.start = Math.min(...report.runs.map((run) => run.columns.t[0]));
    report.end = Math.max(...report.runs.map((run) => run.columns.t[run.columns.t.length - 1]));
  };
})();
