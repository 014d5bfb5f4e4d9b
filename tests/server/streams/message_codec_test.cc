// SPDX-License-Identifier: Apache-2.0
#include "server/streams/message_codec.h"

#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <atomic>
#include <cstdlib>
#include <new>
#include <string>
#include <vector>

#include "api/limits.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"
#include "proto/convert.h"
#include "tests/support/status_matchers.h"

namespace {

std::atomic<int64_t> allocated_bytes{0};  // by operator new since the program's start, in our code and in protobuf's

}  // namespace

void* operator new(size_t size) {
  allocated_bytes += static_cast<int64_t>(size);
  if (void* memory = std::malloc(size)) return memory;
  throw std::bad_alloc();
}
void operator delete(void* memory) noexcept { std::free(memory); }
void operator delete(void* memory, size_t) noexcept { std::free(memory); }

namespace holdfast {
namespace {

using ::testing::HasSubstr;

constexpr int kMaxPoints = 2048;
constexpr int kMillion = 1'000'000;

grpc::ByteBuffer Bytes(const std::string& text) {
  const grpc::Slice slice(text);
  return grpc::ByteBuffer(&slice, 1);
}
// A length-delimited field of a number below 16.
std::string Field(int number, const std::string& content) {
  std::string text(1, static_cast<char>(number << 3 | 2));
  for (size_t size = content.size(); true; size >>= 7) {
    text.push_back(static_cast<char>((size & 0x7f) | (size > 0x7f ? 0x80 : 0)));
    if (size <= 0x7f) return text + content;
  }
}
std::string Repeated(const std::string& text, int count) {
  std::string all;
  for (int i = 0; i < count; ++i) all += text;
  return all;
}
v1::TrackRequest FrameRequest(size_t data_bytes, int points) {
  v1::TrackRequest request;
  *request.mutable_frame() = ToProto(Frame{7, std::string(data_bytes, 'x'), {}, {}});
  for (int i = 0; i < points; ++i) {
    v1::Point* point = request.mutable_frame()->add_points();
    point->set_id(~uint64_t{0} - i);  // the longest on the wire
    point->set_x(1.5F);
    point->set_y(2.5F);
  }
  return request;
}

TEST(MessageCodecTest, GivesBackWhatTheBytesSay) {
  grpc::ByteBuffer bytes = Bytes(FrameRequest(100, 3).SerializeAsString());
  v1::TrackRequest request;
  ASSERT_THAT(ParseRequest(bytes, kMaxPoints, request), IsOk());
  EXPECT_EQ(request.SerializeAsString(), FrameRequest(100, 3).SerializeAsString());
  EXPECT_EQ(bytes.Length(), 0U);
}

TEST(MessageCodecTest, AsManyPointsAsASessionHasFitBesideALargeFrame) {
  const v1::TrackRequest sent = FrameRequest(16 << 20, kMaxPoints);
  grpc::ByteBuffer bytes = Bytes(sent.SerializeAsString());
  v1::TrackRequest request;
  ASSERT_THAT(ParseRequest(bytes, kMaxPoints, request), IsOk());
  EXPECT_EQ(request.frame().points_size(), kMaxPoints);
  EXPECT_EQ(request.frame().data().size(), size_t{16} << 20);
}

TEST(MessageCodecTest, RefusesWhatWouldGrowWithoutParsingIt) {
  const std::string empty_point = Field(4, "");
  const std::string unknown = "\x78\x01";  // field 15, a number
  const std::string frame = Field(2, "pixels");
  const std::vector<std::string> hostile = {
      Field(3, Repeated(Field(1, "12345"), kMillion)),                // add_points of points that are none
      Field(1, Repeated(Field(7, ""), kMillion)),                     // config.points, empty
      Field(4, Field(1, std::string(kMillion, '\1'))),                // remove_points.ids, packed
      Field(2, frame + Repeated(empty_point, kMillion)),              // points beside a frame's data
      Field(2, Repeated(empty_point, kMillion) + frame),              // before it
      Repeated(Field(2, frame + Repeated(empty_point, 1000)), 1000),  // in frames of one message, which are merged
      Repeated(Field(2, Field(2, "")), kMillion),                     // empty data, again and again
      Field(2, Repeated(Field(5, ""), kMillion)),                     // objects that are none
      Field(2, Field(5, Field(2, std::string(kMillion, 'm')))),       // a mask that is too large
      Repeated(Field(2, Field(5, Field(2, std::string(10'000, 'm')))), 65),  // in frames, which are merged
      Field(3, Repeated(unknown, kMillion)),
      Repeated(unknown, kMillion),  // fields of no meaning
  };
  for (size_t i = 0; i < hostile.size(); ++i) {
    grpc::ByteBuffer bytes = Bytes(hostile[i]);
    v1::TrackRequest request;
    const int64_t before = allocated_bytes;
    EXPECT_THAT(ParseRequest(bytes, kMaxPoints, request), StatusIs(kExhausted, HasSubstr("at most 2048"))) << i;
    EXPECT_LT(allocated_bytes - before, 100'000) << i;
    EXPECT_EQ(bytes.Length(), 0U) << i;
  }
}

v1::TrackRequest ConfigRequest(int64_t token_bytes, int points) {
  v1::TrackRequest request = FrameRequest(0, points);
  const v1::Frame frame = request.frame();
  request.mutable_config()->set_resume_token(std::string(token_bytes, 't'));
  *request.mutable_config()->mutable_points() = frame.points();
  return request;
}

TEST(MessageCodecTest, TheLongestTokenFitsBesideAsManyPointsAsASessionHas) {
  grpc::ByteBuffer bytes = Bytes(ConfigRequest(kMaxTokenBytes, kMaxPoints).SerializeAsString());
  v1::TrackRequest request;
  ASSERT_THAT(ParseRequest(bytes, kMaxPoints, request), IsOk());
  EXPECT_EQ(request.config().resume_token().size(), static_cast<size_t>(kMaxTokenBytes));
  EXPECT_EQ(request.config().points_size(), kMaxPoints);
}

TEST(MessageCodecTest, OnlyATokenWhereATokenBelongsIsLetThrough) {
  const std::string token = Field(13, std::string(1'000'000, 't'));
  const std::vector<std::string> hostile = {
      ConfigRequest(kMaxTokenBytes + 100'000, 1).SerializeAsString(),
      Field(1, Repeated(token, 20)),                       // tokens that are longer together
      Repeated(Field(1, token), 20),                       // in configs of one message
      Field(1, token + Repeated(Field(7, ""), kMillion)),  // points beside it
      Field(2, token),                                     // in a frame
      Field(3, token),                                     // among points
      token,                                               // in none of them
      Field(1, Field(2, std::string(1'000'000, 't'))),     // another field of the config
  };
  for (size_t i = 0; i < hostile.size(); ++i) {
    grpc::ByteBuffer bytes = Bytes(hostile[i]);
    v1::TrackRequest request;
    EXPECT_THAT(ParseRequest(bytes, kMaxPoints, request), StatusIs(kExhausted, HasSubstr("or a token"))) << i;
  }
}

TEST(MessageCodecTest, BytesThatAreNoMessageAreNamed) {
  const std::string large(1 << 20, '\xff');
  for (const std::string& text : {std::string("\xff\xff\xff"), Field(2, "\x12\x7f"), large, Field(2, large)}) {
    grpc::ByteBuffer bytes = Bytes(text);
    v1::TrackRequest request;
    EXPECT_THAT(ParseRequest(bytes, kMaxPoints, request),
                StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("request: is not a message")));
  }
}

TEST(MessageCodecTest, ResponsesSurviveTheRoundTrip) {
  v1::TrackResponse response;
  response.mutable_summary()->set_frames(7);
  grpc::ByteBuffer bytes = SerializeResponse(response);
  v1::TrackResponse back;
  ASSERT_TRUE(grpc::SerializationTraits<v1::TrackResponse>::Deserialize(&bytes, &back).ok());
  EXPECT_EQ(back.summary().frames(), 7);
}

TEST(MessageCodecTest, ObjectsWithinTheirLimitsFitBesideALargeFrame) {
  v1::TrackRequest sent = FrameRequest(16 << 20, kMaxPoints);
  for (int i = 0; i < kMaxObjects; ++i) {
    v1::Object* object = sent.mutable_frame()->add_objects();
    object->set_id(kMaxObjectId);
    object->set_points(256);
    object->set_mask_png(std::string(kMaxObjectBytes / kMaxObjects, 'm'));
  }
  grpc::ByteBuffer bytes = Bytes(sent.SerializeAsString());
  v1::TrackRequest request;
  ASSERT_THAT(ParseRequest(bytes, kMaxPoints, request), IsOk());
  EXPECT_EQ(request.frame().objects_size(), kMaxObjects);
}

}  // namespace
}  // namespace holdfast
