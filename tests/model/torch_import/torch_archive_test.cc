// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/torch_archive.h"

#include <gmock/gmock.h>
#include <torch/types.h>
#include <zip.h>

#include <filesystem>
#include <fstream>
#include <random>

#include "io/file_io.h"
#include "tests/model/torch_import/pickle_builder.h"
#include "tests/support/mutate.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::Key;
using ::testing::UnorderedElementsAre;

const std::string kFixture = InSourceTree("tests/data/tiny.pth");

using Entries = std::map<std::string, std::string>;

void WriteZip(const std::string& path, const Entries& entries, int compression = ZIP_CM_STORE) {
  zip_t* zip = zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, nullptr);
  ASSERT_NE(zip, nullptr);
  for (const auto& [name, bytes] : entries) {
    zip_source_t* source = zip_source_buffer(zip, bytes.data(), bytes.size(), 0);
    const zip_int64_t index = zip_file_add(zip, name.c_str(), source, ZIP_FL_ENC_UTF_8);
    ASSERT_GE(index, 0);
    ASSERT_EQ(zip_set_file_compression(zip, static_cast<zip_uint64_t>(index), compression, 0), 0);
  }
  ASSERT_EQ(zip_close(zip), 0);
}

std::string Floats(const std::vector<float>& values) {
  return std::string(reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float));
}

// The state dict {"w": 'tensor'} in an archive named "a", and its storage "0".
Entries Archive(const PickleBuilder& tensor, const std::string& storage) {
  return {{"a/data.pkl", PickleBuilder().Raw("}").Text("w").Raw(tensor.body()).Raw("s").Stop()}, {"a/data/0", storage}};
}

absl::StatusOr<StateDict> Read(const Entries& entries, int compression = ZIP_CM_STORE) {
  const TempDir dir;
  WriteZip(dir.File("x.pth"), entries, compression);
  return ReadTorchStateDict(dir.File("x.pth"));
}

absl::StatusOr<StateDict> ReadBytes(const std::string& bytes) {
  const TempDir dir;
  std::ofstream(dir.File("x.pth"), std::ios::binary) << bytes;
  return ReadTorchStateDict(dir.File("x.pth"));
}

TEST(TorchArchiveTest, AFileOfPyTorchIsReadWithItsOptimizerAndSchedulerLeftAside) {
  const auto tensors = ReadTorchStateDict(kFixture);
  ASSERT_THAT(tensors, IsOk());
  EXPECT_EQ(tensors->size(), 82);
  ASSERT_EQ(tensors->count("fnet.conv1.weight"), 1);
  EXPECT_EQ(tensors->at("fnet.conv1.weight").sizes(), torch::IntArrayRef({4, 3, 7, 7}));
  // The formula of the script beside the fixture; parameters 0 and 1.
  const auto formula = [](int64_t number, int64_t count) {
    return torch::remainder(7 * number + torch::arange(count), 251).to(torch::kFloat32) / 251 - 0.5;
  };
  EXPECT_TRUE(tensors->at("fnet.conv1.weight").flatten().allclose(formula(0, 588)));
  EXPECT_TRUE(tensors->at("fnet.conv1.bias").allclose(formula(1, 4)));
}

TEST(TorchArchiveTest, ABareStateDictIsRead) {
  const auto tensors = Read(Archive(PickleBuilder().Tensor("0", 3, 0, 3, 1), Floats({1, 2, 3})));
  ASSERT_THAT(tensors, IsOk());
  EXPECT_TRUE(tensors->at("w").equal(torch::tensor({1.f, 2.f, 3.f})));
}

TEST(TorchArchiveTest, StridesAndOffsetsAreFollowed) {
  const auto tensors = Read(Archive(PickleBuilder().Tensor("0", 6, 1, 3, 2), Floats({0, 1, 2, 3, 4, 5})));
  ASSERT_THAT(tensors, IsOk());
  EXPECT_TRUE(tensors->at("w").equal(torch::tensor({1.f, 3.f, 5.f})));
  EXPECT_TRUE(tensors->at("w").is_contiguous());
}

