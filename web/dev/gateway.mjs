// SPDX-License-Identifier: Apache-2.0
// Serves dist/ and carries WebSockets over to a gRPC server: node dev/gateway.mjs PORT GRPC_ADDRESS
import { createServer } from "node:http";
import { readFileSync, existsSync } from "node:fs";
import grpc from "@grpc/grpc-js";
import { WebSocketServer } from "ws";
const [, , port, address] = process.argv;
const dist = new URL("../dist/", import.meta.url);
const TYPES = { html: "text/html", js: "text/javascript", css: "text/css", svg: "image/svg+xml", mp4: "video/mp4", txt: "text/plain" };
const CSP = "default-src 'self'; connect-src 'self' ws: wss:; img-src 'self' blob: data:; media-src 'self' blob:; style-src 'self'; script-src 'self'; worker-src 'self' blob:";
const http = createServer((request, response) => {
  const path = new URL(request.url, "http://x").pathname.slice(1) || "index.html";
  if (path === "v1/info") {
    response.setHeader("content-type", "application/json");
    return response.end(JSON.stringify({ modelName: "holdfast", preset: "small", precision: "float32", device: "cpu", build: "dev", defaultProcessingSize: { width: 512, height: 384 }, windowFrames: 24, defaultHopFrames: 8, defaultIterations: 4, maxSessions: 16, limits: { maxPoints: 2048 } }));
  }
  const file = path === "clip.mp4" ? new URL("../../media/pedestrians.mp4", import.meta.url) : new URL(path, dist);
  if (!existsSync(file)) return response.writeHead(404).end();
  response.setHeader("content-type", TYPES[path.split(".").at(-1)] ?? "application/octet-stream");
  response.setHeader("content-security-policy", CSP);
  response.end(readFileSync(file));
});
const varint = (n) => { const out = []; while (n > 127) { out.push((n & 127) | 128); n >>>= 7; } out.push(n); return Buffer.from(out); };
const field = (tag, bytes) => Buffer.concat([Buffer.from([tag]), varint(bytes.length), bytes]);
const same = (x) => x;
new WebSocketServer({ server: http, path: "/v1/track", maxPayload: 64 << 20, handleProtocols: () => "holdfast.v1" }).on("connection", (ws) => {
  const client = new grpc.Client(address, grpc.credentials.createInsecure(), { "grpc.max_receive_message_length": -1, "grpc.max_send_message_length": -1 });
  const call = client.makeBidiStreamRequest("/holdfast.v1.PointTracking/Track", same, same);
  ws.on("message", (data) => {
    if (data.length === 2 && data[0] === 0x2a) return call.end();
    if (!call.write(data)) { ws.pause(); call.once("drain", () => ws.resume()); }
  });
  call.on("data", (data) => { ws.send(data); if (data[0] === 0x22) ws.close(1000); });
  call.on("error", (error) => {
    const details = error.metadata?.get("grpc-status-details-bin")[0];
    const status = details ?? Buffer.concat([Buffer.from([8, error.code]), field(0x12, Buffer.from(error.details))]);
    ws.send(field(0x3a, status));
    ws.close(1011);
  });
  ws.on("close", () => { call.cancel(); client.close(); });
});
http.listen(Number(port), "127.0.0.1", () => console.log("http://127.0.0.1:" + http.address().port));
