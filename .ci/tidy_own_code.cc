// SPDX-License-Identifier: Apache-2.0
// A plugin of clang-tidy: its checks look at the declarations of our own files alone, not at those of libraries'
// headers, whose findings are dropped anyhow and which are nearly all that a translation unit over LibTorch or gRPC
// consists of. Newer clang-tidy does so by itself. Built and loaded by clang_tidy.py.
#include <vector>

#include "clang-tidy/ClangTidyCheck.h"
#include "clang-tidy/ClangTidyModule.h"
#include "clang-tidy/ClangTidyModuleRegistry.h"
#include "clang/AST/ASTContext.h"
#include "clang/ASTMatchers/ASTMatchFinder.h"
#include "clang/Basic/SourceManager.h"

namespace {

using clang::ast_matchers::MatchFinder;

// Reports nothing. The translation unit is matched before anything in it, so that the scope set here is the one that
// all checks walk through.
class OwnCodeCheck : public clang::tidy::ClangTidyCheck {
 public:
  using ClangTidyCheck::ClangTidyCheck;

  void registerMatchers(MatchFinder* finder) override {
    finder->addMatcher(clang::ast_matchers::translationUnitDecl().bind("unit"), this);
  }

  void check(const MatchFinder::MatchResult& result) override {
    const auto* unit = result.Nodes.getNodeAs<clang::TranslationUnitDecl>("unit");
    std::vector<clang::Decl*> own;
    for (clang::Decl* decl : unit->decls()) {
      const clang::SourceLocation place = result.SourceManager->getExpansionLoc(decl->getLocation());
      if (place.isValid() && !result.SourceManager->isInSystemHeader(place)) own.push_back(decl);
    }
    result.Context->setTraversalScope(own);
  }
};

class HoldfastModule : public clang::tidy::ClangTidyModule {
 public:
  void addCheckFactories(clang::tidy::ClangTidyCheckFactories& factories) override {
    factories.registerCheck<OwnCodeCheck>("holdfast-own-code");
  }
};

clang::tidy::ClangTidyModuleRegistry::Add<HoldfastModule> registered("holdfast-module", "Holdfast's own");

}  // namespace
