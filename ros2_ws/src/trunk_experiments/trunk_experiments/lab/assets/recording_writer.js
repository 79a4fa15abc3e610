"use strict";
// Writes one run into one MCAP file with the digests and the summary of a bag that the project's readers ask for.
class RecordingWriter {
  // Names of our metadata records.
  static DIGESTS = "trunk_digests";
  static END = "trunk_end";
  static BAG = "rosbag2";
  static PROVENANCE = "trunk_provenance";

  // `header`: profile and library; `types`: each type's definition, metadata of its channels and part of the summary.
  constructor({ header, types, summary }) {
    this.mcap = new McapWriter(...header);
    this.types = types;
    this.summary = summary;
    this.schemas = new Map(); // type -> number
    this.topics = new Map(); // topic -> { channel, type, digest }
    this.heads = new Blake2b();
    this.digested = { header, channels: [], metadata: [] };
  }

  static canonical(value) {
    if (Array.isArray(value)) return `[${value.map(RecordingWriter.canonical)}]`;
    if (typeof value !== "object") {
      return JSON.stringify(value).replace(/[\u007f-\uffff]/g, (c) => `\\u${c.charCodeAt(0).toString(16).padStart(4, "0")}`);
    }
    return `{${Object.keys(value).sort().map((key) => `${RecordingWriter.canonical(key)}:${RecordingWriter.canonical(value[key])}`)}}`;
  }

  static digestOf(value) { return new Blake2b().update(UTF8.encode(RecordingWriter.canonical(value))).hex(); }

  // Add a topic, unless it is there.
  addTopic(topic, type) {
    if (this.topics.has(topic)) return;
    const { mcap, schemas } = this;
    const { definition, metadata } = this.types[type];
    if (!schemas.has(type)) schemas.set(type, mcap.addSchema(type, "ros2msg", definition));
    const channel = mcap.addChannel(topic, "cdr", schemas.get(type), metadata);
    this.topics.set(topic, { channel, type, digest: new Blake2b() });
    this.digested.channels.push([channel, topic, "cdr", metadata, [type, "ros2msg", hexOf(UTF8.encode(definition))]]);
  }

  // Add a message; one stamped before the first state is logged with it.
  add(topic, ns, message) {
    const { channel, digest } = this.topics.get(topic);
    const at = this.mcap.addMessage(channel, Math.max(ns, 0), message);
    this.heads.update(this.mcap.out.written(at, at + McapWriter.MESSAGE_HEAD));
    digest.update(message);
  }

  addMetadata(name, values) {
    this.mcap.addMetadata(name, values);
    this.digested.metadata.push([name, values]);
  }

  // Write how the run has ended; return the file.
  finish(complete, reason) {
    this.mcap.closeChunk();
    this.addMetadata(RecordingWriter.BAG, { serialized_metadata: this.bag() });
    this.addMetadata(RecordingWriter.END, { complete: String(complete), reason });
    const digests = Object.fromEntries([...this.topics].map(([topic, { digest }]) => [topic, digest.hex()]));
    digests.heads = this.heads.hex();
    for (const part of ["channels", "metadata", "header"]) digests[part] = RecordingWriter.digestOf(this.digested[part]);
    this.mcap.addMetadata(RecordingWriter.DIGESTS, { ...digests, attachments: "0" });
    return this.mcap.finish();
  }

  // What rosbag2 keeps of a bag, as YAML.
  bag() {
    const { counts, first, last } = this.mcap;
    let total = 0;
    const parts = [...this.topics].map(([topic, { channel, type }]) => {
      const count = counts.get(channel) ?? 0;
      total += count;
      return this.types[type].summary.replace("TOPIC", topic).replace("COUNT", count);
    });
    const [head, tail] = this.summary;
    return head.replace("DURATION", last - first).replace("COUNT", total) + parts.join("") + tail;
  }
}
