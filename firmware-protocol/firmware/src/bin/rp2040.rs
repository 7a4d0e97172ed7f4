//! Raspberry Pi RP2040 (Pico): the rig on UART 0 (GPIO 0 and 1), two hobby servos on GPIO 2 and 4, an e-stop switch that
//! opens against ground on GPIO 15.
//!
//! Registers: RP2040 Datasheet, sections 2.14 (resets), 2.15 (clocks), 2.16 (crystal), 2.18 (PLL), 2.19 (pins), 4.2
//! (UART), 4.5 (PWM), 4.6 (timer).
#![no_std]
#![no_main]

use core::panic::PanicInfo;

use cortex_m_rt::{entry, exception};
use firmware_protocol::pulse::PulseServo;
use firmware_protocol::{Config, ResetCause};
use outrigger_firmware::clock::Clock;
use outrigger_firmware::queue::Queue;
use outrigger_firmware::registers::{enable_interrupt, read, restart, sleep, start_tick, write};
use outrigger_firmware::rig::{REVISION, Rig};

#[unsafe(link_section = ".boot2")]
#[used]
static BOOT2: [u8; 256] = rp2040_boot2::BOOT_LOADER_W25Q080;

const CORE_HZ: u32 = 125_000_000;
const RESETS: usize = 0x4000_C000;
const CLOCKS: usize = 0x4000_8000;
const PINS: usize = 0x4001_4000;
const PADS: usize = 0x4001_C000;
const CRYSTAL: usize = 0x4002_4000;
const PLL: usize = 0x4002_8000;
const UART: usize = 0x4003_4000;
const UART_FLAGS: usize = UART + 0x18;
const UART_INTERRUPT_NUMBER: usize = 20;
const PWM: usize = 0x4005_0000;
const TIMER_RAW_LOW: usize = 0x4005_4028;
const WATCHDOG_TICK: usize = 0x4005_802C;
const RESET_CAUSE: usize = 0x4006_4008;
const WATCHDOG_REASON: usize = 0x4005_8008;
const SIO_IN: usize = 0xD000_0004;
/// Writing there clears bits (datasheet 2.1.2).
const CLEAR: usize = 0x3000;

/// GPIO and PWM slice of each axis; both are on channel A of their slice.
const SERVOS: [(usize, usize); 2] = [(2, 1), (4, 2)];
const SWITCH: usize = 15;
const FUNCTION_UART: u32 = 2;
const FUNCTION_PWM: u32 = 4;
const FUNCTION_SIO: u32 = 5;
/// PWM counts of half a microsecond: 20 ms.
const PWM_TOP: u32 = 39_999;

static RECEIVED: Queue<1024> = Queue::new();

#[entry]
fn main() -> ! {
    let reset = reset_cause();
    start_clocks();
    start_pins();
    start_uart();
    SERVOS.iter().for_each(|(_, slice)| start_pwm(*slice));
    start_tick(CORE_HZ / 1000); // only wakes the loop
    let mut clock = Clock::new(1, read(TIMER_RAW_LOW));
    let mut config = Config { revision: REVISION, ..Config::mirrored_pair(0x4F55_5452_5250_3230) };
    for axis in &mut config.axes {
        axis.accuracy_urad = 52_360; // a hobby servo stands within three degrees of its setpoint, unmeasured
    }
    let mut rig = Rig::new(config, [PulseServo::standard(); 2], 1, reset, 0);
    loop {
        sleep();
        let now_us = clock.now_us(read(TIMER_RAW_LOW));
        rig.controller().set_local_switch(read(SIO_IN) & 1 << SWITCH == 0);
        while let Some(byte) = RECEIVED.pop() {
            rig.hear(now_us, byte, |_, _| {}); // its axes are real
        }
        if rig.step(now_us) {
            for (axis, (_, slice)) in SERVOS.iter().enumerate() {
                let pulse = rig.controller().servo_mut(axis).and_then(|servo| servo.pulse_quarter_us());
                write(PWM + slice * 0x14 + 0x0C, pulse.map_or(0, |quarter_us| u32::from(quarter_us) / 2));
            }
        }
        rig.speak(|| read(UART_FLAGS) & 1 << 5 == 0, |byte| write(UART, byte.into()));
    }
}

