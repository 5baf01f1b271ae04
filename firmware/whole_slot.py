"""What a whole slot costs the deployed image, every interrupt included: instructions and exceptions, byte by byte.

The image itself runs in Unicorn, an emulator of the core that counts exactly; this file plays the interrupt controller and the serial line,
as the chip's reference manual (RM0090) has them: an interrupt for each byte that comes, one for each that may go, three ticks of the slot
clock until the next frame. Handlers run one after the other; preempting each other they would count the same.

    python3 -m venv target/unicorn && target/unicorn/bin/pip install unicorn
    target/unicorn/bin/python firmware/whole_slot.py target/thumbv7em-none-eabihf/firmware/firmware

The frames are the recorded ones of the tests, and the answers must be theirs. What an exception's entry and exit cost is in cycles and not in
instructions: 12 each at least (Cortex-M4 TRM, section 3.9.1).
"""

from __future__ import annotations

import argparse
import json
import statistics
import struct
import sys
from pathlib import Path

from unicorn import UC_ARCH_ARM, UC_HOOK_BLOCK, UC_HOOK_CODE, UC_HOOK_MEM_WRITE, UC_MODE_MCLASS, UC_MODE_THUMB, Uc
from unicorn.arm_const import UC_ARM_REG_LR, UC_ARM_REG_SP, UC_CPU_ARM_CORTEX_M4

FLASH, FLASH_LENGTH = 0x0800_0000, 1 << 20
RAM, RAM_LENGTH = 0x2000_0000, 128 << 10
PERIPHERALS, CORE, SYSTEM_MEMORY = 0x4000_0000, 0xE000_0000, 0x1FFF_0000
RETURN = 0x3000_0000
"""Where handlers return to."""

USART1 = 0x4001_1000
STATUS, DATA, CONTROL = USART1, USART1 + 4, USART1 + 12
RECEIVED, MAY_SEND = 1 << 5, 1 << 7
"""Bits of the status; the second also switches its interrupt in the control register."""
SET_PENDING = 0xE000_E200
COPROCESSORS = 0xE000_ED88

SYSTICK, EXTERNAL = 15, 16
"""Numbers of exceptions: the timer, and the first interrupt."""
USART1_INTERRUPT = 37
WFI = b"\x30\xbf"
TICKS = 3
"""Of a slot's four the last coincides with the next frame, which begins a new one."""


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
        self.pending: set[int] = set()
        self.instructions = 0
        self.exceptions = 0
        self.lengths: dict[tuple[int, int], int] = {}
        self._boot()
        self.core.hook_add(UC_HOOK_BLOCK, self._block)
        self.core.hook_add(UC_HOOK_MEM_WRITE, self._send, begin=DATA, end=DATA + 3)
        self.core.hook_add(UC_HOOK_MEM_WRITE, self._pend, begin=SET_PENDING, end=SET_PENDING + 11)

    def _boot(self) -> None:
        # The floating-point unit is on, as an exception would find it.
        self.core.mem_write(COPROCESSORS, struct.pack("<I", 0xF << 20))
        self.core.reg_write(UC_ARM_REG_SP, self.vectors[0])

        def stop_at_sleep(core: Uc, address: int, size: int, _: object) -> None:
            if size == 2 and core.mem_read(address, 2) == WFI:
                core.emu_stop()

        hook = self.core.hook_add(UC_HOOK_CODE, stop_at_sleep)
        self.core.emu_start(self.vectors[1], 0xFFFF_FFFF, count=50_000_000)
        self.core.hook_del(hook)
        self.core.ctl_remove_cache(FLASH, FLASH + FLASH_LENGTH)
        self.stack = self.core.reg_read(UC_ARM_REG_SP)

    def _block(self, core: Uc, address: int, size: int, _: object) -> None:
        if (address, size) not in self.lengths:
            code = bytes(core.mem_read(address, size))
            position = count = 0
            while position < size:
                # Thumb: 0b11101, 0b11110 and 0b11111 begin an instruction of two halfwords.
                position += 4 if code[position + 1] >> 3 >= 0b11101 else 2
                count += 1
            self.lengths[address, size] = count
        self.instructions += self.lengths[address, size]

    def _send(self, core: Uc, _access: int, _address: int, _size: int, value: int, _: object) -> None:
        self.sent.append(value & 0xFF)
        core.mem_write(STATUS, struct.pack("<I", 0))

    def _pend(self, _core: Uc, _access: int, address: int, _size: int, value: int, _: object) -> None:
        first = (address - SET_PENDING) * 8
        self.pending |= {first + bit for bit in range(32) if value >> bit & 1}

    def take(self, exception: int) -> None:
        """Runs an exception's handler, and then what it pends, but not yet the line's: the line sends in its own time."""
        self.exceptions += 1
        # Eight words are what the core itself puts on the stack.
        self.core.reg_write(UC_ARM_REG_SP, self.stack - 32)
        self.core.reg_write(UC_ARM_REG_LR, RETURN | 1)
        self.core.emu_start(self.vectors[exception], RETURN)
        for interrupt in sorted(self.pending - {USART1_INTERRUPT}):
            self.pending.discard(interrupt)
            self.take(EXTERNAL + interrupt)

    def byte(self, byte: int) -> None:
        """A byte comes, and what there is to send goes."""
        self.core.mem_write(DATA, struct.pack("<I", byte))
        self.core.mem_write(STATUS, struct.pack("<I", RECEIVED | MAY_SEND))
        self.take(EXTERNAL + USART1_INTERRUPT)
        while USART1_INTERRUPT in self.pending or self._may_send():
            self.pending.discard(USART1_INTERRUPT)
            self.core.mem_write(STATUS, struct.pack("<I", MAY_SEND))
            self.take(EXTERNAL + USART1_INTERRUPT)

    def _may_send(self) -> bool:
        return bool(struct.unpack("<I", self.core.mem_read(CONTROL, 4))[0] & MAY_SEND)


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


def main() -> int:
    """The command line."""
    golden = Path(__file__).parents[1] / "tests/golden"
    parser = argparse.ArgumentParser(description="Counts what a whole slot costs the deployed image, every interrupt included.")
    parser.add_argument("image", type=Path)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    try:
        chip = Chip(arguments.image)
    except (OSError, ValueError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2

    slots: list[tuple[int, int]] = []
    for byte in (golden / "slots.frames").read_bytes():
        before = len(chip.sent)
        chip.byte(byte)
        if len(chip.sent) == before:
            continue
        for _ in range(TICKS):
            chip.take(SYSTICK)
        slots.append((chip.instructions, chip.exceptions))
        chip.instructions = chip.exceptions = 0
    if chip.sent != (golden / "slots.answers").read_bytes():
        print("error: the image's answers: found others, expected tests/golden/slots.answers", file=sys.stderr)
        return 1

    instructions, exceptions = zip(*slots, strict=True)
    result = {
        "slots": len(slots),
        "slot_with_interrupts_min_instructions": min(instructions),
        "slot_with_interrupts_median_instructions": int(statistics.median(instructions)),
        "slot_with_interrupts_max_instructions": max(instructions),
        "slot_with_interrupts_exceptions": int(statistics.median(exceptions)),
        "slot_with_interrupts_max_exceptions": max(exceptions),
    }
    print(json.dumps(result) if arguments.json else "\n".join(f"{key:42}{value:>8}" for key, value in result.items()))
    return 0


if __name__ == "__main__":
    sys.exit(main())
