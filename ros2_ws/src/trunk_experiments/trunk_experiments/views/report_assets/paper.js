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
  // Programs print a page as soon as it has loaded. A document that is being written delays that: here, that of
  // a frame without a place, until the function returned is called.
  const holdLoading = () => {
    const frame = document.createElement("iframe");
    frame.hidden = true;
    document.body.append(frame);
    const page = frame.contentDocument;
    page.open();
    return () => {
      page.close();
      frame.remove();
    };
  };
  return { start, holdLoading };
})();
