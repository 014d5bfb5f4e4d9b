// SPDX-License-Identifier: Apache-2.0
#include "proto/grpc_status.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "api/errors.h"
#include "google/rpc/error_details.pb.h"
#include "tests/support/status_matchers.h"

namespace holdfast {
namespace {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;
using ::testing::SizeIs;

TEST(GrpcStatusTest, OkIsOkBothWays) {
  EXPECT_TRUE(ToGrpcStatus(absl::OkStatus()).ok());
  EXPECT_THAT(FromGrpcStatus(grpc::Status::OK), IsOk());
  EXPECT_THAT(FromRpcStatus(ToRpcStatus(absl::OkStatus())), IsOk());
}

TEST(GrpcStatusTest, CodesAndTextsOfPlainErrorsAreKept) {
  const grpc::Status status = ToGrpcStatus(absl::UnavailableError("the server is shutting down"));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE);
  EXPECT_EQ(status.error_message(), "the server is shutting down");
  EXPECT_THAT(status.error_details(), Not(IsEmpty()));
  EXPECT_THAT(FromGrpcStatus(status),
              StatusIs(absl::StatusCode::kUnavailable, HasSubstr("the server is shutting down")));
}

TEST(GrpcStatusTest, FieldViolationsTravelAsBadRequest) {
  const grpc::Status status = ToGrpcStatus(InvalidFieldsError({{"config.label", "is long"}, {"frame.index", "is 5"}}));
  google::rpc::Status rpc;
  google::rpc::BadRequest bad_request;
  ASSERT_TRUE(rpc.ParseFromString(status.error_details()));
  ASSERT_EQ(rpc.code(), 3);
  ASSERT_TRUE(rpc.details(0).UnpackTo(&bad_request));
  EXPECT_EQ(bad_request.field_violations(0).field(), "config.label");

  const std::vector<FieldViolation> violations = FieldViolations(FromGrpcStatus(status));
  ASSERT_THAT(violations, SizeIs(2));
  EXPECT_EQ(violations[1].field, "frame.index");
  EXPECT_EQ(violations[1].description, "is 5");
}

TEST(GrpcStatusTest, OverloadTravelsAsQuotaFailureAndRetryInfo) {
  const grpc::Status status = ToGrpcStatus(OverloadError("sessions", "all 16 are open", absl::Milliseconds(2500)));
  EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
  google::rpc::Status rpc;
  google::rpc::RetryInfo retry;
  ASSERT_TRUE(rpc.ParseFromString(status.error_details()));
  ASSERT_EQ(rpc.details_size(), 2);
  ASSERT_TRUE(rpc.details(1).UnpackTo(&retry));
  EXPECT_EQ(retry.retry_delay().seconds(), 2);
  EXPECT_EQ(retry.retry_delay().nanos(), 500'000'000);

  const auto overload = OverloadDetails(FromGrpcStatus(status));
  ASSERT_TRUE(overload.has_value());
  EXPECT_EQ(overload->subject, "sessions");
  EXPECT_EQ(overload->retry_after, absl::Milliseconds(2500));
}

TEST(GrpcStatusTest, AnOverloadThatNeverEndsHasNoRetryInfo) {
  const google::rpc::Status rpc = ToRpcStatus(OverloadError("points", "above the limit", absl::ZeroDuration()));
  EXPECT_EQ(rpc.details_size(), 1);
  EXPECT_EQ(OverloadDetails(FromRpcStatus(rpc))->retry_after, absl::ZeroDuration());
}

TEST(GrpcStatusTest, TextsOfInternalErrorsStayInside) {
  for (const absl::Status& status : {absl::InternalError("at /home/me/secret.cc:7"), absl::UnknownError("token=abc")}) {
    const grpc::Status sent = ToGrpcStatus(status);
    EXPECT_EQ(static_cast<int>(sent.error_code()), static_cast<int>(status.code()));
    EXPECT_THAT(sent.error_message(), Not(HasSubstr("secret")));
    EXPECT_THAT(sent.error_message(), Not(HasSubstr("token")));
  }
}

TEST(GrpcStatusTest, AnErrorThatNoServerWroteIsALostServer) {
  for (const auto code : {grpc::StatusCode::CANCELLED, grpc::StatusCode::INTERNAL, grpc::StatusCode::UNKNOWN}) {
    EXPECT_TRUE(IsLostServer(grpc::Status(code, "Received RST_STREAM with error code 2")));
  }
  EXPECT_TRUE(IsLostServer(ToGrpcStatus(absl::UnavailableError("the server is shutting down"))));
  EXPECT_FALSE(IsLostServer(ToGrpcStatus(absl::InternalError("an operator threw"))));
  EXPECT_FALSE(IsLostServer(ToGrpcStatus(absl::UnknownError(""))));
  EXPECT_FALSE(IsLostServer(grpc::Status(grpc::StatusCode::UNIMPLEMENTED, "")));
  EXPECT_FALSE(IsLostServer(grpc::Status::OK));
}

TEST(GrpcStatusTest, EverythingFitsIntoTrailingMetadata) {
  std::vector<FieldViolation> violations;
  for (int i = 0; i < 1000; ++i) violations.push_back({std::string(5000, 'f'), std::string(5000, '\n')});
  const absl::Status error = InvalidFieldsError(violations);
  EXPECT_LT(error.message().size(), 3000U) << "bounded where it is made";
  const grpc::Status status = ToGrpcStatus(error);
  EXPECT_LT(status.error_message().size(), 600U);
  EXPECT_LT(status.error_details().size() * 4 / 3 + status.error_message().size(), 8000U);
  EXPECT_THAT(FieldViolations(FromGrpcStatus(status)), SizeIs(8));
}

TEST(GrpcStatusTest, BytesThatAreNotTextAreReplaced) {
  EXPECT_EQ(ToGrpcStatus(absl::NotFoundError("a\n\xff\x01z")).error_message(), "a???z");
}

TEST(GrpcStatusTest, GarbageInTheDetailsIsIgnored) {
  const absl::Status status =
      FromGrpcStatus(grpc::Status(grpc::StatusCode::INVALID_ARGUMENT, "no", "\xff\xff garbage"));
  EXPECT_THAT(status, StatusIs(absl::StatusCode::kInvalidArgument, HasSubstr("no")));
  EXPECT_THAT(FieldViolations(status), IsEmpty());
}

}  // namespace
}  // namespace holdfast
