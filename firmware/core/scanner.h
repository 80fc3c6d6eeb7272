/* One cycle over all strips, and the test of the wiring. */
#ifndef TACSTRIP_SCANNER_H
#define TACSTRIP_SCANNER_H

#include "frame.h"

/* Read all strips into a scan frame; its time is that of the first strip. */
void scan_strips(struct frame *frame, uint32_t sequence);

/* Append one byte per strip: bit s is set where the line of signature s does not follow its pull both ways, because
   something touches the strip or holds the line. Nothing may touch the sensor. */
void test_strips(struct frame *frame);

#endif
