// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "absl/status/status.h"
#include "api/types.h"
#include "server/engine/checkpoint_sealer.h"
#include "server/engine/evidence.h"

namespace holdfast {

enum class Precision { kAuto, kFloat32, kBFloat16 };  // kAuto: bfloat16 where the device computes it fast and right
enum class Chaining {
  kStandard,   // later windows start with f2 = f4 = f1
  kPublished,  // later windows carry f2 and f4 over, as the published test script does (hop window-1, evaluation only)
};

// What an operator decides once for all sessions. Fields that are "default of sessions" hold where a session's
// configuration leaves them open.
struct EngineOptions {
  std::string weights_path;    // safetensors file of the network
  std::string device = "cpu";  // as LibTorch names it: "cpu", "cuda", "cuda:1"
  // bfloat16 takes less time and half the memory on processors with AVX512_BF16 and GPUs from compute capability 8.0
  // on, and moves tracks by fractions of a pixel. Force float32 to compare results between machines.
  Precision precision = Precision::kAuto;
  // Threads that share a batch of frames or rows, and a single operation where there is too little to share; 0: all
  // cores that the process may use. Fewer leave cores to decoding and to neighbours, and make a window take longer.
  int compute_threads = 0;
  // Threads that decode frames and compute optical flow; of several, the last free one is kept for sessions that use
  // little. More help where many cameras send large frames.
  int decode_threads = 2;
  // Default of sessions: what frames are resized to before the network sees them; multiples of kProcessingSizeStep.
  // Time and memory of a frame grow with its pixels; small details are lost below the video's own size.
  ImageSize processing_size = {512, 384};
  // Default of sessions: new frames between two windows. Smaller revises estimates more often and costs a window each
  // time; larger is cheaper and answers later.
  int hop_frames = 8;
  // Default of sessions: refinement iterations of a window, at most. Each costs the same and moves estimates less than
  // the one before.
  int iterations = 4;
  // A point's window ends early, after an iteration that moved the point by less than this many pixels of the
  // processing size on every frame; chosen on annotated real video. 0: none does. Off under kPublished.
  double least_step = 0.5;
  Chaining chaining = Chaining::kStandard;
  // Default of sessions: windows start from where optical flow leads, which follows faster motion and costs a few
  // milliseconds a frame on a decode thread. Off under kPublished.
  bool motion_prior = true;
  // Default of sessions: final positions are moved to where the picture says, which is finer than the network's grid
  // and costs decode threads a few milliseconds a frame. Off under kPublished.
  bool polish = true;
  int max_sessions = 16;  // at once; further ones are refused, and told when to come back
  // The share of the time of computing that sessions may be promised; the rest is for bursts, and for what the
  // processor does beside. A session that does not fit is refused. 0: sessions are not counted by work.
  double max_load = 0.8;
  // What a session that names no frame rate is promised. One that is alone is served at any pace.
  double least_frames_per_second = 0.5;
  int max_batch_rows =
      256;  // rows of one refinement batch, over all sessions: more is more throughput and a longer wait
  int max_batch_frames = 4;  // frames of one encoder batch, over all sessions
  // Accepted frames of a session that are not encoded yet; then PushFrame says "full". Bounds memory and delay alike.
  int max_pending_frames = 8;
  // Features and pictures of all sessions; a session that would not fit is refused.
  int64_t cache_budget_bytes = int64_t{4} << 30;
  int64_t max_processing_pixels = int64_t{1024} * 1024;  // of a session's processing size
  int max_iterations = 16;                               // of a session
  SessionLimits limits{/*max_points=*/2048, /*max_frame_bytes=*/int64_t{16} << 20,
                       /*max_frame_pixels=*/int64_t{3840} * 2160,
                       /*max_frames=*/0};

  // Makes the tokens of checkpoints; null: sessions have none. Not owned.
  const CheckpointSealer* sealer = nullptr;
  // For who fits a calibration; empty: nobody. Must be thread-safe where several sessions are open.
  EvidenceSink evidence;

  absl::Status Validate() const;
};

}  // namespace holdfast
