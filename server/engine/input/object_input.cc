// SPDX-License-Identifier: Apache-2.0
#include "server/engine/input/object_input.h"

#include <algorithm>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "absl/container/flat_hash_set.h"
#include "absl/strings/str_cat.h"
#include "api/limits.h"
#include "server/engine/input/opencv_decoder.h"
#include "server/engine/input/png_check.h"
#include "server/engine/objects/placement.h"

namespace holdfast {
namespace {

constexpr size_t kLeastPoints = 3;  // that tell of a motion, and of one of them that does not follow it
constexpr size_t kLeastCorners = 3;

// The checks of one object.
class ObjectCheck {
 public:
  ObjectCheck(std::string field, std::optional<ImageSize> frame, Violations& violations)
      : field_(std::move(field)), frame_(frame), violations_(violations) {}

  // Its mask's pixels.
  int64_t Check(const ObjectQuery& object) {
    if (object.id > kMaxObjectId) Add(".id", absl::StrCat(object.id, " is not in 0 .. ", kMaxObjectId));
    if (object.points < 0 || object.points > kMaxObjectPoints) {
      Add(".points", absl::StrCat("is ", object.points, ", expected 0 .. ", kMaxObjectPoints));
    }
    if (object.mask_png.empty() == object.polygon.empty()) {
      Add("", "expected a mask or a polygon");
      return 0;
    }
    if (object.mask_png.empty()) {
      CheckPolygon(object.polygon);
      return 0;
    }
    return CheckMask(object.mask_png);
  }

 private:
  void Add(absl::string_view member, std::string description) {
    violations_.Add(absl::StrCat(field_, member), std::move(description));
  }

  int64_t CheckMask(const std::string& png) {
    const absl::StatusOr<ImageSize> size = CheckPng(png);
    if (!size.ok()) {
      Add(".mask_png", std::string(size.status().message()));
      return 0;
    }
    if (frame_ && *size != *frame_) {
      Add(".mask_png", absl::StrCat("its size is ", ToString(*size), ", the frame's is ", ToString(*frame_)));
    }
    return Pixels(*size);
  }

  void CheckPolygon(const std::vector<Pixel>& polygon) {
    if (polygon.size() < kLeastCorners || polygon.size() > static_cast<size_t>(kMaxPolygonCorners)) {
      Add(".polygon",
          absl::StrCat("has ", polygon.size(), " corners, expected ", kLeastCorners, " .. ", kMaxPolygonCorners));
    }
    const auto inside = [](float value, int size) { return value >= 0 && value <= static_cast<float>(size - 1); };
    // Without a frame, what no frame could have.
    const ImageSize frame = frame_.value_or(ImageSize{1 << 16, 1 << 16});
    for (size_t i = 0; i < polygon.size(); ++i) {
      if (inside(polygon[i].x, frame.width) && inside(polygon[i].y, frame.height)) continue;
      violations_.AddMade([&] {
        return FieldViolation{absl::StrCat(field_, ".polygon[", i, "]"),
                              absl::StrCat(polygon[i].x, ", ", polygon[i].y, " is not inside the frame")};
      });
    }
  }

  const std::string field_;
  const std::optional<ImageSize> frame_;
  Violations& violations_;
};

cv::Mat ViewMask(GrayImage& mask) { return cv::Mat(mask.size.height, mask.size.width, CV_8UC1, mask.pixels.data()); }

absl::StatusOr<GrayImage> ReadMask(const std::string& png, ImageSize frame) {
  const absl::StatusOr<cv::Mat> picture = DecodePng(png, frame, cv::IMREAD_COLOR | cv::IMREAD_ANYDEPTH);
  if (!picture.ok()) return picture.status();
  GrayImage mask{frame, std::vector<uint8_t>(Pixels(frame))};
  cv::Mat covered;
  cv::inRange(*picture, cv::Scalar::all(0), cv::Scalar::all(0), covered);
  cv::bitwise_not(covered, ViewMask(mask));
  return mask;
}

GrayImage FillPolygon(const std::vector<Pixel>& polygon, ImageSize frame) {
  GrayImage mask{frame, std::vector<uint8_t>(Pixels(frame), 0)};
  std::vector<cv::Point> corners;
  corners.reserve(polygon.size());
  for (const Pixel& corner : polygon) corners.emplace_back(cvRound(corner.x), cvRound(corner.y));
  cv::fillPoly(ViewMask(mask), std::vector<std::vector<cv::Point>>{corners}, cv::Scalar(255));
  return mask;
}

// How the pixels along one side of a frame are shared out among those of its picture in grey. Where the picture is
// smaller each of them has a stretch of its own; where it is larger, several have the same pixel.
struct Sharing {
  int frame;
  int gray;

