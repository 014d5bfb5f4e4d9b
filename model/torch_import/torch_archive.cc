// SPDX-License-Identifier: Apache-2.0
#include "model/torch_import/torch_archive.h"

#include <zip.h>

#include <algorithm>
#include <cstring>
#include <exception>
#include <functional>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/strip.h"
#include "io/quoted.h"
#include "model/torch_import/pickle.h"

namespace holdfast {
namespace {

using Kind = PickleValue::Kind;

constexpr char kPickleSuffix[] = "/data.pkl";
constexpr char kStateDictKey[] = "model_state_dict";
constexpr char kModulePrefix[] = "module.";
constexpr zip_int64_t kMaxEntries = 100000;
constexpr uint64_t kMaxPickleBytes = uint64_t{8} << 20;
constexpr uint64_t kMaxTensorBytes = uint64_t{2} << 30;  // of all storages together, and of all tensors

absl::Status Bad(absl::string_view what, absl::string_view problem) {
  return absl::InvalidArgumentError(absl::StrCat(Quoted(what), ": ", problem));
}

struct ZipCloser {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};
struct ZipFileCloser {
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};

// Entries of a zip file by name.
class Archive {
 public:
  static absl::StatusOr<Archive> Open(const std::string& path) {
    int code = 0;
    zip_t* zip = zip_open(path.c_str(), ZIP_RDONLY, &code);
    if (zip == nullptr) return OpenError(path, code);
    Archive archive(zip);
    if (zip_get_num_entries(zip, 0) > kMaxEntries) return Bad(path, "has too many entries");
    return archive;
  }

  // The name in front of "/data.pkl".
  absl::StatusOr<std::string> Root() const {
    std::string root;
    const zip_int64_t entries = zip_get_num_entries(zip_.get(), 0);
    for (zip_int64_t i = 0; i < entries; ++i) {
      const char* name = zip_get_name(zip_.get(), static_cast<zip_uint64_t>(i), 0);
      if (name == nullptr || !absl::EndsWith(name, kPickleSuffix)) continue;
      if (!root.empty()) return absl::InvalidArgumentError("the zip file has more than one data.pkl");
      root = std::string(absl::StripSuffix(name, kPickleSuffix));
    }
    if (root.empty()) return absl::InvalidArgumentError("the zip file has no data.pkl: it is not from torch.save");
    return root;
  }

  // Only entries that are stored as they are: torch.save compresses none, and so none can unfold to more than the file.
  absl::StatusOr<std::string> Read(const std::string& name, uint64_t max_bytes) const {
    zip_stat_t info;
    if (zip_stat(zip_.get(), name.c_str(), 0, &info) != 0) return Bad(name, "is not in the zip file");
    constexpr uint64_t kNeeded = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
    if ((info.valid & kNeeded) != kNeeded || info.comp_method != ZIP_CM_STORE || info.size != info.comp_size) {
      return Bad(name, "is compressed, which torch.save never does");
    }
    if (info.size > max_bytes) return Bad(name, absl::StrCat("has ", info.size, " bytes; at most ", max_bytes));
    const std::unique_ptr<zip_file_t, ZipFileCloser> file(zip_fopen(zip_.get(), name.c_str(), 0));
    if (file == nullptr) return Bad(name, zip_strerror(zip_.get()));
    std::string bytes;
    return ReadAll(*file, info.size, bytes)
               ? absl::StatusOr<std::string>(std::move(bytes))
               : Bad(name, absl::StrCat("truncated or damaged: ", zip_file_strerror(file.get())));
  }

  bool Has(const std::string& name) const { return zip_name_locate(zip_.get(), name.c_str(), 0) >= 0; }

 private:
  explicit Archive(zip_t* zip) : zip_(zip) {}

  static absl::Status OpenError(const std::string& path, int code) {
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    const std::string text = absl::StrCat("cannot open '", path, "': ", zip_error_strerror(&error));
    zip_error_fini(&error);
    if (code == ZIP_ER_NOENT) return absl::NotFoundError(text);
    if (code == ZIP_ER_NOZIP) {
      return absl::InvalidArgumentError(
          absl::StrCat(text, " (the format of torch.save before PyTorch 1.6 is not read)"));
    }
    return absl::InvalidArgumentError(text);
  }

  // In pieces: a size that the file does not hold takes no memory. The last read checks the CRC.
  static bool ReadAll(zip_file_t& file, uint64_t size, std::string& bytes) {
    constexpr uint64_t kPiece = uint64_t{4} << 20;
    while (true) {
      const size_t done = bytes.size();
      const uint64_t want = std::min(size - done + 1, kPiece);  // one more than there should be reaches the end
      bytes.resize(done + want);
      const zip_int64_t got = zip_fread(&file, bytes.data() + done, want);
      if (got < 0) return false;
      bytes.resize(done + static_cast<size_t>(got));
      if (got == 0) return bytes.size() == size;
      if (bytes.size() > size) return false;
    }
  }

  std::unique_ptr<zip_t, ZipCloser> zip_;
};

// Turns the tensors of a pickle into tensors with memory; each storage is read once.
class TensorReader {
 public:
  TensorReader(const Archive& archive, std::string root) : archive_(archive), root_(std::move(root)) {}

