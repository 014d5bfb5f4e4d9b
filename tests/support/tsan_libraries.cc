// SPDX-License-Identifier: Apache-2.0
// For builds with ThreadSanitizer only: what it must be told of the distribution's libraries, which are not
// instrumented. absl's mutexes and OpenMP's regions order what they guard and run without the sanitizer seeing it; the
// definitions here stand before the library's and say so, the library does the work.
#include <dlfcn.h>
#include <sanitizer/tsan_interface.h>

#include <string>

#include "absl/base/config.h"
#include "absl/synchronization/mutex.h"
#include "absl/synchronization/notification.h"

// Of the sanitizer's runtime, which has no header for them.
extern "C" void AnnotateIgnoreReadsBegin(const char* file, int line);
extern "C" void AnnotateIgnoreReadsEnd(const char* file, int line);

namespace {

#define HOLDFAST_TEXT_OF(x) #x
#define HOLDFAST_TEXT(x) HOLDFAST_TEXT_OF(x)

// The library's function, by its mangled name behind "_ZN4absl<inline namespace>"; a const one's begins with "_ZNK".
void* LibraryFunction(const char* name, const std::string& start = "_ZN") {
  const std::string inline_namespace = HOLDFAST_TEXT(ABSL_OPTION_INLINE_NAMESPACE_NAME);
  const std::string symbol = start + "4absl" + std::to_string(inline_namespace.size()) + inline_namespace + name;
  return dlsym(RTLD_NEXT, symbol.c_str());
}

using MutexFunction = void (*)(absl::Mutex*);

// A mutex evaluates the conditions that are waited for while it is held, on any thread and inside of its functions.
class IgnoreConditions {
 public:
  IgnoreConditions() { AnnotateIgnoreReadsBegin(__FILE__, __LINE__); }
  ~IgnoreConditions() { AnnotateIgnoreReadsEnd(__FILE__, __LINE__); }
};

}  // namespace

// absl::Status counts its references in the library; GDAL, which OpenCV's codecs load, orders its own locks; gRPC hands
// calls and messages from thread to thread by atomics of its own, partly from within its headers; the barriers of
// OpenCV's pool order what runs beneath it.
extern "C" const char* __tsan_default_suppressions() {
  return "race:absl::*Status::Unref\n"
         "deadlock:libgdal\n"
         "race:libopencv_core\n"
         "race:grpc::internal::ServerCallbackCall::Ref\n"
         "race:grpc::internal::ServerCallbackCall::Un\n"
         "race_top:^grpc::\n"
         "race_top:^grpc_*\n"
         "race_top:^google::protobuf::\n"
         "race_top:^holdfast::v1::\n"
         "race_top:std::_Function_base::\n"
         "race_top:std::function<\n"
         "race_top:std::enable_if<*swap<\n"
         "deadlock:libgrpc\n";
}

extern "C" const char* __tsan_default_options() { return "ignore_noninstrumented_modules=1"; }

// A parallel region: its threads begin after what came before it, and end before what comes after it.
extern "C" void GOMP_parallel(void (*work)(void*), void* data, unsigned threads, unsigned flags) {
  struct Region {
    void (*work)(void*);
    void* data;
  };
  using ParallelFunction = void (*)(void (*)(void*), void*, unsigned, unsigned);
  static const auto library = reinterpret_cast<ParallelFunction>(dlsym(RTLD_NEXT, "GOMP_parallel"));
  Region region{work, data};
  __tsan_release(&region);
  const auto run = [](void* of) {
    __tsan_acquire(of);
    const Region& it = *static_cast<const Region*>(of);
    it.work(it.data);
    __tsan_release(of);
  };
  library(run, &region, threads, flags);
  __tsan_acquire(&region);
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
  const IgnoreConditions ignore;
  library(this);
}

void Mutex::Await(const Condition& condition) {
  static const auto library =
      reinterpret_cast<void (*)(Mutex*, const Condition&)>(LibraryFunction("5Mutex5AwaitERKNS0_9ConditionE"));
  __tsan_release(this);
  {
    const IgnoreConditions ignore;
    library(this, condition);
  }
  __tsan_acquire(this);
}

bool Mutex::AwaitWithTimeout(const Condition& condition, Duration timeout) {
  static const auto library = reinterpret_cast<bool (*)(Mutex*, const Condition&, Duration)>(
      LibraryFunction("5Mutex16AwaitWithTimeoutERKNS0_9ConditionENS0_8DurationE"));
  __tsan_release(this);
  bool met;
  {
    const IgnoreConditions ignore;
    met = library(this, condition, timeout);
  }
  __tsan_acquire(this);
  return met;
}

void CondVar::Wait(Mutex* mutex) {
  static const auto library =
      reinterpret_cast<void (*)(CondVar*, Mutex*)>(LibraryFunction("7CondVar4WaitEPNS0_5MutexE"));
  __tsan_release(mutex);
  library(this, mutex);
  __tsan_acquire(mutex);
}

void Notification::Notify() {
  static const auto library = reinterpret_cast<void (*)(Notification*)>(LibraryFunction("12Notification6NotifyEv"));
  __tsan_release(this);
  library(this);
}

void Notification::WaitForNotification() const {
  static const auto library =
      reinterpret_cast<void (*)(const Notification*)>(LibraryFunction("12Notification19WaitForNotificationEv", "_ZNK"));
  {
    const IgnoreConditions ignore;
    library(this);
  }
  __tsan_acquire(const_cast<Notification*>(this));
}

ABSL_NAMESPACE_END
}  // namespace absl
