/* Arduino Uno and its kin: ATmega328P at 16 MHz. Wiring as in docs/guide/build.md:

   D2-D5 (PD2-PD5)   address S0-S3 of every multiplexer
   D8-D11 (PB0-PB3)  enable, active low, of the multiplexers of strips 0.., WAYS.., 2 WAYS.., 3 WAYS..
   A0, A1            lines 0 and 1; D6, D7 (PD6, PD7) pull them through 100 kohm each
   AREF is AVcc, which also feeds the strips: readings are parts of Vref, whatever USB delivers. */
#include <avr/interrupt.h>
#include <avr/io.h>
#include <avr/sleep.h>
#include <avr/wdt.h>
#include <stddef.h>
#include <util/delay_basic.h>

#include "board.h"
#include "clock.h"
#include "settings.h"

#ifndef WAYS
#define WAYS 16 /* of a multiplexer: 16 for the CD74HC4067, 8 for the 74HC4051 */
#endif
#if STRIPS > 4 * WAYS
#error "four multiplexers a line reach 4 WAYS strips"
#endif

#define DIVISOR ((F_CPU + 4 * BAUD) / (8 * BAUD))
#if F_CPU > 8 * DIVISOR * BAUD / 1000 * 1025 || F_CPU < 8 * DIVISOR * BAUD / 1000 * 975
#error "16 MHz cannot make this BAUD to 2.5 %: take 115200, 250000, 500000 or 1000000"
#endif

#define ADDRESS_PINS 0x3C    /* of port D */
#define ENABLE_PINS 0x0F     /* of port B */
#define PULL_PIN(line) (uint8_t)(_BV(PD6) << (line))
#define FROM_AVCC _BV(REFS0)
#define BANDGAP_MV 1100UL
#define CLOCK_250_KHZ (_BV(ADPS2) | _BV(ADPS1)) /* 52 us a conversion; full accuracy is promised up to 200 kHz */
#define CLOCK_1_MHZ _BV(ADPS2)                  /* 13 us, 8 bits or so */
#define RECEIVED 64                             /* a power of 2 */

const uint8_t board_adc_bits = 10;

static volatile uint32_t overflows; /* of timer 1, 32.768 ms each */
static const uint8_t *volatile sent;
static volatile uint16_t unsent;
static uint8_t received[RECEIVED];
static volatile uint8_t received_in;
static uint8_t received_out;

ISR(TIMER1_OVF_vect) { overflows++; }

ISR(USART_UDRE_vect) {
    const uint8_t *next = sent;
    UDR0 = *next;
    sent = next + 1;
    if (--unsent == 0) UCSR0B &= (uint8_t)~_BV(UDRIE0);
}

ISR(USART_RX_vect) {
    uint8_t byte = UDR0;
    received[received_in] = byte; /* a host that sends more than fits loses commands, not the stream */
    received_in = (received_in + 1) & (RECEIVED - 1);
}

EMPTY_INTERRUPT(ADC_vect) /* it only ends the sleep */

static uint16_t convert(uint8_t input, uint8_t clock) {
    ADMUX = FROM_AVCC | input;
    ADCSRA = _BV(ADEN) | _BV(ADIE) | _BV(ADSC) | clock;
    cli();
    while (ADCSRA & _BV(ADSC)) {
        sleep_enable();
        sei(); /* takes effect after the next instruction, so that no interrupt slips in before the sleep */
        sleep_cpu();
        sleep_disable();
        cli();
    }
    sei();
    return ADC;
}

/* After a reset by the watchdog it still runs, at its shortest: stopped before anything else. */
__attribute__((naked, used, section(".init3"))) void stop_watchdog(void);
void stop_watchdog(void) {
    MCUSR = 0;
    wdt_disable();
}

void board_start(void) {
    PORTB |= ENABLE_PINS;
    DDRB |= ENABLE_PINS;
    DDRD |= ADDRESS_PINS;
    DIDR0 = _BV(ADC0D) | _BV(ADC1D);
    TCCR1B = _BV(CS11); /* 2 MHz */
    TIMSK1 = _BV(TOIE1);
    UCSR0A = _BV(U2X0); /* before the divisor: simavr looks at it then */
    UBRR0 = DIVISOR - 1;
    UCSR0B = _BV(RXEN0) | _BV(TXEN0) | _BV(RXCIE0);
    set_sleep_mode(SLEEP_MODE_IDLE);
    sei();
    wdt_enable(WDTO_250MS); /* the longest frame takes 30 ms at 115,200 baud, the longest scan 15 */
    convert(0, CLOCK_250_KHZ); /* the first conversion after switching on is longer */
}

void board_select(uint16_t strip) {
    uint8_t number = (uint8_t)strip; /* 64 at most */
    PORTB |= ENABLE_PINS; /* break before make */
    PORTD = (uint8_t)((PORTD & ~ADDRESS_PINS) | (number % WAYS) << PD2);
    switch (STRIPS > WAYS ? number / WAYS : 0) { /* a bit by its name is one instruction, a shift a loop */
        case 0: PORTB &= (uint8_t)~_BV(PB0); break;
        case 1: PORTB &= (uint8_t)~_BV(PB1); break;
        case 2: PORTB &= (uint8_t)~_BV(PB2); break;
        default: PORTB &= (uint8_t)~_BV(PB3); break;
    }
}

void board_release(void) {
    PORTB |= ENABLE_PINS;
}

void board_alive(void) {
    wdt_reset();
}

void board_pull(uint8_t line, enum pull to) {
    uint8_t pin = PULL_PIN(line);
    if (to == PULL_UP) PORTD |= pin;
    else PORTD &= (uint8_t)~pin;
    if (to == PULL_NONE) DDRD &= (uint8_t)~pin;
    else DDRD |= pin;
}

uint16_t board_convert(uint8_t line, bool quick) {
    return convert(line, quick ? CLOCK_1_MHZ : CLOCK_250_KHZ);
}

void board_wait_us(uint8_t time_us) {
    _delay_loop_2((uint16_t)time_us * (uint16_t)(F_CPU / 4000000UL)); /* 4 cycles a turn */
}

uint32_t board_now_us(void) {
    uint8_t status = SREG;
    cli();
    uint16_t ticks = TCNT1;
    bool pending = TIFR1 & _BV(TOV1); /* after the ticks: they tell on which side of the overflow they were read */
    uint32_t counted = overflows;
    SREG = status;
    return clock_us(counted, ticks, pending);
}

uint16_t board_supply_mv(void) {
    uint8_t bandgap = 0x0E;
    convert(bandgap, CLOCK_250_KHZ); /* the reference takes a while to load the sampler */
    convert(bandgap, CLOCK_250_KHZ);
    uint16_t code = convert(bandgap, CLOCK_250_KHZ);
    return code ? (uint16_t)(BANDGAP_MV * 1024 / code) : 0;
}

void board_send(const uint8_t *bytes, uint16_t count) {
    sent = bytes;
    unsent = count;
    UCSR0B |= _BV(UDRIE0);
}

bool board_sending(void) {
    return (UCSR0B & _BV(UDRIE0)) != 0;
}

int16_t board_receive(void) {
    if (received_out == received_in) return -1;
    uint8_t byte = received[received_out];
    received_out = (received_out + 1) & (RECEIVED - 1);
    return byte;
}
