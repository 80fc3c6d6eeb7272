/* Commands at random against the core on the desk: `fuzz COMMANDS SEED`. Each intact command must have its one answer,
   anything else none, and every frame that the device sends must be intact. Exit code 1 names the first that is not. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "device.h"
#include "frame.h"

#define LONGEST 24 /* bytes between the zeros of a command; longer ones are none */

extern uint8_t desk_sent[], desk_received[];
extern double desk_part[2][STRIPS + 1];
extern uint32_t desk_time_us, desk_sent_count, desk_received_count, desk_taken, desk_misread;

static uint64_t state;

static uint32_t any(uint32_t below) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return (uint32_t)(state >> 32) % below;
}

/* A bit at a time, as the polynomial is defined: apart from the core's own. */
static uint16_t crc_of(const uint8_t *bytes, size_t count) {
    uint16_t crc = 0xFFFF;
    for (size_t i = 0; i < count * 8; i++) {
        int bit = bytes[i / 8] >> (7 - i % 8) & 1;
        crc = (uint16_t)((uint16_t)(crc << 1) ^ ((crc >> 15 ^ bit) & 1 ? 0x1021 : 0));
    }
    return crc;
}

/* Take COBS off; returns the count of plain bytes, or 0. */
static size_t plain_of(const uint8_t *wire, size_t count, uint8_t *plain) {
    size_t n = 0;
    for (size_t at = 0; at < count;) {
        size_t next = at + wire[at];
        if (wire[at] == 0 || next > count) return 0;
        for (size_t i = at + 1; i < next; i++) plain[n++] = wire[i];
        if (wire[at] != 0xFF && next < count) plain[n++] = 0;
        at = next;
    }
    return n;
}

static size_t stuffed(const uint8_t *plain, size_t count, uint8_t *wire) {
    size_t n = 1, length_at = 0;
    for (size_t i = 0; i < count; i++) {
        if (plain[i]) wire[n++] = plain[i];
        else wire[length_at] = (uint8_t)(n - length_at), length_at = n++;
    }
    wire[length_at] = (uint8_t)(n - length_at);
    return n;
}

/* A command, right or nearly so, or anything; without the zeros about it. */
static size_t make(uint8_t *wire) {
    uint8_t plain[64];
    size_t count, n = HEADER + (any(4) ? 0 : any(2) ? 4 : any(12));
    for (size_t i = 0; i < n; i++) plain[i] = (uint8_t)any(any(2) ? 256 : 3);
    plain[0] = any(20) ? PROTOCOL : (uint8_t)any(256);
    plain[1] = any(20) ? (uint8_t)(KIND_IDENTIFY + any(5)) : (uint8_t)any(256);
    if (plain[1] == KIND_RATE && any(4)) {
        n = HEADER + 4;
        uint32_t period_us = any(any(2) ? 5000 : 70000000);
        memcpy(plain + HEADER, &period_us, 4);
    }
    uint16_t crc = crc_of(plain, n);
    plain[n++] = (uint8_t)(crc >> 8);
    plain[n++] = (uint8_t)crc;
    count = stuffed(plain, n, wire);
    switch (any(5)) {
        case 0: wire[any((uint32_t)count)] ^= (uint8_t)(1 + any(255)); break;
        case 1: count = any((uint32_t)count); break;
        case 2:
            if (any(8) == 0)
                for (count = any(200), n = 0; n < count; n++) wire[n] = (uint8_t)(1 + any(255));
            break;
        default: break;
    }
    for (size_t i = 0; i < count; i++)
        if (!wire[i]) wire[i] = 1; /* a zero would make two of it */
    return count;
}

static void fail(const char *what, const uint8_t *wire, size_t count) {
    printf("%s:", what);
    for (size_t i = 0; i < count; i++) printf(" %02x", wire[i]);
    puts("");
    exit(1);
}

/* Check all that the device sent; returns the answers among it, the kind of the last in `kind`. */
static int answers(uint8_t *kind, uint32_t *sequence) {
    int found = 0;
    static uint8_t plain[4096];
    for (size_t at = 0, end; at < desk_sent_count; at = end + 1) {
        for (end = at; end < desk_sent_count && desk_sent[end]; end++) {}
        if (end == at) continue;
        size_t n = plain_of(desk_sent + at, end - at, plain);
        if (n < HEADER + CRC_BYTES || crc_of(plain, n) || plain[0] != PROTOCOL) fail("a broken frame", desk_sent + at, end - at);
        if (plain[1] == KIND_SCAN) {
            if (n != SCAN_BYTES || plain[HEADER + 8 + TOUCHED_BYTES - 1] >> ((STRIPS - 1) % 8 + 1))
                fail("a scan of another length, or with padding", plain, n);
            continue;
        }
        found++;
        *kind = plain[1];
        if (*kind == KIND_REPLY) *kind = plain[HEADER], *sequence = read_u32(plain + HEADER + 1);
    }
    desk_sent_count = 0;
    return found;
}

int main(int count, char **words) {
    long commands = count > 1 ? atol(words[1]) : 20000, answered = 0;
    state = 88172645463325252ULL ^ (count > 2 ? strtoull(words[2], NULL, 10) << 20 : 0);
    uint8_t wire[256], plain[256], kind = 0;
    uint32_t sequence = 0;
    device_start();
    answers(&kind, &sequence);
    for (long i = 0; i < commands; i++) {
        if (any(50) == 0) desk_time_us += any(2) ? any(100000) : (uint32_t)0 - desk_time_us - any(3000);
        for (int line = 0; line < 2; line++) desk_part[line][any(STRIPS)] = any(3) ? any(1001) / 1000.0 : -1.0;
        size_t n = make(wire);
        desk_received_count = desk_taken = 0;
        if (any(2)) desk_received[desk_received_count++] = 0;
        memcpy(desk_received + desk_received_count, wire, n);
        desk_received_count += (uint32_t)n;
        desk_received[desk_received_count++] = 0;
        device_turn();
        size_t length = n <= LONGEST ? plain_of(wire, n, plain) : 0;
        int wanted = length >= HEADER + CRC_BYTES && crc_of(plain, length) == 0;
        int got = answers(&kind, &sequence);
        if (got != wanted) fail(wanted ? "a command without its answer" : "an answer to no command", wire, n);
        int replies = wanted && plain[1] != KIND_IDENTIFY && plain[1] != KIND_TEST;
        if (replies && (kind != plain[1] || sequence != read_u32(plain + 2))) fail("another command's answer", wire, n);
        answered += wanted;
        desk_time_us += any(3000);
    }
    if (desk_misread) fail("a reading while a line was pulled", wire, 0);
    printf("%ld commands, %ld of them answered\n", commands, answered);
    return 0;
}
