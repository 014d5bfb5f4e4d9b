// SPDX-License-Identifier: Apache-2.0
// Small grey pictures in few bytes, for what checkpoints carry: the data of a JPEG without its header, which is the
// same for all of them. Bytes of any kind decode in bounded memory, since the picture's size is not theirs to choose.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "absl/strings/string_view.h"
#include "absl/types/span.h"
#include "server/engine/motion/flow.h"

namespace holdfast {

// 'pixels': [FlowPatch::kSide, FlowPatch::kSide]. What comes back from DecodePatch differs by a few grey levels. Throws
// when the codec fails.
std::string EncodePatch(absl::Span<const uint8_t> pixels);

// [FlowPatch::kSide, FlowPatch::kSide]; empty where 'bytes' cannot be such a picture.
std::optional<std::vector<uint8_t>> DecodePatch(absl::string_view bytes);

}  // namespace holdfast
