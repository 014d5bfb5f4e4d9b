// SPDX-License-Identifier: Apache-2.0
#include "client/cli/video_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <utility>

extern "C" {
#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <libavutil/cpu.h>
#include <libavutil/display.h>
#include <libswscale/swscale.h>
}

#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "absl/time/time.h"

namespace holdfast {
namespace {

namespace fs = std::filesystem;

constexpr double kDoubtfulFps = 1000;  // from here on FFmpeg may give a clock's ticks for a rate
constexpr int kMostDecoderThreads = 8;
constexpr int kReadAttempts = 10;  // behind what cannot be read
constexpr absl::Duration kNetworkPatience = absl::Seconds(30);
constexpr int kRowAlignment = 64;  // pixels: FFmpeg's conversions may write a little beyond a row

// FFmpeg takes what stands before a colon for a protocol, but in an absolute path.
std::string NameForFfmpeg(const std::string& input) {
  if (input == "-") return "pipe:0";
  return IsAddress(input) ? input : fs::absolute(input).string();
}

bool IsRegularFile(const std::string& input) {
  std::error_code ignored;
  return !IsAddress(input) && fs::is_regular_file(input, ignored);
}

std::string Reason(int error) {
  std::array<char, AV_ERROR_MAX_STRING_SIZE> text{};
  av_strerror(error, text.data(), text.size());
  return text.data();
}

double Worth(AVRational ratio) { return ratio.den == 0 ? 0 : av_q2d(ratio); }

// JPEGs one after the other, which know no time: FFmpeg takes them for 25 a second.
bool SaysNoRate(const std::string& input, const AVFormatContext& container) {
  const absl::string_view format = container.iformat->name;
  return input == "-" || format == "mjpeg" || format == "mpjpeg" || format == "jpeg_pipe";
}

double FpsOf(const std::string& input, AVFormatContext& container, AVStream& stream) {
  if (SaysNoRate(input, container)) return 0;
  const double said = Worth(av_guess_frame_rate(&container, &stream, nullptr));
  return said < kDoubtfulFps ? said : Worth(stream.avg_frame_rate);
}

Turn TurnOfStream(const AVStream& stream) {
  const uint8_t* matrix = nullptr;
#if LIBAVCODEC_VERSION_MAJOR >= 61
  const AVPacketSideData* data = av_packet_side_data_get(
      stream.codecpar->coded_side_data, stream.codecpar->nb_coded_side_data, AV_PKT_DATA_DISPLAYMATRIX);
  if (data != nullptr) matrix = data->data;
#else
  matrix = av_stream_get_side_data(&stream, AV_PKT_DATA_DISPLAYMATRIX, nullptr);
#endif
  return matrix == nullptr ? Turn{} : TurnOf(reinterpret_cast<const int32_t*>(matrix));
}

}  // namespace

bool IsAddress(const std::string& input) { return absl::StrContains(input, "://"); }

void VideoFile::Free::operator()(AVCodecContext* decoder) const { avcodec_free_context(&decoder); }
void VideoFile::Free::operator()(AVFormatContext* container) const { avformat_close_input(&container); }
void VideoFile::Free::operator()(AVFrame* frame) const { av_frame_free(&frame); }
void VideoFile::Free::operator()(AVPacket* packet) const { av_packet_free(&packet); }
void VideoFile::Free::operator()(SwsContext* converter) const { sws_freeContext(converter); }

VideoFile::VideoFile(std::string input)
    : input_(std::move(input)), packet_(av_packet_alloc()), frame_(av_frame_alloc()) {}

absl::StatusOr<std::unique_ptr<VideoFile>> VideoFile::Open(const std::string& input) {
  av_log_set_level(AV_LOG_FATAL);  // what FFmpeg has to say is said better by our messages
  std::unique_ptr<VideoFile> file(new VideoFile(input));
  if (absl::Status status = file->OpenContainer(); !status.ok()) return status;
  if (absl::Status status = file->OpenDecoder(); !status.ok()) return status;
  file->ReadFacts();
  return file;
}

absl::Status VideoFile::OpenContainer() {
  const auto refused = [this](int error) {
    return absl::InvalidArgumentError(absl::StrCat(input_, ": is not a video that can be read: ", Reason(error)));
  };
  AVDictionary* options = nullptr;
  av_dict_set(&options, "rtsp_flags", "prefer_tcp", 0);
  if (input_ == "-") {  // else FFmpeg looks at megabytes or seconds of it before it gives a frame
    av_dict_set(&options, "probesize", "32", 0);
    av_dict_set(&options, "analyzeduration", "0", 0);
  }
  AVFormatContext* container = avformat_alloc_context();
  container->interrupt_callback = {&IsOverdue, this};
  asked_ = clock_.SteadyNow();
  const int opened = avformat_open_input(&container, NameForFfmpeg(input_).c_str(), nullptr, &options);
  av_dict_free(&options);
  if (opened < 0) return refused(opened);  // it has freed the container
  container_.reset(container);
  if (const int found = avformat_find_stream_info(container, nullptr); found < 0) return refused(found);
  const int best = av_find_best_stream(container, AVMEDIA_TYPE_VIDEO, -1, -1, nullptr, 0);
  if (best < 0) return refused(best);
  for (unsigned i = 0; i < container->nb_streams; ++i) {
    if (static_cast<int>(i) != best) container->streams[i]->discard = AVDISCARD_ALL;
  }
  stream_ = container->streams[best];
  return absl::OkStatus();
}

absl::Status VideoFile::OpenDecoder() {
  const AVCodec* codec = avcodec_find_decoder(stream_->codecpar->codec_id);
  if (codec == nullptr) {
    return absl::InvalidArgumentError(
        absl::StrCat(input_, ": FFmpeg has no decoder for ", avcodec_get_name(stream_->codecpar->codec_id), " here"));
  }
  decoder_.reset(avcodec_alloc_context3(codec));
  avcodec_parameters_to_context(decoder_.get(), stream_->codecpar);
  decoder_->pkt_timebase = stream_->time_base;
  decoder_->thread_count = std::min(av_cpu_count(), kMostDecoderThreads);
  // Threads that have a frame each hold back as many frames.
  decoder_->thread_type = IsRegularFile(input_) ? FF_THREAD_FRAME | FF_THREAD_SLICE : FF_THREAD_SLICE;
  if (const int opened = avcodec_open2(decoder_.get(), codec, nullptr); opened < 0) {
    return absl::InvalidArgumentError(absl::StrCat(input_, ": cannot be decoded: ", Reason(opened)));
  }
  return absl::OkStatus();
}

void VideoFile::ReadFacts() {
  const AVFormatContext& container = *container_;
  DeclaredVideo facts;
  if (container.duration_estimation_method != AVFMT_DURATION_FROM_BITRATE) {  // which is a guess
    const double of_all = std::max(0.0, static_cast<double>(container.duration) / AV_TIME_BASE);
    const double own = static_cast<double>(stream_->duration) * Worth(stream_->time_base);
    facts.seconds = stream_->duration > 0 ? own : of_all;
  }
  fps_ = FpsOf(input_, *container_, *stream_);
  facts.fps = Worth(stream_->avg_frame_rate);
  facts.counted = stream_->nb_frames > 0;
  facts.frames = facts.counted ? stream_->nb_frames : std::llround(facts.seconds * fps_);
  facts.live = facts.frames == 0 && !IsRegularFile(input_);
  frames_ = facts.frames;
  turn_ = TurnOfStream(*stream_);
  extent_ = std::make_unique<VideoExtent>(input_, facts);
}

absl::StatusOr<bool> VideoFile::Advance() {
  while (true) {
    const int received = avcodec_receive_frame(decoder_.get(), frame_.get());
    if (received == 0) return Arrived();
    if (received == AVERROR_EOF) {
      if (absl::Status whole = extent_->End(); !whole.ok()) return whole;
      return false;
    }
    if (received != AVERROR(EAGAIN)) MetDamage();
    Feed();
  }
}

// Whether something cannot be decoded is not known to matter before a frame comes behind it: many files end in such.
absl::StatusOr<bool> VideoFile::Arrived() {
  began_ = true;
  if (std::exchange(damaged_, false)) {
    if (absl::Status whole = extent_->Damaged(); !whole.ok()) return whole;
  }
  std::optional<double> at;
  if (frame_->best_effort_timestamp != AV_NOPTS_VALUE) {
    const int64_t start = stream_->start_time == AV_NOPTS_VALUE ? 0 : stream_->start_time;
    at = static_cast<double>(frame_->best_effort_timestamp - start) * Worth(stream_->time_base);
  }
  extent_->Passed(at);
  return true;
}

void VideoFile::Feed() {
  asked_ = clock_.SteadyNow();
  const int read = av_read_frame(container_.get(), packet_.get());
  if (read < 0) {
    if (read == AVERROR(EAGAIN)) return;
    if (read != AVERROR_EOF) extent_->CannotBeRead(Reason(read));
    const bool ends = read == AVERROR_EOF || !IsRegularFile(input_) || ++read_failures_ > kReadAttempts;
    if (ends) avcodec_send_packet(decoder_.get(), nullptr);
    return;
  }
  if (std::exchange(read_failures_, 0) > 0) damaged_ = true;
  if (packet_->stream_index == stream_->index) {
    began_ = began_ || (packet_->flags & AV_PKT_FLAG_KEY) != 0;
    const int sent = avcodec_send_packet(decoder_.get(), packet_.get());
    if (sent < 0 && sent != AVERROR(EAGAIN)) MetDamage();
  }
  av_packet_unref(packet_.get());
}

// A recording that was begun in the middle of a broadcast begins with pictures that need earlier ones.
void VideoFile::MetDamage() { damaged_ = damaged_ || began_; }

// A file or a pipe may take its time.
int VideoFile::IsOverdue(void* self) {
  const auto& file = *static_cast<VideoFile*>(self);
  return IsAddress(file.input_) && file.clock_.Since(file.asked_) > kNetworkPatience ? 1 : 0;
}

absl::StatusOr<cv::Mat> VideoFile::Picture() {
  const int width = frame_->width, height = frame_->height;
  const auto format = static_cast<AVPixelFormat>(frame_->format);
  converter_.reset(sws_getCachedContext(converter_.release(), width, height, format, width, height, AV_PIX_FMT_BGR24,
                                        SWS_BICUBIC, nullptr, nullptr, nullptr));
  if (converter_ == nullptr) return absl::DataLossError(absl::StrCat(input_, ": its pixels cannot be read"));
  cv::Mat rows(height, cv::alignSize(width, kRowAlignment), CV_8UC3);
  uint8_t* const planes[] = {rows.data};
  const int strides[] = {static_cast<int>(rows.step)};
  sws_scale(converter_.get(), frame_->data, frame_->linesize, 0, height, planes, strides);
  const cv::Mat stored = rows.colRange(0, width), turned = Turned(stored, turn_);
  return turned.data == stored.data && !turned.isContinuous() ? turned.clone() : turned;
}

}  // namespace holdfast
