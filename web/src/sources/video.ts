// SPDX-License-Identifier: Apache-2.0
import {
  BlobSource,
  CanvasSink,
  type EncodedPacket,
  EncodedPacketSink,
  Input,
  type InputVideoTrack,
  MATROSKA,
  MP4,
  QTFF,
  WEBM,
} from "mediabunny";
import { type Encoding, JpegEncoder, type Picture, sentSize, type Size, type Source } from "./source";

const DEFAULT_FPS = 30; // of a video of one frame, or whose frames have no times

interface TimedImage {
  image: CanvasImageSource;
  seconds: number; // its place in the file
}

/** A video file, every frame of it in the order of presentation. */
export async function openVideo(file: Blob, label: string, encoding: Encoding): Promise<Source> {
  const input = new Input({ formats: [MP4, QTFF, MATROSKA, WEBM], source: new BlobSource(file) });
  const track = await input.getPrimaryVideoTrack().catch(() => null);
  if (!track) throw new Error(`${label} has no video that can be read: expected .mp4, .mov, .mkv or .webm.`);
  const shown = await shownPackets(track);
  const own = await storedSize(track);
  const size = sentSize({ width: await track.getDisplayWidth(), height: await track.getDisplayHeight() }, encoding);
  const codec = await track.getCodec();
  const refused = `${label} is a video${codec ? ` (${codec})` : ""} that this browser does not decode: most know H.264, VP9 and AV1.`;
  const images = (await decodes(track)) ? decoded(track) : sought(shown, file, refused);
  const encoder = new JpegEncoder(size.width, size.height, encoding.quality);
  let begin: number | null = null;
  let failure: unknown = null; // stays: a generator that failed would say that the video has ended

  const next = async (): Promise<Picture | null> => {
    if (failure) throw failure;
    const step = await images.next().catch((error: unknown) => {
      throw (failure = error);
    });
    if (step.done) return null;
    begin ??= step.value.seconds;
    return { jpeg: await encoder.encode(step.value.image), seconds: step.value.seconds - begin };
  };
  const close = () => {
    void images.return(undefined);
    input.dispose();
  };
  return { label, live: false, ...size, own, fps: rateOf(shown), frames: shown.length, dropped: 0, next, close };
}

// Of frames as they are stored, once they are turned: pixels of tracks are these, also where they are not square.
async function storedSize(track: InputVideoTrack): Promise<Size> {
  const [width, height] = [await track.getCodedWidth(), await track.getCodedHeight()];
  return (await track.getRotation()) % 180 === 0 ? { width, height } : { width: height, height: width };
}

/**
 * Those of the frames that are to be seen, in the order of presentation. Trimming leaves frames in a file, with times
 * below 0, as those behind it need them to be decoded.
 */
async function shownPackets(track: InputVideoTrack): Promise<EncodedPacket[]> {
  const shown: EncodedPacket[] = [];
  for await (const packet of new EncodedPacketSink(track).packets(undefined, undefined, { metadataOnly: true })) {
    if (packet.timestamp >= 0) shown.push(packet);
  }
  return shown.sort((a, b) => a.timestamp - b.timestamp);
}

// Frames a second; of a rate that varies, its mean.
function rateOf(shown: readonly EncodedPacket[]): number {
  const seconds = (shown.at(-1)?.timestamp ?? 0) - (shown[0]?.timestamp ?? 0);
  return seconds > 0 ? (shown.length - 1) / seconds : DEFAULT_FPS;
}

// Browsers have decoders for pages of https and localhost only.
const decodes = async (track: InputVideoTrack) => "VideoDecoder" in window && (await track.canDecode());

async function* decoded(track: InputVideoTrack): AsyncGenerator<TimedImage, void> {
  for await (const { canvas, timestamp } of new CanvasSink(track, { poolSize: 3 }).canvases(0)) {
    if (timestamp >= 0) yield { image: canvas, seconds: timestamp }; // not what began before 0, and is on then
  }
}

// Where there is no decoder, a video element is led from frame to frame: slower, and as exact.
async function* sought(shown: readonly EncodedPacket[], file: Blob, refused: string): AsyncGenerator<TimedImage, void> {
  const video = document.createElement("video");
  video.muted = true;
  try {
    await happens(video, "loadedmetadata", refused, () => (video.src = URL.createObjectURL(file)));
    for (const { timestamp, duration } of shown) {
      await happens(video, "seeked", refused, () => (video.currentTime = timestamp + duration / 2));
      yield { image: video, seconds: timestamp };
    }
  } finally {
    URL.revokeObjectURL(video.src);
    video.removeAttribute("src");
  }
}

type VideoEvent = "loadedmetadata" | "seeked";

function happens(video: HTMLVideoElement, event: VideoEvent, refused: string, act: () => void): Promise<void> {
  return new Promise((resolve, reject) => {
    video[`on${event}`] = () => resolve();
    video.onerror = () => reject(new Error(refused));
    act();
  });
}
