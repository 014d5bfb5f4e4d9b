// SPDX-License-Identifier: Apache-2.0
#include "io/npz_reader.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <limits>

#include "io/npz_writer.h"
#include "tests/support/npy_bytes.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"
#include "training/data/rng.h"

namespace holdfast {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

absl::StatusOr<NpyHeader> Parse(const std::string& dictionary) {
  size_t used = 0;
  return ParseNpyHeader(NpyHeaderBytes(dictionary), &used);
}

std::string ReadBytes(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class NpzTest : public ::testing::Test {
 protected:
  std::string Write(const std::vector<std::pair<std::string, std::string>>& arrays) {
    const std::string path = directory_.File("a.npz");
    EXPECT_THAT(WriteNpz(path, arrays), IsOk());
    return path;
  }
  TempDir directory_;
};

TEST(NpyHeaderTest, ReadsWhatNumPyWrites) {
  const absl::StatusOr<NpyHeader> header = Parse("{'descr': '<f4', 'fortran_order': False, 'shape': (24, 100, 2), }");
  ASSERT_THAT(header, IsOk());
  EXPECT_EQ(header->kind, 'f');
  EXPECT_EQ(header->item_bytes, 4);
  EXPECT_THAT(header->shape, ElementsAre(24, 100, 2));
  EXPECT_EQ(header->values(), 4800);
}

TEST(NpyHeaderTest, ReadsScalarsVectorsAndEmptyArrays) {
  EXPECT_EQ(Parse("{'descr': '<i8', 'fortran_order': False, 'shape': (), }")->values(), 1);
  EXPECT_THAT(Parse("{'descr': '|b1', 'fortran_order': False, 'shape': (5,), }")->shape, ElementsAre(5));
  EXPECT_EQ(Parse("{'descr': '|u1', 'fortran_order': False, 'shape': (0, 7), }")->values(), 0);
}

TEST(NpyHeaderTest, RefusesTypesAndOrdersItCannotRead) {
  for (const char* text : {"{'descr': '>f4', 'fortran_order': False, 'shape': (1,), }",
                           "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
                           "{'descr': '<f1', 'fortran_order': False, 'shape': (1,), }",
                           "{'descr': '<U9', 'fortran_order': False, 'shape': (1,), }",
                           "{'descr': [('x', '<f4'), ('y', '<i4')], 'fortran_order': False, 'shape': (1,), }",
                           "{'descr': '<f4', 'fortran_order': True, 'shape': (1,), }"}) {
    EXPECT_THAT(Parse(text), StatusIs(absl::StatusCode::kUnimplemented)) << text;
  }
}

TEST(NpyHeaderTest, RefusesMalformedHeaders) {
  for (const char* text : {"", "{", "{}", "{'descr': '<f4'}", "{'descr': '<f4', 'fortran_order': False, 'shape': (1, }",
                           "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,), }",
                           "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,), }",
                           "{'descr': '<f4', 'fortran_order': False, 'shape': (1048576, 1048576, 1048576), }",
                           "{'descr': '<f4', 'fortran_order': False, 'shape': (1,1,1,1,1,1,1,1,1,1), }",
                           "{'descr': '<f4', 'fortran_order': 0, 'shape': (1,), }",
                           "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'extra': 1, }",
                           "{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (1,), }",
                           "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), } import os"}) {
    EXPECT_THAT(Parse(text), StatusIs(absl::StatusCode::kDataLoss)) << text;
  }
}

TEST(NpyHeaderTest, RefusesHeadersThatAreCutAnywhere) {
  const std::string whole = NpyHeaderBytes(NpyDictionary("<f4", {3, 2}));
  size_t used = 0;
  for (size_t length = 0; length < whole.size(); ++length) {
    EXPECT_FALSE(ParseNpyHeader(whole.substr(0, length), &used).ok()) << length;
  }
  EXPECT_THAT(ParseNpyHeader(whole, &used), IsOk());
  EXPECT_EQ(used, whole.size());
}

TEST_F(NpzTest, ReadsTheRowsAskedFor) {
  const std::string path = Write({{"a", NpyBytes<float>("<f4", {3, 2}, {0, 1, 2, 3, 4, 5})},
                                  {"b", NpyBytes<uint8_t>("|b1", {3}, {1, 0, 1})},
                                  {"c", NpyBytes<double>("<f8", {3, 1}, {0.5, 1.5, -2.5})},
                                  {"d", NpyBytes<int64_t>("<i8", {3}, {-7, 8, 9})}});
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(path);
  ASSERT_THAT(npz, IsOk());
  EXPECT_TRUE(npz->Has("a"));
  EXPECT_FALSE(npz->Has("z"));
  EXPECT_THAT(npz->ReadRows("a", {0, 2})->values, ElementsAre(0, 1, 4, 5));
  EXPECT_THAT(npz->ReadRows("a", {0, 2})->shape, ElementsAre(3, 2));
  EXPECT_THAT(npz->ReadRows("b", {0, 1, 2})->values, ElementsAre(1, 0, 1));
  EXPECT_THAT(npz->ReadRows("c", {2})->values, ElementsAre(-2.5f));
  EXPECT_THAT(npz->ReadRows("d", {0, 1})->values, ElementsAre(-7, 8));
}

// 1, -2.5, the largest, the smallest, both infinities and what is no number, as numpy writes them.
TEST_F(NpzTest, ReadsNumbersOf16Bits) {
  const std::vector<uint16_t> halves = {0x3c00, 0xc100, 0x7bff, 0x0001, 0x7c00, 0xfc00, 0x7e00};
  const auto npz = NpzFile::Open(Write({{"a", NpyBytes<uint16_t>("<f2", {1, 7}, halves)}}));
  ASSERT_THAT(npz, IsOk());
  std::vector<float> values = npz->ReadRows("a", {0})->values;
  EXPECT_TRUE(std::isnan(values.back()));
  values.pop_back();
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  EXPECT_THAT(values, ElementsAre(1, -2.5f, 65504, std::ldexp(1.0f, -24), kInfinity, -kInfinity));
}

TEST_F(NpzTest, ReadsALongRowToItsEnd) {
  constexpr int64_t kLong = (int64_t{2} << 20) + 3;  // more than is read at once
  std::vector<uint8_t> values(2 * kLong);
  for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<uint8_t>(i % 251);
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(Write({{"a", NpyBytes<uint8_t>("|u1", {2, kLong}, values)}}));
  ASSERT_THAT(npz, IsOk());
  const absl::StatusOr<NpyRows> rows = npz->ReadRows("a", {1});
  ASSERT_THAT(rows, IsOk());
  EXPECT_EQ(rows->values, std::vector<float>(values.begin() + kLong, values.end()));
}

TEST_F(NpzTest, ArraysOfOtherKindsDoNotHinderTheReadableOnes) {
  const std::string structure = "{'descr': [('x', '<f4'), ('y', '<f4')], 'fortran_order': False, 'shape': (1,), }";
  const std::string path = Write({{"name", NpyBytes<int32_t>("<U1", {1}, {65})},
                                  {"pairs", NpyHeaderBytes(structure) + std::string(8, '\0')},
                                  {"a", NpyBytes<float>("<f4", {1}, {4})}});
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(path);
  ASSERT_THAT(npz, IsOk());
  EXPECT_THAT(npz->ReadRows("a", {0})->values, ElementsAre(4));
  for (const char* name : {"name", "pairs"}) {
    EXPECT_FALSE(npz->Has(name));
    EXPECT_THAT(npz->ReadRows(name, {0}), StatusIs(absl::StatusCode::kUnimplemented, HasSubstr(name)));
  }
}

TEST_F(NpzTest, MembersThatAreNoArraysArePassedOver) {
  std::string bytes = ReadBytes(Write({{"notes", "no array"}, {"a", NpyBytes<float>("<f4", {1}, {4})}}));
  for (size_t at; (at = bytes.find("notes.npy")) != std::string::npos;) bytes.replace(at, 9, "notes.txt");
  std::ofstream(directory_.File("a.npz"), std::ios::binary) << bytes;
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(directory_.File("a.npz"));
  ASSERT_THAT(npz, IsOk());
  EXPECT_THAT(npz->ReadRows("a", {0})->values, ElementsAre(4));
  for (const char* name : {"notes", "notes.txt"}) {
    EXPECT_THAT(npz->ReadRows(name, {0}), StatusIs(absl::StatusCode::kNotFound, HasSubstr(name)));
  }
}

TEST_F(NpzTest, MessagesShowNamesEscaped) {
  EXPECT_THAT(NpzFile::Open(Write({{"a\nb", "no array"}})),
              StatusIs(absl::StatusCode::kDataLoss, HasSubstr("'a\\nb'")));
}

TEST_F(NpzTest, RowsThatAreNotThereAreErrors) {
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(Write({{"a", NpyBytes<float>("<f4", {2}, {4, 5})}}));
  ASSERT_THAT(npz, IsOk());
  for (const std::vector<int64_t>& rows : {std::vector<int64_t>{2}, {-1}, {1, 0}, {0, 0}}) {
    EXPECT_THAT(npz->ReadRows("a", rows), StatusIs(absl::StatusCode::kOutOfRange));
  }
}

TEST_F(NpzTest, AShapeThatPromisesMoreThanTheFileHasIsDamage) {
  const std::string path = Write({{"a", NpyBytes<float>("<f4", {1000000, 1000}, {1, 2, 3})}});
  EXPECT_THAT(NpzFile::Open(path), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("'a'")));
}

// Here the directory of the archive agrees with the shape, and both promise a gigabyte to a file of some hundred bytes.
TEST_F(NpzTest, ASizeThatTheFileDoesNotHoldIsDamage) {
  constexpr uint32_t kValues = 1 << 27;
  const std::string header = NpyBytes<double>("<f8", {1, kValues}, {});
  std::string bytes = ReadBytes(Write({{"a", header + std::string(1 << 16, '\0')}}));
  const uint32_t lie = static_cast<uint32_t>(header.size()) + kValues * 8;
  std::memcpy(&bytes[bytes.find("PK\x03\x04") + 22], &lie, sizeof(lie));
  std::memcpy(&bytes[bytes.find("PK\x01\x02") + 24], &lie, sizeof(lie));
  const std::string path = directory_.File("lie.npz");
  std::ofstream(path, std::ios::binary) << bytes;
  const absl::StatusOr<NpzFile> npz = NpzFile::Open(path);
  ASSERT_THAT(npz, IsOk());
  EXPECT_THAT(npz->ReadRows("a", {0}), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("damaged")));
}

