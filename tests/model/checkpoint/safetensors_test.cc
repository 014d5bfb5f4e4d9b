// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/safetensors.h"

#include <gmock/gmock.h>
#include <torch/types.h>
#include <torch/utils.h>

#include <cstring>
#include <random>

#include "absl/strings/str_cat.h"
#include "tests/support/mutate.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string WithLength(uint64_t length, const std::string& rest) {
  return std::string(reinterpret_cast<const char*>(&length), sizeof(length)) + rest;
}

// A file of the given header and 'data_bytes' bytes of zeros.
std::string File(const std::string& header, size_t data_bytes) {
  return WithLength(header.size(), header + std::string(data_bytes, '\0'));
}

std::string Entry(const std::string& dtype, const std::string& shape, const std::string& offsets) {
  return absl::StrCat(R"({"dtype":")", dtype, R"(","shape":)", shape, R"(,"data_offsets":)", offsets, "}");
}

TensorFile Sample() {
  torch::manual_seed(1);
  TensorFile file;
  file.metadata = {{"note", "a \"quoted\" text"}, {"other", ""}};
  file.tensors["weight"] = torch::randn({3, 4});
  file.tensors["half"] = torch::randn({5}).to(torch::kFloat16);
  file.tensors["brain"] = torch::randn({2, 3}).to(torch::kBFloat16);
  file.tensors["double"] = torch::randn({2}, torch::kFloat64);
  file.tensors["long"] = torch::tensor({int64_t{-1}, int64_t{1} << 62});
  file.tensors["int"] = torch::tensor({-7, 7}, torch::kInt32);
  file.tensors["byte"] = torch::tensor({0, 255, 3}, torch::kUInt8);
  file.tensors["truth"] = torch::tensor({true, false, true});
  file.tensors["scalar"] = torch::tensor(2.5f);
  file.tensors["empty"] = torch::empty({0, 7});
  return file;
}

void ExpectEqual(const TensorFile& got, const TensorFile& want) {
  EXPECT_EQ(got.metadata, want.metadata);
  ASSERT_EQ(got.tensors.size(), want.tensors.size());
  for (const auto& [name, tensor] : want.tensors) {
    ASSERT_EQ(got.tensors.count(name), 1) << name;
    EXPECT_EQ(got.tensors.at(name).scalar_type(), tensor.scalar_type()) << name;
    EXPECT_EQ(got.tensors.at(name).sizes(), tensor.sizes()) << name;
    EXPECT_TRUE(got.tensors.at(name).equal(tensor)) << name;
  }
}

TEST(SafetensorsTest, EveryDtypeSurvivesTheRoundTrip) {
  const auto bytes = SerializeSafetensors(Sample());
  ASSERT_THAT(bytes, IsOk());
  const auto file = ParseSafetensors(*bytes);
  ASSERT_THAT(file, IsOk());
  ExpectEqual(*file, Sample());
}

TEST(SafetensorsTest, AFileOnDiskHoldsTheSame) {
  const TempDir dir;
  ASSERT_THAT(WriteSafetensors(dir.File("x.safetensors"), Sample()), IsOk());
  const auto file = ReadSafetensors(dir.File("x.safetensors"));
  ASSERT_THAT(file, IsOk());
  ExpectEqual(*file, Sample());
  EXPECT_THAT(ReadSafetensors(dir.File("x.safetensors"), 100), StatusIs(absl::StatusCode::kResourceExhausted));
}

TEST(SafetensorsTest, ViewsAreStoredAsTheirValues) {
  TensorFile file;
  file.tensors["t"] = torch::arange(6, torch::kFloat32).view({2, 3}).t().slice(0, 1);
  const auto read = ParseSafetensors(*SerializeSafetensors(file));
  ASSERT_THAT(read, IsOk());
  EXPECT_TRUE(read->tensors.at("t").equal(torch::tensor({{1.f, 4.f}, {2.f, 5.f}})));
}

TEST(SafetensorsTest, TheLayoutIsThatOfTheFormat) {
  TensorFile file;
  file.tensors["a"] = torch::tensor({1.f, 2.f});
  const std::string header = R"({"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}})";
  const std::string padding((8 - header.size() % 8) % 8, ' ');
  const std::string data("\0\0\x80\x3f\0\0\0\x40", 8);
  EXPECT_EQ(*SerializeSafetensors(file), WithLength(header.size() + padding.size(), header + padding + data));
}

TEST(SafetensorsTest, LargerElementsComeFirstSoThatAllAreAligned) {
  const auto bytes = SerializeSafetensors(Sample());
  const size_t byte = bytes->find("\"byte\":"), brain = bytes->find("\"brain\":"), weight = bytes->find("\"weight\":");
  EXPECT_LT(weight, brain);
  EXPECT_LT(brain, byte);
}

