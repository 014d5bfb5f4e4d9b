// SPDX-License-Identifier: Apache-2.0
// The seam between the engine and the network: frames in, opaque features out, rows of points moved. Plain values, so
// that sessions, batches and windows know no tensor and are tested without a network.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "absl/types/span.h"
#include "api/types.h"

namespace holdfast {

struct RgbImage {
  ImageSize size;
  std::vector<uint8_t> pixels;  // [height, width, 3]
};

// What a model made of one frame. Immutable; only its model looks inside.
class FrameFeatures {
 public:
  virtual ~FrameFeatures() = default;
  virtual int64_t bytes() const = 0;
};
using FrameFeaturesPtr = std::shared_ptr<const FrameFeatures>;

struct Position {  // feature pixels: image pixels of the processing size / stride
  float x = 0;
  float y = 0;
};

// The templates of a window's last iteration, [S, C] each; Chaining::kPublished carries them to the next window.
struct CarriedTemplates {
  std::vector<float> f2;
  std::vector<float> f4;
};

// One point in one window. Borrows; the owner outlives the call it is passed to.
struct WindowRow {
  std::vector<Position> start;                // [S] initial positions; the first stays where it is
  absl::Span<const float> feature;            // [C] f1: the template sampled at the query
  const CarriedTemplates* carried = nullptr;  // of the window before; null: f1 at every frame
};

// Rows that share their frames.
struct WindowGroup {
  std::vector<FrameFeaturesPtr> frames;  // [S], all of one size; the same one may stand several times
  std::vector<WindowRow> rows;
};

struct RowEstimate {
  std::vector<Position> positions;      // [S]
  std::vector<float> visibility_logit;  // [S]; empty without a visibility head
  std::vector<float> similarity;        // [S] cosine of the template and the feature at the estimate
  std::vector<float> last_step;         // [S] feature pixels moved in the last iteration of the row
  int iterations = 0;                   // those of the row
  CarriedTemplates templates;           // empty unless asked for
};

// What the network costs the thread that runs it, in seconds. Zero: unknown.
struct WorkCosts {
  double pixel = 0;  // to encode one pixel of the processing size
  double batch = 0;  // of one iteration of a batch of rows, however few they are
  double row = 0;    // of one iteration of one row more
};

struct ModelInfo {
  std::string name;
  std::string preset;
  std::string weights_sha256;
  std::string precision;
  std::string device;
  std::string calibration;  // of confidence, as Calibration::FromJson takes it; empty: there is none
  int window_frames = 24;   // S
  int stride = 8;           // image pixels a feature pixel
  int channels = 0;         // C: values of a template, as Sample gives and Refine takes them
  WorkCosts costs;          // as they were measured when the network was warmed up
};

// A network that is ready to run. info() and FrameBytes() may be called from any thread; the others from one thread,
// after PrepareThread() on it. They throw what the network throws: std::bad_alloc when memory ends, std::exception for
// a bug.
class TrackerModel {
 public:
  virtual ~TrackerModel() = default;
  virtual const ModelInfo& info() const = 0;
  // Bytes of the features of a frame of this processing size.
  virtual int64_t FrameBytes(ImageSize size) const = 0;
  virtual void PrepareThread() = 0;
  // Images of one size -> their features, in order. No image changes another's features.
  virtual std::vector<FrameFeaturesPtr> Encode(absl::Span<const RgbImage* const> images) = 0;
  // Features at positions, bilinear and clamped to the map: a template of [C] values each.
  virtual std::vector<std::vector<float>> Sample(const FrameFeatures& frame, absl::Span<const Position> at) = 0;
  struct RefineOptions {
    int iterations = 4;  // at most
    bool keep_templates = false;
    // Feature pixels: a row ends after an iteration that moved it by less on every frame. 0: no row ends early.
    // REQUIRES: 0 with keep_templates.
    double least_step = 0;
  };
  // Estimates of every row of every group, in order. No row changes another's.
  virtual std::vector<RowEstimate> Refine(absl::Span<const WindowGroup> groups, const RefineOptions& options) = 0;
};

}  // namespace holdfast
