// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/checkpoint.h"

#include <gmock/gmock.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <random>

#include "model/presets.h"
#include "tests/support/mutate.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

const std::string kInterim = InSourceTree("tests/data/interim.safetensors");

PointModel TestModel(uint64_t seed = 3) {
  torch::manual_seed(seed);
  return PointModel(*PresetByName("test"));
}

// Names and values, the values as float32 after a detour through 'dtype'.
std::map<std::string, torch::Tensor> Values(const PointModelImpl& model, torch::ScalarType dtype = torch::kFloat32) {
  std::map<std::string, torch::Tensor> values;
  for (const auto& item : model.named_parameters()) {
    values[item.key()] = item.value().detach().to(dtype).to(torch::kFloat32).clone();
  }
  return values;
}

void ExpectSame(const std::map<std::string, torch::Tensor>& got, const std::map<std::string, torch::Tensor>& want) {
  ASSERT_EQ(got.size(), want.size());
  for (const auto& [name, tensor] : want) {
    ASSERT_EQ(got.count(name), 1) << name;
    EXPECT_TRUE(got.at(name).equal(tensor)) << name;
  }
}

// What loading says of a sound file of the preset "test" after 'change'.
absl::Status LoadChanged(const std::function<void(TensorFile&)>& change) {
  const TempDir dir;
  TensorFile file = ToTensorFile(*TestModel(), torch::kFloat32, {});
  change(file);
  if (auto s = WriteSafetensors(dir.File("m.safetensors"), file); !s.ok()) return s;
  return LoadModel(dir.File("m.safetensors")).status();
}

TEST(CheckpointTest, TheShippedWeightsAreThoseOfPresetSmall) {
  const auto loaded = LoadModel(InSourceTree("weights/small.safetensors"));
  ASSERT_THAT(loaded, IsOk());
  EXPECT_EQ(loaded->name, "small");
  EXPECT_EQ(PresetName(loaded->model->options()), "small");
}

TEST(CheckpointTest, WeightsOfAnotherProgramLoadValueByValue) {
  const auto loaded = LoadModel(kInterim);
  ASSERT_THAT(loaded, IsOk());
  EXPECT_EQ(loaded->name, "interim");
  EXPECT_EQ(loaded->sha256, Sha256Hex(*ReadFile(kInterim, int64_t{1} << 30)));
  const PointModelImpl& model = *loaded->model;
  EXPECT_EQ(model.ParameterCount(), 2588546);
  EXPECT_EQ(model.options().context_blocks, 0);
  EXPECT_EQ(model.options().update_base, 48);
  EXPECT_FALSE(model.is_training());
  const auto file = ReadSafetensors(kInterim);
  ASSERT_THAT(file, IsOk());
  ExpectSame(Values(model), file->tensors);
}

TEST(CheckpointTest, TheCountOfTheOptionsIsThatOfTheNetwork) {
  for (const std::string& name : PresetNames()) {
    const ModelOptions options = *PresetByName(name);
    EXPECT_EQ(PointModel(options)->ParameterCount(), options.ParameterCount()) << name;
  }
}

class StorageTest : public ::testing::TestWithParam<torch::ScalarType> {};

TEST_P(StorageTest, ParametersSurviveTheRoundTripToTheStorageDtype) {
  const TempDir dir;
  const PointModel model = TestModel();
  ASSERT_THAT(SaveModel(dir.File("m.safetensors"), *model, GetParam()), IsOk());
  const auto loaded = LoadModel(dir.File("m.safetensors"));
  ASSERT_THAT(loaded, IsOk());
  EXPECT_EQ(loaded->model->options(), model->options());
  ExpectSame(Values(*loaded->model), Values(*model, GetParam()));
  const auto bytes = ReadFile(dir.File("m.safetensors"), 1 << 30);
  EXPECT_GT(bytes->size(), model->ParameterCount() * torch::elementSize(GetParam()));
  EXPECT_LT(bytes->size(), model->ParameterCount() * torch::elementSize(GetParam()) + 32768);
}

INSTANTIATE_TEST_SUITE_P(Dtypes, StorageTest, ::testing::Values(torch::kFloat32, torch::kFloat16, torch::kBFloat16));

TEST(CheckpointTest, ExtraMetadataIsKeptAndMayNameTheModel) {
  const TempDir dir;
  ASSERT_THAT(SaveModel(dir.File("m.safetensors"), *TestModel(), torch::kFloat32,
                        {{"holdfast.name", "mine"}, {"note", "x"}, {"holdfast.model", "cannot be overridden"}}),
              IsOk());
  EXPECT_EQ(LoadModel(dir.File("m.safetensors"))->name, "mine");
  EXPECT_EQ(ReadSafetensors(dir.File("m.safetensors"))->metadata.at("note"), "x");
}

TEST(CheckpointTest, NamesAreMadeFitForLabelsAndTerminals) {
  const TempDir dir;
  const auto name_of = [&](const std::string& stem, const std::map<std::string, std::string>& metadata) {
    const std::string path = dir.File(stem + ".safetensors");
    EXPECT_THAT(SaveModel(path, *TestModel(), torch::kFloat32, metadata), IsOk());
    return LoadModel(path)->name;
  };
  EXPECT_EQ(name_of("caf\xe9", {}), "caf\xef\xbf\xbd");
  EXPECT_EQ(name_of("a", {{"holdfast.name", "caf\xc3\xa9\x1b[2J\n\x7f\xc2\x9b"}}), "caf\xc3\xa9?[2J???");
  EXPECT_EQ(name_of("b", {{"holdfast.name", "x" + std::string(119, 'y') + "\xc3\xa9"}}), "x" + std::string(119, 'y'));
  EXPECT_EQ(name_of("c", {{"holdfast.name", std::string(119, 'y') + "\xc3\xa9"}}), std::string(119, 'y'));
}

