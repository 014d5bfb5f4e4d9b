// SPDX-License-Identifier: Apache-2.0
import {
  BlobSource,
  CanvasSink,
  EncodedPacketSink,
  Input,
  type InputVideoTrack,
  MATROSKA,
  MP4,
  QTFF,
  WEBM,
} from "mediabunny";
import { type Encoding, JpegEncoder, type Picture, sentSize, type Source } from "./source";

interface TimedImage {
  image: CanvasImageSource;
  seconds: number; // its place in the file
}

/** A video file, every frame of it in the order of presentation. */
export async function openVideo(file: Blob, label: string, encoding: Encoding): Promise<Source> {
  const input = new Input({ formats: [MP4, QTFF, MATROSKA, WEBM], source: new BlobSource(file) });
  const track = await input.getPrimaryVideoTrack().catch(() => null);
  if (!track) throw new Error(`${label} has no video that can be read: expected .mp4, .mov, .mkv or .webm.`);
  const stats = await track.computePacketStats();
  const own = { width: await track.getDisplayWidth(), height: await track.getDisplayHeight() };
  const size = sentSize(own, encoding);
  const codec = await track.getCodec();
  const refused = `${label} is a video${codec ? ` (${codec})` : ""} that this browser does not decode: most know H.264, VP9 and AV1.`;
  const images = (await decodes(track)) ? decoded(track) : sought(track, file, refused);
  const encoder = new JpegEncoder(size.width, size.height, encoding.quality);
  let begin: number | null = null;

  const next = async (): Promise<Picture | null> => {
    const step = await images.next();
    if (step.done) return null;
    begin ??= step.value.seconds;
    return { jpeg: await encoder.encode(step.value.image), seconds: step.value.seconds - begin };
  };
  const close = () => {
    void images.return(undefined);
    input.dispose();
  };
  const fps = stats.averagePacketRate;
  return { label, live: false, ...size, own, fps, frames: stats.packetCount, dropped: 0, next, close };
}

// Browsers have decoders for pages of https and localhost only.
const decodes = async (track: InputVideoTrack) => "VideoDecoder" in window && (await track.canDecode());

async function* decoded(track: InputVideoTrack): AsyncGenerator<TimedImage, void> {
  for await (const { canvas, timestamp } of new CanvasSink(track, { poolSize: 3 }).canvases()) {
    yield { image: canvas, seconds: timestamp };
  }
}

// Where there is no decoder, a video element is led from frame to frame: slower, and as exact.
async function* sought(track: InputVideoTrack, file: Blob, refused: string): AsyncGenerator<TimedImage, void> {
  const times: [number, number][] = [];
  for await (const packet of new EncodedPacketSink(track).packets(undefined, undefined, { metadataOnly: true })) {
    times.push([packet.timestamp, packet.duration]);
  }
  times.sort(([a], [b]) => a - b);
  const video = document.createElement("video");
  video.muted = true;
  video.src = URL.createObjectURL(file);
  try {
    for (const [start, duration] of times) {
      await seek(video, start + duration / 2, refused);
      yield { image: video, seconds: start };
    }
  } finally {
    URL.revokeObjectURL(video.src);
    video.removeAttribute("src");
  }
}

function seek(video: HTMLVideoElement, seconds: number, refused: string): Promise<void> {
  return new Promise((resolve, reject) => {
    video.onseeked = () => resolve();
    video.onerror = () => reject(new Error(refused));
    video.currentTime = seconds;
  });
}
