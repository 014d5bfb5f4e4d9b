// SPDX-License-Identifier: Apache-2.0
// The objects of a session's state; for state_convert.cc alone.
#pragma once

#include "absl/strings/string_view.h"
#include "holdfast/checkpoint/v1/session_state.pb.h"
#include "server/engine/session_state.h"

namespace holdfast {

void ObjectToProto(const ObjectState& state, checkpoint::v1::Object* out);
// What is wrong with it; empty: nothing.
absl::string_view FaultOfObject(const checkpoint::v1::Object& object);
// REQUIRES: nothing is wrong with it.
ObjectState ObjectFromProto(const checkpoint::v1::Object& object);

}  // namespace holdfast
