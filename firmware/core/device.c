#include "device.h"

#include "board.h"
#include "scanner.h"

#define LONGEST_COMMAND 24 /* bytes between two zeros */
#define LONGEST_PERIOD_US 60000000UL

enum status { STATUS_DONE, STATUS_UNKNOWN, STATUS_BAD_BODY, STATUS_OTHER_VERSION };

static struct frame frame;
static uint8_t wire[WIRE_BYTES];
static uint8_t command[LONGEST_COMMAND];
static uint8_t command_count; /* LONGEST_COMMAND + 1: too long, wait for the next zero */
static uint32_t sequence; /* of the scan that comes next */
static uint32_t period_us, next_us, cycle_us, late;
static bool streaming;

/* The scan that comes next is read while this frame is sent. */
static void send(void) {
    while (board_sending()) {}
    board_send(wire, frame_seal(&frame, wire));
}

static void hello(void) {
    frame_begin(&frame, KIND_HELLO, sequence, board_now_us());
    frame_u16(&frame, STRIPS);
    frame_u8(&frame, SIGNATURES);
    frame_u8(&frame, board_adc_bits);
    frame_u8(&frame, VERSION_MAJOR);
    frame_u8(&frame, VERSION_MINOR);
    frame_u8(&frame, VERSION_PATCH);
    frame_u8(&frame, streaming);
    frame_u16(&frame, board_supply_mv());
    frame_u32(&frame, BAUD);
    frame_u32(&frame, period_us);
    frame_u32(&frame, cycle_us);
    frame_u32(&frame, late);
    frame_text(&frame, CONSTRUCTION, 16);
    frame_text(&frame, UNIT_NAME, 16);
    send();
}

static void reply(enum status status, uint32_t value) {
    frame_begin(&frame, KIND_REPLY, sequence, board_now_us());
    frame_u8(&frame, command[1]);
    frame_u32(&frame, read_u32(command + 2));
    frame_u8(&frame, (uint8_t)status);
    frame_u32(&frame, value);
    send();
}

static void tested(void) {
    frame_begin(&frame, KIND_TESTED, sequence, board_now_us());
    frame_u16(&frame, STRIPS);
    frame_u16(&frame, board_supply_mv());
    frame_u32(&frame, late);
    test_strips(&frame);
    send();
}

static void run(bool on) {
    streaming = on;
    late = 0;
    next_us = board_now_us();
    reply(STATUS_DONE, period_us);
}

static void obey(uint8_t body) {
    uint8_t kind = command[1];
    if (command[0] != PROTOCOL) {
        reply(STATUS_OTHER_VERSION, PROTOCOL);
    } else if (kind < KIND_IDENTIFY || kind > KIND_TEST) {
        reply(STATUS_UNKNOWN, 0);
    } else if (body != (kind == KIND_RATE ? 4 : 0)) {
        reply(STATUS_BAD_BODY, body);
    } else if (kind == KIND_IDENTIFY) {
        hello();
    } else if (kind == KIND_TEST) {
        tested();
    } else if (kind == KIND_RATE) {
        uint32_t wanted = read_u32(command + HEADER);
        if (wanted > LONGEST_PERIOD_US) {
            reply(STATUS_BAD_BODY, LONGEST_PERIOD_US);
            return;
        }
        period_us = wanted;
        next_us = board_now_us();
        reply(STATUS_DONE, period_us);
    } else {
        run(kind == KIND_START);
    }
}

static void listen(void) {
    int16_t byte;
    while ((byte = board_receive()) >= 0) {
        if (byte) {
            if (command_count < LONGEST_COMMAND) command[command_count] = (uint8_t)byte;
            if (command_count <= LONGEST_COMMAND) command_count++;
            continue;
        }
        uint8_t count = command_count > LONGEST_COMMAND ? 0 : (uint8_t)frame_unstuff(command, command_count);
        command_count = 0;
        if (count >= HEADER + CRC_BYTES && frame_crc(command, count) == 0) obey(count - HEADER - CRC_BYTES);
    }
}

static void scan(void) {
    uint32_t now_us = board_now_us();
    if (period_us && (int32_t)(now_us - next_us) < 0) return;
    scan_strips(&frame, sequence++);
    cycle_us = board_now_us() - now_us;
    send();
    next_us += period_us;
    now_us = board_now_us();
    if (period_us && (int32_t)(now_us - next_us) >= (int32_t)period_us) {
        late++;
        next_us = now_us;
    }
}

void device_start(void) {
    board_start();
    period_us = PERIOD_US;
    uint32_t begun_us = board_now_us();
    scan_strips(&frame, 0); /* to learn how long a cycle takes */
    cycle_us = board_now_us() - begun_us;
    hello();
}

void device_turn(void) {
    board_alive();
    listen();
    if (streaming) scan();
}
