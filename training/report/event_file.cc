// SPDX-License-Identifier: Apache-2.0
#include "training/report/event_file.h"

#include <cstring>

namespace holdfast {
namespace {

// Protobuf's wire types of the fields used here; numbers below are those of tensorflow.Event and tensorflow.Summary.
constexpr int kVarint = 0, kFixed64 = 1, kBytes = 2, kFixed32 = 5;

template <typename T>
void AppendLittleEndian(T value, std::string* out) {
  for (size_t i = 0; i < sizeof(T); ++i) out->push_back(static_cast<char>(value >> (8 * i)));
}

void AppendVarint(uint64_t value, std::string* out) {
  for (; value >= 0x80; value >>= 7) out->push_back(static_cast<char>(value | 0x80));
  out->push_back(static_cast<char>(value));
}

void AppendTag(int field, int wire_type, std::string* out) { AppendVarint(field << 3 | wire_type, out); }

void AppendBytes(int field, absl::string_view bytes, std::string* out) {
  AppendTag(field, kBytes, out);
  AppendVarint(bytes.size(), out);
  out->append(bytes.data(), bytes.size());
}

std::string EventAt(double wall_seconds) {
  std::string event;
  uint64_t bits;
  std::memcpy(&bits, &wall_seconds, sizeof bits);
  AppendTag(1, kFixed64, &event);
  AppendLittleEndian(bits, &event);
  return event;
}

uint32_t MaskedCrc(absl::string_view bytes) {
  const uint32_t crc = Crc32c(bytes);
  return ((crc >> 15) | (crc << 17)) + 0xA282EAD8u;
}

}  // namespace

uint32_t Crc32c(absl::string_view bytes) {
  uint32_t crc = ~0u;
  for (const char byte : bytes) {
    crc ^= static_cast<uint8_t>(byte);
    for (int bit = 0; bit < 8; ++bit) crc = (crc >> 1) ^ (crc & 1 ? 0x82F63B78u : 0);
  }
  return ~crc;
}

std::string FrameRecord(absl::string_view bytes) {
  std::string record;
  AppendLittleEndian(static_cast<uint64_t>(bytes.size()), &record);
  AppendLittleEndian(MaskedCrc(record), &record);
  record.append(bytes.data(), bytes.size());
  AppendLittleEndian(MaskedCrc(bytes), &record);
  return record;
}

std::string EncodeVersionEvent(double wall_seconds) {
  std::string event = EventAt(wall_seconds);
  AppendBytes(3, "brain.Event:2", &event);
  return event;
}

std::string EncodeScalarEvent(double wall_seconds, int64_t step, const Scalars& scalars) {
  std::string summary;
  for (const auto& [tag, scalar] : scalars) {
    uint32_t bits;
    std::memcpy(&bits, &scalar, sizeof bits);
    std::string value;
    AppendBytes(1, tag, &value);
    AppendTag(2, kFixed32, &value);
    AppendLittleEndian(bits, &value);
    AppendBytes(1, value, &summary);
  }
  std::string event = EventAt(wall_seconds);
  AppendTag(2, kVarint, &event);
  AppendVarint(static_cast<uint64_t>(step), &event);
  AppendBytes(5, summary, &event);
  return event;
}

}  // namespace holdfast
