// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace holdfast {

// Has the kernel run the calling thread, and threads that it creates from now on, for longer at a time, but step back
// at once for threads that wake up: those which take calls, answer them and decode frames do so in microseconds and
// would otherwise wait for a slice to end at each of their steps, while every processor computes. The share of the
// processors stays what it was. Linux 6.12 and later; earlier kernels take no notice, and neither is it an error
// elsewhere.
void RunInLongSlices();

}  // namespace holdfast
