// SPDX-License-Identifier: Apache-2.0
// For builds with ThreadSanitizer only: what it must be told of the distribution's libraries, which are not
// instrumented. absl's mutexes order what they guard without the sanitizer seeing it; the definitions here stand before
// the library's and say so, the library does the work.
#include <dlfcn.h>
#include <sanitizer/tsan_interface.h>

#include <string>

#include "absl/base/config.h"
#include "absl/synchronization/mutex.h"

namespace {

#define HOLDFAST_TEXT_OF(x) #x
#define HOLDFAST_TEXT(x) HOLDFAST_TEXT_OF(x)

// The library's function, by its mangled name behind "_ZN4absl<inline namespace>".
void* LibraryFunction(const char* name) {
  const std::string inline_namespace = HOLDFAST_TEXT(ABSL_OPTION_INLINE_NAMESPACE_NAME);
  const std::string symbol = "_ZN4absl" + std::to_string(inline_namespace.size()) + inline_namespace + name;
  return dlsym(RTLD_NEXT, symbol.c_str());
}

using MutexFunction = void (*)(absl::Mutex*);

}  // namespace

// absl::Status counts its references in the library; GDAL, which OpenCV's codecs load, orders its own locks.
extern "C" const char* __tsan_default_suppressions() {
  return "race:absl::*Status::Unref\n"
         "deadlock:libgdal\n";
}

namespace absl {
ABSL_NAMESPACE_BEGIN

void Mutex::Lock() {
  static const auto library = reinterpret_cast<MutexFunction>(LibraryFunction("5Mutex4LockEv"));
  library(this);
  __tsan_acquire(this);
}

void Mutex::Unlock() {
  static const auto library = reinterpret_cast<MutexFunction>(LibraryFunction("5Mutex6UnlockEv"));
  __tsan_release(this);
  library(this);
}

void CondVar::Wait(Mutex* mutex) {
  static const auto library =
      reinterpret_cast<void (*)(CondVar*, Mutex*)>(LibraryFunction("7CondVar4WaitEPNS0_5MutexE"));
  __tsan_release(mutex);
  library(this, mutex);
  __tsan_acquire(mutex);
}

ABSL_NAMESPACE_END
}  // namespace absl
