// SPDX-License-Identifier: Apache-2.0
#include "server/engine/motion/patch_coding.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

namespace holdfast {
namespace {

// Chosen on annotated real video: polish with patches of this quality is as precise as with the pixels themselves.
constexpr int kQuality = 75;
constexpr size_t kPatchPixels = size_t{FlowPatch::kSide} * FlowPatch::kSide;
constexpr uint8_t kMarker = 0xFF, kStartOfScan = 0xDA;

std::vector<uint8_t> Jpeg(const uint8_t* pixels) {
  const cv::Mat image(FlowPatch::kSide, FlowPatch::kSide, CV_8UC1, const_cast<uint8_t*>(pixels));
  std::vector<uint8_t> jpeg;
  if (!cv::imencode(".jpg", image, jpeg, {cv::IMWRITE_JPEG_QUALITY, kQuality})) {
    CV_Error(cv::Error::StsError, "a patch could not be encoded");
  }
  return jpeg;
}

// Bytes before the scan's data: segments of a marker, a length and a body, up to the scan's own.
size_t HeaderBytes(const std::vector<uint8_t>& jpeg) {
  size_t at = 2;  // after the start of the image
  while (at + 4 <= jpeg.size() && jpeg[at] == kMarker) {
    const bool last = jpeg[at + 1] == kStartOfScan;
    at += 2 + (size_t{jpeg[at + 2]} << 8 | jpeg[at + 3]);
    if (last && at < jpeg.size()) return at;
  }
  CV_Error(cv::Error::StsError, "a patch's encoding has no scan");
}

// Of every patch: it tells the size, the quality and the encoder's constant tables.
const std::string& Header() {
  static const std::string* const header = [] {
    const std::vector<uint8_t> blank(kPatchPixels);
    const std::vector<uint8_t> jpeg = Jpeg(blank.data());
    return new std::string(jpeg.begin(), jpeg.begin() + static_cast<std::ptrdiff_t>(HeaderBytes(jpeg)));
  }();
  return *header;
}

}  // namespace

std::string EncodePatch(absl::Span<const uint8_t> pixels) {
  CV_Assert(pixels.size() == kPatchPixels);
  const std::vector<uint8_t> jpeg = Jpeg(pixels.data());
  return std::string(jpeg.begin() + static_cast<std::ptrdiff_t>(Header().size()), jpeg.end());
}

std::optional<std::vector<uint8_t>> DecodePatch(absl::string_view bytes) {
  if (bytes.empty() || bytes.size() > FlowPatch::kMaxCodeBytes) return std::nullopt;
  std::vector<uint8_t> jpeg(Header().begin(), Header().end());
  jpeg.insert(jpeg.end(), bytes.begin(), bytes.end());
  const cv::Mat image = cv::imdecode(jpeg, cv::IMREAD_GRAYSCALE);
  if (image.rows != FlowPatch::kSide || image.cols != FlowPatch::kSide || !image.isContinuous()) return std::nullopt;
  return std::vector<uint8_t>(image.datastart, image.dataend);
}

}  // namespace holdfast
