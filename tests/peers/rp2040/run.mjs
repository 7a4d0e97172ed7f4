// The RP2040 image in an emulator that knows nothing of this project: what it says on its UART, and the pulses on its
// servo pins. The messages are made here from their description, without any of the project's code.
//
//     node tests/peers/rp2040/run.mjs IMAGE.elf
//
// Ends with `N passed, N failed`; exit status 1 when a check failed.
import { readFileSync } from 'node:fs';
import { Simulator } from 'rp2040js';

const FLASH = 0x10000000;
const VECTORS = FLASH + 0x100; // what the second boot stage jumps to
const SERVOS = [2, 4];
const SWITCH = 15;
const SESSION = 77;

function crc32c(bytes) {
  let crc = 0xffffffff;
  for (const byte of bytes) {
    crc ^= byte;
    for (let bit = 0; bit < 8; bit++) crc = crc & 1 ? (crc >>> 1) ^ 0x82f63b78 : crc >>> 1;
  }
  return (crc ^ 0xffffffff) >>> 0;
}

function stuff(bytes) {
  const out = [0];
  let codeAt = 0;
  for (const byte of bytes) {
    if (byte === 0) {
      out[codeAt] = out.length - codeAt;
      codeAt = out.length;
      out.push(0);
    } else out.push(byte);
  }
  out[codeAt] = out.length - codeAt; // frames are shorter than a block
  return [...out, 0];
}

function unstuff(bytes) {
  const out = [];
  for (let at = 0; at < bytes.length; ) {
    const end = at + bytes[at];
    out.push(...bytes.slice(at + 1, end));
    at = end;
    if (at < bytes.length) out.push(0);
  }
  return Uint8Array.from(out);
}

function frame(message, payload) {
  const identifier = ((message === 0x16 ? 0 : 2) << 26) | (0b10110 << 21) | (1 << 16) | (message << 8) | 1;
  const plain = new Uint8Array(6 + payload.length + 4);
  const view = new DataView(plain.buffer);
  plain[0] = 1;
  view.setUint32(2, identifier, true);
  plain.set(payload, 6);
  view.setUint32(6 + payload.length, crc32c(plain.subarray(0, 6 + payload.length)), true);
  return stuff(plain);
}

function loadImage(flash, path) {
  const file = readFileSync(path);
  const view = new DataView(file.buffer, file.byteOffset, file.byteLength);
  const [table, size, count] = [view.getUint32(28, true), view.getUint16(42, true), view.getUint16(44, true)];
  for (let at = table; at < table + size * count; at += size) {
    const [kind, offset, , physical, bytes] = [0, 4, 8, 12, 16].map((field) => view.getUint32(at + field, true));
    if (kind === 1 && bytes > 0) flash.set(file.subarray(offset, offset + bytes), physical - FLASH);
  }
}

class Board {
  constructor(path) {
    const simulator = new Simulator();
    this.clock = simulator.clock;
    this.mcu = simulator.rp2040;
    this.mcu.logger = { debug() {}, info() {}, warn() {}, error: (...said) => console.error(...said) };
    loadImage(this.mcu.flash, path);
    const word = (address) => this.mcu.flashView.getUint32(address - FLASH, true);
    this.mcu.core.VTOR = VECTORS;
    this.mcu.core.SP = word(VECTORS);
    this.mcu.core.PC = word(VECTORS + 4) & ~1;
    this.mcu.gpio[SWITCH].setInputValue(false); // closed
    this.heard = [];
    this.pulses = { 2: [], 4: [] };
    let line = [];
    this.mcu.uart[0].onByte = (byte) => {
      if (byte !== 0) return void line.push(byte);
      const plain = unstuff(line);
      line = [];
      if (plain.length < 10) return;
      const view = new DataView(plain.buffer);
      const body = plain.subarray(0, plain.length - 4);
      if (crc32c(body) !== view.getUint32(plain.length - 4, true)) throw new Error('a damaged frame');
      const message = (view.getUint32(2, true) >> 8) & 0xff;
      this.heard.push({ message, data: new DataView(plain.buffer, 6, plain.length - 10), at: this.clock.nanos });
    };
    for (const pin of SERVOS) {
      let rose = null;
      this.mcu.gpio[pin].addListener((state) => {
        const now = this.clock.nanos;
        if (state === 1) rose = now;
        else if (rose !== null) {
          this.pulses[pin].push({ rose, us: (now - rose) / 1000 });
          rose = null;
        }
      });
    }
    this.toBoard = [];
    this.nextByte = 0;
    this.fed = 0;
    this.feeds = false;
    this.id = 0;
  }

  run(ms) {
    const end = this.clock.nanos + ms * 1e6;
    while (this.clock.nanos < end) {
      if (this.feeds && this.clock.nanos >= this.fed) {
        this.fed = this.clock.nanos + 80e6;
        this.say(0x03, [SESSION, 0, 0, 0, 0, 0, 0, 0]);
      }
      if (this.toBoard.length > 0 && this.clock.nanos >= this.nextByte) {
        this.mcu.uart[0].feedByte(this.toBoard.shift());
        this.nextByte = this.clock.nanos + 10_000; // a megabaud
      }
      // the emulator's core timer does not end the core's waiting by itself
      if (this.mcu.core.waiting && !this.mcu.core.interruptsUpdated) this.clock.tick(Math.min(this.clock.nanosToNextAlarm, 10_000) || 8);
      else this.clock.tick(this.mcu.core.executeInstruction() * 8);
    }
  }