TEST(TorchArchiveTest, TensorsMayShareAStorage) {
  const std::string pickle = PickleBuilder()
                                 .Raw("}(")
                                 .Text("a")
                                 .Tensor("0", 4, 0, 2, 1)
                                 .Text("module.b")
                                 .Tensor("0", 4, 2, 2, 1)
                                 .Raw("u")
                                 .Stop();
  const auto tensors = Read({{"x/data.pkl", pickle}, {"x/data/0", Floats({1, 2, 3, 4})}});
  ASSERT_THAT(tensors, IsOk());
  EXPECT_THAT(*tensors, UnorderedElementsAre(Key("a"), Key("b")));
  EXPECT_TRUE(tensors->at("b").equal(torch::tensor({3.f, 4.f})));
}

TEST(TorchArchiveTest, ATensorOutsideItsStorageIsRefused) {
  constexpr int64_t kHuge = int64_t{1} << 62;
  struct Case {
    int64_t offset, size, stride;
  };
  for (const Case& c :
       {Case{0, 5, 1}, Case{1, 4, 1}, Case{0, 3, 2}, Case{-1, 2, 1}, Case{4, 1, 1}, Case{0, -1, 1}, Case{0, 4, -1},
        Case{kHuge, 1, 1}, Case{0, kHuge, 1}, Case{0, 2, kHuge}, Case{0, kHuge, kHuge}}) {
    EXPECT_THAT(Read(Archive(PickleBuilder().Tensor("0", 4, c.offset, c.size, c.stride), Floats({1, 2, 3, 4}))),
                StatusIs(kInvalid, HasSubstr("'w': reaches out of its storage")))
        << c.offset << " " << c.size << " " << c.stride;
  }
}

TEST(TorchArchiveTest, OneNumberCannotBecomeAGiantTensor) {
  EXPECT_THAT(Read(Archive(PickleBuilder().Tensor("0", 4, 0, 1 << 30, 0), Floats({1, 2, 3, 4}))),
              StatusIs(kInvalid, HasSubstr("reaches out")));
}

TEST(TorchArchiveTest, AStorageMustHaveTheBytesItClaims) {
  for (const int64_t elements : {int64_t{3}, int64_t{5}, int64_t{-1}, int64_t{1} << 62}) {
    EXPECT_THAT(Read(Archive(PickleBuilder().Tensor("0", elements, 0, 1, 1), Floats({1, 2, 3, 4}))),
                StatusIs(kInvalid, HasSubstr("'a/data/0': has 16 bytes")))
        << elements;
  }
}

TEST(TorchArchiveTest, OneStorageHasOneType) {
  const std::string other = PickleBuilder()
                                .Raw("}(")
                                .Text("a")
                                .Tensor("0", 4, 0, 2, 1)
                                .Text("b")
                                .Global("torch._utils", "_rebuild_tensor_v2")
                                .Raw("(")
                                .Storage("IntStorage", "0", 4)
                                .Int(0)
                                .Raw("K\1\x85K\1\x85tRu")
                                .Stop();
  EXPECT_THAT(Read({{"x/data.pkl", other}, {"x/data/0", Floats({1, 2, 3, 4})}}),
              StatusIs(kInvalid, HasSubstr("'b': its storage has two types")));
}

TEST(TorchArchiveTest, AValueThatIsNoTensorIsNamed) {
  EXPECT_THAT(Read(Archive(PickleBuilder().Int(3), "")), StatusIs(kInvalid, HasSubstr("'w': is not a tensor")));
  EXPECT_THAT(Read({{"x/data.pkl", PickleBuilder().Int(3).Stop()}}), StatusIs(kInvalid, HasSubstr("no state dict")));
  EXPECT_THAT(Read({{"x/data.pkl", PickleBuilder().Raw("}K\1K\2s").Stop()}}),
              StatusIs(kInvalid, HasSubstr("is no text")));
}

TEST(TorchArchiveTest, ANameMayNotStandTwice) {
  const std::string pickle = PickleBuilder()
                                 .Raw("}(")
                                 .Text("a")
                                 .Tensor("0", 1, 0, 1, 1)
                                 .Text("module.a")
                                 .Tensor("0", 1, 0, 1, 1)
                                 .Raw("u")
                                 .Stop();
  EXPECT_THAT(Read({{"x/data.pkl", pickle}, {"x/data/0", Floats({1})}}), StatusIs(kInvalid, HasSubstr("stands twice")));
}

TEST(TorchArchiveTest, APickleThatWantsToRunCodeIsRefused) {
  EXPECT_THAT(Read(Archive(PickleBuilder().Global("os", "system").Text("id").Raw("\x85R"), "")),
              StatusIs(kInvalid, HasSubstr("'os.system'")));
}

