/* Raspberry Pi Pico and its kin: RP2040 at 48 MHz, without an operating system or the maker's library. Wiring as in
   docs/guide/rp2040.md:

   GP0, GP1     UART 0: sends, receives
   GP2-GP5      address S0-S3 of every multiplexer
   GP6-GP9      enable, active low, of the multiplexers of strips 0.., WAYS.., 2 WAYS.., 3 WAYS..
   GP26, GP27   lines 0 and 1 (ADC 0, 1); GP10, GP11 pull them through 100 kohm each
   GP23         high: the Pico's regulator makes less ripple
   ADC_VREF is joined to 3V3, which also feeds the strips: readings are parts of Vref. */
#include "board.h"
#include "rp2040/registers.h"
#include "settings.h"

#ifndef WAYS
#define WAYS 16 /* of a multiplexer: 16 for the CD74HC4067, 8 for the 74HC4051 */
#endif
#if STRIPS > 4 * WAYS
#error "four multiplexers a line reach 4 WAYS strips"
#endif

#define CRYSTAL_HZ 12000000UL
#define CPU_HZ 48000000UL /* of the PLL for USB, which the converter needs anyway: one PLL, little ripple */
#define DIVISOR ((4 * CPU_HZ + BAUD / 2) / BAUD) /* 64ths of CPU_HZ / 16 BAUD */
#if BAUD > 3000000 || BAUD < 57600 /* slower, a long frame would take longer than the watchdog waits */
#error "BAUD is 57600 to 3000000"
#endif

#define ADDRESS_PIN 2
#define ENABLE_PIN 6
#define PULL_PIN 10
#define CALM_PIN 23
#define LINE_PIN 26
#define ADDRESS_PINS (0xFU << ADDRESS_PIN)
#define ENABLE_PINS (0xFU << ENABLE_PIN)
#define RECEIVED 64 /* a power of 2 */
/* The longest frame takes 50 ms at 57,600 baud, the longest scan 5. The counter goes down by two a microsecond (RP2040-E1). */
#define WATCHDOG_COUNT (2 * 250000UL)

const uint8_t board_adc_bits = 12;

static volatile uint8_t received[RECEIVED];
static volatile uint8_t received_in;
static uint8_t received_out;

void on_received(void);
void on_received(void) {
    while (!(REGISTER(UART_FR) & UART_NOTHING_RECEIVED)) {
        received[received_in] = (uint8_t)REGISTER(UART_DR); /* a host that sends more than fits loses commands, not the stream */
        received_in = (received_in + 1) & (RECEIVED - 1);
    }
}

static void start_clocks(void) {
    REGISTER(XOSC_STARTUP) = CRYSTAL_HZ / 1000 / 256 * 4; /* 4 ms */
    REGISTER(XOSC_CTRL) = 0xFABU << 12 | 0xAA0U;
    while (!(REGISTER(XOSC_STATUS) >> 31)) {}
    REGISTER(CLK_REF_CTRL) = 2; /* the crystal */
    while (!(REGISTER(CLK_REF_SELECTED) & 1U << 2)) {}
    REGISTER(CLK_SYS_CTRL) = 1U << 5; /* still the crystal; the PLL for USB comes next */
    while (!(REGISTER(CLK_SYS_SELECTED) & 1U << 0)) {}
    CLEAR(RESETS) = RESET_PLL_USB;
    while (!(REGISTER(RESETS_DONE) & RESET_PLL_USB)) {}
    REGISTER(PLL_CS) = 1;
    REGISTER(PLL_FBDIV) = 100; /* 1200 MHz */
    CLEAR(PLL_PWR) = 1U << 5 | 1U << 0;
    while (!(REGISTER(PLL_CS) >> 31)) {}
    REGISTER(PLL_PRIM) = 5U << 16 | 5U << 12; /* / 25 */
    CLEAR(PLL_PWR) = 1U << 3;
    REGISTER(CLK_SYS_CTRL) = 1U << 5 | 1U << 0;
    while (!(REGISTER(CLK_SYS_SELECTED) & 1U << 1)) {}
    REGISTER(CLK_PERI_CTRL) = CLOCK_ENABLED;
    REGISTER(CLK_ADC_CTRL) = CLOCK_ENABLED; /* from the PLL for USB */
    REGISTER(WATCHDOG_TICK) = 1U << 9 | CRYSTAL_HZ / 1000000; /* the timer's microsecond, too */
}

static void use_pin(uint32_t pin, uint32_t function, uint32_t pad) {
    REGISTER(PAD(pin)) = pad;
    REGISTER(GPIO_CTRL(pin)) = function;
}

