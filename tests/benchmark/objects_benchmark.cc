// SPDX-License-Identifier: Apache-2.0
// holdfast-objects-benchmark: how well the points of an object hold to it, and tell who of them has left it, on
// synthetic scenes whose every place is known. Objects are asked for by their masks in the first frame, through the
// engine that serves; what is said of them on each frame is held against where the scene has them.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <iostream>
#include <map>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <string>
#include <vector>

#include "absl/flags/flag.h"
#include "absl/strings/str_format.h"
#include "api/clock.h"
#include "api/point_tracker.h"
#include "program/flags.h"
#include "program/network_process.h"
#include "program/program_path.h"
#include "program/shipped_weights.h"
#include "server/engine/engine.h"
#include "server/engine/local_tracker.h"
#include "server/engine/metrics.h"
#include "training/data/synthetic/renderer.h"
#include "training/data/synthetic/scene.h"

ABSL_FLAG(int64_t, count, 24, "Makes this many clips.");
ABSL_FLAG(int64_t, first, 0, "Makes the clips from this one on.");
ABSL_FLAG(uint64_t, seed, 70001, "Seeds the clips.");
ABSL_FLAG(int64_t, frames, 64, "Makes each clip this many frames long.");
ABSL_FLAG(double, motion, 0.4,
          "Scales every motion by this number from 0 (nothing moves) to 1, as training clips have.");
ABSL_FLAG(int, points, 48, "Places this many points on an object.");
ABSL_FLAG(bool, reseed, true, "Has points that have left placed anew.");
ABSL_FLAG(std::string, pictures, "", "Takes pictures from this directory's objects/ and backgrounds/.");
ABSL_FLAG(std::string, weights, "", "Tracks with these weights; empty: the shipped ones.");

namespace holdfast {
namespace {

constexpr Program kProgram = {"holdfast-objects-benchmark", "holdfast-objects-benchmark [flags]"};
constexpr int kWidth = 512, kHeight = 384;
constexpr size_t kMostObjects = 3;   // of a clip
constexpr double kLeastArea = 0.01;  // of the frame, of an object that is followed
constexpr double kMostArea = 0.5;
constexpr int kRim = 3;             // pixels around an object that still count as on it
constexpr int64_t kSettled = 5;     // frames in a row off its object that make a point one that has left
constexpr double kRightPixels = 8;  // of a frame of 256x256: an estimate nearer to its true place is right

struct Clip {
  Scene scene;
  std::vector<cv::Mat> frames;  // RGB
  std::vector<cv::Mat> ids;
};

// An object, its points, and what was said about them.
struct Followed {
  const Layer* layer = nullptr;
  std::vector<cv::Point> covered;  // in the first frame
  cv::Mat solid;                   // of its texture: not zero where it has something, and a little around
  ObjectQuery query;
  std::map<PointId, PointRun> runs;
  ObjectRun said;
};

struct Share {
  int64_t part = 0, whole = 0;
  void Add(bool is_part) {
    ++whole;
    part += is_part ? 1 : 0;
  }
};

struct Mean {
  double sum = 0;
  int64_t count = 0;
  void Add(double value) {
    sum += value;
    ++count;
  }
};

// Of estimates that are visible by the tracker's word; "flagged": said to have left.
struct Findings {
  Share left_found;      // of points that left, those that were flagged then
  Share stayed_flagged;  // of the others, those that were flagged at all
  Share off_flagged;     // of estimates off their object
  Share on_flagged;      // of those on it
  Share flagged_wrong;   // of these flagged ones, those that are not at their true place
};

struct Tally {
  int64_t objects = 0, points = 0;
  Findings all;
  Findings held;        // on the frames where at least half of an object's estimates are on it
  Share anew_in_sight;  // of points that were placed anew, those that were where the object could be seen
  Share anew_on;        // and those on it, seen or not
  // By frame; of the centre, distances over the object's size. Of the points, those that have not left by the group's
  // word: how many of those asked for are visible by the tracker's word, and how many of them right.
  std::map<int64_t, Mean> overlap, points_overlap, centre, seen, on;
};

std::string MaskOf(const cv::Mat& ids, int32_t id) {
  std::vector<uint8_t> png;
  cv::imencode(".png", ids == id, png);
  return {png.begin(), png.end()};
}

absl::StatusOr<Clip> MakeClip(int64_t index, const PictureLibrary* library) {
  SyntheticOptions options;
  options.width = kWidth;
  options.height = kHeight;
  options.frames = absl::GetFlag(FLAGS_frames);
  options.still_share = 0;
  Rng rng(absl::GetFlag(FLAGS_seed), static_cast<uint64_t>(index));
  absl::StatusOr<Scene> scene = RandomScene(options, absl::GetFlag(FLAGS_motion), library, rng);
  if (!scene.ok()) return scene.status();
  Clip clip{*std::move(scene)};
  Renderer renderer(clip.scene);
  for (int64_t frame = 0; frame < options.frames; ++frame) {
    renderer.Render(static_cast<double>(frame), clip.frames.emplace_back(), clip.ids.emplace_back());
  }
  return clip;
}

std::optional<Followed> Follow(const Clip& clip, const Layer& layer, ObjectId id) {
  if (layer.endless || layer.texture.channels() != 4) return std::nullopt;
  Followed object;
  object.layer = &layer;
  cv::findNonZero(clip.ids[0] == layer.id, object.covered);
  const double area = static_cast<double>(object.covered.size()) / (kWidth * kHeight);
  if (area < kLeastArea || area > kMostArea) return std::nullopt;
  cv::extractChannel(layer.texture, object.solid, 3);
  cv::dilate(object.solid >= 128, object.solid,
             cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * kRim + 1, 2 * kRim + 1}));
  object.query.id = id;
  object.query.mask_png = MaskOf(clip.ids[0], layer.id);
  object.query.points = absl::GetFlag(FLAGS_points);
  object.query.reseed = absl::GetFlag(FLAGS_reseed);
  return object;
}

