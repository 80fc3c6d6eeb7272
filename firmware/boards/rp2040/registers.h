/* What of the RP2040's registers the firmware uses (RP2040 datasheet, chapters 2 and 4). */
#ifndef TACSTRIP_RP2040_REGISTERS_H
#define TACSTRIP_RP2040_REGISTERS_H

#include <stdint.h>

#define REGISTER(address) (*(volatile uint32_t *)(uintptr_t)(address))
#define SET(address) REGISTER((address) + 0x2000) /* aliases that set and clear bits at once */
#define CLEAR(address) REGISTER((address) + 0x3000)

#define XIP_SSI 0x18000000
#define SSI_CTRLR0 (XIP_SSI + 0x00)
#define SSI_CTRLR1 (XIP_SSI + 0x04)
#define SSI_SSIENR (XIP_SSI + 0x08)
#define SSI_SER (XIP_SSI + 0x10)
#define SSI_BAUDR (XIP_SSI + 0x14)
#define SSI_SPI_CTRLR0 (XIP_SSI + 0xF4)

#define CLK_REF_CTRL 0x40008030
#define CLK_REF_SELECTED 0x40008038
#define CLK_SYS_CTRL 0x4000803C
#define CLK_SYS_SELECTED 0x40008044
#define CLK_PERI_CTRL 0x40008048
#define CLK_ADC_CTRL 0x40008060
#define CLOCK_ENABLED (1U << 11)

#define RESETS 0x4000C000
#define RESETS_DONE 0x4000C008
#define RESET_ADC (1U << 0)
#define RESET_DMA (1U << 2)
#define RESET_IO (1U << 5)
#define RESET_PADS (1U << 8)
#define RESET_PLL_USB (1U << 13)
#define RESET_TIMER (1U << 21)
#define RESET_UART0 (1U << 22)

#define PSM_WDSEL 0x40010008
#define GPIO_CTRL(pin) (0x40014004 + 8 * (pin))
#define FUNCTION_UART 2
#define FUNCTION_SIO 5
#define FUNCTION_NONE 31
#define PAD(pin) (0x4001C004 + 4 * (pin))
#define PAD_INPUT (1U << 6)
#define PAD_4_MA (1U << 4)
#define PAD_PULL_UP (1U << 3)
#define PAD_SCHMITT (1U << 1)
#define PAD_OUTPUT_OFF (1U << 7)

#define XOSC_CTRL 0x40024000
#define XOSC_STATUS 0x40024004
#define XOSC_STARTUP 0x4002400C
#define PLL_USB 0x4002C000
#define PLL_CS (PLL_USB + 0x0)
#define PLL_PWR (PLL_USB + 0x4)
#define PLL_FBDIV (PLL_USB + 0x8)
#define PLL_PRIM (PLL_USB + 0xC)

#define UART_DR 0x40034000
#define UART_FR 0x40034018
#define UART_IBRD 0x40034024
#define UART_FBRD 0x40034028
#define UART_LCR_H 0x4003402C
#define UART_CR 0x40034030
#define UART_IFLS 0x40034034
#define UART_IMSC 0x40034038
#define UART_DMACR 0x40034048
#define UART_NOTHING_RECEIVED (1U << 4)

#define ADC_CS 0x4004C000
#define ADC_RESULT 0x4004C004
#define TIMER_NOW 0x40054028
#define WATCHDOG_CTRL 0x40058000
#define WATCHDOG_LOAD 0x40058004
#define WATCHDOG_TICK 0x4005802C

#define DMA0_READ 0x50000000
#define DMA0_WRITE 0x50000004
#define DMA0_COUNT 0x50000008
#define DMA0_CTRL_TRIG 0x5000000C
#define DMA_BUSY (1U << 24)

#define SIO_OUT_SET 0xD0000014
#define SIO_OUT_CLEAR 0xD0000018
#define SIO_DIRECTION_SET 0xD0000024
#define SIO_DIRECTION_CLEAR 0xD0000028

#define NVIC_ENABLE 0xE000E100
#define VECTOR_TABLE 0xE000ED08
#define UART0_INTERRUPT 20

#endif
