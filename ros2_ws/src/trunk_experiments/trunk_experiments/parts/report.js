"use strict";
// What only a report has: runs hidden and subtracted, dots on its planes, and paper.
(() => {
  const root = document.documentElement;
  const at = (id) => document.getElementById(id);

  // ── paper ────────────────────────────────────────────────────────────────────────────────────────────
  // Programs print a page as soon as it has loaded. A document that is being written delays that: here, that of a
  // frame without a place, until everything is drawn.
  const frame = document.createElement("iframe");
  frame.hidden = true;
  document.body.append(frame);
  const page = frame.contentDocument;
  page.open();
  const lay = (on) => {
    root.toggleAttribute("data-paper", on); // the style sheet's width and colours of paper
    forgetColors();
    at("paper-time").textContent = `Animation and values: at t = ${view.time.toFixed(3)} s`;
    paintKeys();
    strips.drawAll(view.time, true);
    scene.draw(view.time);
  };
  addEventListener("beforeprint", () => lay(true));
  addEventListener("afterprint", () => lay(false));
  matchMedia("print").addEventListener("change", ({ matches }) => lay(matches));

  // ── runs ─────────────────────────────────────────────────────────────────────────────────────────────
  const paintKeys = () => document.querySelectorAll("line[data-run]").forEach((key) => {
    const index = Number(key.dataset.run);
    key.style.stroke = runColor(index);
    key.style.strokeDasharray = runDash(index).join(" ") || "none";
  });
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", paintKeys);
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
  wire.at = (time) => {
    for (const { dot, axes, index } of known.recorded ? dots : []) {
      const { plant, hidden, world } = known.runs[index];
      const row = plant.row(time);
      const value = (name) => (name === "height" ? pathHeight(world.path, plant.value("x", row)) : plant.value(name, row));
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
    paintKeys();
    requestAnimationFrame(() => requestAnimationFrame(() => {
      strips.drawAll(view.time, false);
      root.dataset.ready = "true";
      page.close();
      frame.remove();
    }));
  });
})();
