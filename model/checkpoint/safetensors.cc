// SPDX-License-Identifier: Apache-2.0
#include "model/checkpoint/safetensors.h"

#include <algorithm>
#include <cstring>
#include <exception>
#include <vector>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"
#include "io/atomic_file.h"
#include "io/bounded_json.h"
#include "io/quoted.h"

namespace holdfast {
namespace {

static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "the format is little-endian, and so is this code");

constexpr uint64_t kLengthBytes = 8;                     // of the header's length in front of the file
constexpr uint64_t kMaxHeaderBytes = uint64_t{4} << 20;  // about 30,000 tensors
constexpr size_t kMaxDims = 8;
constexpr int64_t kMaxElements = int64_t{1} << 40;
constexpr char kMetadataKey[] = "__metadata__";

struct Dtype {
  const char* name;
  torch::ScalarType type;
};

constexpr Dtype kDtypes[] = {
    {"F32", torch::kFloat32}, {"F16", torch::kFloat16}, {"BF16", torch::kBFloat16}, {"F64", torch::kFloat64},
    {"I64", torch::kInt64},   {"I32", torch::kInt32},   {"U8", torch::kUInt8},      {"BOOL", torch::kBool},
};

// One tensor of the header.
struct Entry {
  std::string name;
  torch::ScalarType dtype = torch::kFloat32;
  std::vector<int64_t> shape;
  uint64_t begin = 0;  // bytes after the header
  uint64_t end = 0;
};

absl::Status Bad(absl::string_view tensor, absl::string_view problem) {
  return absl::InvalidArgumentError(absl::StrCat("safetensors: tensor ", Quoted(tensor), ": ", problem));
}

absl::Status BadFile(absl::string_view problem) {
  return absl::InvalidArgumentError(absl::StrCat("safetensors: ", problem));
}

absl::Status ReadDtype(const nlohmann::json& value, Entry& entry) {
  if (!value.is_string()) return Bad(entry.name, "dtype is not a string");
  const auto& name = value.get_ref<const std::string&>();
  for (const Dtype& dtype : kDtypes) {
    if (name != dtype.name) continue;
    entry.dtype = dtype.type;
    return absl::OkStatus();
  }
  return Bad(entry.name, absl::StrCat("unknown dtype ", Quoted(name)));
}

// Unsigned 64-bit values, at most 'max_count' of them.
absl::StatusOr<std::vector<uint64_t>> ReadNumbers(const nlohmann::json& value, size_t max_count) {
  if (!value.is_array() || value.size() > max_count) {
    return absl::InvalidArgumentError(absl::StrCat("is not a list of at most ", max_count, " numbers"));
  }
  std::vector<uint64_t> numbers;
  for (const nlohmann::json& number : value) {
    if (!number.is_number_unsigned()) return absl::InvalidArgumentError("has an item that is not a whole number >= 0");
    numbers.push_back(number.get<uint64_t>());
  }
  return numbers;
}

// A size of 0 counts as 1, so that no tensor library overflows on the strides of an empty tensor either.
absl::Status ReadShape(const nlohmann::json& value, Entry& entry) {
  const auto sizes = ReadNumbers(value, kMaxDims);
  if (!sizes.ok()) return Bad(entry.name, absl::StrCat("shape ", sizes.status().message()));
  int64_t elements = 1;
  for (const uint64_t size : *sizes) {
    const uint64_t factor = std::max<uint64_t>(size, 1);
    if (factor > static_cast<uint64_t>(kMaxElements / elements)) return Bad(entry.name, "shape is too large");
    elements *= static_cast<int64_t>(factor);
    entry.shape.push_back(static_cast<int64_t>(size));
  }
  return absl::OkStatus();
}

absl::Status ReadOffsets(const nlohmann::json& value, uint64_t data_bytes, Entry& entry) {
  const auto offsets = ReadNumbers(value, 2);
  if (!offsets.ok()) return Bad(entry.name, absl::StrCat("data_offsets ", offsets.status().message()));
  if (offsets->size() != 2 || (*offsets)[0] > (*offsets)[1]) {
    return Bad(entry.name, "data_offsets are not a begin and an end");
  }
  entry.begin = (*offsets)[0];
  entry.end = (*offsets)[1];
  if (entry.end > data_bytes) {
    return Bad(entry.name, absl::StrCat("ends at byte ", entry.end, " of ", data_bytes,
                                        ": out of bounds, or the file is truncated"));
  }
  return absl::OkStatus();
}

absl::StatusOr<Entry> ReadEntry(const std::string& name, const nlohmann::json& value, uint64_t data_bytes) {
  Entry entry;
  entry.name = name;
  if (!value.is_object() || value.size() != 3 || !value.contains("dtype") || !value.contains("shape") ||
      !value.contains("data_offsets")) {
    return Bad(name, "is not an object of dtype, shape and data_offsets");
  }
  if (auto s = ReadDtype(value["dtype"], entry); !s.ok()) return s;
  if (auto s = ReadShape(value["shape"], entry); !s.ok()) return s;
  if (auto s = ReadOffsets(value["data_offsets"], data_bytes, entry); !s.ok()) return s;
  uint64_t bytes = torch::elementSize(entry.dtype);
  for (const int64_t size : entry.shape) bytes *= static_cast<uint64_t>(size);
  if (bytes != entry.end - entry.begin) {
    return Bad(name, absl::StrCat("shape [", absl::StrJoin(entry.shape, ", "), "] takes ", bytes, " bytes, not ",
                                  entry.end - entry.begin));
  }
  return entry;
}

// The tensors must cover the data exactly: bytes that are in two tensors or in none can hide something.
absl::Status CheckCoverage(std::vector<Entry>& entries, uint64_t data_bytes) {
  std::sort(entries.begin(), entries.end(),
            [](const Entry& a, const Entry& b) { return std::tie(a.begin, a.end) < std::tie(b.begin, b.end); });
  uint64_t covered = 0;
  for (const Entry& entry : entries) {
    if (entry.begin < covered) return Bad(entry.name, "overlaps another tensor");
    if (entry.begin > covered) return Bad(entry.name, "leaves a hole before it");
    covered = entry.end;
  }
  if (covered != data_bytes) return BadFile(absl::StrCat(data_bytes - covered, " bytes after the last tensor"));
  return absl::OkStatus();
}

absl::Status ReadMetadata(const nlohmann::json& value, std::map<std::string, std::string>& metadata) {
  if (!value.is_object()) return BadFile("__metadata__ is not an object");
  for (const auto& [key, text] : value.items()) {
    if (!text.is_string()) return BadFile(absl::StrCat("metadata ", Quoted(key), " is not a string"));
    metadata[key] = text.get<std::string>();
  }
  return absl::OkStatus();
}

absl::StatusOr<torch::Tensor> MakeTensor(const Entry& entry, absl::string_view data) {
  const absl::string_view bytes = data.substr(entry.begin, entry.end - entry.begin);
  if (entry.dtype == torch::kBool && bytes.find_first_not_of(absl::string_view("\0\1", 2)) != absl::string_view::npos) {
    return Bad(entry.name, "a truth value is neither 0 nor 1");
  }
  torch::Tensor tensor = torch::empty(entry.shape, entry.dtype);
  if (!bytes.empty()) std::memcpy(tensor.data_ptr(), bytes.data(), bytes.size());
  return tensor;
}

// Splits the file into header and data.
absl::StatusOr<nlohmann::json> ParseHeader(absl::string_view bytes, absl::string_view& data) {
  if (bytes.size() < kLengthBytes) return BadFile("truncated before the header");
  uint64_t length = 0;
  std::memcpy(&length, bytes.data(), kLengthBytes);
  bytes.remove_prefix(kLengthBytes);
  if (length > kMaxHeaderBytes)
    return BadFile(absl::StrCat("a header of ", length, " bytes; at most ", kMaxHeaderBytes));
  if (length > bytes.size()) return BadFile("truncated within the header");
  data = bytes.substr(length);
  auto header = ParseBoundedJson(bytes.substr(0, length), JsonLimits{kMaxHeaderBytes, 3});
  if (!header.ok()) return BadFile(absl::StrCat("header: ", header.status().message()));
  if (!header->is_object()) return BadFile("the header is not an object");
  return header;
}

absl::StatusOr<TensorFile> ParseChecked(absl::string_view bytes) {
  absl::string_view data;
  const auto header = ParseHeader(bytes, data);
  if (!header.ok()) return header.status();
  TensorFile file;
  std::vector<Entry> entries;
  for (const auto& [name, value] : header->items()) {
    if (name == kMetadataKey) {
      if (auto s = ReadMetadata(value, file.metadata); !s.ok()) return s;
      continue;
    }
    auto entry = ReadEntry(name, value, data.size());
    if (!entry.ok()) return entry.status();
    entries.push_back(*std::move(entry));
  }
  if (auto s = CheckCoverage(entries, data.size()); !s.ok()) return s;
  for (const Entry& entry : entries) {
    auto tensor = MakeTensor(entry, data);
    if (!tensor.ok()) return tensor.status();
    file.tensors[entry.name] = *std::move(tensor);
  }
  return file;
}

const char* DtypeName(torch::ScalarType type) {
  for (const Dtype& dtype : kDtypes) {
    if (dtype.type == type) return dtype.name;
  }
  return nullptr;
}

struct Output {
  std::string name;
  torch::Tensor tensor;  // contiguous, CPU
};

absl::StatusOr<std::vector<Output>> Outputs(const TensorFile& file) {
  std::vector<Output> outputs;
  for (const auto& [name, tensor] : file.tensors) {
    if (name == kMetadataKey) return Bad(name, "the name is taken by the format");
    if (!tensor.defined()) return Bad(name, "is undefined");
    if (DtypeName(tensor.scalar_type()) == nullptr) {
      return Bad(name, absl::StrCat("dtype ", c10::toString(tensor.scalar_type()), " cannot be stored"));
    }
    outputs.push_back({name, tensor.detach().cpu().contiguous()});
  }
  // Larger elements first: each tensor is then aligned in a file that is mapped into memory.
  std::stable_sort(outputs.begin(), outputs.end(),
                   [](const Output& a, const Output& b) { return a.tensor.element_size() > b.tensor.element_size(); });
  return outputs;
}

std::string MakeHeader(const TensorFile& file, const std::vector<Output>& outputs) {
  nlohmann::ordered_json header = nlohmann::ordered_json::object();
  if (!file.metadata.empty()) header[kMetadataKey] = file.metadata;
  uint64_t offset = 0;
  for (const Output& output : outputs) {
    const uint64_t end = offset + output.tensor.nbytes();
    header[output.name] = {{"dtype", DtypeName(output.tensor.scalar_type())},
                           {"shape", output.tensor.sizes().vec()},
                           {"data_offsets", {offset, end}}};
    offset = end;
  }
  std::string text = header.dump();
  text.append((8 - text.size() % 8) % 8, ' ');
  return text;
}

absl::StatusOr<std::string> SerializeChecked(const TensorFile& file) {
  const auto outputs = Outputs(file);
  if (!outputs.ok()) return outputs.status();
  const std::string header = MakeHeader(file, *outputs);
  const uint64_t length = header.size();
  if (length > kMaxHeaderBytes)
    return BadFile(absl::StrCat("a header of ", length, " bytes; at most ", kMaxHeaderBytes));
  std::string bytes(reinterpret_cast<const char*>(&length), kLengthBytes);
  bytes += header;
  for (const Output& output : *outputs) {
    bytes.append(static_cast<const char*>(output.tensor.data_ptr()), output.tensor.nbytes());
  }
  return bytes;
}

// Exceptions end here: LibTorch's and the allocator's mean a lack of memory, nlohmann's a text that is not UTF-8.
template <typename Function>
auto WithoutExceptions(const Function& function) -> decltype(function()) {
  try {
    return function();
  } catch (const nlohmann::json::exception& error) {
    return BadFile(error.what());
  } catch (const std::exception& error) {
    return absl::ResourceExhaustedError(absl::StrCat("safetensors: ", error.what()));
  }
}

}  // namespace

absl::StatusOr<TensorFile> ParseSafetensors(absl::string_view bytes) {
  return WithoutExceptions([&] { return ParseChecked(bytes); });
}

absl::StatusOr<TensorFile> ReadSafetensors(const std::string& path, int64_t max_bytes) {
  const auto bytes = ReadFile(path, max_bytes);
  if (!bytes.ok()) return bytes.status();
  return ParseSafetensors(*bytes);
}

absl::StatusOr<std::string> SerializeSafetensors(const TensorFile& file) {
  return WithoutExceptions([&] { return SerializeChecked(file); });
}

absl::Status WriteSafetensors(const std::string& path, const TensorFile& file) {
  const auto bytes = SerializeSafetensors(file);
  if (!bytes.ok()) return bytes.status();
  return WriteFileAtomically(path, *bytes);
}

}  // namespace holdfast
