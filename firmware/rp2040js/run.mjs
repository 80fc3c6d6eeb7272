/* Runs the firmware for the RP2040 in rp2040js, with the sensor's voltages on its A/D inputs.

   Usage: node run.mjs FIRMWARE.bin SECONDS STRIPS LINES WAYS SOURCE_OHM NODE_PF < SCENARIO > BYTES
   SCENARIO has lines in the order of their time:
     volts TIME_US V ...          from then on: the volts of all strips on line 0, then on line 1; nan: nothing touches
     bytes TIME_US HEX            the host sends these bytes
     widths TIME_US CODE=LSB ...  codes of the converter that are wider than the others
     hang TIME_US                 the program stops
   BYTES is what the firmware sends, at the line's speed. Exit code 0 done, 1 two multiplexers met, a byte was lost or the
   firmware left its memory, 2 bad input. */
import { readFileSync, writeSync } from "node:fs";
import { GPIOPinState, RP2040 } from "rp2040js";

const FLASH = 0x10000000, VREF_VOLT = 3.3, PULL_OHM = 100e3, PAD_PULL_OHM = 60e3;
const ADDRESS_PIN = 2, ENABLE_PIN = 6, PULL_PIN = 10, LINE_PIN = 26, BANKS = 4;
const CODES = 4096, FIFO_BYTES = 32, CONVERSION_NS = 2000, DREQ_UART0_TX = 20, WATCHDOG = 0x40058;

function quit(what) {
  process.stderr.write(`run.mjs: ${what}\n`);
  process.exit(2);
}

const words = process.argv.slice(2);
if (words.length !== 7) quit("usage: run.mjs FIRMWARE.bin SECONDS STRIPS LINES WAYS SOURCE_OHM NODE_PF");
const [seconds, strips, lines, ways, sourceOhm, nodePf] = words.slice(1).map(Number);
const scenario = readFileSync(0, "utf8").split("\n").filter(Boolean).map((line) => line.split(" "));
const firmware = readFileSync(words[0]);

let chip; // a new one after each reset
let originNs = 0; // when it was switched on
const sent = [];
const problems = new Set();
const volts = Array.from({ length: lines }, () => new Array(strips).fill(NaN));
let edges = Float64Array.from({ length: CODES + 1 }, (_, code) => code / CODES); // of the codes, over Vref

/* The lines: each a capacitor that the strip, the pull and the pad charge. */
const node = { volt: new Array(lines).fill(0), pins: 0, driven: 0, atNs: 0 };

function selectedStrip() {
  const open = [];
  for (let bank = 0; bank < BANKS; bank++) {
    const pin = ENABLE_PIN + bank;
    if (node.driven >>> pin & 1 && !(node.pins >>> pin & 1)) open.push(bank);
  }
  if (open.length > 1) problems.add("two multiplexers met");
  const strip = open.length ? open[0] * ways + (node.pins >>> ADDRESS_PIN & (ways - 1)) : -1;
  return strip < strips ? strip : -1;
}

function advance() {
  const nowNs = originNs + chip.clock.nanos;
  const passed = (nowNs - node.atNs) * 1e-9;
  node.atNs = nowNs;
  if (passed <= 0) return;
  const strip = selectedStrip();
  for (let line = 0; line < lines; line++) {
    let siemens = 0, amps = 0;
    const join = (volt, ohm) => { siemens += 1 / ohm; amps += volt / ohm; };
    if (strip >= 0 && !Number.isNaN(volts[line][strip])) join(volts[line][strip], sourceOhm);
    const pull = PULL_PIN + line;
    if (node.driven >>> pull & 1) join(node.pins >>> pull & 1 ? VREF_VOLT : 0, PULL_OHM);
    const pad = chip.gpio[LINE_PIN + line];
    if (pad.pullupEnabled) join(VREF_VOLT, PAD_PULL_OHM);
    if (pad.pulldownEnabled) join(0, PAD_PULL_OHM);
    if (siemens === 0) continue; // an open line keeps its charge
    const target = amps / siemens;
    node.volt[line] = target + (node.volt[line] - target) * Math.exp(-passed * siemens / (nodePf * 1e-12));
  }
}

/* The code whose part of the range a voltage is in. */
function converted(volt) {
  const part = volt / VREF_VOLT;
  let low = 0, high = CODES - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (edges[middle] <= part) low = middle;
    else high = middle - 1;
  }
  return low;
}

