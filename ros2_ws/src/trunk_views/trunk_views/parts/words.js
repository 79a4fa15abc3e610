"use strict";
// A page's own texts about hip, trunk and torque, in the words of another plant; of the trunk they stay as they are.
let inWords = (text) => text;
// `first`, `second`: the plant's joints; `slides`: the drive pushes along a line; null: not every run's, or it is not known.
const speakOf = ({ first, second, slides }) => {
  const nouns = { hip: first, trunk: second, torque: slides === null ? "effort" : slides ? "force" : "torque" };
  inWords = (text) => {
    const said = text.replace(/\b(hip|trunk|torque)(?=s?\b)/gi, (word) => {
      const noun = nouns[word.toLowerCase()];
      return word[0] === word[0].toLowerCase() ? noun : noun[0].toUpperCase() + noun.slice(1);
    });
    return slides === false ? said : said.replaceAll("N·m", slides ? "N" : "N or N·m");
  };
  for (const element of document.querySelectorAll("[data-words]")) {
    const label = element.getAttribute("aria-label");
    if (label) element.setAttribute("aria-label", inWords(label));
    for (const node of element.childNodes) if (node.nodeType === Node.TEXT_NODE) node.data = inWords(node.data);
  }
};