TEST(SafetensorsTest, WhatCannotBeStoredIsNamed) {
  TensorFile file;
  file.tensors["short"] = torch::zeros({2}, torch::kInt16);
  EXPECT_THAT(SerializeSafetensors(file), StatusIs(kInvalid, AllOf(HasSubstr("'short'"), HasSubstr("Short"))));
  file.tensors = {{"nothing", torch::Tensor()}};
  EXPECT_THAT(SerializeSafetensors(file), StatusIs(kInvalid, HasSubstr("'nothing': is undefined")));
  file.tensors = {{"__metadata__", torch::zeros({1})}};
  EXPECT_THAT(SerializeSafetensors(file), StatusIs(kInvalid, HasSubstr("taken by the format")));
  file.tensors = {{"not \xff text", torch::zeros({1})}};
  EXPECT_THAT(SerializeSafetensors(file), StatusIs(kInvalid, HasSubstr("UTF-8")));
}

TEST(SafetensorsTest, AFileThatEndsAnywhereIsRefused) {
  const std::string bytes = *SerializeSafetensors(Sample());
  for (size_t size = 0; size < bytes.size(); ++size) {
    ASSERT_THAT(ParseSafetensors(absl::string_view(bytes).substr(0, size)), StatusIs(kInvalid)) << size;
  }
  EXPECT_THAT(ParseSafetensors(bytes.substr(0, 5)), StatusIs(kInvalid, HasSubstr("truncated before the header")));
  EXPECT_THAT(ParseSafetensors(bytes.substr(0, 50)), StatusIs(kInvalid, HasSubstr("truncated within the header")));
  EXPECT_THAT(ParseSafetensors(bytes.substr(0, bytes.size() - 1)), StatusIs(kInvalid, HasSubstr("truncated")));
}

TEST(SafetensorsTest, BytesAfterTheLastTensorAreRefused) {
  EXPECT_THAT(ParseSafetensors(*SerializeSafetensors(Sample()) + "x"), StatusIs(kInvalid, HasSubstr("1 bytes after")));
}

TEST(SafetensorsTest, AnOversizedHeaderIsRefusedWhateverItsLengthSays) {
  for (const uint64_t length : {uint64_t{5} << 20, uint64_t{1} << 40, ~uint64_t{0}, ~uint64_t{0} - 7}) {
    EXPECT_THAT(ParseSafetensors(WithLength(length, "{}")), StatusIs(kInvalid, HasSubstr("at most 4194304")));
  }
}

struct HostileHeader {
  const char* name;
  std::string header;
  size_t data_bytes;
  const char* message;
};

class HostileHeaderTest : public ::testing::TestWithParam<HostileHeader> {};

TEST_P(HostileHeaderTest, IsRefusedWithAClearMessage) {
  EXPECT_THAT(ParseSafetensors(File(GetParam().header, GetParam().data_bytes)),
              StatusIs(kInvalid, HasSubstr(GetParam().message)));
}

