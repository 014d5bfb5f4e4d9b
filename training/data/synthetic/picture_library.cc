// SPDX-License-Identifier: Apache-2.0
#include "training/data/synthetic/picture_library.h"

#include <algorithm>
#include <filesystem>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <system_error>

#include "absl/memory/memory.h"
#include "absl/strings/ascii.h"
#include "absl/strings/str_cat.h"

namespace holdfast {
namespace {

// Sorted, so that the same directory gives the same clips everywhere.
std::vector<std::string> ListPictures(const std::filesystem::path& directory) {
  std::vector<std::string> paths;
  std::error_code error;
  for (std::filesystem::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    const std::string extension = absl::AsciiStrToLower(it->path().extension().string());
    if (extension == ".png" || extension == ".jpg" || extension == ".jpeg") paths.push_back(it->path().string());
  }
  std::sort(paths.begin(), paths.end());
  return paths;
}

cv::Mat ToRgba(const cv::Mat& decoded) {
  cv::Mat eight = decoded, rgba;
  if (decoded.depth() == CV_16U) decoded.convertTo(eight, CV_8U, 1 / 257.0);
  const int code = eight.channels() == 4   ? cv::COLOR_BGRA2RGBA
                   : eight.channels() == 3 ? cv::COLOR_BGR2RGBA
                                           : cv::COLOR_GRAY2RGBA;
  cv::cvtColor(eight, rgba, code);
  return rgba;
}

absl::StatusOr<cv::Mat> ReadPicture(const std::string& path) {
  try {
    const cv::Mat decoded = cv::imread(path, cv::IMREAD_UNCHANGED);
    if (decoded.empty()) return absl::DataLossError(absl::StrCat("cannot read the picture ", path));
    cv::Mat rgba = ToRgba(decoded);
    const double scale = static_cast<double>(PictureLibrary::kMaxSide) / std::max(rgba.cols, rgba.rows);
    if (scale < 1) cv::resize(rgba, rgba, cv::Size(), scale, scale, cv::INTER_AREA);
    return rgba;
  } catch (const cv::Exception& e) {
    return absl::DataLossError(absl::StrCat("cannot read the picture ", path, ": ", e.err));
  }
}

int64_t Bytes(const cv::Mat& picture) { return static_cast<int64_t>(picture.total() * picture.elemSize()); }

}  // namespace

absl::StatusOr<std::unique_ptr<PictureLibrary>> PictureLibrary::Create(const std::string& directory,
                                                                       int64_t cache_bytes) {
  const std::filesystem::path root(directory);
  std::vector<std::string> objects = ListPictures(root / "objects"), backgrounds = ListPictures(root / "backgrounds");
  if (objects.empty() && backgrounds.empty()) {
    return absl::NotFoundError(absl::StrCat("no PNG or JPEG files in ", directory, "/objects or /backgrounds"));
  }
  return absl::WrapUnique(new PictureLibrary(std::move(objects), std::move(backgrounds), cache_bytes));
}

absl::StatusOr<cv::Mat> PictureLibrary::Load(const std::string& path) const {
  {
    absl::MutexLock lock(&mutex_);
    const auto found = places_.find(path);
    if (found != places_.end()) {
      recent_.splice(recent_.begin(), recent_, found->second);
      return found->second->second;
    }
  }
  absl::StatusOr<cv::Mat> picture = ReadPicture(path);  // unlocked: other threads go on meanwhile
  if (!picture.ok()) return picture;
  absl::MutexLock lock(&mutex_);
  KeepLocked(path, *picture);
  return picture;
}

void PictureLibrary::KeepLocked(const std::string& path, const cv::Mat& picture) const {
  if (places_.count(path) != 0 || Bytes(picture) > cache_bytes_) return;
  recent_.emplace_front(path, picture);
  places_[path] = recent_.begin();
  used_bytes_ += Bytes(picture);
  while (used_bytes_ > cache_bytes_) {
    used_bytes_ -= Bytes(recent_.back().second);
    places_.erase(recent_.back().first);
    recent_.pop_back();
  }
}

}  // namespace holdfast
