"use strict";
// Messages as ROS 2 serializes them: XCDR1, little-endian; a number is aligned to its size, counted from byte 4.
class CdrWriter extends ByteWriter {
  constructor() {
    super();
    this.u32(0x0100); // the bytes 00 01 00 00: little-endian
  }

  align(size) {
    this.room((size - ((this.size - 4) % size)) % size);
    return this;
  }

  bool(value) { return this.u8(value ? 1 : 0); }

  count(value) { return this.align(4).u32(value); }

  integer(value) { return this.align(8).i64(value); }

  double(value) { return this.align(8).f64(value); }

  string(text) {
    const bytes = UTF8.encode(text);
    return this.count(bytes.length + 1).raw(bytes).u8(0);
  }

  sequence(values, write) {
    this.count(values.length);
    for (const value of values) write(value);
    return this;
  }

  stamp(ns) {
    const seconds = Math.floor(ns / 1e9);
    return this.count(seconds).count(ns - seconds * 1e9);
  }
}

const cdr = (() => {
  // The fields of a ParameterValue; a kind is the place among them, from 1 on.
  const KINDS = ["bool", "integer", "double", "string"];
  const FIELDS = [...KINDS, "byte array", ...KINDS.map((kind) => `${kind} array`)];
  const EMPTY = { bool: false, integer: 0, double: 0, string: "" };

  const parameter = (message, [name, kind, value]) => {
    message.string(name).u8(FIELDS.indexOf(kind) + 1);
    for (const field of FIELDS) {
      const [scalar, array] = field.split(" ");
      if (!array) message[scalar](field === kind ? value : EMPTY[scalar]);
      else message.sequence(field === kind ? value : [], (element) => message[scalar](element));
    }
  };

  return {
    // A DiagnosticArray with one status; `values`: names and texts.
    event: (ns, node, words, values = {}, level = 0) => {
      const message = new CdrWriter().stamp(ns).string("").count(1);
      message.u8(level).string(node).string(words).string("trunk");
      return message.sequence(Object.entries(values), ([name, text]) => message.string(name).string(text)).written();
    },

    // A ParameterEvent; each parameter is [name, kind, value].
    parameters: (ns, node, initial, changed) => {
      const message = new CdrWriter().stamp(ns).string(node);
      for (const list of [initial, changed, []]) message.sequence(list, (entry) => parameter(message, entry));
      return message.written();
    },
  };
})();

// JointState messages of one layout, which differ in their stamp and values alone.
// `position`, `velocity`, `effort`: for each value its column in a table of doubles; -1: it is 0.
class JointStates {
  constructor({ names, position = [], velocity = [], effort = [] }) {
    const message = new CdrWriter().stamp(0).string("");
    message.sequence(names, (name) => message.string(name));
    this.sources = []; // where in the message, and from which column
    for (const columns of [position, velocity, effort]) {
      message.sequence(columns, (column) => {
        message.double(0);
        if (column >= 0) this.sources.push([message.size - 8, column]);
      });
    }
    this.bytes = message.written();
    this.view = message.view;
  }

  // The message with a stamp and the doubles from `first` on, given as 32-bit halves; valid until the next one.
  // A double's bits stay as they are, NaN's too.
  at(ns, halves, first) {
    const { view, sources } = this;
    const seconds = Math.floor(ns / 1e9);
    view.setInt32(4, seconds, true);
    view.setUint32(8, ns - seconds * 1e9, true);
    for (let i = 0; i < sources.length; i++) {
      const [offset, column] = sources[i];
      view.setUint32(offset, halves[2 * (first + column)], true);
      view.setUint32(offset + 4, halves[2 * (first + column) + 1], true);
    }
    return this.bytes;
  }
}
