// SPDX-License-Identifier: Apache-2.0
// The pictures of a directory, for synthetic scenes.
#pragma once

#include <opencv2/core.hpp>

#include <cstdint>
#include <list>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "absl/base/thread_annotations.h"
#include "absl/status/statusor.h"
#include "absl/synchronization/mutex.h"

namespace holdfast {

// <directory>/objects: pictures with alpha. <directory>/backgrounds: pictures. Decoded ones are kept up to
// 'cache_bytes', the least recently used going first. Thread-safe.
class PictureLibrary {
 public:
  static constexpr int kMaxSide = 1024;  // pixels; larger pictures are reduced when read

  // Fails where neither folder has a PNG or JPEG file.
  static absl::StatusOr<std::unique_ptr<PictureLibrary>> Create(const std::string& directory,
                                                                int64_t cache_bytes = int64_t{512} << 20);

  const std::vector<std::string>& objects() const { return objects_; }
  const std::vector<std::string>& backgrounds() const { return backgrounds_; }

  // [h, w] CV_8UC4 RGBA (opaque where the file has no alpha), shared: not to be written to. DATA_LOSS if unreadable.
  absl::StatusOr<cv::Mat> Load(const std::string& path) const;

 private:
  PictureLibrary(std::vector<std::string> objects, std::vector<std::string> backgrounds, int64_t cache_bytes)
      : objects_(std::move(objects)), backgrounds_(std::move(backgrounds)), cache_bytes_(cache_bytes) {}

  void KeepLocked(const std::string& path, const cv::Mat& picture) const ABSL_EXCLUSIVE_LOCKS_REQUIRED(mutex_);

  using Entry = std::pair<std::string, cv::Mat>;
  const std::vector<std::string> objects_;      // paths, sorted
  const std::vector<std::string> backgrounds_;  // paths, sorted
  const int64_t cache_bytes_;
  mutable absl::Mutex mutex_;
  mutable std::list<Entry> recent_ ABSL_GUARDED_BY(mutex_);  // most recently used first
  mutable std::map<std::string, std::list<Entry>::iterator> places_ ABSL_GUARDED_BY(mutex_);
  mutable int64_t used_bytes_ ABSL_GUARDED_BY(mutex_) = 0;
};

}  // namespace holdfast