class Finals final : public TrackObserver {
 public:
  explicit Finals(std::vector<Followed>& objects) : objects_(objects) {}
  void OnTracks(TrackUpdate update) override {
    for (PointRun& run : update.runs) {
      const auto [place, added] = objects_[ObjectOf(run.id)].runs.try_emplace(run.id);
      PointRun& whole = place->second;
      if (added) whole.first_frame = run.first_frame;
      whole.id = run.id;
      const auto append = [](auto& to, const auto& from) { to.insert(to.end(), from.begin(), from.end()); };
      append(whole.x, run.x);
      append(whole.y, run.y);
      append(whole.visible, run.visible);
      append(whole.confidence, run.confidence);
      whole.final_count = static_cast<int64_t>(whole.x.size());
    }
    for (ObjectRun& run : update.objects) {
      std::vector<ObjectSample>& samples = objects_[run.id].said.samples;
      samples.insert(samples.end(), run.samples.begin(), run.samples.end());
    }
  }
  void OnDone(const absl::Status&, const SessionSummary&) override {}

 private:
  std::vector<Followed>& objects_;
};

absl::Status Track(const Clip& clip, std::vector<Followed>& objects, PointTracker& tracker) {
  SessionConfig config;
  config.encoding = FrameEncoding::kRgb24;
  config.raw_size = {kWidth, kHeight};
  config.send_provisional = false;
  for (const Followed& object : objects) config.objects.push_back(object.query);
  Finals finals(objects);
  auto stream = tracker.Open(config, finals);
  if (!stream.ok()) return stream.status();
  for (size_t i = 0; i < clip.frames.size(); ++i) {
    const cv::Mat& image = clip.frames[i];
    Frame frame;
    frame.index = static_cast<int64_t>(i);
    frame.bytes.assign(reinterpret_cast<const char*>(image.data), image.total() * image.elemSize());
    if (absl::Status pushed = (*stream)->PushFrame(std::move(frame)); !pushed.ok()) return pushed;
  }
  return (*stream)->Finish();
}

double Overlap(std::vector<cv::Point2f> a, std::vector<cv::Point2f> b) {
  std::vector<cv::Point2f> hull_a, hull_b, both;
  cv::convexHull(a, hull_a);
  cv::convexHull(b, hull_b);
  const double common = cv::intersectConvexConvex(hull_a, hull_b, both);
  const double all = cv::contourArea(hull_a) + cv::contourArea(hull_b) - common;
  return all > 0 ? common / all : 0;
}

struct Judged {
  bool seen = false, on = false, right = false, flagged = false;
};

// A point frame by frame; on those before its first, nothing.
std::vector<Judged> JudgePoint(const Clip& clip, const Followed& object, const PointRun& run) {
  const auto first = static_cast<size_t>(run.first_frame);
  const PlaneMap queried = clip.scene.MapAt(*object.layer, static_cast<double>(first));
  const cv::Point2d plane = queried.PlaneFromImage({run.x[0], run.y[0]});
  std::vector<Judged> judged(object.said.samples.size());
  for (size_t i = 0; i < run.x.size(); ++i) {
    const size_t t = first + i;
    const PlaneMap map = clip.scene.MapAt(*object.layer, static_cast<double>(t));
    const cv::Point2d texture = map.PlaneFromImage({run.x[i], run.y[i]}) + object.layer->Centre();
    const cv::Point pixel(cvRound(texture.x), cvRound(texture.y));
    const cv::Point2d apart = cv::Point2d(run.x[i], run.y[i]) - map.ImageFromPlane(plane);
    const std::vector<PointId>& left = object.said.samples[t].left;
    judged[t].seen = run.visible[i] != 0;
    judged[t].on = cv::Rect({0, 0}, object.solid.size()).contains(pixel) && object.solid.at<uint8_t>(pixel) != 0;
    judged[t].right = std::hypot(apart.x * 256 / kWidth, apart.y * 256 / kHeight) < kRightPixels;
    judged[t].flagged = std::binary_search(left.begin(), left.end(), run.id);
  }
  return judged;
}

