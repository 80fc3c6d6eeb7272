// A viewer by Foxglove's own client library, for benchmarks/foxglove_viewers.py: subscribes to everything, counts what comes.
// In a folder where `npm install @foxglove/ws-protocol ws` was run: node foxglove_client.mjs ws://127.0.0.1:8765

import protocol from "@foxglove/ws-protocol";
import WebSocket from "ws";

const client = new protocol.FoxgloveClient({ ws: new WebSocket(process.argv[2], ["foxglove.sdk.v1"]) });
const topics = new Map(), counts = {}, status = [];
let last = Date.now(), first = true;
client.on("advertise", (channels) => {
  for (const { id, topic } of channels) {
    topics.set(client.subscribe(id), topic);
    counts[topic] = 0;
  }
  console.log("ready");
});
client.on("message", ({ subscriptionId }) => {
  const topic = topics.get(subscriptionId);
  counts[topic] += 1;
  if (topic === "/tacstrip/signatures") { last = Date.now(); first = false; }
});
client.on("status", ({ message }) => status.push(message));
client.on("error", (error) => { console.error(String(error)); process.exit(1); });
setInterval(() => {
  if (first || Date.now() - last < 2000) return;
  console.log(JSON.stringify({ ...counts, status }));
  process.exit(0);
}, 100);
