/* How the RP2040 comes from its boot ROM to main: the second stage, the vectors, the memory. */
#include "registers.h"

#define READ_DATA 0x03U /* the one command that every flash has; 24 bits of address, no dummy cycles */
#define FLASH 0x10000000U
#define BOOT2_BYTES 256U

extern uint32_t ram_end[], data_load[], data_start[], data_end[], bss_start[], bss_end[];
int main(void);
void on_received(void);

/* The ROM copies the first 256 bytes of the flash into RAM, checks the CRC in their last four (boards/rp2040/image.py writes it)
   and runs them. They map the flash into memory and start what stands behind them. Position independent, for they do not
   run where they are linked. */
__attribute__((section(".boot2"), noreturn, used)) void boot2(void);
void boot2(void) {
    REGISTER(SSI_SSIENR) = 0;
    REGISTER(SSI_BAUDR) = 2; /* 24 MHz at 48, of the 33 and more that flashes bear */
    REGISTER(SSI_CTRLR0) = 3U << 8 | 31U << 16; /* send the address, then read, 32 bits a word */
    REGISTER(SSI_CTRLR1) = 0;
    REGISTER(SSI_SPI_CTRLR0) = READ_DATA << 24 | 2U << 8 | 6U << 2; /* 8 bits of command, 24 of address, all on one wire */
    REGISTER(SSI_SER) = 1;
    REGISTER(SSI_SSIENR) = 1;
    REGISTER(VECTOR_TABLE) = FLASH + BOOT2_BYTES;
    uint32_t stack = REGISTER(FLASH + BOOT2_BYTES), entry = REGISTER(FLASH + BOOT2_BYTES + 4);
    __asm volatile("msr msp, %0\n bx %1" : : "r"(stack), "r"(entry));
    __builtin_unreachable();
}

__attribute__((noreturn)) static void reset(void) {
    for (uint32_t *to = data_start, *from = data_load; to != data_end;) *to++ = *from++;
    for (uint32_t *to = bss_start; to != bss_end;) *to++ = 0;
    main();
    for (;;) {}
}

/* A fault: wait for the watchdog. */
static void trap(void) {
    for (;;) {}
}

union vector {
    void (*run)(void);
    uint32_t *stack;
};

__attribute__((section(".vectors"), used)) static const union vector vectors[16 + 32] = {
    [0] = {.stack = ram_end},
    [1] = {.run = reset},
    [2 ... 16 + UART0_INTERRUPT - 1] = {.run = trap},
    [16 + UART0_INTERRUPT] = {.run = on_received},
    [16 + UART0_INTERRUPT + 1 ... 16 + 31] = {.run = trap},
};
