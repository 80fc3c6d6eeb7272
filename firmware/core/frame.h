/* Frames of docs/reference/protocol.md: header, body, CRC-16, COBS, a zero byte before and after. */
#ifndef TACSTRIP_FRAME_H
#define TACSTRIP_FRAME_H

#include <stdint.h>

#include "settings.h"

#define PROTOCOL 1
#define HEADER 10 /* version, kind, sequence, time */
#define CRC_BYTES 2

enum kind {
    KIND_SCAN = 0x01,
    KIND_HELLO = 0x02,
    KIND_REPLY = 0x03,
    KIND_TESTED = 0x04,
    KIND_IDENTIFY = 0x81,
    KIND_START = 0x82,
    KIND_STOP = 0x83,
    KIND_RATE = 0x84,
    KIND_TEST = 0x85
};

#define TOUCHED_BYTES ((STRIPS + 7) / 8)
#define SCAN_BYTES (HEADER + 8 + TOUCHED_BYTES + 2 * READINGS * STRIPS + CRC_BYTES)
#define HELLO_BYTES (HEADER + 58 + CRC_BYTES)
#define TESTED_BYTES (HEADER + 8 + STRIPS + CRC_BYTES)
#define LARGER(a, b) ((a) > (b) ? (a) : (b))
#define FRAME_BYTES LARGER(SCAN_BYTES, LARGER(HELLO_BYTES, TESTED_BYTES))
#define WIRE_BYTES (FRAME_BYTES + FRAME_BYTES / 254 + 3)

struct frame {
    uint16_t count;
    uint8_t bytes[FRAME_BYTES];
};

void frame_begin(struct frame *frame, enum kind kind, uint32_t sequence, uint32_t time_us);
void frame_u8(struct frame *frame, uint8_t value);
void frame_u16(struct frame *frame, uint16_t value);
void frame_u32(struct frame *frame, uint32_t value);
void frame_text(struct frame *frame, const char *text, uint8_t width); /* zeros after it */

/* Close a frame with its CRC and write it as it goes over the line; returns the bytes of that, WIRE_BYTES at most. */
uint16_t frame_seal(struct frame *frame, uint8_t *wire);

/* Take COBS off bytes between two zeros, in place; returns how many are left, 0 where they are no COBS. */
uint16_t frame_unstuff(uint8_t *bytes, uint16_t count);

/* CRC-16/IBM-3740 of bytes; 0 for a frame with its own CRC at the end. */
uint16_t frame_crc(const uint8_t *bytes, uint16_t count);

uint32_t read_u32(const uint8_t *bytes);

#endif
