// SPDX-License-Identifier: Apache-2.0

/** A message of the session, as bytes. */
export interface Message {
  bytes: Uint8Array;
  frame: number | null; // its index, where it is a frame
}

/**
 * What was said in a session since its newest checkpoint, to be sent again to the server that goes on: messages in
 * their order, the first `sent` of which have left. The rules are those of the other clients (client/replay_buffer.h).
 */
export class ReplayBuffer {
  bytes = 0;
  frames = 0;
  private messages: Message[] = [];
  private sent = 0;
  private keeping = true;

  /** False: this session ends with its server; what was sent is forgotten at once. */
  get keeps(): boolean {
    return this.keeping;
  }

  get unsent(): number {
    return this.messages.length - this.sent;
  }

  push(message: Message): void {
    this.messages.push(message);
    this.bytes += message.bytes.length;
    if (message.frame !== null) ++this.frames;
  }

  /** The oldest message that has not left. */
  peek(): Message | undefined {
    return this.messages[this.sent];
  }

  /** Counts that message as sent. */
  advance(): void {
    if (this.unsent === 0) return;
    ++this.sent;
    if (!this.keeping) this.dropFirst(1);
  }

  /** Everything is to be sent again. False: the server would go on at a frame that is gone. */
  rewind(firstFrame: number): boolean {
    this.sent = 0;
    const first = this.messages.find((message) => message.frame !== null);
    return first === undefined || first.frame! <= firstFrame;
  }

  /**
   * A checkpoint wants no frame before this one. The newest frame before it stays, for what follows it in the stream
   * speaks of it. False: the checkpoint is of no use, as a frame that it wants is gone.
   */
  dropBefore(frame: number): boolean {
    let begin = -1;
    for (let i = 0; i < this.messages.length; ++i) {
      const index = this.messages[i]!.frame;
      if (index === null) continue;
      if (index > frame) break;
      begin = i;
    }
    if (begin < 0) return this.frames === 0;
    this.dropFirst(Math.min(begin, this.sent));
    return true;
  }

  keepNothing(): void {
    this.keeping = false;
    this.dropFirst(this.sent);
  }

  private dropFirst(count: number): void {
    for (const message of this.messages.splice(0, count)) {
      this.bytes -= message.bytes.length;
      if (message.frame !== null) --this.frames;
    }
    this.sent -= count;
  }
}
