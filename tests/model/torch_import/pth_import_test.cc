// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/pth_import.h"

#include <gmock/gmock.h>
#include <torch/types.h>

#include "model/checkpoint/checkpoint.h"
#include "model/presets.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::Eq;
using ::testing::HasSubstr;

const std::string kPthFixture = InSourceTree("tests/data/tiny.pth");

StateDict StateOf(const ModelOptions& options) {
  const PointModel model(options);
  return ToTensorFile(*model, torch::kFloat32, {}).tensors;
}

ModelOptions Tiny() {
  ModelOptions options;
  options.encoder_channels = {4, 4, 6, 8};
  options.encoder_mid = 8;
  options.feature_channels = 8;
  options.context_blocks = 0;
  options.correlation_levels = 2;
  options.correlation_radius = 1;
  options.update_base = 4;
  return options;
}

TEST(InferModelOptionsTest, ShapesTellTheOptionsOfThePublishedNetwork) {
  EXPECT_THAT(InferModelOptions(StateOf(*PresetByName("pips2")), {}), IsOkAndHolds(Eq(*PresetByName("pips2"))));
}

TEST(InferModelOptionsTest, ShapesTellAttentionAndTheVisibilityHead) {
  for (const std::string name : {"paper", "small", "test"}) {
    const ModelOptions preset = *PresetByName(name);
    ImportOptions import;
    import.context_heads = preset.context_heads;
    EXPECT_THAT(InferModelOptions(StateOf(preset), import), IsOkAndHolds(Eq(preset))) << name;
  }
}

TEST(InferModelOptionsTest, EveryPyramidIsTold) {
  for (int64_t levels = 1; levels <= 6; ++levels) {
    for (int64_t radius = 1; radius <= 8; ++radius) {
      ModelOptions options = Tiny();
      options.correlation_levels = levels;
      options.correlation_radius = radius;
      StateDict shapes = StateOf(Tiny());
      shapes["delta_block.first_block_conv.conv.weight"] =
          torch::zeros({options.update_base, options.CorrelationFeatures() + options.feature_channels + 2, 3});
      EXPECT_THAT(InferModelOptions(shapes, {}), IsOkAndHolds(Eq(options))) << levels << " " << radius;
    }
  }
}

TEST(InferModelOptionsTest, AStateDictOfAnotherNetworkIsRefusedByTheFirstNameThatIsMissing) {
  EXPECT_THAT(InferModelOptions({{"conv1.weight", torch::zeros({1})}}, {}),
              StatusIs(kInvalid, HasSubstr("'fnet.layer1.0.conv1.weight' is missing: not a PIPs++ checkpoint")));
  StateDict shapes = StateOf(Tiny());
  shapes["fnet.conv3.weight"] = torch::zeros({8});
  EXPECT_THAT(InferModelOptions(shapes, {}), StatusIs(kInvalid, HasSubstr("'fnet.conv3.weight' has shape [8]")));
  shapes = StateOf(Tiny());
  shapes["delta_block.first_block_conv.conv.weight"] = torch::zeros({4, 17, 3});
  EXPECT_THAT(InferModelOptions(shapes, {}), StatusIs(kInvalid, HasSubstr("takes 17 inputs")));
}

TEST(PthImportTest, AFileOfPyTorchBecomesACheckpointOfTheSameNumbers) {
  const TempDir dir;
  const auto result = ImportPth(kPthFixture, dir.File("out.safetensors"), {});
  ASSERT_THAT(result, IsOk());
  EXPECT_EQ(result->options, Tiny());
  EXPECT_EQ(result->parameters, Tiny().ParameterCount());
  const auto loaded = LoadModel(dir.File("out.safetensors"));
  ASSERT_THAT(loaded, IsOk());
  const auto tensors = ReadTorchStateDict(kPthFixture);
  for (const auto& item : loaded->model->named_parameters()) {
    EXPECT_TRUE(item.value().equal(tensors->at(item.key()))) << item.key();
  }
}

TEST(PthImportTest, TheStorageMayBeHalf) {
  const TempDir dir;
  ImportOptions import;
  import.dtype = torch::kBFloat16;
  ASSERT_THAT(ImportPth(kPthFixture, dir.File("out.safetensors"), import), IsOk());
  EXPECT_EQ(ReadSafetensors(dir.File("out.safetensors"))->tensors.at("norm.bias").scalar_type(), torch::kBFloat16);
}

TEST(PthImportTest, AFailedImportWritesNothing) {
  const TempDir dir;
  EXPECT_THAT(ImportPth("/nonexistent.pth", dir.File("out"), {}), StatusIs(absl::StatusCode::kNotFound));
  ImportOptions import;
  import.window = 1;
  EXPECT_THAT(ImportPth(kPthFixture, dir.File("out"), import), StatusIs(kInvalid, HasSubstr("window is 1")));
  EXPECT_EQ(dir.Count(), 0);
  EXPECT_THAT(ImportPth(kPthFixture, "/nonexistent/out", {}), StatusIs(absl::StatusCode::kNotFound));
}

}  // namespace
}  // namespace holdfast
