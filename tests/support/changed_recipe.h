// SPDX-License-Identifier: Apache-2.0
// Recipes that differ in one field, for tests that walk the table of fields.
#pragma once

#include <cstdint>
#include <variant>

#include "training/recipe.h"

namespace holdfast {

// 'recipe' with another value of 'field', one that its limits allow and that its text tells from the present one.
inline Recipe WithAnother(const RecipeField& field, Recipe recipe) {
  const RecipeValue value = field.get(recipe);
  if (const auto* integer = std::get_if<int64_t>(&value)) {
    field.set(recipe, *integer + 1);
  } else if (const auto* on = std::get_if<bool>(&value)) {
    field.set(recipe, !*on);
  } else if (const auto* form = std::get_if<DistanceForm>(&value)) {
    field.set(recipe, *form == DistanceForm::kPaper ? DistanceForm::kPublished : DistanceForm::kPaper);
  } else {
    const double present = std::get<double>(value);
    for (const double other : {0.25, 0.5, 2.0, 3.0}) {
      if (other != present && field.limits.Allow(other)) field.set(recipe, other);
    }
  }
  return recipe;
}

}  // namespace holdfast
