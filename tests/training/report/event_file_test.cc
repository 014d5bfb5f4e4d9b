// SPDX-License-Identifier: Apache-2.0
#include "training/report/event_file.h"

#include <gtest/gtest.h>

namespace holdfast {
namespace {

std::string Bytes(std::initializer_list<int> values) {
  std::string bytes;
  for (const int value : values) bytes.push_back(static_cast<char>(value));
  return bytes;
}

TEST(EventFileTest, ChecksumsAreCastagnolis) {
  EXPECT_EQ(Crc32c("123456789"), 0xE3069283u);
  EXPECT_EQ(Crc32c(std::string(32, '\0')), 0x8A9136AAu);  // RFC 3720, B.4
}

TEST(EventFileTest, RecordsHaveLengthAndMaskedChecksums) {
  const std::string record = FrameRecord("123456789");
  ASSERT_EQ(record.size(), 8 + 4 + 9 + 4u);
  EXPECT_EQ(record.substr(0, 8), Bytes({9, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_EQ(record.substr(12, 9), "123456789");
  // ((0xE3069283 >> 15) | (0xE3069283 << 17)) + 0xA282EAD8 modulo 2^32
  EXPECT_EQ(record.substr(21), Bytes({0xE5, 0xB0, 0x8A, 0xC7}));
}

TEST(EventFileTest, ScalarEventsAreTensorflowsMessages) {
  const std::string event = EncodeScalarEvent(1.0, 300, {{"a", 2.0f}});
  EXPECT_EQ(event, Bytes({0x09, 0,    0,    0,    0, 0, 0, 0xF0, 0x3F,  // wall_time = 1.0
                          0x10, 0xAC, 0x02,                             // step = 300
                          0x2A, 0x0A,                                   // summary, 10 bytes
                          0x0A, 0x08,                                   // value, 8 bytes
                          0x0A, 0x01, 'a',  0x15, 0, 0, 0, 0x40}));     // tag = "a", simple_value = 2.0
}

TEST(EventFileTest, TheFirstEventNamesTheVersion) {
  EXPECT_EQ(EncodeVersionEvent(1.0).substr(9), Bytes({0x1A, 13}) + "brain.Event:2");
}

}  // namespace
}  // namespace holdfast
