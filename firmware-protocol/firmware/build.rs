//! Chooses the memory map of the board and notes the revision that is built.

use std::path::PathBuf;
use std::process::Command;

const MPS2: &str = "MEMORY {
    FLASH : ORIGIN = 0x00000000, LENGTH = 4M
    RAM : ORIGIN = 0x20000000, LENGTH = 4M
}
";

const RP2040: &str = "MEMORY {
    BOOT2 : ORIGIN = 0x10000000, LENGTH = 0x100
    FLASH : ORIGIN = 0x10000100, LENGTH = 2048K - 0x100
    RAM : ORIGIN = 0x20000000, LENGTH = 256K
}
SECTIONS {
    .boot2 ORIGIN(BOOT2) : { KEEP(*(.boot2)); } > BOOT2
} INSERT BEFORE .text;
";

fn main() {
    let target = std::env::var("TARGET").expect("cargo sets TARGET");
    let folder = PathBuf::from(std::env::var_os("OUT_DIR").expect("cargo sets OUT_DIR"));
    let map = if target.starts_with("thumbv6m") { RP2040 } else { MPS2 };
    std::fs::write(folder.join("memory.x"), map).expect("the build folder can be written");
    println!("cargo:rustc-link-search={}", folder.display());
    let described = Command::new("git").args(["rev-parse", "--short=8", "HEAD"]).output();
    let revision = described.ok().filter(|output| output.status.success());
    let revision =
        revision.map_or_else(String::new, |output| String::from_utf8_lossy(&output.stdout).into_owned());
    let revision = revision.trim().get(..8).unwrap_or("00000000");
    println!("cargo:rustc-env=OUTRIGGER_REVISION={revision}");
    println!("cargo:rerun-if-changed=build.rs");
    println!("cargo:rerun-if-changed=../../.git/HEAD");
}