INSTANTIATE_TEST_SUITE_P(
    Safetensors, HostileHeaderTest,
    ::testing::Values(
        HostileHeader{"NotJson", "{\"a\":", 0, "syntax error"}, HostileHeader{"Empty", "", 0, "syntax error"},
        HostileHeader{"List", "[]", 0, "not an object"}, HostileHeader{"NotUtf8", "{\"\xff\":1}", 0, "syntax error"},
        HostileHeader{"Deep", "{\"a\":" + std::string(100000, '[') + "}", 0, "nested deeper than 3"},
        HostileHeader{"NameTwice",
                      "{\"a\":" + Entry("U8", "[1]", "[0,1]") + ",\"a\":" + Entry("U8", "[1]", "[1,2]") + "}", 2,
                      "'a' stands twice"},
        HostileHeader{"OffsetsTwice", R"({"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1],"data_offsets":[0,1]}})",
                      1, "'data_offsets' stands twice"},
        HostileHeader{"MetadataNumber", R"({"__metadata__":{"k":1}})", 0, "metadata 'k' is not a string"},
        HostileHeader{"MetadataList", R"({"__metadata__":[]})", 0, "__metadata__ is not an object"},
        HostileHeader{"NoShape", R"({"a":{"dtype":"U8","data_offsets":[0,1]}})", 1, "dtype, shape and data_offsets"},
        HostileHeader{"OtherKey", R"({"a":{"dtype":"U8","shape":[1],"data_offsets":[0,1],"k":1}})", 1,
                      "dtype, shape and data_offsets"},
        HostileHeader{"EntryNumber", R"({"a":3})", 0, "dtype, shape and data_offsets"},
        HostileHeader{"DtypeNumber", R"({"a":{"dtype":1,"shape":[1],"data_offsets":[0,1]}})", 1, "not a string"},
        HostileHeader{"UnknownDtype", "{\"a\":" + Entry("F8_E4M3", "[1]", "[0,1]") + "}", 1, "unknown dtype 'F8_E4M3'"},
        HostileHeader{"ShapeText", "{\"a\":" + Entry("U8", "\"1\"", "[0,1]") + "}", 1, "shape is not a list"},
        HostileHeader{"ShapeNegative", "{\"a\":" + Entry("U8", "[-1,-1]", "[0,1]") + "}", 1, "whole number >= 0"},
        HostileHeader{"ShapeFraction", "{\"a\":" + Entry("U8", "[1.0]", "[0,1]") + "}", 1, "whole number >= 0"},
        HostileHeader{"ShapeRank", "{\"a\":" + Entry("U8", "[1,1,1,1,1,1,1,1,1]", "[0,1]") + "}", 1, "at most 8"},
        HostileHeader{"ShapeOverflow", "{\"a\":" + Entry("F32", "[4294967296,4294967296]", "[0,0]") + "}", 0,
                      "shape is too large"},
        HostileHeader{"ShapeOverflowBesideZero", "{\"a\":" + Entry("F32", "[0,9223372036854775807,4]", "[0,0]") + "}",
                      0, "shape is too large"},
        HostileHeader{"ShapeMismatch", "{\"a\":" + Entry("F32", "[2,3]", "[0,20]") + "}", 20,
                      "shape [2, 3] takes 24 bytes, not 20"},
        HostileHeader{"OffsetsOne", "{\"a\":" + Entry("U8", "[1]", "[0]") + "}", 1, "not a begin and an end"},
        HostileHeader{"OffsetsThree", "{\"a\":" + Entry("U8", "[1]", "[0,1,2]") + "}", 1, "at most 2 numbers"},
        HostileHeader{"OffsetsBackwards", "{\"a\":" + Entry("U8", "[1]", "[1,0]") + "}", 1, "not a begin and an end"},
        HostileHeader{"OffsetsHuge",
                      "{\"a\":" + Entry("U8", "[1]", "[18446744073709551614,18446744073709551615]") + "}", 1,
                      "out of bounds"},
        HostileHeader{"OffsetsPastTheEnd", "{\"a\":" + Entry("U8", "[3]", "[0,3]") + "}", 2, "ends at byte 3 of 2"},
        HostileHeader{"Overlap",
                      "{\"a\":" + Entry("U8", "[2]", "[0,2]") + ",\"b\":" + Entry("U8", "[2]", "[1,3]") + "}", 3,
                      "'b': overlaps another tensor"},
        HostileHeader{"SameBytes",
                      "{\"a\":" + Entry("U8", "[2]", "[0,2]") + ",\"b\":" + Entry("U8", "[2]", "[0,2]") + "}", 2,
                      "overlaps another tensor"},
        HostileHeader{"Hole", "{\"a\":" + Entry("U8", "[1]", "[0,1]") + ",\"b\":" + Entry("U8", "[1]", "[2,3]") + "}",
                      3, "'b': leaves a hole"}),
    [](const auto& info) { return std::string(info.param.name); });

TEST(SafetensorsTest, ATruthValueOtherThanZeroAndOneIsRefused) {
  std::string bytes = File("{\"a\":" + Entry("BOOL", "[2]", "[0,2]") + "}", 2);
  EXPECT_THAT(ParseSafetensors(bytes), IsOk());
  bytes.back() = 2;
  EXPECT_THAT(ParseSafetensors(bytes), StatusIs(kInvalid, HasSubstr("neither 0 nor 1")));
}

TEST(SafetensorsTest, ControlCharactersOfAHostileNameDoNotReachTheMessage) {
  const auto file = ParseSafetensors(File(R"({"a\n\u001b[31m":3})", 0));
  EXPECT_THAT(file, StatusIs(kInvalid, HasSubstr(R"('a\n\x1b[31m')")));
}

// With its length put right, a changed header is not refused at the first check.
void RepairLength(std::string& bytes) {
  const size_t end = bytes.rfind("}}");
  if (bytes.size() < 8 || end == std::string::npos || end < 8) return;
  const uint64_t length = end + 2 - 8;
  std::memcpy(bytes.data(), &length, sizeof(length));
}

TEST(SafetensorsFuzzTest, NoCorruptedFileDoesHarm) {
  const std::string sound = *SerializeSafetensors(Sample());
  std::mt19937 random(20240611);
  int refused = 0;
  constexpr int kFiles = 20000;
  for (int i = 0; i < kFiles; ++i) {
    std::string bytes = Mutate(sound, 900, random);
    if (i % 2 == 0) RepairLength(bytes);
    const auto file = ParseSafetensors(bytes);
    if (!file.ok()) {
      ++refused;
      ASSERT_THAT(file, StatusIs(kInvalid)) << "mutation " << i;
      continue;
    }
    size_t taken = 0;
    for (const auto& item : file->tensors) taken += item.second.nbytes();
    ASSERT_LE(taken, bytes.size()) << "mutation " << i;  // never more memory than the file has bytes
  }
  RecordProperty("refused", refused);
  EXPECT_GT(refused, kFiles / 2);
  EXPECT_LT(refused, kFiles);  // changed numbers of a tensor are no error: the fuzz goes past the header
}

}  // namespace
}  // namespace holdfast
