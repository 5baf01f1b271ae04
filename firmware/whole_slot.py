"""What a whole slot costs the deployed image, every interrupt included: instructions and exceptions counted, cycles modelled.

The image itself runs in Unicorn, an emulator of the core that counts exactly; this file plays the rest of the chip as far as the image needs
it, as the chip's reference manual (RM0090) has it: an oscillator and a PLL that are ready, two streams of DMA between memory and line, an
interrupt when the line falls idle behind a frame, three ticks of the slot clock until the next. Handlers run one after the other, as
they do on the chip, where none preempts another. DMA and idle line have run in this model alone.

    python3 -m venv target/unicorn && target/unicorn/bin/pip install unicorn capstone
    target/unicorn/bin/python firmware/whole_slot.py target/thumbv7em-none-eabihf/firmware/firmware

The frames are the recorded ones of the tests, and the answers must be theirs.

Cycles are a model, not a measurement: each instruction's from the Cortex-M4's Technical Reference Manual (r0p1, table 3-1), 24 for an exception's
entry and exit (section 3.9.1, 12 each at least), and five wait states (RM0090, table 10) for every line of 16 bytes of the flash that
its two caches do not hold: 64 lines for instructions and 8 for data, the least recently used one given up (section 3.5.2). No prefetch
hides any of them.
"""

from __future__ import annotations

import argparse
import json
import statistics
import struct
import sys
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path

from capstone import CS_ARCH_ARM, CS_MODE_MCLASS, CS_MODE_THUMB, Cs, CsInsn
from unicorn import (
    UC_ARCH_ARM,
    UC_HOOK_BLOCK,
    UC_HOOK_CODE,
    UC_HOOK_MEM_READ,
    UC_MODE_MCLASS,
    UC_MODE_THUMB,
    Uc,
)
from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_SP, UC_CPU_ARM_CORTEX_M4

FLASH, FLASH_LENGTH = 0x0800_0000, 1 << 20
RAM, RAM_LENGTH = 0x2000_0000, 128 << 10
PERIPHERALS, CORE, SYSTEM_MEMORY = 0x4000_0000, 0xE000_0000, 0x1FFF_0000
RETURN = 0x3000_0000
"""Where handlers return to."""

USART1 = 0x4001_1000
STATUS, DATA, CONTROL = USART1, USART1 + 4, USART1 + 12
IDLE, SENT = 1 << 4, 1 << 6
"""Bits of the status; each also switches its interrupt in the control register."""
DMA2 = 0x4002_6400
IN, OUT = DMA2 + 0x10 + 2 * 0x18, DMA2 + 0x10 + 7 * 0x18
"""Two streams: control, number of bytes left, peripheral, memory."""
ENABLED, CIRCULAR = 1, 1 << 8
RCC_CONTROL, RCC_CLOCK = 0x4002_3800, 0x4002_3808
COPROCESSORS = 0xE000_ED88

SYSTICK, EXTERNAL = 15, 16
"""Numbers of exceptions: the timer, and the first interrupt."""
USART1_INTERRUPT = 37
WFI = b"\x30\xbf"
LONGEST = 43
"""Bytes of the longest frame of three sub-channels."""
TICKS = 3
"""Of a slot's four the last coincides with the next frame, which begins a new one."""

CORE_HZ, SLOT_SECONDS = 168e6, 1e-3
MOST_INSTRUCTIONS, MOST_EXCEPTIONS, MOST_PERCENT = 6_000, 12, 7.0
"""What a slot may take (chosen)."""
WAIT_STATES, LINE = 5, 16
INSTRUCTION_LINES, DATA_LINES = 64, 8
EXCEPTION_CYCLES, BRANCH_CYCLES = 24, 2


