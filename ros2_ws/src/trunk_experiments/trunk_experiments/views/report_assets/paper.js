"use strict";
// On paper: plots are drawn anew for the page's width and colours, before the browser lays it out.
const paper = (() => {
  const root = document.documentElement;
  // `repaintAll`: draws charts and pictures again.
  const start = (repaintAll) => {
    const lay = (on) => {
      if (on === Boolean(report.paper)) return;
      report.paper = on;
      root.toggleAttribute("data-paper", on); // the style sheet's width and colours of paper
      forgetColors();
      document.querySelector(".paper-time").textContent = `Animation and values: at t = ${clock.time.toFixed(3)} s`;
      repaintAll();
    };
    addEventListener("beforeprint", () => lay(true));
    addEventListener("afterprint", () => lay(false));
    matchMedia("print").addEventListener("change", ({ matches }) => lay(matches));
  };
  return { start };
})();
