// SPDX-License-Identifier: Apache-2.0
// The paper's results as rows of data, and our numbers beside them for the data sets that are present.
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "absl/status/statusor.h"
#include "training/evaluation/evaluator.h"

namespace holdfast {

struct PublishedResult {
  std::string title;          // of the data set
  std::string format;         // as --format names it
  std::string folder;         // below the suite's root
  std::string where;          // to get it
  ImageSize processing_size;  // the paper's
  Metrics published;          // of the paper's model
  int64_t points = 0;         // of a sequence at most, as the published test takes them; 0: all
  std::string differs;        // what we choose in another way than the published test; empty: nothing
};
std::vector<PublishedResult> PaperResults();

struct SuiteRow {
  PublishedResult published;
  // One a method. NOT_FOUND: the data set is absent; other errors: why it could not be evaluated.
  absl::StatusOr<std::vector<Report>> ours;
};

// Evaluates one data set, found in 'folder', at its published processing size.
using EvaluateFolder =
    std::function<absl::StatusOr<std::vector<Report>>(const PublishedResult& published, const std::string& folder)>;

// Every row of 'results' whose folder exists below 'root' is evaluated; the others say where to get the data.
std::vector<SuiteRow> RunSuite(const std::vector<PublishedResult>& results, const std::string& root,
                               const EvaluateFolder& evaluate);

// The paper's figures and those of our methods, row by row, then a line for each data set without one.
std::string FormatSuite(const std::vector<SuiteRow>& rows);

}  // namespace holdfast
