// SPDX-License-Identifier: Apache-2.0
import { type Encoding, JpegEncoder, type Picture, sentSize, type Size, type Source } from "./source";

const DEFAULT_FPS = 30; // of a camera that promises none

/** Why there can be no camera, or null. */
export function noCamera(): string | null {
  if (!window.isSecureContext) return "Browsers give a camera to pages of https and localhost only.";
  return navigator.mediaDevices ? null : "This browser gives no camera.";
}

/** A camera's newest frame, whenever one is asked for. */
export async function openCamera(encoding: Encoding): Promise<Source> {
  const stream = await navigator.mediaDevices.getUserMedia({
    video: { width: { ideal: 1280 }, height: { ideal: 720 }, facingMode: "environment" },
  });
  const video = document.createElement("video");
  video.muted = video.playsInline = true;
  video.srcObject = stream;
  try {
    await video.play();
  } catch (error) {
    for (const track of stream.getTracks()) track.stop();
    throw error;
  }
  const settings = stream.getVideoTracks()[0]!.getSettings();
  return new Camera(stream, video, settings.frameRate || DEFAULT_FPS, encoding);
}

class Camera implements Source {
  readonly label = "Camera";
  readonly live = true;
  readonly width: number;
  readonly height: number;
  readonly own: Size;
  readonly frames = null;
  dropped = 0;
  private readonly encoder: JpegEncoder;
  private begin: number | null = null; // of the first frame, and later by what was skipped since
  private last = 0; // seconds of the frame given last
  private shown = 0; // frames that the video had shown with the one given last; 0: none of them is missed
  private skipped = false; // between the frame given last and the next one
  private ended = false;
  private wake: (() => void) | null = null;

  constructor(
    private readonly stream: MediaStream,
    private readonly video: HTMLVideoElement,
    readonly fps: number,
    encoding: Encoding,
  ) {
    this.own = { width: video.videoWidth, height: video.videoHeight };
    ({ width: this.width, height: this.height } = sentSize(this.own, encoding));
    this.encoder = new JpegEncoder(this.width, this.height, encoding.quality);
    for (const track of stream.getTracks()) track.onended = () => this.close(); // unplugged
  }

  async next(): Promise<Picture | null> {
    const frame = await this.newFrame();
    if (!frame) return null;
    this.expectUnturned();
    if (this.shown > 0) this.dropped += Math.max(0, frame.presentedFrames - this.shown - 1);
    this.shown = frame.presentedFrames;
    this.begin ??= frame.mediaTime;
    if (this.skipped) this.begin = frame.mediaTime - this.last - 1 / this.fps;
    this.skipped = false;
    this.last = frame.mediaTime - this.begin;
    return { jpeg: await this.encoder.encode(this.video), seconds: this.last };
  }

  skip(): void {
    this.shown = 0;
    this.skipped = this.begin !== null;
  }

  close(): void {
    this.ended = true;
    for (const track of this.stream.getTracks()) track.stop();
    this.video.srcObject = null;
    this.wake?.();
  }

  // Frames of another size, squashed into that of the first, would be followed as if the scene had moved so.
  private expectUnturned(): void {
    const { videoWidth, videoHeight } = this.video;
    const { width, height } = this.own;
    if (videoWidth === width && videoHeight === height) return;
    throw new Error(`The camera was turned: its frames were ${width}×${height}, and are ${videoWidth}×${videoHeight} now. Start it anew.`);
  }

  private newFrame(): Promise<VideoFrameCallbackMetadata | null> {
    return new Promise((resolve) => {
      if (this.ended) return resolve(null);
      this.wake = () => resolve(null);
      this.video.requestVideoFrameCallback((_now, frame) => resolve(frame));
    });
  }
}