static void start_pins(void) {
    REGISTER(SIO_OUT_SET) = ENABLE_PINS | 1U << CALM_PIN;
    REGISTER(SIO_DIRECTION_SET) = ENABLE_PINS | ADDRESS_PINS | 1U << CALM_PIN;
    for (uint32_t pin = ADDRESS_PIN; pin < PULL_PIN + 2; pin++) use_pin(pin, FUNCTION_SIO, PAD_4_MA);
    use_pin(CALM_PIN, FUNCTION_SIO, PAD_4_MA);
    /* The pads' own pulls, on after a reset, would load the lines. */
    use_pin(LINE_PIN, FUNCTION_NONE, PAD_OUTPUT_OFF);
    use_pin(LINE_PIN + 1, FUNCTION_NONE, PAD_OUTPUT_OFF);
    use_pin(0, FUNCTION_UART, PAD_4_MA);
    use_pin(1, FUNCTION_UART, PAD_INPUT | PAD_SCHMITT | PAD_PULL_UP);
}

static void start_line(void) {
    REGISTER(UART_IBRD) = DIVISOR >> 6;
    REGISTER(UART_FBRD) = DIVISOR & 63;
    REGISTER(UART_LCR_H) = 3U << 5 | 1U << 4; /* 8 bits, with FIFOs; takes the divisor over */
    REGISTER(UART_IFLS) = 0; /* an interrupt from four bytes on, */
    REGISTER(UART_IMSC) = 1U << 6 | 1U << 4; /* or when no more come */
    REGISTER(UART_DMACR) = 1U << 1; /* sent by DMA */
    REGISTER(UART_CR) = 1U << 9 | 1U << 8 | 1U << 0;
    REGISTER(NVIC_ENABLE) = 1U << UART0_INTERRUPT;
}

void board_start(void) {
    start_clocks();
    uint32_t used = RESET_ADC | RESET_DMA | RESET_IO | RESET_PADS | RESET_TIMER | RESET_UART0;
    CLEAR(RESETS) = used;
    while ((REGISTER(RESETS_DONE) & used) != used) {}
    start_pins();
    start_line();
    REGISTER(ADC_CS) = 1;
    while (!(REGISTER(ADC_CS) & 1U << 8)) {}
    REGISTER(PSM_WDSEL) = 0x1FFFCU; /* resets all but the oscillators */
    board_alive();
    SET(WATCHDOG_CTRL) = 1U << 30;
}

void board_select(uint16_t strip) {
    REGISTER(SIO_OUT_SET) = ENABLE_PINS; /* break before make */
    REGISTER(SIO_OUT_CLEAR) = ADDRESS_PINS;
    REGISTER(SIO_OUT_SET) = (uint32_t)(strip % WAYS) << ADDRESS_PIN;
    REGISTER(SIO_OUT_CLEAR) = 1U << (ENABLE_PIN + strip / WAYS);
}

void board_release(void) {
    REGISTER(SIO_OUT_SET) = ENABLE_PINS;
}

void board_alive(void) {
    REGISTER(WATCHDOG_LOAD) = WATCHDOG_COUNT;
}

void board_pull(uint8_t line, enum pull to) {
    uint32_t pin = 1U << (PULL_PIN + line);
    if (to == PULL_UP) REGISTER(SIO_OUT_SET) = pin;
    else REGISTER(SIO_OUT_CLEAR) = pin;
    if (to == PULL_NONE) REGISTER(SIO_DIRECTION_CLEAR) = pin;
    else REGISTER(SIO_DIRECTION_SET) = pin;
}

uint16_t board_convert(uint8_t line, bool quick) {
    (void)quick; /* all are: 2 us at full accuracy */
    REGISTER(ADC_CS) = (uint32_t)line << 12 | 1U << 2 | 1U << 0;
    while (!(REGISTER(ADC_CS) & 1U << 8)) {}
    return (uint16_t)REGISTER(ADC_RESULT);
}

void board_wait_us(uint8_t time_us) {
    uint32_t turns = (uint32_t)time_us * (CPU_HZ / 3000000UL); /* 3 cycles a turn */
    if (turns) __asm volatile("1: sub %0, #1\n bne 1b" : "+l"(turns) : : "cc");
}

uint32_t board_now_us(void) {
    return REGISTER(TIMER_NOW);
}

uint16_t board_supply_mv(void) {
    return 0; /* there is nothing to hold 3V3 against */
}

void board_send(const uint8_t *bytes, uint16_t count) {
    REGISTER(DMA0_READ) = (uint32_t)(uintptr_t)bytes;
    REGISTER(DMA0_WRITE) = UART_DR;
    REGISTER(DMA0_COUNT) = count;
    REGISTER(DMA0_CTRL_TRIG) = 1U << 21 | 20U << 15 | 1U << 4 | 1U << 0; /* bytes, at UART 0's pace, no interrupt */
}

bool board_sending(void) {
    return (REGISTER(DMA0_CTRL_TRIG) & DMA_BUSY) != 0;
}

int16_t board_receive(void) {
    if (received_out == received_in) return -1;
    uint8_t byte = received[received_out];
    received_out = (received_out + 1) & (RECEIVED - 1);
    return byte;
}
