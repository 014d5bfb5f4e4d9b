// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/jpeg_decoder.h"

#include <turbojpeg.h>

#include <memory>
#include <new>

#include "absl/status/status.h"

namespace holdfast {

int JpegReduction(ImageSize size, ImageSize least) {
  for (const int reduction : {8, 4, 2}) {
    const ImageSize reduced{size.width / reduction, size.height / reduction};
    if (reduced.width * reduction == size.width && reduced.height * reduction == size.height &&
        reduced.width >= least.width && reduced.height >= least.height) {
      return reduction;
    }
  }
  return 1;
}

absl::StatusOr<cv::Mat> DecodeJpeg(absl::string_view bytes, ImageSize size, int reduction) {
  const std::unique_ptr<void, int (*)(tjhandle)> decoder(tjInitDecompress(), tjDestroy);
  if (decoder == nullptr) throw std::bad_alloc();
  const auto* data = reinterpret_cast<const unsigned char*>(bytes.data());
  int width = 0, height = 0, subsampling = 0, colours = 0;
  if (tjDecompressHeader3(decoder.get(), data, bytes.size(), &width, &height, &subsampling, &colours) != 0 ||
      colours == TJCS_CMYK || colours == TJCS_YCCK) {
    return absl::UnimplementedError("a kind of JPEG that libturbojpeg does not read");
  }
  if (width != size.width || height != size.height) return absl::InvalidArgumentError("the picture is broken");
  // Its pixels stay what they are where the coded data ends too soon.
  cv::Mat image(height / reduction, width / reduction, CV_8UC3, cv::Scalar::all(0));
  // Cameras are careless about what libjpeg only warns of.
  if (tjDecompress2(decoder.get(), data, bytes.size(), image.data, image.cols, static_cast<int>(image.step), image.rows,
                    TJPF_BGR, /*flags=*/0) != 0 &&
      tjGetErrorCode(decoder.get()) == TJERR_FATAL) {
    return absl::InvalidArgumentError("the picture is broken");
  }
  return image;
}

}  // namespace holdfast
