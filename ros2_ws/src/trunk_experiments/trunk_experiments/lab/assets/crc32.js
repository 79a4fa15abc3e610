"use strict";
// CRC-32 as zlib and MCAP have it, eight bytes at a time; `crc`: of the bytes before these.
const crc32 = (() => {
  // TABLES[k * 256 + b]: what byte b contributes when k more bytes follow it.
  const TABLES = new Int32Array(8 * 256);
  for (let byte = 0; byte < 256; byte++) {
    let crc = byte;
    for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0xedb88320 : crc >>> 1;
    TABLES[byte] = crc;
  }
  for (let i = 256; i < TABLES.length; i++) TABLES[i] = (TABLES[i - 256] >>> 8) ^ TABLES[TABLES[i - 256] & 255];
  const parts = (word, k) => TABLES[k * 256 + 768 + (word & 255)] ^ TABLES[k * 256 + 512 + ((word >>> 8) & 255)]
    ^ TABLES[k * 256 + 256 + ((word >>> 16) & 255)] ^ TABLES[k * 256 + (word >>> 24)];

  return (bytes, crc = 0) => {
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.length);
    let rest = ~crc;
    let at = 0;
    for (; at + 8 <= bytes.length; at += 8) {
      rest = parts(rest ^ view.getInt32(at, true), 4) ^ parts(view.getInt32(at + 4, true), 0);
    }
    for (; at < bytes.length; at++) rest = (rest >>> 8) ^ TABLES[(rest ^ bytes[at]) & 255];
    return ~rest >>> 0;
  };
})();