function setWidths(pairs) {
  const wide = new Map(pairs.map((pair) => pair.split("=").map(Number)));
  const others = (CODES - [...wide.values()].reduce((a, b) => a + b, 0)) / (CODES - wide.size);
  let sum = 0;
  for (let code = 0; code < CODES; code++) {
    edges[code] = sum / CODES;
    sum += wide.get(code) ?? others;
  }
}

function connectConverter() {
  chip.adc.onADCRead = (channel) => {
    advance();
    const code = channel < lines ? converted(node.volt[channel]) : 0;
    chip.clock.createAlarm(() => chip.adc.completeADCRead(code, false)).schedule(CONVERSION_NS);
  };
}

function connectPins() {
  for (let pin = 0; pin < LINE_PIN; pin++) {
    chip.gpio[pin].addListener((state) => {
      advance();
      const bit = 1 << pin, drives = state === GPIOPinState.High || state === GPIOPinState.Low;
      node.driven = drives ? node.driven | bit : node.driven & ~bit;
      node.pins = state === GPIOPinState.High ? node.pins | bit : node.pins & ~bit;
    });
  }
}

/* rp2040js sends at once; here bytes wait in a FIFO and leave at the line's speed. */
function connectUart() {
  const uart = chip.uart[0], fifo = [], byteNs = () => 1e10 / uart.baudRate;
  const shift = chip.clock.createAlarm(() => {
    sent.push(fifo.shift());
    if (fifo.length) shift.schedule(byteNs());
    chip.dma.setDREQ(DREQ_UART0_TX);
  });
  uart.onByte = (byte) => {
    if (fifo.length >= FIFO_BYTES) problems.add("a byte that was to be sent was lost");
    if (fifo.push(byte) === 1) shift.schedule(byteNs());
    if (fifo.length >= FIFO_BYTES) chip.dma.clearDREQ(DREQ_UART0_TX);
  };
}

function receive(hex) {
  const bytes = Buffer.from(hex, "hex"), uart = chip.uart[0];
  let next = 0;
  const alarm = chip.clock.createAlarm(() => {
    if (uart.rxFIFO.full) problems.add("a byte that was received was lost");
    uart.feedByte(bytes[next++]);
    if (next < bytes.length) alarm.schedule(1e10 / uart.baudRate);
  });
  alarm.schedule(0);
}

/* What rp2040js has no register for, and does not need. */
const ABSENT = /(SSI.*write to 0x10|UART0.*write to 0x(34|48)):/;

function complain(who, what) {
  const problem = `${who}: ${what}`;
  if (!ABSENT.test(problem)) problems.add(problem);
}

let hung = false;

function switchOn() {
  originNs += chip ? chip.clock.nanos : 0;
  chip = new RP2040();
  chip.logger = { debug() {}, info() {}, warn: complain, error: complain };
  chip.flash.set(firmware);
  chip.core.PC = FLASH;
  Object.assign(node, { pins: 0, driven: 0, atNs: originNs });
  connectConverter();
  connectPins();
  connectUart();
  hung = false;
  let again = false;
  const watchdog = chip.peripherals[WATCHDOG];
  watchdog.onWatchdogTrigger = () => {
    again = true;
    watchdog.alarm.enable = false; // or it would trigger again at once, for ever
  };
  return () => again;
}

function apply([what, , ...rest]) {
  if (what === "volts") {
    if (rest.length !== lines * strips) quit("a line of volts has not as many as there are strips and lines");
    advance();
    rest.forEach((word, i) => { volts[Math.floor(i / strips)][i % strips] = Number(word); });
  } else if (what === "bytes") receive(rest[0]);
  else if (what === "widths") setWidths(rest);
  else if (what === "hang") hung = true;
  else quit(`no such line in a scenario: ${what}`);
}

let mustReset = switchOn();
let row = 0;
while (originNs + chip.clock.nanos < seconds * 1e9) {
  while (row < scenario.length && (originNs + chip.clock.nanos) >= Number(scenario[row][1]) * 1e3) apply(scenario[row++]);
  if (hung) chip.clock.tick(1e5);
  else if (chip.core.waiting) chip.clock.tick(Math.max(chip.clock.nanosToNextAlarm, 1));
  else chip.clock.tick(chip.core.executeInstruction() * 1e9 / chip.clkSys);
  if (mustReset()) mustReset = switchOn();
}
writeSync(1, Buffer.from(sent));
for (const problem of problems) process.stderr.write(`run.mjs: ${problem}\n`);
process.exit(problems.size ? 1 : 0);
