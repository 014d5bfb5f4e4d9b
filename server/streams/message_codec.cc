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

// Walks over a message as far as it is well-formed and within 'most' bytes beside the data of frames and a token.
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
  bool Exceeded() const { return in_.CurrentPosition() - data_ - std::min(token_, kMaxTokenBytes) > most_; }

  // False, here and below: there is no use in going on.
  bool WalkField(uint32_t tag) {
    if (tag == kFrameTag) return WalkPart(kDataTag, data_);
    if (tag == kConfigTag) return WalkPart(kTokenTag, token_);
    return WireFormatLite::SkipField(&in_, tag);
  }

  // A message within the message. Adds the bytes of its fields of that tag to 'counted'.
  bool WalkPart(uint32_t counted_tag, int64_t& counted) {
    uint32_t size = 0;
    if (!in_.ReadVarint32(&size)) return false;
    const CodedInputStream::Limit outer = in_.PushLimit(static_cast<int>(size));
    while (const uint32_t tag = in_.ReadTag()) {
      if (!(tag == counted_tag ? WalkBytes(counted) : WireFormatLite::SkipField(&in_, tag))) return false;
      if (Exceeded()) return false;
    }
    in_.PopLimit(outer);
    return true;
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
};

bool Fits(google::protobuf::io::ZeroCopyInputStream& bytes, int64_t most) {
  CodedInputStream in(&bytes);
  return Measure(in, most).Fits();
}

int64_t MostBytes(int max_points) { return kOtherBytes + kPointBytes * max_points; }

absl::Status TooManyPoints(int max_points) {
  return OverloadError("points of a session",
                       absl::StrCat("at most ", max_points, "; a message has more than the ", MostBytes(max_points),
                                    " bytes that they need beside a picture or a token"),
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
