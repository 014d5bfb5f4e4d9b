// SPDX-License-Identifier: Apache-2.0
// Sessions that outlive their server, with real processes: killed, restarted, drained, cut off. Final tracks are those
// of a session that was never interrupted.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <csignal>
#include <fstream>
#include <functional>
#include <iostream>
#include <memory>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "absl/strings/str_cat.h"
#include "client/remote_tracker.h"
#include "tests/support/moving_picture.h"
#include "tests/support/recorders.h"
#include "tests/support/server_process.h"
#include "tests/support/source_tree.h"
#include "tests/support/status_matchers.h"
#include "tests/support/tcp_proxy.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

constexpr int64_t kFrames = 64;
constexpr PointId kIds[] = {1, 2, 3, 4};
constexpr ObjectId kObject = 6;
constexpr float kTolerance = 1e-3f;  // pixels

const std::string& PictureAt(int64_t index) {
  static auto& made = *new std::vector<std::string>(kFrames);
  const auto t = static_cast<float>(index);
  if (made[index].empty()) made[index] = BytesOf(ShiftedTexture(kPicture, 0.75f * t, 0.25f * t));
  return made[index];
}

// What happens to the servers when frames 0 .. 'index' have been sent.
using Trouble = std::function<void(int64_t index)>;

class ResumeTest : public ::testing::Test {
 protected:
  ResumeTest() : keys_(dir_.File("keys")) {
    std::ofstream(keys_) << "k1:" << std::string(64, 'a') << "\n";
    std::vector<std::string> flags = {absl::StrCat("--weights=", InSourceTree("tests/data/interim.safetensors")),
                                      "--precision=float32",
                                      "--compute_threads=1",
                                      "--processing_size=128x96",
                                      "--grace_period=0s",
                                      absl::StrCat("--checkpoint_keys=", keys_)};
    flags_ = std::move(flags);
  }

  std::unique_ptr<ServerProcess> Start(int port = 0) {
    std::vector<std::string> flags = flags_;
    if (port != 0) flags.push_back(absl::StrCat("--listen=127.0.0.1:", port));
    return std::make_unique<ServerProcess>(HOLDFAST_SERVER_PROGRAM, flags);
  }

  static std::unique_ptr<RemoteTracker> Connect(std::vector<std::string> addresses,
                                                absl::Duration reconnect_timeout = absl::Minutes(2)) {
    RemoteTracker::Options options;
    options.reconnect_timeout = reconnect_timeout;
    options.addresses = std::move(addresses);
    options.checkpoint_interval_frames = 8;
    auto tracker = RemoteTracker::Connect(options);
    EXPECT_THAT(tracker, IsOk());
    return *std::move(tracker);
  }

  static absl::Status Say(TrackStream& stream, int64_t index) {
    Frame frame{index, PictureAt(index), {}, {}};
    if (index == 33) frame.points = {{1, 70, 45}};  // again
    absl::Status status = stream.PushFrame(std::move(frame));
    if (index == 10) status.Update(stream.AddPoints({{4, 50, 60}}));
    if (index == 20) status.Update(stream.RemovePoints({2}));
    if (index == 40) status.Update(stream.AddPoints({{3, 30, 30}, {2, 90, 60}}));
    return status;
  }

  // All of it, and troubles on the way.
  void Track(PointTracker& tracker, RecordingObserver& observer, const Trouble& trouble,
             const std::function<void(TrackStream&)>& finish) {
    SessionConfig config;
    config.encoding = FrameEncoding::kGray8;
    config.raw_size = config.processing_size = kPicture;
    config.points = {{1, 40.5f, 50.25f}, {2, 80, 30}, {3, 60, 40}};
    config.objects = {{kObject, "", {{30, 30}, {90, 30}, {90, 70}, {30, 70}}, 9}};
    auto stream = tracker.Open(config, observer);
    ASSERT_THAT(stream, IsOk());
    for (int64_t index = 0; index < kFrames; ++index) {
      ASSERT_THAT(Say(**stream, index), IsOk()) << "frame " << index;
      trouble(index);
    }
    finish(**stream);
  }
  void Track(PointTracker& tracker, RecordingObserver& observer, const Trouble& trouble) {
    Track(tracker, observer, trouble, [](TrackStream& stream) { EXPECT_THAT(stream.Finish(), IsOk()); });
  }

