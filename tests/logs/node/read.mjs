// Reads a log with the library that Foxglove and Lichtblick use, decodes every message, and prints what it
// found as JSON: { topics: { name: { schema, encoding, count } }, attachments, metadata }.
import { McapIndexedReader } from "@mcap/core";
import { decompress } from "fzstd";
import { open } from "node:fs/promises";
import protobuf from "protobufjs";
import descriptor from "protobufjs/ext/descriptor/index.js";

const file = await open(process.argv[2]);
const readable = {
  size: async () => BigInt((await file.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await file.read(buffer, 0, buffer.length, Number(offset));
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({
  readable,
  decompressHandlers: { zstd: (data, size) => decompress(data, new Uint8Array(Number(size))) },
});

const kinds = new Map();
function decode(schema, data) {
  if (schema.encoding === "jsonschema") {
    const value = JSON.parse(new TextDecoder().decode(data));
    for (const name of JSON.parse(new TextDecoder().decode(schema.data)).required) {
      if (!(name in value)) throw new Error(`${schema.name} lacks ${name}`);
    }
    return;
  }
  if (!kinds.has(schema.name)) {
    const root = protobuf.Root.fromDescriptor(descriptor.FileDescriptorSet.decode(schema.data));
    kinds.set(schema.name, root.lookupType(schema.name));
  }
  kinds.get(schema.name).decode(data);
}

const topics = {};
let last = 0n;
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId);
  const schema = reader.schemasById.get(channel.schemaId);
  decode(schema, message.data);
  if (message.logTime < last) throw new Error("messages out of order");
  last = message.logTime;
  topics[channel.topic] ??= { schema: schema.name, encoding: channel.messageEncoding, count: 0 };
  topics[channel.topic].count += 1;
}
const attachments = [];
for await (const attachment of reader.readAttachments()) attachments.push(attachment.name);
const metadata = [];
for await (const record of reader.readMetadata()) metadata.push(record.name);
console.log(JSON.stringify({ topics, attachments, metadata }));
await file.close();
