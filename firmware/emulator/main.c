/* Runs the firmware for the Uno in simavr, with the sensor's voltages on its A/D inputs.

   This program links simavr, which is under the GNU General Public License, version 3 or later; so is this program
   when it is built. Nothing of tacstrip links it: tests start it as a process.

   Usage: emulator UNO.elf SECONDS STRIPS LINES WAYS SOURCE_OHM NODE_PF < SCENARIO > BYTES
   SCENARIO has lines in the order of their time:
     volts TIME_US V ...   from then on: the volts of all strips on line 0, then on line 1; nan: nothing touches
     ohms TIME_US R ...    likewise what lies between those volts and the line, instead of SOURCE_OHM
     bytes TIME_US HEX     the host sends these bytes
     memory TIME_US ADDRESS HEX   these bytes are put into the firmware's RAM, as avr-nm tells the address
   BYTES is what the firmware sends. Exit code 0 done, 1 the firmware crashed or two multiplexers met, 2 bad input. */
#include <math.h>
#include <simavr/avr_adc.h>
#include <simavr/avr_ioport.h>
#include <simavr/avr_uart.h>
#include <simavr/sim_avr.h>
#include <simavr/sim_elf.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "wiring.h"

#define PULL_OHM 100e3
#define SUPPLY_MV 5000
#define ADCSRA_AT 0x7A     /* its low bits are the divider of the converter's clock, as a power of 2 */
#define SAMPLED_CLOCKS 1.5 /* that the converter's capacitor is joined to its input */

static avr_t *avr;
static struct wiring wiring = {.pull_ohm = PULL_OHM, .supply_volt = SUPPLY_MV / 1000.0, .port_b = 0x0F};
static char *row, *row_data;
static size_t row_room;
static double row_time_s;

static void quit(const char *what, const char *detail) {
    fprintf(stderr, "emulator: %s%s\n", what, detail);
    exit(2);
}

static double now_s(void) {
    return (double)avr->cycle / avr->frequency;
}

static void on_pins(struct avr_irq_t *irq, uint32_t value, void *which) {
    (void)irq;
    wiring_advance(&wiring, now_s());
    *(uint8_t *)which = (uint8_t)value;
}

static void on_conversion(struct avr_irq_t *irq, uint32_t value, void *unused) {
    (void)irq, (void)unused;
    union {
        avr_adc_mux_t mux;
        uint32_t v;
    } asked = {.v = value};
    if (asked.mux.kind != ADC_MUX_SINGLE || asked.mux.src >= LINES) return;
    wiring_advance(&wiring, now_s());
    double clock_hz = avr->frequency / (double)(1 << (avr->data[ADCSRA_AT] & 7));
    uint32_t mv = (uint32_t)lround(wiring_sample(&wiring, (int)asked.mux.src, SAMPLED_CLOCKS / clock_hz) * 1000.0);
    avr_raise_irq(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_ADC0 + (int)asked.mux.src), mv);
}

static void on_byte(struct avr_irq_t *irq, uint32_t value, void *unused) {
    (void)irq, (void)unused;
    putchar((int)value);
}

static void connect(void) {
    const struct {
        char port;
        int irq;
        uint8_t *to;
    } pins[] = {
        {'B', IOPORT_IRQ_REG_PORT, &wiring.port_b},
        {'D', IOPORT_IRQ_REG_PORT, &wiring.port_d},
        {'D', IOPORT_IRQ_DIRECTION_ALL, &wiring.direction_d},
    };
    for (size_t i = 0; i < sizeof pins / sizeof *pins; i++)
        avr_irq_register_notify(
            avr_io_getirq(avr, (uint32_t)AVR_IOCTL_IOPORT_GETIRQ(pins[i].port), pins[i].irq), on_pins, pins[i].to);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_ADC_GETIRQ, ADC_IRQ_OUT_TRIGGER), on_conversion, NULL);
    avr_irq_register_notify(avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_OUTPUT), on_byte, NULL);
    uint32_t flags = 0; /* no lines on the console, no sleep while the firmware polls */
    avr_ioctl(avr, AVR_IOCTL_UART_SET_FLAGS('0'), &flags);
}

