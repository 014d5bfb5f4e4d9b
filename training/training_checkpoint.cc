// SPDX-License-Identifier: Apache-2.0
#include "training/training_checkpoint.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "absl/strings/match.h"
#include "absl/strings/numbers.h"
#include "absl/strings/str_cat.h"
#include "absl/strings/str_format.h"
#include "absl/strings/strip.h"
#include "absl/time/time.h"
#include "model/checkpoint/checkpoint.h"

namespace holdfast {
namespace {

constexpr char kPairKey[] = "holdfast.training_id";
constexpr char kStateKey[] = "holdfast.training_state";
constexpr char kAveragePrefix[] = "average/";
constexpr char kOptimizer[] = "optimizer";

std::string WeightsPath(const std::string& directory, int64_t step) {
  return absl::StrFormat("%s/checkpoint-%08d.safetensors", directory, step);
}
std::string StatePath(const std::string& directory, int64_t step) {
  return absl::StrFormat("%s/checkpoint-%08d.state.safetensors", directory, step);
}

// Steps of which the directory has a file of either kind, newest first.
std::set<int64_t, std::greater<int64_t>> StepsIn(const std::string& directory) {
  std::set<int64_t, std::greater<int64_t>> steps;
  std::error_code error;
  for (std::filesystem::directory_iterator it(directory, error), end; !error && it != end; it.increment(error)) {
    const std::string name = it->path().filename().string();
    absl::string_view digits = name;
    int64_t step = 0;
    if (!absl::ConsumePrefix(&digits, "checkpoint-") || !absl::ConsumeSuffix(&digits, ".safetensors")) continue;
    absl::ConsumeSuffix(&digits, ".state");
    if (absl::SimpleAtoi(digits, &step)) steps.insert(step);
  }
  return steps;
}

// The weights of the first pair, without the state that would have made it one: its training was killed in between.
bool HasBarelyBegun(const std::string& directory, const std::set<int64_t, std::greater<int64_t>>& steps) {
  std::error_code error;
  return steps.size() == 1 && !std::filesystem::exists(StatePath(directory, *steps.begin()), error) && !error;
}

std::string ToJson(const TrainingState& state) {
  const nlohmann::json json = {{"step", state.step},
                               {"next_draw", state.next_draw},
                               {"world", state.world},
                               {"seed", state.seed},
                               {"elapsed_s", absl::ToDoubleSeconds(state.elapsed)},
                               {"skipped_steps", state.skipped_steps},
                               {"best", state.best},
                               {"validated", state.validated},
                               {"validated_step", state.validated_step},
                               {"recipe", state.recipe},
                               {"average_updates", state.average_updates}};
  return json.dump();
}

absl::StatusOr<TrainingState> FromJson(const std::string& text) {
  try {
    const nlohmann::json json = nlohmann::json::parse(text);
    TrainingState state;
    json.at("step").get_to(state.step);
    state.world = json.value("world", 0);  // earlier checkpoints have neither this nor draws
    json.at(state.world > 0 ? "next_draw" : "next_batch").get_to(state.next_draw);
    json.at("seed").get_to(state.seed);
    state.elapsed = absl::Seconds(json.at("elapsed_s").get<double>());
    json.at("skipped_steps").get_to(state.skipped_steps);
    json.at("best").get_to(state.best);
    state.validated = json.value("validated", state.validated);  // earlier checkpoints have neither
    state.validated_step = json.value("validated_step", state.validated_step);
    json.at("recipe").get_to(state.recipe);
    json.at("average_updates").get_to(state.average_updates);
    return state;
  } catch (const nlohmann::json::exception& e) {
    return absl::InvalidArgumentError(absl::StrCat("its training state does not parse: ", e.what()));
  }
}

TensorFile ToFile(const TrainingState& state, const std::string& id) {
  TensorFile file;
  file.metadata = {{kPairKey, id}, {kStateKey, ToJson(state)}};
  for (const auto& [name, tensor] : state.average) file.tensors[absl::StrCat(kAveragePrefix, name)] = tensor.cpu();
  const int64_t bytes = static_cast<int64_t>(state.optimizer.size());
  torch::Tensor archive = torch::empty({bytes}, torch::kUInt8);
  std::copy(state.optimizer.begin(), state.optimizer.end(), archive.data_ptr<uint8_t>());
  file.tensors[kOptimizer] = archive;
  return file;
}

absl::StatusOr<TrainingState> FromFile(const TensorFile& file) {
  const auto json = file.metadata.find(kStateKey);
  const auto archive = file.tensors.find(kOptimizer);
  if (json == file.metadata.end() || archive == file.tensors.end() || archive->second.scalar_type() != torch::kUInt8) {
    return absl::InvalidArgumentError("it is no training state");
  }
  absl::StatusOr<TrainingState> state = FromJson(json->second);
  if (!state.ok()) return state;
  const uint8_t* bytes = archive->second.data_ptr<uint8_t>();
  state->optimizer.assign(bytes, bytes + archive->second.numel());
  for (const auto& [name, tensor] : file.tensors) {
    absl::string_view parameter = name;
    if (absl::ConsumePrefix(&parameter, kAveragePrefix)) state->average[std::string(parameter)] = tensor;
  }
  return state;
}

absl::StatusOr<TrainingCheckpoint> ReadPair(const std::string& directory, int64_t step) {
  absl::StatusOr<TensorFile> weights = ReadSafetensors(WeightsPath(directory, step));
  if (!weights.ok()) return weights.status();
  const absl::StatusOr<TensorFile> file = ReadSafetensors(StatePath(directory, step));
  if (!file.ok()) return file.status();
  const auto id = weights->metadata.find(kPairKey);
  const auto state_id = file->metadata.find(kPairKey);
  if (id == weights->metadata.end() || state_id == file->metadata.end() || id->second != state_id->second) {
    return absl::InvalidArgumentError("its two files do not belong together");
  }
  absl::StatusOr<TrainingState> state = FromFile(*file);
  if (!state.ok()) return state.status();
  return TrainingCheckpoint{WeightsPath(directory, step), *std::move(weights), *std::move(state), ""};
}

// Newer steps than the one just saved are what a training left that could not go on from them.
void RemoveOthers(const std::string& directory, int64_t saved) {
  std::error_code ignored;  // a file too many does no harm
  bool spare = false;       // the newest complete pair before 'saved' has been met
  for (const int64_t step : StepsIn(directory)) {
    if (step == saved) continue;
    if (step < saved && !spare && ReadPair(directory, step).ok()) {
      spare = true;
      continue;
    }
    std::filesystem::remove(StatePath(directory, step), ignored);
    std::filesystem::remove(WeightsPath(directory, step), ignored);
  }
}

}  // namespace

absl::Status SaveTrainingCheckpoint(const std::string& directory, const PointModelImpl& model,
                                    const TrainingState& state, absl::Time now) {
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  if (error) return absl::PermissionDeniedError(absl::StrCat("cannot make ", directory, ": ", error.message()));
  // The two files cannot change at one moment.
  if (StepsIn(directory).count(state.step) > 0 && ReadPair(directory, state.step).ok()) return absl::OkStatus();
  const std::string id = absl::StrCat(state.step, "-", absl::ToUnixNanos(now));
  absl::Status status = SaveModel(WeightsPath(directory, state.step), model, torch::kFloat32, {{kPairKey, id}});
  if (status.ok()) status = WriteSafetensors(StatePath(directory, state.step), ToFile(state, id));
  if (status.ok()) RemoveOthers(directory, state.step);
  return status;
}

bool HasTrainingCheckpoint(const std::string& directory) {
  const auto steps = StepsIn(directory);
  return !steps.empty() && !HasBarelyBegun(directory, steps);
}

absl::StatusOr<std::optional<TrainingCheckpoint>> FindTrainingCheckpoint(const std::string& directory) {
  std::string skipped;
  const auto steps = StepsIn(directory);
  if (steps.empty() || HasBarelyBegun(directory, steps)) return std::nullopt;
  for (const int64_t step : steps) {
    absl::StatusOr<TrainingCheckpoint> checkpoint = ReadPair(directory, step);
    if (checkpoint.ok()) {
      checkpoint->skipped = skipped;
      return *std::move(checkpoint);
    }
    absl::StrAppend(&skipped, skipped.empty() ? "" : "; ", "checkpoint of step ", step, ": ",
                    checkpoint.status().message());
  }
  return absl::DataLossError(absl::StrCat("no checkpoint in ", directory, " is complete: ", skipped));
}

}  // namespace holdfast
