// SPDX-License-Identifier: Apache-2.0
#include "io/npz_writer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <string>

#include "io/npz_reader.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

template <typename T>
std::string Bytes(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

// As numpy.save(numpy.float32([1, -2])) writes it.
TEST(NpyFileTest, IsNumPysFileByteForByte) {
  const std::string header = "{'descr': '<f4', 'fortran_order': False, 'shape': (2,), }";
  const std::string want = std::string("\x93NUMPY\x01\x00\x76\x00", 10) + header + std::string(60, ' ') + "\n" +
                           std::string("\x00\x00\x80\x3f\x00\x00\x00\xc0", 8);
  ASSERT_EQ(want.size(), 128u + 8u);
  EXPECT_EQ(NpyFile("<f4", {2}, Bytes<float>({1, -2})), want);
}

TEST(NpyFileTest, ShapesArePythonTuples) {
  EXPECT_THAT(NpyFile("|b1", {}, "\x01"), HasSubstr("'descr': '|b1', 'fortran_order': False, 'shape': (), }"));
  EXPECT_THAT(NpyFile("<i8", {0}, ""), HasSubstr("'shape': (0,), }"));
  EXPECT_THAT(NpyFile("<i8", {3, 0, 2}, ""), HasSubstr("'shape': (3, 0, 2), }"));
}

TEST(NpyFileTest, DataBeginsAtAMultipleOf64WhateverTheShape) {
  for (size_t axes = 1; axes <= 40; ++axes) {
    std::vector<int64_t> shape(axes, 1000000000);  // up to 500 bytes of header: the length needs both of its bytes
    shape[0] = 0;
    const std::string file = NpyFile("<f4", shape, "");
    ASSERT_EQ(file.size() % 64, 0u);
    EXPECT_EQ(static_cast<uint8_t>(file[8]) + 256 * static_cast<uint8_t>(file[9]), static_cast<int>(file.size()) - 10);
    EXPECT_EQ(file.back(), '\n');
  }
}

TEST(WriteNpzTest, TheReaderFindsEveryArray) {
  const TempDir dir;
  ASSERT_THAT(WriteNpz(dir.File("a.npz"), {{"tracks", NpyFile("<f4", {2, 2}, Bytes<float>({0.5f, -1, 2, 1e9f}))},
                                           {"visible", NpyFile("|b1", {3}, Bytes<uint8_t>({1, 0, 1}))},
                                           {"ids", NpyFile("<i8", {2}, Bytes<int64_t>({-7, 1 << 20}))},
                                           {"none", NpyFile("<f4", {0, 5}, "")},
                                           {"fps", NpyFile("<f8", {}, Bytes<double>({30}))}}),
              IsOk());
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(dir.File("a.npz"));
  ASSERT_THAT(npz, IsOk());
  EXPECT_THAT(npz->ReadRows("tracks", {0, 1})->values, ElementsAre(0.5f, -1, 2, 1e9f));
  EXPECT_THAT(npz->ReadRows("tracks", {1})->values, ElementsAre(2, 1e9f));
  EXPECT_THAT(npz->ReadRows("visible", {0, 1, 2})->values, ElementsAre(1, 0, 1));
  EXPECT_THAT(npz->ReadRows("ids", {0, 1})->values, ElementsAre(-7, 1 << 20));
  EXPECT_THAT(npz->Header("none")->shape, ElementsAre(0, 5));
  EXPECT_EQ(npz->Header("fps")->item_bytes, 8);
  EXPECT_THAT(npz->Header("fps")->shape, IsEmpty());
  EXPECT_EQ(dir.Count(), 1u);
}

TEST(WriteNpzTest, ArraysAreCompressed) {
  const TempDir dir;
  ASSERT_THAT(WriteNpz(dir.File("a.npz"), {{"a", NpyFile("|u1", {1 << 20}, std::string(1 << 20, '\0'))}}), IsOk());
  EXPECT_LT(std::filesystem::file_size(dir.File("a.npz")), size_t{1} << 14);
}

TEST(WriteNpzTest, AnArchiveThatWasThereIsReplacedAndNotAddedTo) {
  const TempDir dir;
  ASSERT_THAT(WriteNpz(dir.File("a.npz"), {{"old", NpyFile("|u1", {1}, "1")}}), IsOk());
  ASSERT_THAT(WriteNpz(dir.File("a.npz"), {{"new", NpyFile("|u1", {1}, "2")}}), IsOk());
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(dir.File("a.npz"));
  ASSERT_THAT(npz, IsOk());
  EXPECT_TRUE(npz->Has("new"));
  EXPECT_FALSE(npz->Has("old"));
}

TEST(WriteNpzTest, WhatCannotBeWrittenIsAnErrorAndLeavesNoFile) {
  const TempDir dir;
  const std::string array = NpyFile("|u1", {1}, "1");
  EXPECT_FALSE(WriteNpz(dir.File("no/a.npz"), {{"a", array}}).ok());
  EXPECT_FALSE(WriteNpz("/proc/a.npz", {{"a", array}}).ok());
  EXPECT_FALSE(WriteNpz(dir.File("a.npz"), {{"a", array}, {"a", array}}).ok()) << "two arrays of one name";
  EXPECT_EQ(dir.Count(), 0u);
}

}  // namespace
}  // namespace holdfast