  // A session that nothing happens to; one for all tests.
  RecordingObserver& Uninterrupted() {
    static RecordingObserver* const whole = [this] {
      auto* const observer = new RecordingObserver;
      const auto server = Start();
      Track(*Connect({server->address()}), *observer, [](int64_t) {});
      return observer;
    }();
    return *whole;
  }

  static void ExpectSameObject(const FinalObject& object, const FinalObject& expected) {
    ASSERT_EQ(object.size(), static_cast<size_t>(kFrames));
    ASSERT_EQ(expected.size(), object.size());
    for (const auto& [frame, sample] : expected) {
      const ObjectSample& found = object.at(frame);
      EXPECT_NEAR(found.centre.x, sample.centre.x, 10 * kTolerance) << frame;
      EXPECT_NEAR(found.centre.y, sample.centre.y, 10 * kTolerance) << frame;
      EXPECT_EQ(found.left, sample.left) << frame;
    }
  }

  void ExpectUninterrupted(const RecordingObserver& observer, const char* name) {
    const RecordingObserver& whole = Uninterrupted();
    float largest = 0;
    for (const PointId id : kIds) {
      const FinalTrack track = observer.Final(id), expected = whole.Final(id);
      ASSERT_EQ(track.size(), expected.size()) << "point " << id;
      for (const auto& [frame, sample] : expected) {
        ASSERT_EQ(track.count(frame), 1u) << "point " << id << ", frame " << frame;
        const FinalSample& found = track.at(frame);
        largest = std::max({largest, std::abs(found.x - sample.x), std::abs(found.y - sample.y)});
        EXPECT_EQ(found.visible, sample.visible) << "point " << id << ", frame " << frame;
      }
    }
    ExpectSameObject(observer.FinalOfObject(kObject), whole.FinalOfObject(kObject));
    EXPECT_LE(largest, kTolerance);
    std::cout << name << ": largest difference " << largest << " px, resumed " << observer.resumed() << " times\n";
  }

  const TempDir dir_;
  const std::string keys_;
  std::vector<std::string> flags_;
};

TEST_F(ResumeTest, KilledInMidStreamAndOnToASecondServer) {
  auto first = Start();
  const auto second = Start();
  const auto tracker = Connect({first->address(), second->address()});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index != 45) return;
    observer.AwaitFinal(3, 9);  // in the middle of things
    first.reset();
  });
  EXPECT_EQ(observer.resumed(), 1);
  ExpectUninterrupted(observer, "killed, second server");
}

TEST_F(ResumeTest, TheOnlyServerIsKilledAndStartedAgain) {
  auto server = Start();
  const int port = server->port();
  const auto tracker = Connect({server->address()});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index != 40) return;
    observer.AwaitFinal(3, 9);
    server.reset();
    server = Start(port);
  });
  EXPECT_EQ(observer.resumed(), 1);
  ExpectUninterrupted(observer, "killed, restarted");
}

TEST_F(ResumeTest, TheConnectionIsCut) {
  const auto server = Start();
  TcpProxy proxy(server->port());
  const auto tracker = Connect({proxy.address()});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index == 37) proxy.CutAll();
  });
  EXPECT_EQ(observer.resumed(), 1);
  ExpectUninterrupted(observer, "cut");
}

TEST_F(ResumeTest, DrainedServersSayGoodbyeAndExitWithZero) {
  auto first = Start();
  const auto second = Start();
  const auto tracker = Connect({first->address(), second->address()});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index != 40) return;
    first->Send(SIGTERM);
    EXPECT_EQ(first->Wait(), 0);
  });
  EXPECT_EQ(observer.resumed(), 1);
  EXPECT_EQ(observer.going_away(), 1);
  ExpectUninterrupted(observer, "drained");
}

