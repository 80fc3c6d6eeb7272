#include "frame.h"

void frame_u8(struct frame *frame, uint8_t value) {
    frame->bytes[frame->count++] = value;
}

void frame_u16(struct frame *frame, uint16_t value) {
    frame_u8(frame, (uint8_t)value);
    frame_u8(frame, (uint8_t)(value >> 8));
}

void frame_u32(struct frame *frame, uint32_t value) {
    frame_u16(frame, (uint16_t)value);
    frame_u16(frame, (uint16_t)(value >> 16));
}

void frame_text(struct frame *frame, const char *text, uint8_t width) {
    while (width--) frame_u8(frame, *text ? (uint8_t)*text++ : 0);
}

void frame_begin(struct frame *frame, enum kind kind, uint32_t sequence, uint32_t time_us) {
    frame->count = 0;
    frame_u8(frame, PROTOCOL);
    frame_u8(frame, (uint8_t)kind);
    frame_u32(frame, sequence);
    frame_u32(frame, time_us);
}

/* x^16 + x^12 + x^5 + 1, a byte at a time, its two bytes apart: no table, and no wide shifts on an 8-bit core. */
uint16_t frame_crc(const uint8_t *bytes, uint16_t count) {
    uint8_t high = 0xFF, low = 0xFF;
    while (count--) {
        uint8_t x = high ^ *bytes++;
        x ^= x >> 4;
        high = (uint8_t)(low ^ (uint8_t)(x << 4) ^ (x >> 3));
        low = (uint8_t)((uint8_t)(x << 5) ^ x);
    }
    return (uint16_t)(high << 8 | low);
}

uint16_t frame_seal(struct frame *frame, uint8_t *wire) {
    uint16_t crc = frame_crc(frame->bytes, frame->count);
    frame_u8(frame, (uint8_t)(crc >> 8));
    frame_u8(frame, (uint8_t)crc);
    uint8_t *out = wire;
    *out++ = 0;
    uint8_t *length = out++; /* of the block that is being written, 1 more than its bytes */
    uint8_t block = 1;
    const uint8_t *end = frame->bytes + frame->count;
    for (const uint8_t *in = frame->bytes; in != end; in++) {
        if (*in) {
            *out++ = *in;
            block++;
        }
        if (!*in || (block == 0xFF && in + 1 != end)) {
            *length = block;
            length = out++;
            block = 1;
        }
    }
    *length = block;
    *out++ = 0;
    return (uint16_t)(out - wire);
}

uint16_t frame_unstuff(uint8_t *bytes, uint16_t count) {
    uint16_t in = 0, out = 0;
    while (in < count) {
        uint8_t block = bytes[in++];
        if (block == 0 || (uint16_t)(block - 1) > count - in) return 0;
        for (uint8_t left = block; --left;) bytes[out++] = bytes[in++];
        if (block != 0xFF && in < count) bytes[out++] = 0;
    }
    return out;
}

uint32_t read_u32(const uint8_t *bytes) {
    return bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24;
}
