/* A clock of 32 bits out of a timer of 16 that runs at 2 MHz and counts its overflows. */
#ifndef TACSTRIP_CLOCK_H
#define TACSTRIP_CLOCK_H

#include <stdbool.h>
#include <stdint.h>

/* An overflow is 2^15 us, so 17 bits of their count make the 32 of the clock: a count of 16 would end at 2^31 us, after
   35.8 minutes, and begin anew. `pending`: the timer has overflowed and the count does not know yet. */
static inline uint32_t clock_us(uint32_t overflows, uint16_t ticks, bool pending) {
    if (pending && ticks < 0x8000) overflows++;
    return overflows << 15 | ticks >> 1;
}

#endif
