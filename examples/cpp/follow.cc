// SPDX-License-Identifier: Apache-2.0
// Follows one point through a video or a camera and prints where it is: follow SERVER INPUT X Y
#include <cstdio>
#include <cstdlib>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>
#include <string>
#include <vector>

#include "client/remote_tracker.h"

// Called on a thread of the stream's own.
class Printer final : public holdfast::TrackObserver {
 public:
  void OnTracks(holdfast::TrackUpdate update) override {
    for (const holdfast::PointRun& run : update.runs) {
      for (int64_t i = 0; i < run.final_count; ++i) {
        std::printf("%lld %.2f %.2f %s\n", static_cast<long long>(run.first_frame + i), run.x[i], run.y[i],
                    run.visible[i] ? "visible" : "hidden");
      }
    }
  }
  void OnDone(const absl::Status&, const holdfast::SessionSummary&) override {}  // Finish says the same
};

int Fail(const absl::Status& status) { return std::fprintf(stderr, "%s\n", status.ToString().c_str()), EXIT_FAILURE; }

int main(int argc, char** argv) {
  if (argc != 5) return std::fprintf(stderr, "follow SERVER INPUT X Y\n"), 2;
  holdfast::RemoteTracker::Options options;
  options.addresses = {argv[1]};
  const auto tracker = holdfast::RemoteTracker::Connect(options);
  if (!tracker.ok()) return Fail(tracker.status());

  const std::string input = argv[2];
  cv::VideoCapture video = input == "camera" ? cv::VideoCapture(0) : cv::VideoCapture(input);
  if (!video.isOpened()) return Fail(absl::NotFoundError(input + ": cannot be opened as a video"));
  // Pictures as they are stored, which is what X and Y are of: versions of OpenCV turn those of phones differently.
  video.set(cv::CAP_PROP_ORIENTATION_AUTO, 0);
  holdfast::SessionConfig config;
  config.frame_size = {static_cast<int>(video.get(cv::CAP_PROP_FRAME_WIDTH)),
                       static_cast<int>(video.get(cv::CAP_PROP_FRAME_HEIGHT))};
  config.points = {{/*id=*/0, std::strtof(argv[3], nullptr), std::strtof(argv[4], nullptr)}};
  Printer printer;
  const auto stream = (*tracker)->Open(config, printer);
  if (!stream.ok()) return Fail(stream.status());

  cv::Mat picture;
  std::vector<unsigned char> jpeg;
  for (holdfast::Frame frame; video.read(picture); ++frame.index) {
    cv::imencode(".jpg", picture, jpeg);
    frame.bytes.assign(jpeg.begin(), jpeg.end());
    const absl::Status pushed = (*stream)->PushFrame(frame);  // waits while the server has no room
    if (!pushed.ok()) return Fail(pushed);
  }
  const absl::Status finished = (*stream)->Finish();
  return finished.ok() ? EXIT_SUCCESS : Fail(finished);
}
