// SPDX-License-Identifier: Apache-2.0
#include "client/cli/command_line.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sstream>

#include "absl/flags/reflection.h"
#include "tests/client/scripted_service.h"
#include "tests/support/temp_dir.h"

namespace holdfast {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class CommandLineTest : public ::testing::Test {
 protected:
  int Run(const std::vector<std::string>& args) {
    const absl::FlagSaver saver;
    out_.str("");
    err_.str("");
    const auto getenv = [this](const char* name) {
      const auto found = environment_.find(name);
      return found == environment_.end() ? nullptr : found->second.c_str();
    };
    return RunCommandLine(args, {out_, err_, false, getenv}, stop_);
  }

  std::map<std::string, std::string> environment_;
  std::ostringstream out_, err_;
  StopSignal stop_;
};

TEST_F(CommandLineTest, HelpAndVersionGoToStandardOutput) {
  EXPECT_EQ(Run({"--help"}), 0);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("Usage: holdfast track INPUT"), HasSubstr("--grid"), HasSubstr("--json")));
  EXPECT_EQ(Run({"track", "--help"}), 0);
  EXPECT_EQ(Run({"--version"}), 0);
  EXPECT_THAT(out_.str(), testing::StartsWith("holdfast "));
  EXPECT_THAT(err_.str(), IsEmpty());
}

TEST_F(CommandLineTest, HelpExplainsEveryFlagOfTheProgram) {
  Run({"--help"});
  for (const auto& [name, flag] : absl::GetAllFlags()) {
    if (flag->Filename().find("client/") == std::string::npos) continue;
    EXPECT_THAT(out_.str(), HasSubstr("  --" + std::string(name)));
  }
}

TEST_F(CommandLineTest, WrongCallsAreCode2AndSayWhy) {
  const std::vector<std::pair<std::vector<std::string>, std::string>> calls = {
      {{}, "give a command"},
      {{"follow"}, "unknown command follow"},
      {{"track"}, "give one INPUT"},
      {{"track", "a.mp4", "b.mp4"}, "give one INPUT"},
      {{"info", "now"}, "unexpected now"},
      {{"load"}, "give one INPUT"},
      {{"load", "a.mp4", "--points=p.csv"}, "--points: load takes a number"},
      {{"load", "a.mp4", "--fps=fast"}, "--fps: expected a number or max"},
      {{"load", "a.mp4", "--sessions=0"}, "--sessions"},
      {{"load", "a.mp4", "--seconds=inf"}, "--seconds"},
      {{"info", "--server=foo"}, "--server"},
      {{"info", "--server="}, "--server"},
      {{"info", "--server=a:1, b :2"}, "\"b :2\""},
      {{"info", "--connect_timeout=0"}, "--connect_timeout"},
      {{"track", "a.mp4", "--grid=5", "--overlay=t.mp4", "--trail_frames=-1"}, "--trail_frames"},
      {{"track", "a.mp4", "--grit=5"}, "unknown flag --grit"},
      {{"track", "a.mp4", "--grid=many"}, "--grid"},
      {{"track", "a.mp4", "--out=t.json"}, "no points"},
      {{"track", "a.mp4", "--grid=5"}, "nothing to write"},
      {{"track", "a.mp4", "--grid=5", "--out=t.txt"}, "t.txt"},
      {{"track", "a.mp4", "--grid=5", "--overlay=t.avi"}, "t.avi"},
      {{"track", "a.mp4", "--grid=5", "--out=t.csv", "--processing_size=500x384"}, "--processing_size"},
      {{"track", "a.mp4", "--grid=5", "--out=t.csv", "--hop=8-16"}, "4..16, or auto"},
      {{"track", "a.mp4", "--grid=5", "--out=t.csv", "--buffer_mib=0"}, "--buffer_mib"},
      {{"track", "a.mp4", "--grid=5", "--out=t.csv", "--reconnect_timeout=-1s"}, "--reconnect_timeout"},
  };
  for (const auto& [args, reason] : calls) {
    EXPECT_EQ(Run(args), 2) << reason;
    EXPECT_THAT(err_.str(), AllOf(HasSubstr(reason), HasSubstr("holdfast --help")));
    EXPECT_THAT(out_.str(), IsEmpty());
  }
}

TEST_F(CommandLineTest, FailuresAreCode1AndNameTheirCause) {
  EXPECT_EQ(Run({"track", "/none.mp4", "--grid=5", "--out=/tmp/t.json"}), 1);
  EXPECT_EQ(err_.str(), "holdfast: /none.mp4: no such file\n");
}

TEST_F(CommandLineTest, AStoppedRunHasTheCodeOfItsSignal) {
  const TempDir dir;
  for (int i = 0; i < 9; ++i) {
    cv::imwrite(dir.File(std::to_string(i) + ".png"), cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(i)));
  }
  for (const int signal : {SIGINT, SIGTERM}) {
    StopSignal stop;
    FakeService service([&stop, signal](grpc::ServerContext& context, FakeService::Stream& stream) {
      v1::TrackRequest request;
      stream.Read(&request);
      stream.Write(Accepted());
      for (int frame = 0; stream.Read(&request); ++frame) {
        if (frame == 2) stop.Stop(signal);
      }
      return context.IsCancelled() ? grpc::Status::CANCELLED : grpc::Status::OK;
    });
    const std::vector<std::string> args = {"track", dir.path().string(), "--server=" + service.address(), "--grid=4",
                                           "--out=" + dir.File("t.json")};
    const absl::FlagSaver saver;
    err_.str("");
    EXPECT_EQ(RunCommandLine(args, {out_, err_, false, [](const char*) { return nullptr; }}, stop), 128 + signal);
    EXPECT_THAT(err_.str(), AllOf(HasSubstr("no estimate came"), HasSubstr("holdfast: interrupted\n")));
    EXPECT_FALSE(std::filesystem::exists(dir.File("t.json")));
  }
}