class Cache:
    """Lines of flash; the least recently used one is given up."""

    def __init__(self, lines: int) -> None:
        self.lines, self.held = lines, OrderedDict[int, None]()

    def misses(self, first: int, last: int) -> int:
        """How many lines of these addresses were not there."""
        misses = 0
        for line in range(first // LINE, last // LINE + 1):
            if line in self.held:
                self.held.move_to_end(line)
                continue
            misses += 1
            self.held[line] = None
            if len(self.held) > self.lines:
                self.held.popitem(last=False)
        return misses


@dataclass
class Block:
    """A stretch of instructions without a branch, and its cycles without wait states."""

    instructions: int
    cycles: int


def cycles(instruction: CsInsn, follows_access: bool) -> tuple[int, bool]:
    """What an instruction takes, and whether it is a single load or store, which the next one does not wait for."""
    name = instruction.mnemonic
    registers = instruction.op_str.partition("{")[2].count(",") + 1
    if name.startswith(("ldm", "stm", "pop", "push", "vldm", "vstm", "vpop", "vpush")):
        return 1 + registers, False
    if name.startswith(("ldrd", "strd")):
        return 3, False
    if name.startswith("ldr"):
        return 1 if follows_access else 2, True
    if name.startswith("str"):
        return 1, True
    if name.startswith(("vdiv", "vsqrt")):
        return 14, False
    if name.startswith(("udiv", "sdiv")):
        return 7, False
    if name.startswith(("vml", "vfm", "vnml", "vfn")):
        return 3, False
    return (2 if name.startswith(("vldr", "vstr")) else 1), False


class Chip:
    """An image in the emulator, booted."""

    def __init__(self, image: Path) -> None:
        self.core = Uc(UC_ARCH_ARM, UC_MODE_THUMB | UC_MODE_MCLASS)
        self.core.ctl_set_cpu_model(UC_CPU_ARM_CORTEX_M4)
        for start, length in [
            (FLASH, FLASH_LENGTH),
            (RAM, RAM_LENGTH),
            (PERIPHERALS, 0x3_0000),
            (CORE, 0x10_0000),
            (SYSTEM_MEMORY, 0x1_0000),
            (RETURN, 0x1000),
        ]:
            self.core.mem_map(start, length)
        self.core.mem_write(FLASH, b"\xff" * FLASH_LENGTH)
        for address, data in segments(image):
            self.core.mem_write(address, data)
        self.vectors = struct.unpack("<98I", self.core.mem_read(FLASH, 4 * 98))
        self.sent = bytearray()
        self.ring = 0
        self.instructions = 0
        self.exceptions = 0
        self.cycles = 0
        self.blocks: dict[tuple[int, int], Block] = {}
        self.disassembler = Cs(CS_ARCH_ARM, CS_MODE_THUMB | CS_MODE_MCLASS)
        self.code, self.data = Cache(INSTRUCTION_LINES), Cache(DATA_LINES)
        self.behind = 0
        self._boot()
        self.ring = self._word(IN + 4)
        self.core.hook_add(UC_HOOK_BLOCK, self._block)
        self.core.hook_add(UC_HOOK_MEM_READ, self._load, begin=FLASH, end=FLASH + FLASH_LENGTH - 1)

    def _boot(self) -> None:
        # The floating-point unit is on, as an exception would find it.
        self.core.mem_write(COPROCESSORS, struct.pack("<I", 0xF << 20))
        self.core.reg_write(UC_ARM_REG_SP, self.vectors[0])
        self.core.hook_add(UC_HOOK_MEM_READ, self._clocks, begin=RCC_CONTROL, end=RCC_CLOCK + 3)

        def stop_at_sleep(core: Uc, address: int, size: int, _: object) -> None:
            if size == 2 and core.mem_read(address, 2) == WFI:
                core.emu_stop()

        hook = self.core.hook_add(UC_HOOK_CODE, stop_at_sleep)
        self.core.emu_start(self.vectors[1], 0xFFFF_FFFF, count=50_000_000)
        self.core.hook_del(hook)
        self.core.ctl_remove_cache(FLASH, FLASH + FLASH_LENGTH)
        self.stack = self.core.reg_read(UC_ARM_REG_SP)

    def _word(self, address: int) -> int:
        return int.from_bytes(self.core.mem_read(address, 4), "little")

    def _write(self, address: int, word: int) -> None:
        self.core.mem_write(address, word.to_bytes(4, "little"))

    def _clocks(self, *_: object) -> None:
        # What is switched on is ready: the oscillators and the PLL, by the bit behind each; and the core runs from what it is told.
        on = self._word(RCC_CONTROL) | 1
        self._write(RCC_CONTROL, on | (on & 0x0101_0001) << 1)
        chosen = self._word(RCC_CLOCK) & ~0xC
        self._write(RCC_CLOCK, chosen | (chosen & 3) << 2)

    def _block(self, core: Uc, address: int, size: int, _: object) -> None:
        block = self.blocks.get((address, size)) or self._disassemble(core, address, size)
        self.instructions += block.instructions
        self.cycles += block.cycles + BRANCH_CYCLES * (address != self.behind)
        self.cycles += WAIT_STATES * self.code.misses(address, address + size - 1)
        self.behind = address + size

    def _disassemble(self, core: Uc, address: int, size: int) -> Block:
        block, follows_access, decoded = Block(0, 0), False, 0
        for instruction in self.disassembler.disasm(bytes(core.mem_read(address, size)), address):
            taken, follows_access = cycles(instruction, follows_access)
            block.cycles += taken
            block.instructions += 1
            decoded += instruction.size
        if decoded != size:
            raise ValueError(f"the code at {address + decoded:#x}: found what the disassembler does not know, expected an instruction")
        self.blocks[address, size] = block
        return block

    def _load(self, _core: Uc, _access: int, address: int, size: int, _value: int, _: object) -> None:
        self.cycles += WAIT_STATES * self.data.misses(address, address + size - 1)

    def take(self, exception: int) -> None:
        """Runs an exception's handler, and has what it sends go out."""
        self.exceptions += 1
        self.cycles += EXCEPTION_CYCLES
        # Eight words are what the core itself puts on the stack.
        self.core.reg_write(UC_ARM_REG_SP, self.stack - 32)
        self.core.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self.core.emu_start(self.vectors[exception], RETURN)
        if not self._word(OUT) & ENABLED:
            return
        self.sent += self.core.mem_read(self._word(OUT + 12), self._word(OUT + 4))
        self._write(OUT, self._word(OUT) & ~ENABLED)
        self._write(STATUS, self._word(STATUS) | SENT)
        if self._word(CONTROL) & SENT:
            self.take(EXTERNAL + USART1_INTERRUPT)

    def receive(self, data: bytes) -> None:
        """Bytes come without a gap, and then the line is idle."""
        if self._word(IN) & (ENABLED | CIRCULAR) != ENABLED | CIRCULAR or not self._word(CONTROL) & IDLE:
            raise ValueError("the image: found no stream that receives into a ring, and no interrupt of the idle line")
        for byte in data:
            left = self._word(IN + 4)
            self.core.mem_write(self._word(IN + 12) + self.ring - left, bytes([byte]))
            self._write(IN + 4, left - 1 or self.ring)
        self._write(STATUS, self._word(STATUS) | IDLE)
        self.take(EXTERNAL + USART1_INTERRUPT)


def segments(image: Path) -> list[tuple[int, bytes]]:
    """What an ELF file puts where in memory."""
    data = image.read_bytes()
    if data[:6] != b"\x7fELF\x01\x01":
        raise ValueError(f"{image}: found something else, expected a 32-bit ELF file")
    (headers,) = struct.unpack_from("<I", data, 28)
    size, count = struct.unpack_from("<HH", data, 42)
    loaded = []
    for index in range(count):
        kind, offset, _, address, length = struct.unpack_from("<5I", data, headers + index * size)
        if kind == 1 and length:
            loaded.append((address, data[offset : offset + length]))
    return loaded


@dataclass(frozen=True)
class Slot:
    """What a slot took, from the answer before to its own and the ticks behind it."""

    instructions: int
    exceptions: int
    cycles: int
    is_usual: bool
    """Whether it had a single frame, of three sub-channels at most."""


def record(chip: Chip, golden: Path) -> list[Slot]:
    """The recorded frames, and what each slot took. Raises ValueError if the answers are not the recorded ones."""
    runs: list[bytes] = []
    for index, frame in enumerate((golden / "slots.frames").read_bytes().split(b"\0")[:-1]):
        # Now and then two come at once, so that the second one's answer waits for the line.
        runs[-1:] = [runs[-1] + frame + b"\0"] if index % 64 == 63 else [*runs[-1:], frame + b"\0"]
    slots, frames = [], 0
    for run in runs:
        before = len(chip.sent)
        chip.receive(run)
        frames += run.count(0)
        if len(chip.sent) == before:
            continue
        for _ in range(TICKS):
            chip.take(SYSTICK)
        slots.append(Slot(chip.instructions, chip.exceptions, chip.cycles, frames == 1 and len(run) <= LONGEST))
        chip.instructions = chip.exceptions = chip.cycles = frames = 0
    if chip.sent != (golden / "slots.answers").read_bytes():
        raise ValueError("the image's answers: found others, expected tests/golden/slots.answers")
    return slots


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Counts what a whole slot costs the deployed image, every interrupt included.")
    parser.add_argument("image", type=Path)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    try:
        slots = record(Chip(arguments.image), Path(__file__).parents[1] / "tests/golden")
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2

    usual = [slot for slot in slots if slot.is_usual]
    instructions, exceptions, worst = (max(getattr(slot, of) for slot in usual) for of in ("instructions", "exceptions", "cycles"))
    percent = 100 * worst / (CORE_HZ * SLOT_SECONDS)
    result = {
        "slots": len(usual),
        "slot_with_interrupts_min_instructions": min(slot.instructions for slot in usual),
        "slot_with_interrupts_median_instructions": int(statistics.median(slot.instructions for slot in usual)),
        "slot_with_interrupts_max_instructions": instructions,
        "slot_with_interrupts_exceptions": exceptions,
        "slot_with_interrupts_median_cycles": int(statistics.median(slot.cycles for slot in usual)),
        "slot_with_interrupts_max_cycles": worst,
        "slot_with_interrupts_percent": round(percent, 2),
        # With up to eight sub-channels, and with damaged and late frames before the slot's own.
        "unusual_slots": len(slots) - len(usual),
        "unusual_slot_max_instructions": max(slot.instructions for slot in slots),
        "unusual_slot_max_cycles": max(slot.cycles for slot in slots),
    }
    print(json.dumps(result) if arguments.json else "\n".join(f"{key:42}{value:>8}" for key, value in result.items()))
    if instructions > MOST_INSTRUCTIONS or exceptions > MOST_EXCEPTIONS or percent > MOST_PERCENT:
        expected = f"at most {MOST_INSTRUCTIONS} instructions, {MOST_EXCEPTIONS} exceptions and {MOST_PERCENT} % of a slot"
        print(f"error: a slot: found {instructions}, {exceptions} and {percent:.2f} %, expected {expected}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
