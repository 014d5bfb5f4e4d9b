// SPDX-License-Identifier: Apache-2.0
#include "server/streams/message_codec.h"

#include <google/protobuf/io/coded_stream.h>
#include <google/protobuf/io/zero_copy_stream_impl_lite.h>
#include <google/protobuf/wire_format_lite.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/support/proto_buffer_reader.h>

#include <algorithm>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "absl/time/time.h"
#include "api/errors.h"
#include "api/limits.h"
#include "holdfast/v1/point_tracking.grpc.pb.h"  // how gRPC turns messages into bytes

namespace holdfast {
namespace {

using google::protobuf::internal::WireFormatLite;
using google::protobuf::io::CodedInputStream;

constexpr int64_t kPointBytes = 32;    // a point on the wire takes at most 23, an id to remove 11
constexpr int64_t kOtherBytes = 4096;  // everything else but a frame's data and a token

constexpr uint32_t TagOf(int field) { return static_cast<uint32_t>(field) << 3 | 2; }  // of a length-delimited field
constexpr uint32_t kFrameTag = TagOf(v1::TrackRequest::kFrameFieldNumber);
constexpr uint32_t kDataTag = TagOf(v1::Frame::kDataFieldNumber);
constexpr uint32_t kConfigTag = TagOf(v1::TrackRequest::kConfigFieldNumber);
constexpr uint32_t kTokenTag = TagOf(v1::SessionConfig::kResumeTokenFieldNumber);
constexpr uint32_t kConfigObjectTag = TagOf(v1::SessionConfig::kObjectsFieldNumber);
constexpr uint32_t kFrameObjectTag = TagOf(v1::Frame::kObjectsFieldNumber);
constexpr int64_t kObjectBytes = 64;  // of an object on the wire, at most, beside its mask or polygon
constexpr int64_t kMostObjectBytes = kMaxObjectBytes + kMaxObjects * kObjectBytes;

// Walks over a message as far as it is well-formed and within 'most' bytes beside the data of frames, a token and
// objects.
class Measure {
 public:
  Measure(CodedInputStream& in, int64_t most) : in_(in), most_(most) {}

  bool Fits() {
    while (const uint32_t tag = in_.ReadTag()) {
      if (!WalkField(tag) || Exceeded()) break;
    }
    return !Exceeded();
  }

 private:
  bool Exceeded() const {
    const int64_t own = data_ + std::min(token_, kMaxTokenBytes) + std::min(object_bytes_, kMostObjectBytes);
    return in_.CurrentPosition() - own > most_ || objects_ > kMaxObjects;
  }

  // False, here and below: there is no use in going on.
  bool WalkField(uint32_t tag) {
    if (tag == kFrameTag) return WalkPart(kDataTag, data_, kFrameObjectTag);
    if (tag == kConfigTag) return WalkPart(kTokenTag, token_, kConfigObjectTag);
    return WireFormatLite::SkipField(&in_, tag);
  }

  // A message within the message. Adds the bytes of its fields of that tag to 'counted', and counts its objects.
  bool WalkPart(uint32_t counted_tag, int64_t& counted, uint32_t object_tag) {
    uint32_t size = 0;
    if (!in_.ReadVarint32(&size)) return false;
    const CodedInputStream::Limit outer = in_.PushLimit(static_cast<int>(size));
    while (const uint32_t tag = in_.ReadTag()) {
      if (!WalkPartField(tag, counted_tag, counted, object_tag) || Exceeded()) return false;
    }
    in_.PopLimit(outer);
    return true;
  }

  bool WalkPartField(uint32_t tag, uint32_t counted_tag, int64_t& counted, uint32_t object_tag) {
    if (tag == counted_tag) return WalkBytes(counted);
    if (tag != object_tag) return WireFormatLite::SkipField(&in_, tag);
    ++objects_;
    return WalkBytes(object_bytes_);
  }

  bool WalkBytes(int64_t& counted) {
    uint32_t size = 0;
    if (!in_.ReadVarint32(&size) || !in_.Skip(static_cast<int>(size))) return false;
    counted += size;
    return true;
  }

  CodedInputStream& in_;
  const int64_t most_;
  int64_t data_ = 0;   // bytes of frames' data
  int64_t token_ = 0;  // bytes of tokens
  int64_t objects_ = 0;
  int64_t object_bytes_ = 0;
};

bool Fits(google::protobuf::io::ZeroCopyInputStream& bytes, int64_t most) {
  CodedInputStream in(&bytes);
  return Measure(in, most).Fits();
}

int64_t MostBytes(int max_points) { return kOtherBytes + kPointBytes * max_points; }

absl::Status TooManyPoints(int max_points) {
  return OverloadError("points of a session",
                       absl::StrCat("at most ", max_points, "; a message has more than the ", MostBytes(max_points),
                                    " bytes that they need beside a picture, objects or a token"),
                       absl::ZeroDuration());
}

absl::Status NoMessage() { return InvalidFieldError("request", "is not a message of this protocol"); }

}  // namespace

absl::Status ParseRequest(grpc::ByteBuffer& bytes, int max_points, v1::TrackRequest& request) {
  if (static_cast<int64_t>(bytes.Length()) > MostBytes(max_points)) {
    grpc::ProtoBufferReader reader(&bytes);
    if (!Fits(reader, MostBytes(max_points))) {
      bytes.Clear();
      return TooManyPoints(max_points);
    }
  }
  return grpc::SerializationTraits<v1::TrackRequest>::Deserialize(&bytes, &request).ok() ? absl::OkStatus()
                                                                                         : NoMessage();
}

absl::StatusOr<v1::TrackRequest> ParseRequest(absl::string_view bytes, int max_points) {
  const int size = static_cast<int>(bytes.size());  // carriers bound messages far below 2 GiB
  if (size > MostBytes(max_points)) {
    google::protobuf::io::ArrayInputStream reader(bytes.data(), size);
    if (!Fits(reader, MostBytes(max_points))) return TooManyPoints(max_points);
  }
  v1::TrackRequest request;
  if (!request.ParseFromArray(bytes.data(), size)) return NoMessage();
  return request;
}

grpc::ByteBuffer SerializeResponse(const v1::TrackResponse& response) {
  grpc::ByteBuffer bytes;
  bool own = false;
  // Fails for messages beyond 2 GiB only; those that are sent here are bounded far below.
  (void)grpc::SerializationTraits<v1::TrackResponse>::Serialize(response, &bytes, &own);
  return bytes;
}

}  // namespace holdfast
