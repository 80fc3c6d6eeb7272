/* No board at all: the core as a library on a desktop computer, for tests. Volts, time and bytes are the caller's. */
#include "board.h"
#include "clock.h"
#include "settings.h"

#define SENT 4096
#define RECEIVED 4096

const uint8_t board_adc_bits = 12;

/* What the caller sets and reads. Part of Vref by line and strip; below 0: nothing touches. */
double desk_part[2][STRIPS + 1] = {[0][STRIPS] = -1.0, [1][STRIPS] = -1.0}; /* the last: no strip is selected */
uint32_t desk_time_us, desk_misread; /* exact conversions while a line was pulled */
uint8_t desk_sent[SENT], desk_received[RECEIVED];
uint32_t desk_sent_count, desk_received_count, desk_taken;
uint16_t desk_selected;
enum pull desk_pull[2];

void board_start(void) {
    desk_time_us += 1000;
}

void board_select(uint16_t strip) {
    desk_selected = strip;
}

void board_release(void) {
    desk_selected = STRIPS;
}

void board_alive(void) {}

void board_pull(uint8_t line, enum pull to) {
    desk_pull[line] = to;
}

uint16_t board_convert(uint8_t line, bool quick) {
    const double top = (1U << board_adc_bits) - 1;
    double part = desk_part[line][desk_selected];
    desk_time_us += quick ? 13 : 52;
    if (!quick && (desk_pull[0] || desk_pull[1])) desk_misread++;
    if (part >= 0.0) return (uint16_t)(part * top + 0.5);
    return desk_pull[line] == PULL_UP ? (uint16_t)top : 0;
}

void board_wait_us(uint8_t time_us) {
    desk_time_us += time_us;
}

uint32_t desk_clock_us(uint32_t overflows, uint16_t ticks, bool pending) {
    return clock_us(overflows, ticks, pending);
}

uint32_t board_now_us(void) {
    return desk_time_us;
}

uint16_t board_supply_mv(void) {
    return 0;
}

void board_send(const uint8_t *bytes, uint16_t count) {
    for (uint16_t i = 0; i < count && desk_sent_count < SENT; i++) desk_sent[desk_sent_count++] = bytes[i];
}

bool board_sending(void) {
    return false;
}

int16_t board_receive(void) {
    return desk_taken < desk_received_count ? desk_received[desk_taken++] : -1;
}