  say(message, payload) {
    this.toBoard.push(...frame(message, payload));
  }

  last(message) {
    return this.heard.filter((heard) => heard.message === message).at(-1)?.data;
  }

  // The code of the acknowledgement: 0 is accepted.
  order(message, payload) {
    this.id += 1;
    this.say(message, [this.id & 255, this.id >> 8, ...payload]);
    this.run(5);
    const ack = this.last(0x20);
    if (ack?.getUint16(0, true) !== this.id) throw new Error(`order ${message} is not acknowledged`);
    return ack.getUint8(3);
  }

  pulse(pin) {
    const [before, last] = this.pulses[pin].slice(-2);
    return last && { us: last.us, periodUs: (last.rose - before.rose) / 1000 };
  }
}

const urad24 = (value) => [value & 255, (value >> 8) & 255, (value >> 16) & 255];
const pair = (a, b) => [...urad24(a), ...urad24(b)];
let [passed, failed] = [0, 0];

function expect(what, holds, found) {
  if (holds) passed += 1;
  else {
    failed += 1;
    console.log(`FAILED ${what}: ${JSON.stringify(found)}`);
  }
}

function expectPulses(what, board, wanted) {
  SERVOS.forEach((pin, axis) => {
    const found = board.pulse(pin);
    const right = found && Math.abs(found.us - wanted[axis]) <= 1 && Math.abs(found.periodUs - 20000) <= 1;
    expect(`${what}, GPIO ${pin}: ${wanted[axis]} us every 20 ms`, right, found);
  });
}

const board = new Board(process.argv[2]);
board.run(300);
const start = board.last(0x02);
expect('tells what it is: version 1, two axes, nothing measured, power on', start?.getUint32(0, true) === 0x00000201, start?.getUint32(0, true));
expect('no pulse before it is armed', SERVOS.every((pin) => board.pulses[pin].length === 0), board.pulses);
expect('a move without a session is refused', board.order(0x12, pair(0, 0)) === 8);
board.say(0x01, [1, 1, 0xe8, 3, SESSION, 0, 0, 0]);
board.feeds = true;
board.run(20);
expect('opens the session', board.last(0x02).getUint32(4, true) === SESSION);
expect('a move before arming is refused', board.order(0x12, pair(0, 0)) === 7);
expect('arms', board.order(0x19, [1]) === 0);
expect('homes', board.order(0x15, [255]) === 0);
board.run(500);
expectPulses('armed', board, [1500, 1500]);
expect('a pair beyond the pulses is refused by the servo', board.order(0x12, pair(900000, 0)) === 4);
expect('a pair in the keep-out region is refused', board.order(0x12, pair(-750000, 750000)) !== 0);
expect('moves by 30 degrees', board.order(0x12, pair(523599, -523599)) === 0);
const [low, high] = [board.pulses[2].length, 2.2];
board.run(high * 1000);
const widths = board.pulses[2].slice(low).map((pulse) => pulse.us);
expect('the pulse grows step by step', widths.every((us, at) => at === 0 || (us - widths[at - 1] >= -1 && us - widths[at - 1] < 15)), widths);
expectPulses('after 30 degrees', board, [1500 + 1000 / 3, 1500 - 1000 / 3]);
const position = board.last(0x30);
expect('says that the position is commanded, not measured', position.getUint8(1) === 1, position.getUint8(1));
expect('moves on', board.order(0x12, pair(-523599, 0)) === 0);
board.run(400);
board.mcu.gpio[SWITCH].setInputValue(true);
board.run(300);
const [state, faults] = [board.last(0x04).getUint8(0), board.last(0x04).getUint16(2, true)];
expect('the switch is an emergency stop', state === 6 && faults === 1 << 11, { state, faults });
const held = board.pulse(2).us;
board.run(500);
expect('it holds where it stopped', Math.abs(board.pulse(2).us - held) < 1 && held > 1200, held);
expect('an open switch keeps it stopped', board.order(0x17, [11, 0, ...Buffer.from('FREE')]) === 11);
board.mcu.gpio[SWITCH].setInputValue(false);
board.run(5);
expect('a closed switch and the key free it', board.order(0x17, [11, 0, ...Buffer.from('FREE')]) === 0);
expect('arms again', board.order(0x19, [1]) === 0);
board.feeds = false;
board.run(1500);
expect('a silent host is a fault', board.last(0x04).getUint16(2, true) === 1);
const rate = board.heard.filter((heard) => heard.message === 0x30 && heard.at > board.clock.nanos - 1e9).length;
expect('fifty positions of each axis in a second', Math.abs(rate - 100) <= 2, rate);
console.log(`${passed} passed, ${failed} failed`);
process.exit(failed > 0 ? 1 : 0);
