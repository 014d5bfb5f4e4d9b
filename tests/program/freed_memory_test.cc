// SPDX-License-Identifier: Apache-2.0
#include "program/freed_memory.h"

#include <gtest/gtest.h>
#include <malloc.h>

#include <cstdlib>
#include <thread>

namespace holdfast {
namespace {

constexpr size_t kTensor = size_t{40} << 20;  // bytes

// How many blocks come from the kernel alone while a thread holds a block of a tensor's size.
size_t BlocksOfTheirOwn() {
  size_t blocks = 0;
  std::thread([&] {
    void* const tensor = std::malloc(kTensor);
    *static_cast<volatile char*>(tensor) = 1;  // so that the compiler does not do without it
    blocks = mallinfo2().hblks;
    std::free(tensor);
  }).join();
  return blocks;
}

// malloc's settings are the process's: each case is a process of its own.
[[noreturn]] void ExitWithBlocks(const char* variable, const char* value) {
  if (variable != nullptr) setenv(variable, value, 1);
  const size_t before = BlocksOfTheirOwn();
  KeepFreedMemory();
  std::_Exit(before == 1 ? static_cast<int>(BlocksOfTheirOwn()) : 99);
}

class FreedMemoryDeathTest : public ::testing::Test {
 protected:
  void SetUp() override {
#ifdef HOLDFAST_SANITIZED
    GTEST_SKIP() << "the sanitizers bring a malloc of their own";
#endif
    GTEST_FLAG_SET(death_test_style, "threadsafe");
  }
};

TEST_F(FreedMemoryDeathTest, ATensorsMemoryIsKeptForTheNextOne) {
  EXPECT_EXIT(ExitWithBlocks(nullptr, nullptr), testing::ExitedWithCode(0), "");
}

TEST_F(FreedMemoryDeathTest, AChoiceOfTheUsersWins) {
  EXPECT_EXIT(ExitWithBlocks("MALLOC_ARENA_MAX", "4"), testing::ExitedWithCode(1), "");
  EXPECT_EXIT(ExitWithBlocks("GLIBC_TUNABLES", "glibc.malloc.check=0"), testing::ExitedWithCode(1), "");
}

TEST_F(FreedMemoryDeathTest, OtherTunablesAreNoChoiceOfThis) {
  EXPECT_EXIT(ExitWithBlocks("GLIBC_TUNABLES", "glibc.rtld.nns=4"), testing::ExitedWithCode(0), "");
}

}  // namespace
}  // namespace holdfast
