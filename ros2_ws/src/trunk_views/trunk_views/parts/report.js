"use strict";
// What only a report has: runs hidden and subtracted, and what is in force at the time shown.
(() => {
  const at = (id) => document.getElementById(id);

  // Programs print a page as soon as it has loaded. A document that is being written delays that: here, that of a
  // frame without a place, until everything is drawn.
  const frame = document.createElement("iframe");
  frame.hidden = true;
  document.body.append(frame);
  const page = frame.contentDocument;
  page.open();

  // ── runs ─────────────────────────────────────────────────────────────────────────────────────────────
  document.querySelectorAll("line[data-run]").forEach((key) => {
    const index = Number(key.dataset.run);
    key.style.stroke = `var(--run${index % 8})`;
    key.style.strokeDasharray = runDash(index).join(" ") || "none";
  });
  document.querySelectorAll("button.toggle").forEach((button) => {
    const index = Number(button.dataset.toggle);
    button.addEventListener("click", () => {
      const run = known.runs[index];
      run.hidden = !run.hidden;
      known.version += 1;
      button.setAttribute("aria-pressed", String(!run.hidden));
    });
  });
  at("base")?.addEventListener("change", ({ target }) => {
    wire.subtract(target.value === "" ? null : Number(target.value));
    known.version += 1;
  });
  at("zoom-in").addEventListener("click", () => view.zoomAbout(view.time, 0.5));
  at("zoom-out").addEventListener("click", () => view.zoomAbout(view.time, 2));

  // ── planes ───────────────────────────────────────────────────────────────────────────────────────────
  // Their pictures are drawn already; a dot on each is where each run is. Axes: left, top, width, height as parts of
  // the picture, what their ends are, and the columns over them.
  const dots = [...document.querySelectorAll(".plane")].flatMap((plane) => JSON.parse(plane.dataset.axes).flatMap((axes) => axes.runs.map((index) => {
    const dot = document.createElement("span");
    dot.className = "dot";
    dot.setAttribute("aria-hidden", "true");
    plane.querySelector(".picture").append(dot);
    return { dot, axes, index };
  })));
  const part = (value, [low, high], inside) => {
    const place = (value - low) / (high - low);
    return inside ? Math.min(1, Math.max(0, place)) : place;
  };

  // ── what is in force ─────────────────────────────────────────────────────────────────────────────────
  const parameters = new Map(); // the cell of a parameter that was changed -> its texts, by the times of the changes
  const cells = new Map([...document.querySelectorAll("[data-parameter]")].map((cell) => [cell.dataset.parameter, cell]));
  report.runs.forEach(({ changes }, run) => changes.forEach(([t, name, text]) => {
    const cell = cells.get(`${run} ${name}`);
    if (!cell) return; // of a node that is not known
    if (!parameters.has(cell)) parameters.set(cell, [[-Infinity, cell.textContent]]);
    parameters.get(cell).push([t, text]);
  }));
  const tables = [...document.querySelectorAll("[data-rules]")];
  const branches = [...document.querySelectorAll("[data-branch]")];
  const since = (list, time) => list.findLast(([t]) => t <= time) ?? list[0];
  const say = (element, words) => { if (element.textContent !== words) element.textContent = words; };
  const force = (time) => {
    for (const [cell, texts] of parameters) say(cell, since(texts, time)[1]);
    for (const table of tables) {
      const { plant } = known.runs[table.dataset.rules];
      const [row, column] = ["rules_row", "rules_column"].map((name) => plant.value(name, plant.row(time)));
      [...table.tBodies[0].rows].forEach(({ cells: line }, i) => [...line].forEach((cell, j) =>
        cell.toggleAttribute("data-lit", Math.abs(i - row) < 1 && Math.abs(j - 1 - column) < 1)));
    }
    for (const code of branches) {
      const [at, controller] = code.querySelectorAll("b");
      say(at, time.toFixed(3));
      say(controller, since(report.runs[code.dataset.branch].others, time)[1]);
    }
  };
  for (const code of branches) code.nextElementSibling.addEventListener("click", () => copyText(code));
  for (const button of document.querySelectorAll("[data-seek]")) button.addEventListener("click", () => view.seek(Number(button.dataset.seek)));

  wire.at = (time) => {
    at("paper-time").textContent = `Animation and values: at t = ${time.toFixed(3)} s`;
    if (known.recorded) force(time);
    for (const { dot, axes, index } of known.recorded ? dots : []) {
      const { plant, hidden, world } = known.runs[index];
      const row = plant.row(time);
      const value = (name) => (name === "height" ? pathHeight(world.picture.track, plant.value("x", row)) : plant.value(name, row));
      const x = part(value(axes.of[0]), axes.x, axes.edge);
      const y = part(value(axes.of[1]), axes.y, axes.edge);
      dot.hidden = hidden || !(x >= 0 && x <= 1 && y >= 0 && y <= 1);
      dot.style.left = `${100 * (axes.box[0] + x * axes.box[2])}%`;
      dot.style.top = `${100 * (axes.box[1] + (1 - y) * axes.box[3])}%`;
      dot.style.background = runColor(index);
    }
  };
  for (const place of document.querySelectorAll(".scroll")) {
    // Only what can be scrolled is a stop of the Tab key.
    new ResizeObserver(() => { place.tabIndex = place.scrollWidth > place.clientWidth + 1 ? 0 : -1; }).observe(place);
  }
  wire.listen((kind) => {
    if (kind !== "recorded") return;
    view.digits = 3;
    view.playing = false; // nothing moves by itself
    requestAnimationFrame(() => requestAnimationFrame(() => {
      strips.drawAll(view.time, false);
      document.documentElement.dataset.ready = "true";
      page.close();
      frame.remove();
    }));
  });
})();
