// The protocol's own client in TypeScript, and protobufjs: node watch.js ADDRESS TOPIC COUNT
"use strict";
const { FoxgloveClient } = require("@foxglove/ws-protocol");
const protobuf = require("protobufjs");
require("protobufjs/ext/descriptor");
const { WebSocket } = require("ws");

function main(address, topic, count) {
  // The package's own list of protocols is of its last release; that of the viewers goes on.
  const socket = new WebSocket(address, ["foxglove.sdk.v1"]);
  const client = new FoxgloveClient({ ws: socket });
  const said = { channels: {}, seen: [] };
  const readers = new Map();
  client.on("serverInfo", (info) => { said.name = info.name; });
  client.on("advertise", (channels) => {
    for (const channel of channels) {
      said.channels[channel.topic] = channel.schemaName;
      if (channel.topic !== topic) continue;
      const data = Buffer.from(channel.schema, "base64");
      const root = protobuf.Root.fromDescriptor(data);
      readers.set(client.subscribe(channel.id), root.lookupType(channel.schemaName));
    }
  });
  client.on("message", ({ subscriptionId, data }) => {
    const type = readers.get(subscriptionId);
    const message = type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    said.seen.push(type.toObject(message, { longs: Number }));
    if (said.seen.length < count) return;
    console.log(JSON.stringify(said));
    client.close();
    process.exit(0);
  });
  client.on("error", (error) => { console.error(error); process.exit(1); });
}

main(process.argv[2], process.argv[3], Number(process.argv[4]));
setTimeout(() => { console.error("nothing came"); process.exit(1); }, 60000);