static void next_row(void) {
    int at = 0;
    double time_us;
    row_time_s = INFINITY;
    if (getline(&row, &row_room, stdin) < 0) return;
    if (sscanf(row, "%*s %lf %n", &time_us, &at) != 1 || at == 0) quit("no such line in a scenario: ", row);
    row_time_s = time_us / 1e6;
    row_data = row + at;
}

static void apply_row(void) {
    if (strncmp(row, "volts ", 6) == 0 || strncmp(row, "ohms ", 5) == 0) {
        wiring_advance(&wiring, now_s());
        for (int i = 0; i < wiring.lines * wiring.strips; i++) {
            char *end;
            (*row == 'v' ? wiring.volts : wiring.ohms)[i / wiring.strips][i % wiring.strips] = strtod(row_data, &end);
            if (end == row_data) quit("too few numbers: ", row);
            row_data = end;
        }
    } else if (strncmp(row, "bytes ", 6) == 0) {
        avr_irq_t *in = avr_io_getirq(avr, AVR_IOCTL_UART_GETIRQ('0'), UART_IRQ_INPUT);
        unsigned byte;
        for (; sscanf(row_data, "%2x", &byte) == 1; row_data += 2) avr_raise_irq(in, byte);
    } else if (strncmp(row, "memory ", 7) == 0) {
        char *end;
        unsigned long at = strtoul(row_data, &end, 16) & 0xFFFF; /* the linker counts RAM from 0x800000 */
        unsigned byte;
        for (end++; sscanf(end, "%2x", &byte) == 1; end += 2, at++) {
            if (at > avr->ramend) quit("no such address: ", row);
            avr->data[at] = (uint8_t)byte;
        }
    } else {
        quit("no such line in a scenario: ", row);
    }
}

/* simavr would wait for the real time to come. */
static void no_sleep(avr_t *of, avr_cycle_count_t cycles) {
    (void)of, (void)cycles;
}

static void log_errors(avr_t *of, const int level, const char *format, va_list values) {
    (void)of;
    if (level <= LOG_ERROR) vfprintf(stderr, format, values);
}

int main(int count, char **words) {
    if (count != 8) quit("usage: ", "emulator UNO.elf SECONDS STRIPS LINES WAYS SOURCE_OHM NODE_PF");
    double seconds = atof(words[2]);
    wiring.strips = atoi(words[3]), wiring.lines = atoi(words[4]), wiring.ways = atoi(words[5]);
    wiring.source_ohm = atof(words[6]), wiring.node_farad = atof(words[7]) * 1e-12;
    if (wiring.strips < 1 || wiring.strips > MOST_STRIPS || wiring.lines < 1 || wiring.lines > LINES ||
        (wiring.ways != 8 && wiring.ways != 16) || !(wiring.source_ohm > 0.0) || !(wiring.node_farad > 0.0))
        quit("impossible ", "STRIPS, LINES, WAYS, SOURCE_OHM or NODE_PF");
    for (int i = 0; i < LINES * MOST_STRIPS; i++) wiring.volts[i / MOST_STRIPS][i % MOST_STRIPS] = NAN;
    static elf_firmware_t firmware;
    avr_global_logger_set(log_errors); /* simavr's own writes to standard output */
    if (elf_read_firmware(words[1], &firmware)) quit("not a firmware: ", words[1]);
    avr = avr_make_mcu_by_name("atmega328p");
    avr_init(avr);
    avr_load_firmware(avr, &firmware);
    avr->frequency = 16000000;
    avr->vcc = avr->avcc = avr->aref = SUPPLY_MV;
    avr->sleep = no_sleep;
    connect();
    next_row();
    int state = cpu_Running;
    while (now_s() < seconds && state != cpu_Done && state != cpu_Crashed) {
        for (; now_s() >= row_time_s; next_row()) apply_row();
        state = avr_run(avr);
    }
    if (state == cpu_Done || state == cpu_Crashed) fprintf(stderr, "emulator: the firmware crashed\n");
    if (wiring.clashes) fprintf(stderr, "emulator: %ld clashes of multiplexers\n", wiring.clashes);
    return state == cpu_Done || state == cpu_Crashed || wiring.clashes;
}