TEST(TorchArchiveTest, ABigEndianFileIsRefusedAndALittleEndianOneRead) {
  Entries entries = Archive(PickleBuilder().Tensor("0", 1, 0, 1, 1), Floats({1}));
  entries["a/byteorder"] = "little";
  EXPECT_THAT(Read(entries), IsOk());
  entries["a/byteorder"] = "big";
  EXPECT_THAT(Read(entries), StatusIs(kInvalid, HasSubstr("byte order 'big'")));
}

TEST(TorchArchiveTest, CompressedEntriesAreRefusedSoThatNoneCanUnfold) {
  const int64_t elements = 1 << 20;
  EXPECT_THAT(
      Read(Archive(PickleBuilder().Tensor("0", elements, 0, elements, 1), std::string(4 << 20, '\0')), ZIP_CM_DEFLATE),
      StatusIs(kInvalid, HasSubstr("is compressed")));
}

TEST(TorchArchiveTest, ASizeThatTheFileDoesNotHoldIsRefused) {
  const TempDir dir;
  WriteZip(dir.File("x.pth"), Archive(PickleBuilder().Tensor("0", 3, 0, 3, 1), Floats({1, 2, 3})));
  std::string bytes = *ReadFile(dir.File("x.pth"), 1 << 20);
  // The central directory's record of data/0: both sizes, 20 and 24 bytes after its signature.
  size_t record = bytes.find("PK\1\2");
  while (bytes.compare(record + 46, 8, "a/data/0") != 0) record = bytes.find("PK\1\2", record + 1);
  for (const size_t field : {20, 24}) bytes.replace(record + field, 4, "\xf0\xff\xff\x3f");
  EXPECT_THAT(ReadBytes(bytes), StatusIs(kInvalid));
}

TEST(TorchArchiveTest, WhatIsNoArchiveOfPyTorchIsReported) {
  EXPECT_THAT(ReadTorchStateDict("/nonexistent.pth"), StatusIs(absl::StatusCode::kNotFound));
  EXPECT_THAT(ReadBytes("not a zip file"), StatusIs(kInvalid, HasSubstr("before PyTorch 1.6")));
  EXPECT_THAT(Read({{"readme", "text"}}), StatusIs(kInvalid, HasSubstr("no data.pkl")));
  EXPECT_THAT(Read({{"a/data.pkl", "."}, {"b/data.pkl", "."}}),
              StatusIs(kInvalid, HasSubstr("more than one data.pkl")));
  Entries entries = Archive(PickleBuilder().Tensor("0", 1, 0, 1, 1), Floats({1}));
  entries.erase("a/data/0");
  EXPECT_THAT(Read(entries), StatusIs(kInvalid, HasSubstr("'w': 'a/data/0': is not in the zip file")));
}

TEST(TorchArchiveTest, AChangedStorageFailsItsChecksum) {
  const TempDir dir;
  WriteZip(dir.File("x.pth"), Archive(PickleBuilder().Tensor("0", 3, 0, 3, 1), "marked bytes"));
  std::string bytes = *ReadFile(dir.File("x.pth"), 1 << 20);
  bytes[bytes.find("marked bytes")] = 'M';
  EXPECT_THAT(ReadBytes(bytes), StatusIs(kInvalid, HasSubstr("truncated or damaged")));
}

TEST(TorchArchiveFuzzTest, NoCorruptedArchiveDoesHarm) {
  const TempDir dir;
  WriteZip(dir.File("x.pth"), Archive(PickleBuilder().Tensor("0", 3, 0, 3, 1), Floats({1, 2, 3})));
  const std::string sound = *ReadFile(dir.File("x.pth"), 1 << 20);
  std::mt19937 random(11);
  int refused = 0;
  constexpr int kFiles = 1000;
  for (int i = 0; i < kFiles; ++i) {
    std::filesystem::remove(dir.File("y.pth"));  // some file systems flush a file that is written over
    std::ofstream(dir.File("y.pth"), std::ios::binary) << Mutate(sound, sound.size(), random);
    const auto tensors = ReadTorchStateDict(dir.File("y.pth"));
    if (tensors.ok()) continue;
    ++refused;
    ASSERT_THAT(tensors, StatusIs(kInvalid)) << "mutation " << i;
  }
  RecordProperty("refused", refused);
  EXPECT_GT(refused, kFiles / 2);
}

}  // namespace
}  // namespace holdfast
