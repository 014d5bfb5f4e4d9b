// SPDX-License-Identifier: Apache-2.0
// How the threads of OpenMP wait for each other, for programs that run the network.
#pragma once

namespace holdfast {

// Rounds that an OpenMP thread spins at a barrier before it sleeps: 28 us on an AMD EPYC.
//
// Threads that share a batch (model/shares.h) meet at its end only, but where there is too little to share there is a
// barrier after every operator. By default libgomp spins 300,000 rounds, some milliseconds: beside one other busy
// process a thread that waits burns the processor that the thread it waits for needs. Sleeping at once costs two system
// calls a barrier, also on a quiet machine. tests/benchmark/wait_policy.py measures both ends.
inline constexpr char kSpinCount[] = "1000";

// Makes the OpenMP threads of this process spin for kSpinCount rounds. A choice of the user's wins: nothing happens
// when OMP_WAIT_POLICY or GOMP_SPINCOUNT is set. Call it early in main, with main's argv: what comes before is
// done twice.
//
// libgomp reads its environment in a constructor, before any code of the program itself, and has no call to change what
// it read. (Functions of DT_PREINIT_ARRAY run before constructors, but before libc has taken over the environment too.)
// So the program executes itself once more, with GOMP_SPINCOUNT set, which also ends the recursion: process id,
// arguments, open files and the rest of the environment stay. Where that fails, the program goes on with the default.
void ChooseOpenMpWait(char** argv);

}  // namespace holdfast
