"use strict";
// Commands to copy: a page names no files and runs nothing.
const quoted = (text) => (/^[\w./:=+,%@-]+$/.test(text) ? text : `'${text.replaceAll("'", `'\\''`)}'`);

// Copy an element's text; it is selected, so that keys can copy it where the browser does not let a page.
const copyText = async (element) => {
  const range = document.createRange();
  range.selectNodeContents(element);
  getSelection().removeAllRanges();
  getSelection().addRange(range);
  try {
    await navigator.clipboard.writeText(element.textContent);
  } catch {
    document.execCommand("copy");
  }
};
