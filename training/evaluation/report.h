// SPDX-License-Identifier: Apache-2.0
// Reports for people (tables) and for programs (JSON). The processing resolution stands beside every number: it changes
// the result.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "training/evaluation/evaluator.h"

namespace holdfast {

// Those at which the sequences were processed: one as a rule, several when a method takes frames as they are.
std::string ProcessingSizes(const Report& report);
// One decimal; "-" when there is none.
std::string FormatMetric(const std::optional<double>& value);

// Columns of 'rows' aligned: the first to the left, the others to the right. The first row is the header.
std::string FormatColumns(const std::vector<std::vector<std::string>>& rows);

// One line a sequence, the mean, and whatever was skipped and why.
std::string FormatReport(const Report& report);

// {"settings": {...}, "reports": [{"method", "sequences": [...], "skipped": [...], "mean": {...}, "iterations",
// "reliability": {...}}]}; a metric that does not exist is null, one that is infinite too.
std::string ReportsToJson(const std::vector<Report>& reports, const std::map<std::string, std::string>& settings);

}  // namespace holdfast
