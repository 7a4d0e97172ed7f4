//! ARM MPS2 with the AN386 image (Cortex-M4F): the rig on UART 0, two axes simulated on the chip.
//!
//! Registers: ARM CMSDK Technical Reference Manual (DDI 0479), 4.2 (timer) and 4.3 (UART); ARM AN386 for their addresses.
#![no_std]
#![no_main]

use core::panic::PanicInfo;
use core::sync::atomic::{AtomicU32, Ordering};

use cortex_m_rt::{entry, exception};
use firmware_protocol::config::Home;
use firmware_protocol::simulated::SimulatedAxis;
use firmware_protocol::{Config, Controller, ResetCause};
use outrigger_firmware::clock::Clock;
use outrigger_firmware::queue::Queue;
use outrigger_firmware::registers::{enable_interrupt, read, restart, sleep, start_tick, write};
use outrigger_firmware::rig::{REVISION, Rig};

/// Where the switches of a rig that has them close: -30 degrees.
const SWITCH_URAD: i32 = -523_599;
const CORE_HZ: u32 = 25_000_000;
const TIMER: usize = 0x4000_0000;
const UART: usize = 0x4000_4000;
const UART_STATE: usize = UART + 4;
const UART_CONTROL: usize = UART + 8;
const UART_INTERRUPT: usize = UART + 12;
const UART_DIVIDER: usize = UART + 16;
const UART_INTERRUPT_NUMBER: usize = 0;

static RECEIVED: Queue<1024> = Queue::new();

/// Memory that a sagging supply leaves as it is and switching off does not: a mark, and where the shafts stand.
struct Retained {
    mark: AtomicU32,
    shafts_urad: [AtomicU32; 2],
}

#[unsafe(link_section = ".uninit.retained")]
static RETAINED: Retained =
    Retained { mark: AtomicU32::new(0), shafts_urad: [const { AtomicU32::new(0) }; 2] };
const MARK: u32 = 0x4F55_5452;
const PANICKED: u32 = 0x5041_4E49;

#[entry]
fn main() -> ! {
    start_uart();
    write(TIMER + 8, u32::MAX); // counts down and wraps
    write(TIMER + 4, u32::MAX);
    write(TIMER, 1);
    start_tick(CORE_HZ / 1000); // only wakes the loop
    let reset = match RETAINED.mark.swap(MARK, Ordering::Relaxed) {
        MARK => ResetCause::BrownOut,
        PANICKED => ResetCause::Software,
        _ => ResetCause::PowerOn,
    };
    let start_urad = match reset {
        ResetCause::PowerOn => [30_000, -20_000],
        _ => [0, 1].map(|axis: usize| RETAINED.shafts_urad[axis].load(Ordering::Relaxed) as i32),
    };
    let mut clock = Clock::new(CORE_HZ / 1_000_000, counter());
    let mut axes = [0, 1].map(|axis: usize| SimulatedAxis::new(axis as u64 + 1, start_urad[axis], 0));
    let mut config = Config { revision: REVISION, ..Config::mirrored_pair(0x4F55_5452_4D50_5332) };
    if cfg!(feature = "home-switch") {
        axes = axes.map(|axis| axis.counting_from_start(SWITCH_URAD));
        config.axes.iter_mut().for_each(|axis| axis.home = Home::switch_below(SWITCH_URAD));
    }
    let mut rig = Rig::new(config, axes, 1, reset, 0);
    loop {
        sleep();
        let now_us = clock.now_us(counter());
        while let Some(byte) = RECEIVED.pop() {
            rig.hear(now_us, byte, |controller, inject| break_axis(controller, inject));
        }
        if rig.step(now_us) {
            for (axis, shaft) in RETAINED.shafts_urad.iter().enumerate() {
                let at = rig.controller().servo_mut(axis).map_or(0, |axis| axis.true_position_urad());
                shaft.store(at as u32, Ordering::Relaxed);
            }
        }
        rig.speak(|| read(UART_STATE) & 1 == 0, |byte| write(UART, byte.into()));
    }
}

fn break_axis(controller: &mut Controller<SimulatedAxis, 2>, inject: firmware_protocol::inject::Inject) {
    let Some(axis) = controller.servo_mut(inject.axis.into()) else { return };
    match inject.fault {
        Some(fault) => axis.inject(fault),
        None => axis.repair(SimulatedAxis::new(0, 0, 0).backlash_urad),
    }
}

/// The timer counts down; the clock wants one that counts up.
fn counter() -> u32 {
    !read(TIMER + 4)
}

fn start_uart() {
    write(UART_DIVIDER, CORE_HZ / 1_000_000);
    write(UART_CONTROL, 0b1011); // send, receive, interrupt on what is received
    enable_interrupt(UART_INTERRUPT_NUMBER);
}

#[exception]
fn SysTick() {}

/// Every interrupt of the board comes here.
#[exception]
unsafe fn DefaultHandler(_number: i16) {
    // cleared before it is looked at: a byte that comes in between asks again
    write(UART_INTERRUPT, 0b10);
    while read(UART_STATE) & 0b10 != 0 {
        RECEIVED.push(read(UART) as u8);
    }
}

#[panic_handler]
fn panic(_: &PanicInfo) -> ! {
    RETAINED.mark.store(PANICKED, Ordering::Relaxed);
    restart()
}
