// SPDX-License-Identifier: Apache-2.0
#include "io/npz_reader.h"

#include <zip.h>

#include <algorithm>
#include <cstring>
#include <memory>
#include <utility>

#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

constexpr int64_t kMaxReadValues = int64_t{1} << 29;  // of the rows of one call
// What memory is taken for before the file has shown that it holds so many: its sizes are only what it says of itself.
constexpr int64_t kPieceValues = int64_t{1} << 20;

template <typename T>
float ValueAt(const char* bytes) {
  T value;
  std::memcpy(&value, bytes, sizeof(T));
  return static_cast<float>(value);
}

// Of an IEEE 754 number of 16 bits.
float HalfAt(const char* bytes) {
  uint16_t half;
  std::memcpy(&half, bytes, sizeof(half));
  const int exponent = half >> 10 & 31, fraction = half & 1023;
  const float sign = half >> 15 != 0 ? -1.0f : 1.0f;
  if (exponent == 0) return sign * std::ldexp(static_cast<float>(fraction), -24);
  if (exponent < 31) return sign * std::ldexp(static_cast<float>(1024 + fraction), exponent - 25);
  return fraction != 0 ? std::nanf("") : sign * std::numeric_limits<float>::infinity();
}

using Converter = float (*)(const char*);

Converter ConverterOf(const NpyHeader& header) {
  const bool is_signed = header.kind == 'i';
  if (header.kind == 'f' && header.item_bytes == 2) return &HalfAt;
  if (header.kind == 'f') return header.item_bytes == 4 ? &ValueAt<float> : &ValueAt<double>;
  if (header.item_bytes == 1) return is_signed ? &ValueAt<int8_t> : &ValueAt<uint8_t>;
  if (header.item_bytes == 2) return is_signed ? &ValueAt<int16_t> : &ValueAt<uint16_t>;
  if (header.item_bytes == 4) return is_signed ? &ValueAt<int32_t> : &ValueAt<uint32_t>;
  return is_signed ? &ValueAt<int64_t> : &ValueAt<uint64_t>;
}

struct ZipCloser {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct EntryCloser {
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};
using Archive = std::unique_ptr<zip_t, ZipCloser>;
using ArchiveEntry = std::unique_ptr<zip_file_t, EntryCloser>;

absl::StatusOr<Archive> OpenArchive(const std::string& path) {
  int error = 0;
  Archive archive(zip_open(path.c_str(), ZIP_RDONLY, &error));
  if (archive != nullptr) return archive;
  if (error == ZIP_ER_NOENT) return absl::NotFoundError(absl::StrCat("no file ", path));
  return absl::DataLossError(absl::StrCat(path, " is not a readable .npz file"));
}

// Reads exactly 'size' bytes.
bool ReadFully(zip_file_t* file, char* out, size_t size) {
  while (size > 0) {
    const zip_int64_t got = zip_fread(file, out, size);
    if (got <= 0) return false;
    out += got;
    size -= static_cast<size_t>(got);
  }
  return true;
}

bool Skip(zip_file_t* file, size_t size) {
  std::string scratch(std::min<size_t>(size, 1 << 20), '\0');
  while (size > 0) {
    const size_t step = std::min(size, scratch.size());
    if (!ReadFully(file, scratch.data(), step)) return false;
    size -= step;
  }
  return true;
}

// The header of the array in 'file', whose entry has 'entry_bytes' unpacked.
absl::StatusOr<NpyHeader> ReadHeader(zip_file_t* file, uint64_t entry_bytes, size_t* header_bytes) {
  std::string bytes(std::min<uint64_t>(entry_bytes, kMaxNpyHeaderBytes), '\0');
  if (!ReadFully(file, bytes.data(), bytes.size())) return DamagedArray("its packed bytes are damaged");
  absl::StatusOr<NpyHeader> header = ParseNpyHeader(bytes, header_bytes);
  if (!header.ok()) return header;
  if (*header_bytes + static_cast<uint64_t>(header->values() * header->item_bytes) != entry_bytes) {
    return DamagedArray("its shape does not match its size");
  }
  return header;
}

absl::Status CheckRows(const std::vector<int64_t>& rows, const NpyHeader& header, int64_t row_values) {
  if (header.shape.empty()) return absl::FailedPreconditionError("has no rows");
  int64_t last = -1;
  for (const int64_t row : rows) {
    if (row <= last || row >= header.shape[0]) {
      return absl::OutOfRangeError(absl::StrCat("has no row ", row, " after ", last, " of ", header.shape[0]));
    }
    last = row;
  }
  if (!rows.empty() && row_values > kMaxReadValues / static_cast<int64_t>(rows.size())) {
    return absl::ResourceExhaustedError("has too many values to read at once");
  }
  return absl::OkStatus();
}

// Appends the next 'count' values.
bool ReadValues(zip_file_t* file, const NpyHeader& header, int64_t count, std::vector<float>& values) {
  const Converter convert = ConverterOf(header);
  std::string piece(static_cast<size_t>(std::min(count, kPieceValues) * header.item_bytes), '\0');
  while (count > 0) {
    const int64_t taken = std::min(count, kPieceValues);
    if (!ReadFully(file, piece.data(), static_cast<size_t>(taken * header.item_bytes))) return false;
    for (int64_t i = 0; i < taken; ++i) values.push_back(convert(piece.data() + i * header.item_bytes));
    count -= taken;
  }
  return true;
}

// Unpacks 'rows' from 'file', which is at its beginning.
absl::Status StreamRows(zip_file_t* file, const NpyHeader& header, size_t header_bytes,
                        const std::vector<int64_t>& rows, int64_t row_values, std::vector<float>& values) {
  const size_t row_bytes = static_cast<size_t>(row_values * header.item_bytes);
  if (!Skip(file, header_bytes)) return DamagedArray("its packed bytes are damaged");
  int64_t next = 0;
  for (const int64_t wanted : rows) {
    if (!Skip(file, static_cast<size_t>(wanted - next) * row_bytes) || !ReadValues(file, header, row_values, values)) {
      return DamagedArray("its packed bytes are damaged");
    }
    next = wanted + 1;
  }
  return absl::OkStatus();
}

}  // namespace