// Nine frames, and a file of one point; the arguments that track it.
std::vector<std::string> TrackNineFrames(const TempDir& dir, const std::string& server) {
  std::filesystem::create_directory(dir.File("frames"));
  for (int i = 0; i < 9; ++i) {
    cv::imwrite(dir.File("frames/" + std::to_string(i) + ".png"), cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(i)));
  }
  std::ofstream(dir.File("p.csv")) << "1,10,20\n";
  return {"track", dir.File("frames"), "--server=" + server, "--points=" + dir.File("p.csv"),
          "--out=" + dir.File("t.json")};
}

TEST_F(CommandLineTest, ASecondServerTakesOverFromAFirstThatIsLost) {
  const TempDir dir;
  std::vector<ScriptedCall> calls(1);
  calls[0].frames = 6;
  ScriptedService first(calls), second(std::vector<ScriptedCall>{});
  EXPECT_EQ(Run(TrackNineFrames(dir, first.address() + ", " + second.address())), 0) << err_.str();
  const auto json = nlohmann::json::parse(std::ifstream(dir.File("t.json")));
  EXPECT_EQ(json["complete"], true);
  EXPECT_EQ(json["frames"], 9);
  EXPECT_THAT(err_.str(), AllOf(HasSubstr("server at " + first.address() + " is unavailable: cut"),
                                HasSubstr("; reconnecting\nresumed at frame 2 on " + second.address() + "\n")));
}

TEST_F(CommandLineTest, WithoutResumeTheFirstLossIsTheEnd) {
  const TempDir dir;
  std::vector<ScriptedCall> calls(1);
  calls[0].frames = 6;
  ScriptedService server(calls);
  auto args = TrackNineFrames(dir, server.address());
  args.push_back("--resume=false");
  EXPECT_EQ(Run(args), 1);
  EXPECT_EQ(nlohmann::json::parse(std::ifstream(dir.File("t.json")))["complete"], false);
  EXPECT_THAT(err_.str(),
              AllOf(HasSubstr("kept in "), HasSubstr("is unavailable: cut"), Not(HasSubstr("reconnecting"))));
}

TEST_F(CommandLineTest, AnAbsentServerIsNamedOnce) {
  std::string address;
  {
    FakeService service([](grpc::ServerContext&, FakeService::Stream&) { return grpc::Status::OK; });
    address = service.address();
  }
  EXPECT_EQ(Run({"info", "--server=" + address, "--connect_timeout=50ms"}), 1);
  EXPECT_THAT(err_.str(), testing::StartsWith("holdfast: server at " + address + " cannot be reached: "));
}

TEST_F(CommandLineTest, InfoPrintsTextOrJsonAndTheServerMayComeFromTheEnvironment) {
  FakeService service([](grpc::ServerContext&, FakeService::Stream&) { return grpc::Status::OK; });
  service.info.set_model_name("interim");
  service.info.set_weights_sha256("abc123");
  service.info.set_window_frames(24);
  service.info.mutable_default_processing_size()->set_width(512);
  service.info.mutable_default_processing_size()->set_height(384);
  service.info.mutable_limits()->set_max_points(2048);
  service.info.mutable_load()->set_sessions(3);
  service.info.mutable_load()->set_work_promised(120);
  service.info.mutable_load()->set_work_budget(900);
  EXPECT_EQ(Run({"info", "--server", service.address()}), 0);
  EXPECT_THAT(out_.str(), AllOf(HasSubstr("interim"), HasSubstr("sha256 abc123"), HasSubstr("512x384"),
                                HasSubstr("at most 2048 points, endless"),
                                HasSubstr("3 sessions, 0 points, 120 of 900 point-frames/s promised")));
  environment_ = {{"HOLDFAST_SERVER", service.address()}, {"HOLDFAST_JSON", "true"}};
  EXPECT_EQ(Run({"info"}), 0);
  const auto json = nlohmann::json::parse(out_.str());
  EXPECT_EQ(json["model_name"], "interim");
  EXPECT_EQ(json["window_frames"], 24);
  EXPECT_EQ(json["default_processing_size"]["width"], 512);
  EXPECT_EQ(json["limits"]["max_points"], 2048);
  EXPECT_EQ(json["load"]["work_budget"], 900);
  service.info.mutable_load()->set_work_budget(std::numeric_limits<double>::infinity());
  EXPECT_EQ(Run({"info"}), 0);
  EXPECT_TRUE(nlohmann::json::parse(out_.str())["load"]["work_budget"].is_null()) << "it is not bounded";
}

TEST_F(CommandLineTest, AWrongVariableOfTheEnvironmentIsAWrongCall) {
  environment_ = {{"HOLDFAST_GRID", "many"}};
  EXPECT_EQ(Run({"info"}), 2);
  EXPECT_THAT(err_.str(), HasSubstr("HOLDFAST_GRID"));
}

}  // namespace
}  // namespace holdfast
