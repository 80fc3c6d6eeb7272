/* What the core asks of a board. A new board needs one file that defines these, and nothing else. */
#ifndef TACSTRIP_BOARD_H
#define TACSTRIP_BOARD_H

#include <stdbool.h>
#include <stdint.h>

enum pull { PULL_NONE, PULL_UP, PULL_DOWN };

extern const uint8_t board_adc_bits; /* codes run from 0 to 2^bits - 1 */

void board_start(void);

/* Switch all multiplexers to a strip: those of the lines that are read, and where strips are energised one by one
   (CRS-M) those of Vref and ground. They share their address wires, so one call does both. */
void board_select(uint16_t strip);

/* Open all multiplexers: between scans no strip is energised, and a shorted one draws nothing. */
void board_release(void);

/* The main loop is alive. A board that does not hear so for a quarter of a second resets itself. */
void board_alive(void);

/* Pull a line (0 or 1) to Vref or ground through its weak resistor, or let go. */
void board_pull(uint8_t line, enum pull to);

/* Convert a line once. A quick conversion may be a few codes off: it decides about touch only. */
uint16_t board_convert(uint8_t line, bool quick);

void board_wait_us(uint8_t time_us);
uint32_t board_now_us(void); /* wraps after 2^32 */
uint16_t board_supply_mv(void); /* 0: the board cannot tell */

/* Send in the background; the bytes stay untouched until board_sending() is false. */
void board_send(const uint8_t *bytes, uint16_t count);
bool board_sending(void);
int16_t board_receive(void); /* the next byte from the host, or -1 */

#endif