fn reset_cause() -> ResetCause {
    if read(WATCHDOG_REASON) & 0b11 != 0 {
        ResetCause::Watchdog
    } else if read(RESET_CAUSE) & 1 << 8 != 0 {
        // power on and brown-out look alike here; in both cases nothing is homed
        ResetCause::PowerOn
    } else {
        ResetCause::Software // the reset pin or a debugger
    }
}

/// Crystal of 12 MHz, times 125, by 6, by 2: 125 MHz for core and peripherals, and a microsecond timer.
fn start_clocks() {
    write(CRYSTAL, 0xAA0);
    write(CRYSTAL + 0x0C, 47);
    write(CRYSTAL, 0xFA_BAA0);
    wait(|| read(CRYSTAL + 4) >> 31 == 1);
    write(CLOCKS + 0x30, 2); // reference: crystal
    wait(|| read(CLOCKS + 0x38) & 0b100 != 0);
    unreset(12);
    write(PLL, 1);
    write(PLL + 8, 125);
    write(PLL + 4 + CLEAR, 0b10_0001);
    wait(|| read(PLL) >> 31 == 1);
    write(PLL + 0x0C, 6 << 16 | 2 << 12);
    write(PLL + 4 + CLEAR, 0b1000);
    write(CLOCKS + 0x3C, 0); // system: reference, while the other input is set to the PLL
    wait(|| read(CLOCKS + 0x44) & 1 != 0);
    write(CLOCKS + 0x3C, 1);
    wait(|| read(CLOCKS + 0x44) & 0b10 != 0);
    write(CLOCKS + 0x48, 1 << 11); // peripherals: system
    write(WATCHDOG_TICK, 1 << 9 | 12);
}

fn start_pins() {
    unreset(5); // pins
    unreset(8); // pads
    let function = |pin: usize, function: u32| write(PINS + pin * 8 + 4, function);
    function(0, FUNCTION_UART);
    function(1, FUNCTION_UART);
    SERVOS.iter().for_each(|(pin, _)| function(*pin, FUNCTION_PWM));
    write(PADS + 4 + SWITCH * 4, 0b100_1010); // input, pull-up: a broken wire is an open switch
    function(SWITCH, FUNCTION_SIO);
}

/// A megabaud: 125 MHz / 16 / (7 + 52 / 64).
fn start_uart() {
    unreset(22);
    write(UART + 0x24, 7);
    write(UART + 0x28, 52);
    write(UART + 0x2C, 0b111_0000); // 8 bits, queues
    write(UART + 0x30, 0b11_0000_0001);
    write(UART + 0x38, 0b101_0000); // what came, and what came and waits
    enable_interrupt(UART_INTERRUPT_NUMBER);
}

fn start_pwm(slice: usize) {
    unreset(14);
    let base = PWM + slice * 0x14;
    write(base + 4, 62 << 4 | 8); // 125 MHz / 62.5
    write(base + 0x0C, 0); // no pulse: the shaft is free
    write(base + 0x10, PWM_TOP);
    write(base, 1);
}

fn unreset(block: u32) {
    write(RESETS + CLEAR, 1 << block);
    wait(|| read(RESETS + 8) & 1 << block != 0);
}

fn wait(mut ready: impl FnMut() -> bool) {
    while !ready() {}
}

#[exception]
fn SysTick() {}

/// Every interrupt of the chip comes here.
#[exception]
unsafe fn DefaultHandler(_number: i16) {
    // cleared before it is looked at: a byte that comes in between asks again
    write(UART + 0x44, 0b101_0000);
    while read(UART_FLAGS) & 1 << 4 == 0 {
        RECEIVED.push(read(UART) as u8);
    }
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    restart()
}
