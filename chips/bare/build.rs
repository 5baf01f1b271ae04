//! The linker's scripts: a memory map for each target, of the machine in which the tests run it.

use std::error::Error;
use std::path::PathBuf;
use std::{env, fs};

/// Of each target: where code begins, and where RAM begins and how long it is.
const MEMORIES: [(&str, u32, u32, u32); 5] = [
    // nRF51822: QEMU's microbit.
    ("thumbv6m-none-eabi", 0x0000_0000, 0x2000_0000, 16 << 10),
    // Arm's FPGA images AN385 and AN386: QEMU's mps2-an385 and mps2-an386.
    ("thumbv7m-none-eabi", 0x0000_0000, 0x2000_0000, 64 << 10),
    ("thumbv7em-none-eabihf", 0x0000_0000, 0x2000_0000, 64 << 10),
    // AN505: mps2-an505.
    ("thumbv8m.main-none-eabihf", 0x1000_0000, 0x3800_0000, 64 << 10),
    // SiFive FE310: sifive_e.
    ("riscv32imc-unknown-none-elf", 0x2040_0000, 0x8000_0000, 16 << 10),
];
const CODE_LENGTH: u32 = 256 << 10;

fn main() -> Result<(), Box<dyn Error>> {
    println!("cargo::rerun-if-changed=build.rs");
    let target = env::var("TARGET")?;
    let (_, code, ram, length) = MEMORIES
        .into_iter()
        .find(|(name, ..)| *name == target)
        .ok_or_else(|| {
            format!("target: found {target}, expected one that `MEMORIES` in bare/build.rs lists")
        })?;
    let mut map = format!(
        "MEMORY {{ FLASH : ORIGIN = {code:#x}, LENGTH = {CODE_LENGTH} RAM : ORIGIN = {ram:#x}, LENGTH = {length} }}\n"
    );
    if target.starts_with("riscv32") {
        for (region, memory) in [
            ("TEXT", "FLASH"),
            ("RODATA", "FLASH"),
            ("DATA", "RAM"),
            ("BSS", "RAM"),
            ("HEAP", "RAM"),
            ("STACK", "RAM"),
        ] {
            map += &format!("REGION_ALIAS(\"REGION_{region}\", {memory});\n");
        }
        println!("cargo::rustc-link-arg-bins=-Tmemory.x");
    }
    let out = PathBuf::from(env::var("OUT_DIR")?);
    fs::write(out.join("memory.x"), map)?;
    println!("cargo::rustc-link-search={}", out.display());
    println!("cargo::rustc-link-arg-bins=--nmagic");
    println!("cargo::rustc-link-arg-bins=-Tlink.x");
    Ok(())
}