absl::StatusOr<NpzFile> NpzFile::Open(const std::string& path) {
  absl::StatusOr<Archive> archive = OpenArchive(path);
  if (!archive.ok()) return archive.status();
  NpzFile npz(path);
  const zip_int64_t count = zip_get_num_entries(archive->get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    zip_stat_t stat;
    if (zip_stat_index(archive->get(), static_cast<zip_uint64_t>(i), 0, &stat) != 0 ||
        (stat.valid & (ZIP_STAT_NAME | ZIP_STAT_SIZE)) != (ZIP_STAT_NAME | ZIP_STAT_SIZE)) {
      return absl::DataLossError(absl::StrCat(path, " has an unreadable entry"));
    }
    absl::string_view name = stat.name;
    if (!absl::ConsumeSuffix(&name, ".npy")) continue;
    const ArchiveEntry file(zip_fopen_index(archive->get(), static_cast<zip_uint64_t>(i), 0));
    if (file == nullptr) return absl::DataLossError(absl::StrCat(path, " has an unreadable entry"));
    Entry entry{std::string(name), NpyHeader(), 0};
    entry.header = ReadHeader(file.get(), stat.size, &entry.header_bytes);
    if (absl::IsDataLoss(entry.header.status())) {
      return absl::DataLossError(absl::StrCat(path, ": ", Quoted(name), " is ", entry.header.status().message()));
    }
    npz.entries_.push_back(std::move(entry));
  }
  return npz;
}

const NpzFile::Entry* NpzFile::Find(absl::string_view name) const {
  for (const Entry& entry : entries_) {
    if (entry.name == name) return &entry;
  }
  return nullptr;
}

bool NpzFile::Has(absl::string_view name) const { return Header(name).ok(); }

absl::StatusOr<NpyHeader> NpzFile::Header(absl::string_view name) const {
  const Entry* entry = Find(name);
  if (entry == nullptr) return absl::NotFoundError(absl::StrCat(path_, " has no array ", Quoted(name)));
  if (entry->header.ok()) return entry->header;
  const absl::Status& status = entry->header.status();
  return absl::Status(status.code(), absl::StrCat(path_, ": ", Quoted(name), ": ", status.message()));
}

absl::StatusOr<NpyRows> NpzFile::ReadRows(absl::string_view name, const std::vector<int64_t>& rows) const {
  const auto failed = [&](const absl::Status& status) {
    return absl::Status(status.code(), absl::StrCat(path_, ": ", Quoted(name), " ", status.message()));
  };
  const absl::StatusOr<NpyHeader> header = Header(name);
  if (!header.ok()) return header.status();
  const int64_t row_values = header->shape.empty() || header->shape[0] == 0 ? 0 : header->values() / header->shape[0];
  if (absl::Status status = CheckRows(rows, *header, row_values); !status.ok()) return failed(status);
  absl::StatusOr<Archive> archive = OpenArchive(path_);
  if (!archive.ok()) return archive.status();
  const ArchiveEntry file(zip_fopen(archive->get(), absl::StrCat(name, ".npy").c_str(), 0));
  if (file == nullptr) return failed(DamagedArray("it cannot be opened"));
  NpyRows result{header->shape, {}};
  result.values.reserve(static_cast<size_t>(std::min(static_cast<int64_t>(rows.size()) * row_values, kPieceValues)));
  const size_t header_bytes = Find(name)->header_bytes;
  const absl::Status status = StreamRows(file.get(), *header, header_bytes, rows, row_values, result.values);
  if (!status.ok()) return failed(status);
  return result;
}

}  // namespace holdfast
