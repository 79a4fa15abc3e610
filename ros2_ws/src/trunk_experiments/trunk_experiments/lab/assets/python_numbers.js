"use strict";
// Finite doubles as Python prints them, for texts that are compared with Python's.
const pythonNumbers = (() => {
  const signed = (value, text) => (value < 0 || Object.is(value, -0) ? `-${text}` : text);
  const scientific = (digits, exponent) => `${digits}e${exponent < 0 ? "-" : "+"}${String(Math.abs(exponent)).padStart(2, "0")}`;

  // As the format `.Ng`: so many digits at most; halfway between two, the even one.
  const general = (value, count) => {
    const size = Math.abs(value);
    const exact = size.toExponential(60);
    const kept = exact.slice(0, count + 1);
    const even = /^50*e/.test(exact.slice(count + 1)) && "02468".includes(kept.at(-1));
    const [rounded, exponent] = size.toExponential(count - 1).split("e");
    const digits = Number(even ? kept : rounded);
    const outside = exponent < -4 || exponent >= count;
    return signed(value, outside ? scientific(digits, exponent) : String(Number(`${digits}e${exponent}`)));
  };

  // A text with values in the place of {name:.Ng}.
  const format = (text, values) => text.replace(/\{(\w+):(?:\.(\d+))?g\}/g, (_, name, count) => general(values[name], Number(count ?? 6)));

  return { format };
})();
