// SPDX-License-Identifier: Apache-2.0
import { create, fromBinary, toBinary } from "@bufbuild/protobuf";
import { writeFileSync } from "node:fs";
import { join } from "node:path";
import grpc from "@grpc/grpc-js";
import { TrackRequestSchema, type TrackResponse, TrackResponseSchema } from "../../src/gen/holdfast/v1/point_tracking_pb";
import { BIN, run, scratch } from "./server";

const same = (bytes: Buffer) => bytes;

/** The files of the very JPEGs that `holdfast track` sends of a video: a server that follows nothing writes them down. */
export async function sentFrames(video: string, count: number): Promise<string[]> {
  const folder = scratch();
  const paths: string[] = [];
  const track = (call: grpc.ServerDuplexStream<Buffer, Buffer>) => {
    const say = (response: TrackResponse["response"]) =>
      call.write(Buffer.from(toBinary(TrackResponseSchema, create(TrackResponseSchema, { response }))));
    call.on("data", (bytes: Buffer) => {
      const { request } = fromBinary(TrackRequestSchema, bytes);
      if (request.case === "config") say(accepted());
      if (request.case !== "frame") return;
      paths.push(join(folder, `${String(request.value.index).padStart(4, "0")}.jpg`));
      writeFileSync(paths.at(-1)!, request.value.data);
    });
    call.on("end", () => {
      say(summary());
      call.end();
    });
  };
  const server = new grpc.Server();
  const method = { path: "/holdfast.v1.PointTracking/Track", requestStream: true, responseStream: true };
  const plain = { requestSerialize: same, requestDeserialize: same, responseSerialize: same, responseDeserialize: same };
  server.addService({ Track: { ...method, ...plain } }, { Track: track });
  const port = await new Promise<number>((bound, failed) =>
    server.bindAsync("127.0.0.1:0", grpc.ServerCredentials.createInsecure(), (error, at) => (error ? failed(error) : bound(at))));
  // There is not one estimate, which the command line minds.
  await run(join(BIN, "holdfast"), ["track", video, `--server=127.0.0.1:${port}`, "--grid=1", `--max_frames=${count}`,
    `--out=${join(folder, "none.csv")}`]).catch(() => {});
  server.forceShutdown();
  if (paths.length !== count) throw new Error(`holdfast track sent ${paths.length} frames of ${count}`);
  return paths;
}

const accepted = () =>
  create(TrackResponseSchema, {
    response: {
      case: "accepted",
      value: { sessionId: "record", processingSize: { width: 256, height: 192 }, hopFrames: 8, iterations: 1, windowFrames: 24,
        limits: { maxPoints: 1, maxFrameBytes: 1n << 24n, maxFramePixels: 1n << 24n } },
    },
  }).response;

const summary = () => create(TrackResponseSchema, { response: { case: "summary", value: {} } }).response;
