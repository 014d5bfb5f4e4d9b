// SPDX-License-Identifier: Apache-2.0
#include "io/npz_writer.h"

#include <zip.h>

#include <memory>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

constexpr absl::string_view kMagic("\x93NUMPY\x01\x00", 8);
constexpr size_t kAlignment = 64;  // of the data, as NumPy asks for

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
};

absl::Status ZipError(zip_t* archive) { return absl::InternalError(zip_strerror(archive)); }

}  // namespace

std::string NpyFile(absl::string_view dtype, const std::vector<int64_t>& shape, absl::string_view data) {
  // A tuple of one needs its comma.
  std::string header = absl::StrCat("{'descr': '", dtype, "', 'fortran_order': False, 'shape': (",
                                    absl::StrJoin(shape, ", "), shape.size() == 1 ? ",), }" : "), }");
  const size_t unpadded = kMagic.size() + 2 + header.size() + 1;
  header.append((kAlignment - unpadded % kAlignment) % kAlignment, ' ').append("\n");
  const char length[2] = {static_cast<char>(header.size() & 0xff), static_cast<char>(header.size() >> 8)};
  return absl::StrCat(kMagic, absl::string_view(length, 2), header, data);
}

absl::Status WriteNpz(const std::string& path, const std::vector<std::pair<std::string, std::string>>& npy_files) {
  int code = 0;
  std::unique_ptr<zip_t, Discard> archive(zip_open(path.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code));
  if (archive == nullptr) return absl::InternalError(absl::StrCat("cannot be created, zip error ", code));
  for (const auto& [name, bytes] : npy_files) {
    zip_source_t* source = zip_source_buffer(archive.get(), bytes.data(), bytes.size(), /*freep=*/0);
    if (source == nullptr) return ZipError(archive.get());
    if (zip_file_add(archive.get(), absl::StrCat(name, ".npy").c_str(), source, ZIP_FL_ENC_UTF_8) < 0) {
      zip_source_free(source);
      return ZipError(archive.get());
    }
  }
  // Closing writes the file; after a failure the archive is still ours.
  if (zip_close(archive.get()) != 0) return ZipError(archive.get());
  (void)archive.release();
  return absl::OkStatus();
}

}  // namespace holdfast
