"use strict";
// What is wrong stands first: the red line.
const alarm = (() => {
  const box = document.getElementById("alarm");
  const words = document.getElementById("alarm-text");
  const MOST = 4; // lines; the oldest goes
  const lines = new Map(); // about what -> the words
  const show = () => {
    words.replaceChildren(...[...lines.values()].map((text) => {
      const line = document.createElement("span");
      line.textContent = text;
      return line;
    }));
    box.hidden = !lines.size;
  };
  document.getElementById("alarm-close").addEventListener("click", () => {
    lines.clear();
    show();
  });
  return {
    // An empty text: nothing is wrong any more.
    say: (text, about = text) => {
      lines.delete(about);
      if (text) lines.set(about, text);
      if (lines.size > MOST) lines.delete(lines.keys().next().value);
      show();
    },
  };
})();
