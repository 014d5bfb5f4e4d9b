// SPDX-License-Identifier: Apache-2.0
#include "training/evaluation/data_sets.h"

#include <algorithm>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "training/data/readers/crohd.h"
#include "training/data/readers/neutral.h"
#include "training/data/readers/point_odyssey.h"
#include "training/data/synthetic/synthetic_dataset.h"

namespace holdfast {
namespace {

using DatasetOr = absl::StatusOr<std::unique_ptr<Dataset>>;

// Not more than the first 'count' sequences.
class FirstSequences final : public Dataset {
 public:
  FirstSequences(std::unique_ptr<const Dataset> source, size_t count) : source_(std::move(source)), count_(count) {}
  size_t size() const override { return std::min(count_, source_->size()); }
  absl::StatusOr<Sample> Get(size_t index, Rng& rng) const override { return source_->Get(index, rng); }

 private:
  const std::unique_ptr<const Dataset> source_;
  const size_t count_;
};

DatasetOr OpenNeutral(const EvaluationDataOptions& options) {
  NeutralOptions neutral;
  neutral.root = options.dir;
  neutral.max_frames = options.frames;
  neutral.points = options.points;
  return Neutral::Create(neutral);
}

DatasetOr OpenPointOdyssey(const EvaluationDataOptions& options) {
  PointOdysseyOptions odyssey;
  odyssey.root = options.dir;
  odyssey.split = options.split;
  odyssey.frames = 0;
  odyssey.max_frames = options.frames;
  odyssey.points = options.points;
  odyssey.masks = false;
  return PointOdyssey::Create(odyssey);
}

DatasetOr OpenCrohd(const EvaluationDataOptions& options) {
  CrohdOptions crohd;
  crohd.root = options.dir;
  crohd.points = options.points;
  crohd.size = options.crohd_size;
  if (options.frames > 0) {
    crohd.clip_frames = options.frames;
    crohd.min_frames = std::min(crohd.min_frames, options.frames);
  }
  return Crohd::Create(crohd);
}

DatasetOr OpenSynthetic(const EvaluationDataOptions& options) {
  SyntheticOptions synthetic;
  synthetic.count = options.count > 0 ? options.count : 20;
  synthetic.seed = options.seed;
  synthetic.width = options.size.width;
  synthetic.height = options.size.height;
  synthetic.pictures = options.pictures;
  synthetic.alike_share = options.alike_share;
  if (options.frames > 0) synthetic.frames = options.frames;
  if (options.points > 0) synthetic.points = options.points;
  return SyntheticDataset::Create(synthetic);
}

// Rows of data: a converted TAP-Vid data set is a folder of clips in the neutral format.
struct Format {
  const char* name;
  bool needs_directory;
  DatasetOr (*open)(const EvaluationDataOptions& options);
};
constexpr Format kFormats[] = {{"neutral", true, OpenNeutral},
                               {"pointodyssey", true, OpenPointOdyssey},
                               {"tapvid", true, OpenNeutral},
                               {"crohd", true, OpenCrohd},
                               {"synthetic", false, OpenSynthetic}};

}  // namespace

std::vector<std::string> EvaluationFormats() {
  std::vector<std::string> names;
  for (const Format& format : kFormats) names.push_back(format.name);
  return names;
}

absl::StatusOr<std::unique_ptr<Dataset>> OpenEvaluationData(const EvaluationDataOptions& options) {
  const auto* format =
      std::find_if(std::begin(kFormats), std::end(kFormats), [&](const Format& f) { return options.format == f.name; });
  if (format == std::end(kFormats)) {
    return absl::InvalidArgumentError(
        absl::StrCat("unknown format \"", options.format, "\"; there are ", absl::StrJoin(EvaluationFormats(), ", ")));
  }
  if (options.frames < 0 || options.points < 0) {
    return absl::InvalidArgumentError("frames and points must not be negative");
  }
  if (format->needs_directory && options.dir.empty()) {
    return absl::InvalidArgumentError(absl::StrCat("format ", options.format, " needs the directory of the data"));
  }
  DatasetOr dataset = format->open(options);
  if (!dataset.ok() || options.count == 0) return dataset;
  return std::make_unique<FirstSequences>(*std::move(dataset), options.count);
}

}  // namespace holdfast