// Where it was placed, of a point that was placed anew.
void JudgePlace(const Clip& clip, const Followed& object, const PointRun& run, const Judged& first, Tally& tally) {
  if (!IsPlacedAnew(run.id)) return;
  const cv::Mat& ids = clip.ids[static_cast<size_t>(run.first_frame)];
  tally.anew_in_sight.Add(ids.at<int32_t>(cvRound(run.y[0]), cvRound(run.x[0])) == object.layer->id);
  tally.anew_on.Add(first.on);
}

// 'counts': the frames that do.
void Count(const std::vector<Judged>& point, const std::vector<bool>& counts, Findings& findings) {
  int64_t off_in_a_row = 0;
  bool left = false, found = false, flagged = false;
  for (size_t t = 1; t < point.size(); ++t) {
    const Judged& now = point[t];
    if (!now.seen || !counts[t]) continue;
    flagged |= now.flagged;
    (now.on ? findings.on_flagged : findings.off_flagged).Add(now.flagged);
    if (now.on && now.flagged) findings.flagged_wrong.Add(!now.right);
    off_in_a_row = now.on ? 0 : off_in_a_row + 1;
    left |= off_in_a_row >= kSettled;
    found |= off_in_a_row >= kSettled && now.flagged;
  }
  if (left) {
    findings.left_found.Add(found);
  } else {
    findings.stayed_flagged.Add(flagged);
  }
}

void JudgePoints(const Clip& clip, const Followed& object, Tally& tally) {
  std::vector<std::vector<Judged>> points;
  for (const auto& [id, run] : object.runs) {
    points.push_back(JudgePoint(clip, object, run));
    JudgePlace(clip, object, run, points.back()[static_cast<size_t>(run.first_frame)], tally);
  }
  const size_t frames = points[0].size();
  std::vector<bool> held(frames), all(frames, true);
  for (size_t t = 0; t < frames; ++t) {
    Share on;
    for (const auto& point : points) {
      if (point[t].seen) on.Add(point[t].on);
    }
    held[t] = on.whole > 0 && 2 * on.part >= on.whole;
    if (t == 0 || t % 8 != 0) continue;
    Share seen, right;
    for (const auto& point : points) {
      if (!point[t].seen || point[t].flagged) continue;
      seen.Add(true);
      right.Add(point[t].on);
    }
    tally.seen[static_cast<int64_t>(t)].Add(static_cast<double>(seen.part) / object.query.points);
    if (right.whole > 0) tally.on[static_cast<int64_t>(t)].Add(static_cast<double>(right.part) / right.whole);
  }
  for (const auto& point : points) {
    Count(point, all, tally.all);
    Count(point, held, tally.held);
  }
}

void JudgeOutline(const Clip& clip, const Followed& object, Tally& tally) {
  const PlaneMap first = clip.scene.MapAt(*object.layer, 0);
  std::vector<cv::Point> hull;
  cv::convexHull(object.covered, hull);
  const double size = std::sqrt(static_cast<double>(object.covered.size()));
  cv::Point2d middle;
  for (const cv::Point& pixel : object.covered) middle += cv::Point2d(pixel);
  middle *= 1 / static_cast<double>(object.covered.size());
  for (size_t t = 8; t < object.said.samples.size(); t += 8) {
    // While a tenth of it is in sight.
    if (cv::countNonZero(clip.ids[t] == object.layer->id) * 10 < static_cast<int>(object.covered.size())) continue;
    const PlaneMap map = clip.scene.MapAt(*object.layer, static_cast<double>(t));
    const auto moved = [&](cv::Point2d pixel) { return map.ImageFromPlane(first.PlaneFromImage(pixel)); };
    std::vector<cv::Point2f> truth, said, points;
    for (const cv::Point& pixel : object.covered) truth.emplace_back(moved(cv::Point2d(pixel)));
    const ObjectSample& sample = object.said.samples[t];
    for (const Pixel& corner : sample.outline) said.emplace_back(corner.x, corner.y);
    for (const auto& [id, run] : object.runs) {
      const int64_t i = static_cast<int64_t>(t) - run.first_frame;
      if (i >= 0 && i < run.final_count) points.emplace_back(run.x[i], run.y[i]);
    }
    const auto frame = static_cast<int64_t>(t);
    tally.overlap[frame].Add(Overlap(truth, said));
    tally.points_overlap[frame].Add(Overlap(truth, points));
    const cv::Point2d apart = cv::Point2d(sample.centre.x, sample.centre.y) - moved(middle);
    tally.centre[frame].Add(std::hypot(apart.x, apart.y) / size);
  }
}

