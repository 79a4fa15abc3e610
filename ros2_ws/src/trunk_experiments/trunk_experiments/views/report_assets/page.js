"use strict";
// Controls, keys, themes, printing; then everything is drawn.
const letLoad = paper.holdLoading();
(async () => {
  await unpackReport();
  const play = document.getElementById("play");
  const scrub = document.getElementById("scrub");
  const time = document.getElementById("time");
  const speed = document.getElementById("speed");
  const periods = report.runs.map(({ columns: { t } }) => (t.length > 1 ? (t[t.length - 1] - t[0]) / (t.length - 1) : 0.001));
  const finest = Math.min(...periods);

  scrub.min = report.start;
  scrub.max = report.end;
  scrub.addEventListener("input", () => {
    clock.pause();
    clock.set(Number(scrub.value));
  });
  speed.addEventListener("change", () => { clock.speed = Number(speed.value); });
  const toggle = () => (clock.playing ? clock.pause() : clock.play());
  play.addEventListener("click", toggle);
  clock.told = () => {
    play.firstElementChild.textContent = clock.playing ? "⏸" : "▶";
    play.setAttribute("aria-label", clock.playing ? "Pause" : "Play");
  };
  clock.listeners.push((now) => {
    scrub.value = now;
    scrub.setAttribute("aria-valuetext", `${now.toFixed(3)} seconds`);
    time.textContent = `${now.toFixed(3)} s`;
  });

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey) return;
    const on = event.target instanceof Element ? event.target : document.body;
    if (on.closest("select, summary, a, .scroll")) return;
    if (event.key === " ") {
      if (on.closest("button")) return; // it knows what space means
      event.preventDefault();
      toggle();
      return;
    }
    const times = { "+": 0.5, "=": 0.5, "-": 2, 0: Infinity }[event.key];
    if (times !== undefined) zoomAbout(clock.time, times);
    const to = timeOfKey(event, { time: clock.time, finest, first: report.start, last: report.end });
    if (to === undefined) return;
    event.preventDefault();
    clock.pause();
    clock.set(to);
  });

  const stages = report.runs.map(makeStage);
  const paint = () => {
    document.querySelectorAll(".swatch[data-run]").forEach((s) => { s.style.background = runColor(Number(s.dataset.run)); });
    document.querySelectorAll("line[data-run]").forEach((s) => {
      s.style.stroke = runColor(Number(s.dataset.run));
      const dash = runDash(Number(s.dataset.run));
      s.style.strokeDasharray = dash === "solid" ? "none" : dash.replaceAll("px", "");
    });
    stages.forEach((stage) => stage.draw());
  };
  const repaintAll = () => {
    paint();
    repaintCharts();
  };
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", repaintAll);
  paper.start(repaintAll);

  makeTimeCharts();
  makePlaneCharts();
  makeMaps();
  clock.listeners.push((now) => charts.forEach((chart) => chart.show(now)));
  comparing.start();
  for (const place of document.querySelectorAll(".scroll")) {
    // Only what can be scrolled is a stop of the Tab key.
    new ResizeObserver(() => { place.tabIndex = place.scrollWidth > place.clientWidth + 1 ? 0 : -1; }).observe(place);
  }
  paint();
  clock.set(report.start);
  if (report.bits) document.querySelector(".rounded").hidden = false;
  await drawCharts();
  document.documentElement.dataset.ready = "true";
})().finally(letLoad);
