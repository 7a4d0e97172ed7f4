//! Memory-mapped registers, the restart and the sleep of a Cortex-M core.

/// Reads a register.
pub fn read(address: usize) -> u32 {
    // SAFETY: every caller names a register of its board's reference manual, and reading one breaks no Rust object.
    unsafe { (address as *const u32).read_volatile() }
}

/// Writes a register.
pub fn write(address: usize, value: u32) {
    // SAFETY: as above; registers lie outside the memory that Rust objects use.
    unsafe { (address as *mut u32).write_volatile(value) }
}

/// Lets an interrupt through (ARMv7-M and ARMv6-M Architecture Reference Manual: NVIC_ISER).
pub fn enable_interrupt(number: usize) {
    write(0xE000_E100 + number / 32 * 4, 1 << (number % 32));
}

/// Starts the core's own timer (SYST_RVR, SYST_CVR, SYST_CSR): it interrupts every `ticks` of the core clock.
pub fn start_tick(ticks: u32) {
    write(0xE000_E014, ticks - 1);
    write(0xE000_E018, 0);
    write(0xE000_E010, 0b111);
}

/// Sleeps until an interrupt.
pub fn sleep() {
    // SAFETY: the instruction only waits.
    #[cfg(target_arch = "arm")]
    unsafe {
        core::arch::asm!("wfi", options(nomem, nostack, preserves_flags));
    }
}

/// Restarts (AIRCR.SYSRESETREQ).
pub fn restart() -> ! {
    write(0xE000_ED0C, 0x05FA_0004);
    loop {
        sleep();
    }
}
