"use strict";
// Writes an MCAP file: uncompressed chunks with their indexes, metadata, a summary; all checksums are on.
const OPCODES = {
  header: 1, footer: 2, schema: 3, channel: 4, message: 5, chunk: 6, messageIndex: 7, chunkIndex: 8,
  attachmentIndex: 10, statistics: 11, metadata: 12, metadataIndex: 13, summaryOffset: 14, dataEnd: 15,
};

class McapWriter {
  static MAGIC = Uint8Array.of(0x89, 0x4d, 0x43, 0x41, 0x50, 0x30, 0x0d, 0x0a);
  static CHUNK_HEAD = 49; // bytes before a chunk's records
  static MESSAGE_HEAD = 31; // bytes before a message's data
  static LONGEST = 2 ** 20; // a chunk ends with the record that makes it longer

  constructor(profile, library) {
    this.out = new ByteWriter(2 ** 20).raw(McapWriter.MAGIC);
    this.schemas = []; // what writes each record once more, into the summary
    this.channels = [];
    this.chunks = [];
    this.metadata = [];
    this.counts = new Map(); // of messages, by channel
    this.first = Infinity; // log times, ns
    this.last = 0;
    this.chunk = null; // the one that is being written
    this.record("header", (out) => out.text(profile).text(library));
  }

  record(kind, write) { return this.out.u8(OPCODES[kind]).sized(8, write); }

  static pairs(out, values) {
    return out.sized(4, () => Object.entries(values).forEach(([name, text]) => out.text(name).text(text)));
  }

  openChunk() {
    this.chunk ??= { at: this.out.room(McapWriter.CHUNK_HEAD), first: Infinity, last: 0, index: new Map() };
    return this.chunk;
  }

  addSchema(name, encoding, text) {
    this.openChunk();
    const number = this.schemas.push((out) => out.u16(number).text(name).text(encoding).text(text));
    this.record("schema", this.schemas.at(-1));
    return number;
  }

  addChannel(topic, encoding, schema, metadata) {
    this.openChunk();
    const number = this.channels.push(
      (out) => McapWriter.pairs(out.u16(number).u16(schema).text(topic).text(encoding), metadata),
    );
    this.record("channel", this.channels.at(-1));
    return number;
  }

  // Add a message with one time for log and publication; return where its record begins.
  addMessage(channel, ns, data) {
    const { out, counts } = this;
    const chunk = this.openChunk();
    const records = chunk.at + McapWriter.CHUNK_HEAD;
    const at = out.size;
    const sequence = counts.get(channel) ?? 0;
    counts.set(channel, sequence + 1);
    if (!chunk.index.has(channel)) chunk.index.set(channel, new ByteWriter(2 ** 14));
    chunk.index.get(channel).u64(ns).u64(at - records);
    chunk.first = Math.min(ns, chunk.first);
    chunk.last = Math.max(ns, chunk.last);
    out.u8(OPCODES.message).u64(22 + data.length).u16(channel).u32(sequence).u64(ns).u64(ns).raw(data);
    if (out.size - records > McapWriter.LONGEST) this.closeChunk();
    return at;
  }

  closeChunk() {
    const { chunk, out } = this;
    if (!chunk) return;
    this.chunk = null;
    this.first = Math.min(chunk.first, this.first);
    this.last = Math.max(chunk.last, this.last);
    const begin = chunk.at + McapWriter.CHUNK_HEAD;
    const end = out.size;
    const size = end - begin;
    const head = new ByteWriter().u8(OPCODES.chunk).u64(end - chunk.at - 9).u64(chunk.first).u64(chunk.last);
    head.u64(size).u32(crc32(out.written(begin))).text("").u64(size);
    out.bytes.set(head.written(), chunk.at);
    const offsets = [];
    for (const [channel, entries] of chunk.index) {
      offsets.push([channel, out.size]);
      this.record("messageIndex", () => out.u16(channel).sized(4, () => out.raw(entries.written())));
    }
    const indexes = out.size - end;
    this.chunks.push(() => {
      out.u64(chunk.first).u64(chunk.last).u64(chunk.at).u64(end - chunk.at);
      out.sized(4, () => offsets.forEach(([channel, at]) => out.u16(channel).u64(at)));
      out.u64(indexes).text("").u64(size).u64(size);
    });
  }

  addMetadata(name, values) {
    this.closeChunk();
    const at = this.out.size;
    this.record("metadata", (out) => McapWriter.pairs(out.text(name), values));
    const length = this.out.size - at;
    this.metadata.push((out) => out.u64(at).u64(length).text(name));
  }

  // Write the end of the data, the summary and the footer; return the file.
  finish() {
    this.closeChunk();
    const { out } = this;
    const data = crc32(out.written());
    this.record("dataEnd", () => out.u32(data));
    const summary = out.size;
    const groups = {
      schema: this.schemas,
      channel: this.channels,
      statistics: [() => this.statistics()],
      chunkIndex: this.chunks,
      attachmentIndex: [],
      metadataIndex: this.metadata,
    };
    const spans = Object.entries(groups).map(([kind, records]) => {
      const at = out.size;
      for (const write of records) this.record(kind, write);
      return [kind, at, out.size - at];
    });
    const offsets = out.size;
    for (const [kind, at, length] of spans) {
      this.record("summaryOffset", () => out.u8(OPCODES[kind]).u64(at).u64(length));
    }
    out.u8(OPCODES.footer).u64(20).u64(summary).u64(offsets);
    out.u32(crc32(out.written(summary)));
    return out.raw(McapWriter.MAGIC).written();
  }

  statistics() {
    const { out, counts } = this;
    out.u64([...counts.values()].reduce((sum, count) => sum + count, 0));
    out.u16(this.schemas.length).u32(this.channels.length).u32(0).u32(this.metadata.length).u32(this.chunks.length);
    out.u64(this.counts.size ? this.first : 0).u64(this.last);
    out.sized(4, () => counts.forEach((count, channel) => out.u16(channel).u64(count)));
  }
}