  // value.kind is kTensor.
  absl::StatusOr<torch::Tensor> Read(const PickleValue& value) {
    const PickleValue& storage_value = *value.items[0];
    const auto storage = Storage(storage_value);
    if (!storage.ok()) return storage.status();
    if (storage->scalar_type() != storage_value.dtype) return absl::InvalidArgumentError("its storage has two types");
    std::vector<int64_t> sizes, strides;
    for (const PickleValue* size : value.items[2]->items) sizes.push_back(size->integer);
    for (const PickleValue* stride : value.items[3]->items) strides.push_back(stride->integer);
    const int64_t offset = value.items[1]->integer;
    if (!Inside(sizes, strides, offset, storage->numel()))
      return absl::InvalidArgumentError("reaches out of its storage");
    bytes_made_ += torch::elementSize(storage_value.dtype) * Elements(sizes);
    if (bytes_made_ > kMaxTensorBytes) return absl::InvalidArgumentError("the state dict is too large");
    return storage->as_strided(sizes, strides, offset).clone(torch::MemoryFormat::Contiguous);
  }

 private:
  // True when every element lies within the storage and there are no more of them than it has: a stride of 0 could
  // otherwise make a giant of one number. All factors are bounded by 'elements', so that no product overflows.
  static bool Inside(const std::vector<int64_t>& sizes, const std::vector<int64_t>& strides, int64_t offset,
                     int64_t elements) {
    if (offset < 0 || offset > elements) return false;
    int64_t last = offset;
    int64_t count = 1;
    for (size_t i = 0; i < sizes.size(); ++i) {
      if (sizes[i] < 1 || sizes[i] > elements / count || strides[i] < 0) return false;
      count *= sizes[i];
      if (sizes[i] == 1) continue;
      if (strides[i] > elements || strides[i] > (elements - last) / (sizes[i] - 1)) return false;
      last += strides[i] * (sizes[i] - 1);
    }
    return last < elements;
  }

  // REQUIRES: Inside().
  static uint64_t Elements(const std::vector<int64_t>& sizes) {
    return std::accumulate(sizes.begin(), sizes.end(), uint64_t{1}, std::multiplies<>());
  }

  absl::StatusOr<torch::Tensor> Storage(const PickleValue& value) {
    if (const auto found = storages_.find(value.text); found != storages_.end()) return found->second;
    const std::string name = absl::StrCat(root_, "/data/", value.text);
    const auto bytes = archive_.Read(name, kMaxTensorBytes - bytes_read_);
    if (!bytes.ok()) return bytes.status();
    bytes_read_ += bytes->size();
    const size_t item = torch::elementSize(value.dtype);
    if (value.integer < 0 || static_cast<uint64_t>(value.integer) != bytes->size() / item ||
        bytes->size() % item != 0) {
      return Bad(name, absl::StrCat("has ", bytes->size(), " bytes, not ", value.integer, " elements of ", item));
    }
    torch::Tensor storage = torch::empty({value.integer}, value.dtype);
    if (!bytes->empty()) std::memcpy(storage.data_ptr(), bytes->data(), bytes->size());
    storages_[value.text] = storage;
    return storage;
  }

  const Archive& archive_;
  const std::string root_;
  std::map<std::string, torch::Tensor> storages_;
  uint64_t bytes_read_ = 0;
  uint64_t bytes_made_ = 0;
};

// The last value under a text key, as in Python; nullptr: none.
const PickleValue* Find(const PickleValue& dict, absl::string_view key) {
  const PickleValue* found = nullptr;
  for (size_t i = 0; i + 1 < dict.items.size(); i += 2) {
    if (dict.items[i]->kind == Kind::kText && dict.items[i]->text == key) found = dict.items[i + 1];
  }
  return found;
}

absl::StatusOr<StateDict> ReadTensors(const PickleValue& dict, TensorReader& reader) {
  if (dict.kind != Kind::kDict) return absl::InvalidArgumentError("the file holds no state dict");
  StateDict tensors;
  for (size_t i = 0; i + 1 < dict.items.size(); i += 2) {
    const PickleValue& key = *dict.items[i];
    if (key.kind != Kind::kText) return absl::InvalidArgumentError("a key of the state dict is no text");
    const std::string name(absl::StripPrefix(key.text, kModulePrefix));
    if (dict.items[i + 1]->kind != Kind::kTensor) return Bad(key.text, "is not a tensor");
    if (tensors.count(name) > 0) return Bad(key.text, "stands twice in the state dict");
    auto tensor = reader.Read(*dict.items[i + 1]);
    if (!tensor.ok()) return Bad(key.text, tensor.status().message());
    tensors[name] = *std::move(tensor);
  }
  return tensors;
}

absl::StatusOr<StateDict> ReadChecked(const std::string& path) {
  const auto archive = Archive::Open(path);
  if (!archive.ok()) return archive.status();
  const auto root = archive->Root();
  if (!root.ok()) return root.status();
  if (const std::string order = *root + "/byteorder"; archive->Has(order)) {
    const auto text = archive->Read(order, 16);
    if (!text.ok()) return text.status();
    if (*text != "little") return Bad(order, absl::StrCat("byte order ", Quoted(*text), " is not supported"));
  }
  const auto pickle = archive->Read(*root + kPickleSuffix, kMaxPickleBytes);
  if (!pickle.ok()) return pickle.status();
  const auto document = ReadPickle(*pickle);
  if (!document.ok()) return document.status();
  const PickleValue& outer = *(*document)->root;
  const PickleValue* inner = outer.kind == Kind::kDict ? Find(outer, kStateDictKey) : nullptr;
  TensorReader reader(*archive, *root);
  return ReadTensors(inner != nullptr ? *inner : outer, reader);
}

}  // namespace

absl::StatusOr<StateDict> ReadTorchStateDict(const std::string& path) {
  try {
    return ReadChecked(path);
  } catch (const std::exception& error) {  // LibTorch's and the allocator's
    return absl::ResourceExhaustedError(absl::StrCat("cannot read '", path, "': ", error.what()));
  }
}

}  // namespace holdfast