  int Begin(int at) const { return static_cast<int>(int64_t{at} * frame / gray); }
  int End(int at) const { return std::max(Begin(at) + 1, Begin(at + 1)); }
  // Where a pixel of the grey picture lies, of whose stretch 'covered' is a part of the object.
  float Place(int at, int covered) const {
    if (gray <= frame) return static_cast<float>(covered);
    const float place = static_cast<float>(at) * static_cast<float>(frame) / static_cast<float>(gray);
    return std::min(place, static_cast<float>(frame - 1));
  }
};

// A mask, looked at by the pixels of a picture of another size.
class SharedMask {
 public:
  SharedMask(const GrayImage& mask, ImageSize gray)
      : mask_(mask), x_{mask.size.width, gray.width}, y_{mask.size.height, gray.height} {}

  // Covers whatever has a covered pixel in its share, so that no part of the mask is too thin to be seen.
  GrayImage Shrunk() const {
    GrayImage shrunk{{x_.gray, y_.gray}, {}};
    shrunk.pixels.reserve(Pixels(shrunk.size));
    for (int y = 0; y < y_.gray; ++y) {
      for (int x = 0; x < x_.gray; ++x) shrunk.pixels.push_back(FirstCovered(x, y) ? 255 : 0);
    }
    return shrunk;
  }

  // REQUIRES: the pixel is covered.
  Pixel Place(int x, int y) const {
    const cv::Point covered = *FirstCovered(x, y);
    return {x_.Place(x, covered.x), y_.Place(y, covered.y)};
  }

 private:
  std::optional<cv::Point> FirstCovered(int x, int y) const {
    const int left = x_.Begin(x), right = x_.End(x);
    for (int row = y_.Begin(y); row < y_.End(y); ++row) {
      const uint8_t* pixels = &mask_.pixels[static_cast<size_t>(row) * static_cast<size_t>(x_.frame)];
      const uint8_t* found = std::find_if(pixels + left, pixels + right, [](uint8_t pixel) { return pixel != 0; });
      if (found != pixels + right) return cv::Point(static_cast<int>(found - pixels), row);
    }
    return std::nullopt;
  }

  const GrayImage& mask_;
  const Sharing x_, y_;
};

std::vector<PointQuery> PlaceOn(const GrayImage& mask, const ObjectQuery& object, const GrayImage& gray) {
  const SharedMask shared(mask, gray.size);
  std::vector<PointQuery> points;
  for (const FlowPoint& at : PlacePoints(gray, shared.Shrunk(), PointsOf(object))) {
    const Pixel place = shared.Place(static_cast<int>(at.x), static_cast<int>(at.y));
    points.push_back({ObjectPointId(object.id, static_cast<uint32_t>(points.size())), place.x, place.y});
  }
  return points;
}

absl::StatusOr<PlacedObject> Place(const ObjectQuery& object, absl::string_view field, ImageSize frame,
                                   const GrayImage& gray) {
  absl::StatusOr<GrayImage> mask =
      object.mask_png.empty() ? FillPolygon(object.polygon, frame) : ReadMask(object.mask_png, frame);
  if (absl::IsInvalidArgument(mask.status())) {
    return InvalidFieldError(absl::StrCat(field, ".mask_png"), mask.status().message());
  }
  if (!mask.ok()) return mask.status();
  PlacedObject placed;
  placed.points = PlaceOn(*mask, object, gray);
  if (placed.points.size() < kLeastPoints) {
    return InvalidFieldError(
        field, absl::StrCat("has room for ", placed.points.size(), " points, expected at least ", kLeastPoints));
  }
  placed.shape = ShapeOf(*mask);
  return placed;
}

}  // namespace

int PointsOf(const ObjectQuery& object) { return object.points == 0 ? kDefaultObjectPoints : object.points; }

int64_t PointsOf(const std::vector<ObjectQuery>& objects) {
  int64_t points = 0;
  for (const ObjectQuery& object : objects) points += PointsOf(object);
  return points;
}

Violations CheckObjects(absl::string_view list, const std::vector<ObjectQuery>& objects,
                        std::optional<ImageSize> frame) {
  Violations violations;
  absl::flat_hash_set<ObjectId> ids;
  int64_t pixels = 0;
  for (size_t i = 0; i < objects.size(); ++i) {
    const std::string field = absl::StrCat(list, "[", i, "]");
    if (!ids.insert(objects[i].id).second) {
      violations.Add(absl::StrCat(field, ".id"), absl::StrCat(objects[i].id, " stands twice in this message"));
    }
    pixels = std::min(pixels + ObjectCheck(field, frame, violations).Check(objects[i]), kMaxMaskPixels + 1);
  }
  if (pixels > kMaxMaskPixels) {
    violations.Add(std::string(list), absl::StrCat("masks of more than ", kMaxMaskPixels, " pixels"));
  }
  return violations;
}

Violations CheckObject(absl::string_view field, const ObjectQuery& object, std::optional<ImageSize> frame) {
  Violations violations;
  (void)ObjectCheck(std::string(field), frame, violations).Check(object);
  return violations;
}

absl::StatusOr<PlacedObject> PlaceObject(const ObjectQuery& object, absl::string_view field, ImageSize frame,
                                         const GrayImage& gray) {
  return CatchOpenCv("read an object", InvalidFieldError(field, "its mask is broken"),
                     [&] { return Place(object, field, frame, gray); });
}

}  // namespace holdfast
