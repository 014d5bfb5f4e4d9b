// SPDX-License-Identifier: Apache-2.0
// Annotations of the neutral format: the input is a clip's tracks.json, beside two frames of 8 x 8 pixels.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "tests/fuzz/fuzz_input.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/data/readers/neutral.h"

namespace holdfast {
namespace {

// A folder that is a clip, once it has its annotations.
class Clip {
 public:
  Clip() {
    std::filesystem::create_directory(directory_.File("frames"));
    for (const char* name : {"frames/00000.png", "frames/00001.png"}) {
      EXPECT_TRUE(cv::imwrite(directory_.File(name), cv::Mat(8, 8, CV_8UC3, cv::Scalar(1, 2, 3))));
    }
    Annotate("{}");
  }

  void Annotate(absl::string_view text) const {
    std::ofstream(directory_.File("tracks.json"), std::ios::binary) << text;
  }
  std::string path() const { return directory_.path().string(); }

 private:
  const TempDir directory_;
};

}  // namespace
}  // namespace holdfast

extern "C" int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
  static const holdfast::Clip clip;
  clip.Annotate(holdfast::FuzzInput(data, size).TakeRest());
  const auto dataset = holdfast::Neutral::Create({clip.path()});
  EXPECT_THAT(dataset, holdfast::IsOk());
  holdfast::Rng rng(1);
  const auto sample = (*dataset)->Get(0, rng);
  if (sample.ok()) {
    EXPECT_EQ(sample->num_frames(), 2);
  }
  return 0;
}
