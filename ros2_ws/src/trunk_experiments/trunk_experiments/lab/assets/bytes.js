"use strict";
// Bytes that grow, little-endian; every method that writes returns the writer.
const UTF8 = new TextEncoder();
const hexOf = (bytes) => Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");

class ByteWriter {
  constructor(capacity = 256) {
    this.size = 0;
    this.hold(new Uint8Array(capacity));
  }

  hold(bytes) {
    this.bytes = bytes;
    this.view = new DataView(bytes.buffer);
  }

  // Make room for more bytes and return where they begin.
  room(count) {
    const at = this.size;
    this.size += count;
    if (this.size > this.bytes.length) {
      const larger = new Uint8Array(2 * this.size);
      larger.set(this.bytes.subarray(0, at));
      this.hold(larger);
    }
    return at;
  }

  // `room` comes first: it may change the view.
  u8(value) {
    const at = this.room(1);
    this.view.setUint8(at, value);
    return this;
  }

  u16(value) {
    const at = this.room(2);
    this.view.setUint16(at, value, true);
    return this;
  }

  u32(value) {
    const at = this.room(4);
    this.view.setUint32(at, value, true);
    return this;
  }

  // An integer from 0 on that is exact as a double.
  u64(value) { return this.u32(value % 2 ** 32).u32(value / 2 ** 32); }

  i64(value) {
    const at = this.room(8);
    this.view.setBigInt64(at, BigInt(value), true);
    return this;
  }

  f64(value) {
    const at = this.room(8);
    this.view.setFloat64(at, value, true);
    return this;
  }

  raw(bytes) {
    const at = this.room(bytes.length);
    this.bytes.set(bytes, at);
    return this;
  }

  // What `write` writes, after its length in four or eight bytes.
  sized(width, write) {
    const at = this.room(width);
    write(this);
    const length = this.size - at - width;
    this.view.setUint32(at, length, true);
    if (width === 8) this.view.setUint32(at + 4, length / 2 ** 32, true);
    return this;
  }

  // A text after its length.
  text(text) {
    const bytes = UTF8.encode(text);
    return this.u32(bytes.length).raw(bytes);
  }

  written(from = 0, to = this.size) { return this.bytes.subarray(from, to); }
}
