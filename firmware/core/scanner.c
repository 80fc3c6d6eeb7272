#include "scanner.h"

#include "board.h"

#define LINE_OF(signature) ((signature) == 1 ? 1 : 0)
#define FIRST_SIGNATURE (SIGNATURES & 1 ? 0 : SIGNATURES & 2 ? 1 : 2)
#define TOUCHED_AT (HEADER + 8)
#define CODES_AT (TOUCHED_AT + TOUCHED_BYTES)

static uint16_t pulled(uint8_t line, enum pull to) {
    board_pull(line, to);
    board_wait_us(PULLED_US);
    return board_convert(line, true);
}

/* An open line follows its pull; one that a touched strip holds hardly moves. */
static bool held(uint8_t line) {
    uint16_t up = pulled(line, PULL_UP);
    uint16_t down = pulled(line, PULL_DOWN);
    board_pull(line, PULL_NONE);
    uint16_t apart = up > down ? up - down : 0;
    return apart < (uint16_t)(1U << board_adc_bits) / TOUCH_PART;
}

static void put_code(uint8_t *at, uint16_t code) {
    at[0] = (uint8_t)code;
    at[1] = (uint8_t)(code >> 8);
}

void scan_strips(struct frame *frame, uint32_t sequence) {
    uint32_t first_us = 0, last_us = 0;
    frame_begin(frame, KIND_SCAN, sequence, 0);
    uint8_t *touched = frame->bytes + TOUCHED_AT;
    uint8_t *code = frame->bytes + CODES_AT;
    for (uint8_t i = 0; i < TOUCHED_BYTES; i++) touched[i] = 0;
    for (uint16_t strip = 0; strip < STRIPS; strip++, code += 2) {
        board_select(strip);
        if (held(LINE_OF(FIRST_SIGNATURE))) touched[strip >> 3] |= (uint8_t)(1U << (strip & 7));
        board_wait_us(RELEASED_US);
        last_us = board_now_us();
        if (strip == 0) first_us = last_us;
        put_code(code, board_convert(LINE_OF(FIRST_SIGNATURE), false));
#if READINGS > 1
        put_code(code + 2 * STRIPS, board_convert(1, false));
#endif
    }
    board_release();
    frame->count = HEADER - 4;
    frame_u32(frame, first_us);
    frame_u16(frame, STRIPS);
    frame_u8(frame, SIGNATURES);
    frame_u8(frame, board_adc_bits);
    frame_u32(frame, last_us - first_us);
    frame->count = SCAN_BYTES - CRC_BYTES;
}

void test_strips(struct frame *frame) {
    for (uint16_t strip = 0; strip < STRIPS; strip++) {
        uint8_t flags = 0;
        board_select(strip);
        for (uint8_t signature = 0; signature < 3; signature++) {
            if ((SIGNATURES >> signature & 1) && held(LINE_OF(signature))) flags |= (uint8_t)(1U << signature);
        }
        frame_u8(frame, flags);
    }
    board_release();
}