void Judge(const Clip& clip, const Followed& object, Tally& tally) {
  ++tally.objects;
  tally.points += static_cast<int64_t>(object.runs.size());
  JudgePoints(clip, object, tally);
  JudgeOutline(clip, object, tally);
}

std::string Text(const Share& share) {
  const double percent = share.whole == 0 ? 0 : 100.0 * static_cast<double>(share.part) / share.whole;
  return absl::StrFormat("%6.1f %% (%d of %d)", percent, share.part, share.whole);
}

void Print(const char* title, const Findings& findings) {
  std::cout << title << "\n  points that left, found           " << Text(findings.left_found)
            << "\n  points that stayed, flagged       " << Text(findings.stayed_flagged)
            << "\n  estimates off the object, flagged " << Text(findings.off_flagged)
            << "\n  estimates on the object, flagged  " << Text(findings.on_flagged)
            << "\n    of these, at a wrong place      " << Text(findings.flagged_wrong) << "\n";
}

void Print(const Tally& tally) {
  std::cout << absl::StrFormat("%d objects, %d points\n", tally.objects, tally.points);
  Print("where at least half of an object's estimates are on it", tally.held);
  Print("all frames", tally.all);
  std::cout << "placed anew, on the object          " << Text(tally.anew_on) << "\nplaced anew, where it is in sight   "
            << Text(tally.anew_in_sight) << "\n";
  std::cout << "frame  overlap of outlines  hull of all points  centre off (of its size)  objects in sight  points seen"
            << " (of those asked for)  of these on the object\n";
  const auto of = [](const Mean& mean) { return mean.sum / static_cast<double>(mean.count); };
  for (const auto& [frame, overlap] : tally.overlap) {
    std::cout << absl::StrFormat("%5d  %19.3f  %18.3f  %24.3f  %16d  %33.3f  %22.3f\n", frame, of(overlap),
                                 of(tally.points_overlap.at(frame)), of(tally.centre.at(frame)), overlap.count,
                                 of(tally.seen.at(frame)), of(tally.on.at(frame)));
  }
}

absl::Status Run() {
  EngineOptions options;
  options.weights_path = absl::GetFlag(FLAGS_weights);
  if (options.weights_path.empty()) {
    const absl::StatusOr<std::string> shipped = FindShippedWeights(ProgramPath());
    if (!shipped.ok()) return shipped.status();
    options.weights_path = *shipped;
  }
  SystemClock clock;
  NullEngineMetrics metrics;
  absl::StatusOr<std::unique_ptr<Engine>> engine = Engine::Create(options, clock, metrics);
  if (!engine.ok()) return engine.status();
  LocalTracker tracker(**engine);
  std::unique_ptr<PictureLibrary> library;
  if (const std::string pictures = absl::GetFlag(FLAGS_pictures); !pictures.empty()) {
    auto opened = PictureLibrary::Create(pictures);
    if (!opened.ok()) return opened.status();
    library = *std::move(opened);
  }
  Tally tally;
  for (int64_t index = 0; index < absl::GetFlag(FLAGS_count); ++index) {
    const absl::StatusOr<Clip> clip = MakeClip(absl::GetFlag(FLAGS_first) + index, library.get());
    if (!clip.ok()) return clip.status();
    std::vector<Followed> objects;
    for (const Layer& layer : clip->scene.layers) {
      auto object = Follow(*clip, layer, static_cast<ObjectId>(objects.size()));
      if (object && objects.size() < kMostObjects) objects.push_back(*std::move(object));
    }
    if (objects.empty()) continue;
    if (absl::Status status = Track(*clip, objects, tracker); !status.ok()) return status;
    for (const Followed& object : objects) Judge(*clip, object, tally);
    std::cerr << absl::StrFormat("clip %d of %d\n", index + 1, absl::GetFlag(FLAGS_count));
  }
  Print(tally);
  return absl::OkStatus();
}

int Main(const std::vector<std::string>& args) {
  if (AnswerQuestion(kProgram, args, std::cout)) return EXIT_SUCCESS;
  absl::Status status = SetFlags(args, std::getenv);
  if (status.ok()) status = Run();
  if (status.ok()) return EXIT_SUCCESS;
  std::cerr << "holdfast-objects-benchmark: " << status.message() << "\n";
  return EXIT_FAILURE;
}

}  // namespace
}  // namespace holdfast

int main(int argc, char** argv) {
  holdfast::PrepareForNetwork(argv);
  return holdfast::Main({argv + 1, argv + argc});
}
