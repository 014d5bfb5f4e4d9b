// SPDX-License-Identifier: Apache-2.0
// The one way in which files are written: under a temporary name first, so that readers, and a crash, see a whole file
// or none. A symbolic link stays one: the file it leads to is written. What is no file, as a device or a pipe, stays
// too and is given the bytes when all of them are there; so is a file that may be written to but not replaced. A file
// that is replaced hands on its mode.
#pragma once

#include <functional>
#include <string>

#include "absl/status/status.h"
#include "absl/strings/string_view.h"

namespace holdfast {

// A file in the making, for writers that take a name and write for a while.
class PendingFile {
 public:
  // Makes nothing yet.
  explicit PendingFile(const std::string& path);
  // Removes the temporary file unless Commit gave it its name or had to keep it.
  ~PendingFile();
  PendingFile(const PendingFile&) = delete;
  PendingFile& operator=(const PendingFile&) = delete;

  // Where to write: a name that nobody else has, with the suffix of 'path' and in the directory of its file.
  const std::string& temporary() const { return temporary_; }
  // Syncs what was written, gives it its name and, where the system can, syncs the directory. On an error a file at
  // 'path' is what it was, and the temporary file goes away with this object. Only where the file could not be replaced
  // nor be written to in place it may be damaged: then the temporary file stays, and the error names it. A pipe is
  // waited for until somebody reads. REQUIRES: the file is written and closed.
  absl::Status Commit();

 private:
  absl::Status WriteInPlace();

  const bool is_file_;      // or nothing yet
  const std::string path_;  // without links, but for what is no file
  const std::string temporary_;
  bool kept_ = false;  // the temporary file has its name, or is all there is
};

// Lets 'write' make the file under a temporary name, then gives it its own; on an error nothing is left behind and a
// file that had the name before is untouched, but for what Commit says.
absl::Status WriteAtomically(const std::string& path, const std::function<absl::Status(const std::string&)>& write);

// The same for bytes in memory; a new file has mode 0644 less the umask.
absl::Status WriteFileAtomically(const std::string& path, absl::string_view bytes);

// Removes the temporary files that processes left in 'directory' when they were killed as they wrote. Nobody may be
// writing there.
void RemoveTemporaryFiles(const std::string& directory);

// OK where a file can be made beside 'path' to take its name; makes one and removes it. What is there already must be
// writable: a file, which may turn out not to be replaced, a device or a pipe.
absl::Status CheckWritable(const std::string& path);

}  // namespace holdfast
