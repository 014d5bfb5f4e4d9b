// SPDX-License-Identifier: Apache-2.0

/** A frame as it is sent. */
export interface Picture {
  jpeg: Uint8Array<ArrayBuffer>;
  seconds: number; // since the first frame
}

export interface Size {
  width: number; // pixels
  height: number;
}

/** Where frames come from. They have one size, and are given one at a time. */
export interface Source {
  readonly label: string;
  /** Does not wait: what is not asked for in time is dropped, and it ends only when it is told to. */
  readonly live: boolean;
  readonly width: number; // of the frames as they are sent, pixels
  readonly height: number;
  /** Of the frames as the source has them: larger where they are shrunk before they are sent. */
  readonly own: Size;
  readonly fps: number; // as recorded, or as promised by a camera
  readonly frames: number | null; // in all, where that is known
  /** Frames that a live source had and nobody asked for. */
  readonly dropped: number;
  /** Null: it has ended. */
  next(): Promise<Picture | null>;
  /** Frames of a live source that came until now were not wanted: neither they nor their time count as missing. */
  skip?(): void;
  close(): void;
}

/** How frames are made ready for sending. */
export interface Encoding {
  maxSide: number; // pixels of the longer side; larger frames are shrunk; 0: never
  quality: number; // of JPEG, 0 .. 1
}

export function sentSize({ width, height }: Size, { maxSide }: Encoding): Size {
  const factor = maxSide > 0 ? Math.min(1, maxSide / Math.max(width, height)) : 1;
  const scaled = (side: number) => Math.max(1, Math.round(side * factor));
  return { width: scaled(width), height: scaled(height) };
}

/** Takes coordinates in frames of one size to those in frames of another. */
export interface Resizing {
  x(x: number): number;
  y(y: number): number;
}

/**
 * From pixels of the frames sent to those of the source's own frames, where files have their positions. Frames are shrunk
 * edge to edge, and (0, 0) is the centre of the first pixel: half a pixel lies between it and the edge. It is what
 * `holdfast track --max_side` does (FrameEncoder::FromSent), to the last digit.
 */
export function toOwnPixels({ width, height, own }: Pick<Source, "width" | "height" | "own">): Resizing {
  const resized = (at: number, from: number, to: number) => Math.fround(((at + 0.5) * to) / from - 0.5);
  return { x: (x) => resized(x, width, own.width), y: (y) => resized(y, height, own.height) };
}

/** Makes JPEGs of one size. */
export class JpegEncoder {
  private readonly canvas: OffscreenCanvas;
  private readonly context: OffscreenCanvasRenderingContext2D;

  constructor(
    width: number,
    height: number,
    private readonly quality: number,
  ) {
    this.canvas = new OffscreenCanvas(width, height);
    this.context = this.canvas.getContext("2d", { alpha: false })!;
    this.context.imageSmoothingQuality = "high";
  }

  async encode(image: CanvasImageSource): Promise<Uint8Array<ArrayBuffer>> {
    this.context.drawImage(image, 0, 0, this.canvas.width, this.canvas.height);
    const blob = await this.canvas.convertToBlob({ type: "image/jpeg", quality: this.quality });
    return new Uint8Array(await blob.arrayBuffer());
  }
}