TEST_F(ResumeTest, OfServersBehindOneNameTheDrainedOneHandsItsSessionOver) {
  auto first = Start(), second = Start();
  const auto tracker = Connect({absl::StrCat("ipv4:", first->address(), ",", second->address())});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index != 40) return;
    ServerProcess& has_it = Connect({first->address()})->Info()->load.sessions > 0 ? *first : *second;
    has_it.Send(SIGTERM);
    EXPECT_EQ(has_it.Wait(), 0);
  });
  EXPECT_EQ(observer.resumed(), 1);
  ExpectUninterrupted(observer, "drained, one name");
}

TEST_F(ResumeTest, TwoInterruptionsOfOneStream) {
  auto first = Start(), second = Start();
  const auto third = Start();
  const auto tracker = Connect({first->address(), second->address(), third->address()});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index == 26) first.reset();
    if (index == 52) {
      observer.AwaitResumed(1);
      observer.AwaitFinal(3, 9);
      second.reset();
    }
  });
  EXPECT_GE(observer.resumed(), 2);
  ExpectUninterrupted(observer, "twice");
}

TEST_F(ResumeTest, BeforeTheFirstWindow) {
  auto first = Start();
  const auto second = Start();
  const auto tracker = Connect({first->address(), second->address()});
  RecordingObserver observer;
  Track(*tracker, observer, [&](int64_t index) {
    if (index == 5) first.reset();
  });
  EXPECT_EQ(observer.resumed(), 1);
  ExpectUninterrupted(observer, "before the first window");
}

TEST_F(ResumeTest, WhilePointsAreReSeeded) {
  for (const int64_t when : {33, 40}) {
    auto first = Start();
    const auto second = Start();
    const auto tracker = Connect({first->address(), second->address()});
    RecordingObserver observer;
    Track(*tracker, observer, [&](int64_t index) {
      if (index == when) first.reset();
    });
    EXPECT_EQ(observer.resumed(), 1);
    ExpectUninterrupted(observer, "re-seeding");
  }
}

TEST_F(ResumeTest, InTheLastWindowAfterHalfClose) {
  auto first = Start();
  const auto second = Start();
  const auto tracker = Connect({first->address(), second->address()});
  RecordingObserver observer;
  Track(
      *tracker, observer,
      [&](int64_t index) {
        if (index == kFrames - 1) first->Send(SIGSTOP);  // it takes what comes, and answers nothing
      },
      [&](TrackStream& stream) {
        std::thread finishing([&stream] { EXPECT_THAT(stream.Finish(), IsOk()); });
        first.reset();
        finishing.join();
      });
  EXPECT_EQ(observer.resumed(), 1);
  ExpectUninterrupted(observer, "after half-close");
}

TEST_F(ResumeTest, AServerOfOtherKeysRefusesTheToken) {
  auto first = Start();
  const std::string others = dir_.File("others");
  std::ofstream(others) << "k2:" << std::string(64, 'b') << "\n";
  flags_.push_back(absl::StrCat("--checkpoint_keys=", others));
  const auto second = Start();
  const auto tracker = Connect({first->address(), second->address()}, absl::Seconds(2));
  RecordingObserver observer;
  SessionConfig config;
  config.encoding = FrameEncoding::kGray8;
  config.raw_size = config.processing_size = kPicture;
  config.points = {{1, 40, 50}};
  auto stream = tracker->Open(config, observer);
  ASSERT_THAT(stream, IsOk());
  absl::Status status;
  for (int64_t index = 0; index < kFrames && status.ok(); ++index) {
    status = Say(**stream, index);
    if (index == 45) {
      observer.AwaitCheckpoints(1);
      first.reset();
    }
  }
  if (status.ok()) status = (*stream)->Finish();
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kFailedPrecondition, ::testing::HasSubstr("key")));
}

}  // namespace
}  // namespace holdfast
