// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/metadata.h"

#include <gmock/gmock.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <fstream>
#include <map>
#include <string>

#include "model/checkpoint/checkpoint.h"
#include "model/checkpoint/safetensors.h"
#include "model/presets.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Pair;

TensorFile SmallFile() {
  torch::manual_seed(1);
  TensorFile file;
  file.metadata = {{"holdfast.name", "mine"}, {"note", "a \"quoted\" text"}};
  file.tensors["weight"] = torch::randn({3, 4});
  file.tensors["half"] = torch::randn({5}).to(torch::kFloat16);
  file.tensors["brain"] = torch::randn({2, 3}).to(torch::kBFloat16);
  file.tensors["count"] = torch::tensor({int64_t{-1}, int64_t{1} << 62});
  file.tensors["empty"] = torch::empty({0, 7});
  return file;
}

// The tensors are those of SmallFile().
void ExpectHolds(const std::string& path, const std::map<std::string, std::string>& metadata) {
  const auto got = ReadSafetensors(path);
  ASSERT_THAT(got, IsOk());
  EXPECT_EQ(got->metadata, metadata);
  const TensorFile want = SmallFile();
  ASSERT_EQ(got->tensors.size(), want.tensors.size());
  for (const auto& [name, tensor] : want.tensors) {
    ASSERT_EQ(got->tensors.count(name), 1) << name;
    EXPECT_EQ(got->tensors.at(name).scalar_type(), tensor.scalar_type()) << name;
    EXPECT_TRUE(got->tensors.at(name).equal(tensor)) << name;
  }
}

TEST(MetadataTest, ACopyHasTheEntryAndEverythingElse) {
  const TempDir dir;
  ASSERT_THAT(WriteSafetensors(dir.File("from"), SmallFile()), IsOk());
  ASSERT_THAT(CopyWithMetadata(dir.File("from"), dir.File("to"), "holdfast.confidence", "{\"version\":1}"), IsOk());
  ExpectHolds(dir.File("to"),
              {{"holdfast.confidence", "{\"version\":1}"}, {"holdfast.name", "mine"}, {"note", "a \"quoted\" text"}});
  ExpectHolds(dir.File("from"), SmallFile().metadata);
}

TEST(MetadataTest, AnEntryThatIsThereIsReplaced) {
  const TempDir dir;
  ASSERT_THAT(WriteSafetensors(dir.File("from"), SmallFile()), IsOk());
  ASSERT_THAT(CopyWithMetadata(dir.File("from"), dir.File("to"), "note", "another"), IsOk());
  ExpectHolds(dir.File("to"), {{"holdfast.name", "mine"}, {"note", "another"}});
}

TEST(MetadataTest, AFileMayBeItsOwnCopy) {
  const TempDir dir;
  ASSERT_THAT(WriteSafetensors(dir.File("same"), SmallFile()), IsOk());
  ASSERT_THAT(CopyWithMetadata(dir.File("same"), dir.File("same"), "note", "another"), IsOk());
  ExpectHolds(dir.File("same"), {{"holdfast.name", "mine"}, {"note", "another"}});
  EXPECT_EQ(dir.Count(), 1);
}

TEST(MetadataTest, ASourceThatIsNotThereIsNamed) {
  const TempDir dir;
  EXPECT_THAT(CopyWithMetadata(dir.File("from"), dir.File("to"), "note", "x"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr(dir.File("from"))));
  EXPECT_EQ(dir.Count(), 0);
}

TEST(MetadataTest, ASourceThatIsNoCheckpointIsNamed) {
  const TempDir dir;
  std::ofstream(dir.File("from"), std::ios::binary) << "these are no tensors, whatever else they may be";
  EXPECT_THAT(
      CopyWithMetadata(dir.File("from"), dir.File("to"), "note", "x"),
      StatusIs(absl::StatusCode::kInvalidArgument, AllOf(HasSubstr(dir.File("from")), HasSubstr("safetensors"))));
  EXPECT_EQ(dir.Count(), 1);
}

TEST(MetadataTest, ATargetThatCannotBeWrittenIsNamed) {
  const TempDir dir;
  ASSERT_THAT(WriteSafetensors(dir.File("from"), SmallFile()), IsOk());
  const std::string to = dir.File("absent") + "/to";
  EXPECT_THAT(CopyWithMetadata(dir.File("from"), to, "note", "x"),
              StatusIs(absl::StatusCode::kNotFound, HasSubstr(to)));
}

TEST(MetadataTest, AnEntryThatIsNotUtf8LeavesTheTargetAsItWas) {
  const TempDir dir;
  ASSERT_THAT(WriteSafetensors(dir.File("same"), SmallFile()), IsOk());
  EXPECT_THAT(CopyWithMetadata(dir.File("same"), dir.File("same"), "note", "\xff"),
              StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr(dir.File("same"))));
  ExpectHolds(dir.File("same"), SmallFile().metadata);
  EXPECT_EQ(dir.Count(), 1);
}

TEST(MetadataTest, ALoadedModelSaysAllOfItsMetadata) {
  const TempDir dir;
  torch::manual_seed(3);
  ASSERT_THAT(SaveModel(dir.File("m"), *PointModel(*PresetByName("test")), torch::kFloat32, {{"note", "x"}}), IsOk());
  ASSERT_THAT(CopyWithMetadata(dir.File("m"), dir.File("m"), "holdfast.confidence", "{}"), IsOk());
  const auto loaded = LoadModel(dir.File("m"));
  ASSERT_THAT(loaded, IsOk());
  EXPECT_THAT(loaded->metadata, Contains(Pair("holdfast.confidence", "{}")));
  EXPECT_THAT(loaded->metadata, Contains(Pair("note", "x")));
  EXPECT_EQ(loaded->metadata.count("holdfast.model"), 1);
}

}  // namespace
}  // namespace holdfast