TEST(CheckpointTest, AMissingParameterIsNamed) {
  EXPECT_THAT(LoadChanged([](TensorFile& f) { f.tensors.erase("fnet.conv1.weight"); }),
              StatusIs(kInvalid, AllOf(HasSubstr("m.safetensors"), HasSubstr("missing 'fnet.conv1.weight'"))));
}

TEST(CheckpointTest, AnUnknownParameterIsNamed) {
  EXPECT_THAT(LoadChanged([](TensorFile& f) { f.tensors["fnet.conv9.weight"] = torch::zeros({1}); }),
              StatusIs(kInvalid, HasSubstr("unknown 'fnet.conv9.weight'")));
}

TEST(CheckpointTest, ARenamedParameterIsBothAndManyAreCounted) {
  const auto prefix_all = [](TensorFile& f) {
    std::map<std::string, torch::Tensor> renamed;
    for (const auto& [name, tensor] : f.tensors) renamed["module." + name] = tensor;
    f.tensors = renamed;
  };
  EXPECT_THAT(LoadChanged(prefix_all),
              StatusIs(kInvalid, AllOf(HasSubstr("missing '"), HasSubstr("unknown 'module."), HasSubstr(" more"))));
}

TEST(CheckpointTest, AWrongShapeIsNamedWithBothShapes) {
  EXPECT_THAT(LoadChanged([](TensorFile& f) {
                f.tensors["norm.bias"] = torch::zeros({4, 4});
              }),
              StatusIs(kInvalid, HasSubstr("'norm.bias' has shape [4, 4]; want [16]")));
}

TEST(CheckpointTest, AWrongDtypeIsNamed) {
  EXPECT_THAT(LoadChanged([](TensorFile& f) { f.tensors["norm.bias"] = torch::zeros({16}, torch::kInt64); }),
              StatusIs(kInvalid, HasSubstr("'norm.bias' is Long")));
}

TEST(CheckpointTest, AParameterThatIsNotFiniteIsRefused) {
  EXPECT_THAT(LoadChanged([](TensorFile& f) { f.tensors["norm.bias"][3] = std::nan(""); }),
              StatusIs(kInvalid, HasSubstr("'norm.bias' is not finite")));
}

TEST(CheckpointTest, OptionsAreNeededAndMustFitTheFile) {
  EXPECT_THAT(LoadChanged([](TensorFile& f) { f.metadata.clear(); }),
              StatusIs(kInvalid, HasSubstr("no 'holdfast.model'")));
  EXPECT_THAT(LoadChanged([](TensorFile& f) { f.metadata["holdfast.model"] = "{}"; }),
              StatusIs(kInvalid, HasSubstr("missing key 'encoder_channels'")));
  // A file of a few kilobytes cannot have memory taken for a network of 18 million parameters.
  const std::string paper = ModelOptionsToJson(*PresetByName("paper"));
  EXPECT_THAT(LoadChanged([&](TensorFile& f) { f.metadata["holdfast.model"] = paper; }),
              StatusIs(kInvalid, HasSubstr("describes 18656226 parameters")));
}

TEST(CheckpointTest, ARefusedFileLeavesTheNetworkAsItWas) {
  PointModel model = TestModel(1);
  const auto before = Values(*model);
  TensorFile file = ToTensorFile(*TestModel(2), torch::kFloat32, {});
  file.tensors["norm.weight"] = torch::zeros({3});
  EXPECT_THAT(CopyParameters(file, *model), StatusIs(kInvalid));
  ExpectSame(Values(*model), before);
}

TEST(CheckpointTest, AFileThatIsNotThereIsReported) {
  EXPECT_THAT(LoadModel("/nonexistent/m.safetensors"), StatusIs(absl::StatusCode::kNotFound));
}

TEST(CheckpointTest, SavingRefusesWhatLoadingWould) {
  const TempDir dir;
  const PointModel model = TestModel();
  EXPECT_THAT(SaveModel(dir.File("m"), *model, torch::kInt64), StatusIs(kInvalid, HasSubstr("not stored as Long")));
  EXPECT_THAT(SaveModel("/nonexistent/m", *model), StatusIs(absl::StatusCode::kNotFound));
  {
    const torch::NoGradGuard no_grad;
    model->named_parameters()["norm.bias"].fill_(1e6);  // beyond float16
  }
  EXPECT_THAT(SaveModel(dir.File("m"), *model, torch::kFloat16), StatusIs(kInvalid, HasSubstr("not finite")));
  EXPECT_EQ(dir.Count(), 0);
}

TEST(CheckpointFuzzTest, NoCorruptedCheckpointDoesHarm) {
  const TempDir dir;
  ASSERT_THAT(SaveModel(dir.File("m"), *TestModel()), IsOk());
  const std::string sound = *ReadFile(dir.File("m"), 1 << 30);
  std::mt19937 random(5);
  int refused = 0;
  constexpr int kFiles = 1000;
  for (int i = 0; i < kFiles; ++i) {
    std::filesystem::remove(dir.File("c"));  // some file systems flush a file that is written over
    std::ofstream(dir.File("c"), std::ios::binary) << Mutate(sound, 600, random);  // mostly in the options
    const auto loaded = LoadModel(dir.File("c"));
    if (loaded.ok()) continue;
    ++refused;
    ASSERT_THAT(loaded, StatusIs(kInvalid)) << "mutation " << i;
  }
  RecordProperty("refused", refused);
  EXPECT_GT(refused, kFiles / 2);
}

}  // namespace
}  // namespace holdfast