TEST_F(NpzTest, AMissingFileAndAFileThatIsNoArchiveAreErrorsWithThePath) {
  EXPECT_THAT(NpzFile::Open(directory_.File("none.npz")), StatusIs(absl::StatusCode::kNotFound, HasSubstr("none.npz")));
  std::ofstream(directory_.File("text.npz")) << "hello";
  EXPECT_THAT(NpzFile::Open(directory_.File("text.npz")), StatusIs(absl::StatusCode::kDataLoss, HasSubstr("text.npz")));
}

// Whatever is done to the bytes, the answer is an error or an array of the promised size.
TEST_F(NpzTest, DamagedBytesNeverGiveAnArrayOfAnotherSize) {
  std::vector<float> values(600);
  for (size_t i = 0; i < values.size(); ++i) values[i] = static_cast<float>(i * 7919 % 601);
  const std::string whole = ReadBytes(Write({{"a", NpyBytes<float>("<f4", {30, 20}, values)}}));
  Rng rng(3);
  int errors = 0;
  for (int round = 0; round < 300; ++round) {
    std::string bytes = whole;
    if (round % 3 == 0) bytes.resize(static_cast<size_t>(rng.Below(static_cast<int64_t>(bytes.size()))));
    for (int i = 0; i < 3 && !bytes.empty(); ++i)
      bytes[static_cast<size_t>(rng.Below(static_cast<int64_t>(bytes.size())))] ^= static_cast<char>(1 << rng.Below(8));
    const std::string path = directory_.File("damaged.npz");
    std::ofstream(path, std::ios::binary) << bytes;
    const absl::StatusOr<NpzFile> npz = NpzFile::Open(path);
    const absl::StatusOr<NpyRows> rows = npz.ok() ? npz->ReadRows("a", {0, 29}) : npz.status();
    if (rows.ok()) {
      EXPECT_EQ(rows->values.size(), 40u);
    }
    errors += !rows.ok();
  }
  EXPECT_GT(errors, 200);
}

}  // namespace
}  // namespace holdfast
