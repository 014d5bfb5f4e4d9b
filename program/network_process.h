// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace holdfast {

// What every program that runs the network does before anything else of it, and before there are threads: how its
// OpenMP threads wait (ChooseOpenMpWait, which may execute the program once more), what becomes of freed memory
// (KeepFreedMemory), and that release builds do not look for deadlocks. Environment variables that the user has set
// win. 'argv' is main's.
void PrepareForNetwork(char** argv);

}  // namespace holdfast
