// SPDX-License-Identifier: Apache-2.0
#include "program/shipped_weights.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "absl/strings/str_cat.h"
#include "absl/strings/str_join.h"

namespace holdfast {
namespace {

constexpr char kFile[] = "small.safetensors";
constexpr char kInstalled[] = "/usr/share/holdfast/weights";

}  // namespace

std::vector<std::string> ShippedWeightsPlaces(const std::string& program) {
  std::vector<std::string> places;
  const std::filesystem::path directory = std::filesystem::path(program).parent_path();
  const std::filesystem::path build = directory.parent_path().parent_path();
  if (directory.has_parent_path()) {
    places.push_back((directory.parent_path() / "share/holdfast/weights" / kFile).string());
  }
  if (build.filename() == "build") places.push_back((build.parent_path() / "weights" / kFile).string());
  const std::string installed = absl::StrCat(kInstalled, "/", kFile);
  if (std::find(places.begin(), places.end(), installed) == places.end()) places.push_back(installed);
  return places;
}

absl::StatusOr<std::string> FindShippedWeights(const std::string& program) {
  const std::vector<std::string> places = ShippedWeightsPlaces(program);
  std::error_code ignored;
  for (const std::string& place : places) {
    if (std::filesystem::exists(place, ignored)) return place;
  }
  return absl::NotFoundError(
      absl::StrCat("no weights are named, and the shipped ones are at none of ", absl::StrJoin(places, ", ")));
}

}  // namespace holdfast
