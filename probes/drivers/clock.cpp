// Loaded before a library that takes its seed from the clock: the clock stands where we set it.
#include <ctime>

namespace {
std::time_t now = 0;
}

extern "C" {

void ransac_fix_set_clock(long value) { now = value; }

std::time_t time(std::time_t* result) noexcept {
    if (result) *result = now;
    return now;
}

std::clock_t clock() noexcept { return 0; }
}
