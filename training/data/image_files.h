// SPDX-License-Identifier: Apache-2.0
// Frames and masks of data sets, read with errors instead of empty images.
#pragma once

#include <filesystem>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "absl/status/status.h"
#include "absl/status/statusor.h"
#include "training/data/sample.h"

namespace holdfast {

// Whether there is something at 'path'. No where that cannot be told: in a directory that may not be read, behind a
// name that is too long.
bool Exists(const std::filesystem::path& path);
// [H, W] CV_8UC3 RGB. NOT_FOUND or DATA_LOSS with the path; a JPEG that was cut short is no picture.
absl::StatusOr<cv::Mat> ReadFrame(const std::string& path);
// [H, W] CV_32SC1 ids: grey values of 8 or 16 bits, places in the palette of a PNG that has one (as PointOdyssey's
// have), or colours, blue + 256 green + 65536 red.
absl::StatusOr<cv::Mat> ReadMask(const std::string& path);
// The other way round; the extension chooses the format, which for masks must hold 16 bits. UNAVAILABLE with the path.
absl::Status WriteFrame(const std::string& path, const cv::Mat& frame, int jpeg_quality = 95);
absl::Status WriteMask(const std::string& path, const cv::Mat& mask);

// Reads the files as the frames (masks) of 'sample', each scaled to 'size' at once, if that is not empty, so that long
// clips of large frames fit into memory. DATA_LOSS if the files differ in size.
absl::Status ReadFrames(const std::vector<std::string>& paths, ImageSize size, Sample& sample);
absl::Status ReadMasks(const std::vector<std::string>& paths, Sample& sample);

// Gives the pixels of unlabelled (0) parts of a mask [H, W] CV_32SC1 that are larger than 'min_pixels' the median of
// the 7 x 7 pixels about them, the unlabelled ones among them: it mends the seams that fog and smoke leave, and an
// object's outline stays where it is.
void FillHoles(int min_pixels, cv::Mat& mask);

// Tracks of 'sample' from pixels of frames of 'from' to pixels of its own frames.
void ScaleTracks(ImageSize from, Sample& sample);

}  // namespace holdfast
