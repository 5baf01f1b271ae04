"""The modem's end of the line to a unit, in plain Python: every frame that goes either way, and a program that talks to a unit.

A frame is its fields, the CRC-32 of those bytes, little-endian, and COBS around both (Cheshire and Baker, IEEE/ACM Transactions on
Networking 7(2), 1999), with a zero byte behind. A measurement's and a decision's fields have their places; all others' are in postcard's encoding
(https://postcard.jamesmunns.com/wire-format). The firmware's own definition is `firmware/src/link/`. Levels and powers count 1/256 dB, over noise or over 1 mW.

    python3 modem.py read < tests/golden/slots.answers
    python3 modem.py talk --slots 100 -- qemu-system-arm -machine microbit -display none -monitor none -serial stdio -kernel UNIT

On a real line `Line` takes any pair of binary streams, as pyserial's `Serial` is one: `Line(port, port)`.
"""

from __future__ import annotations

import argparse
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import IO, ClassVar, TypeAlias

PROTOCOL = 2
"""The version of all frames here; a unit tells its own when it is asked with `Hello`."""
MAX_FRAME = 96
"""Most bytes of a frame on the wire, its delimiter among them."""
MAX_SUB_CHANNELS = 16
CHUNK_LEN = 32
"""Bytes of a table's package in one chunk."""
STATES = ("nominal", "degraded", "silent without a table", "silent without a measurement")
REFUSALS = (
    "not begun",
    "length",
    "incomplete",
    "flash",
    "header",
    "table",
    "version",
    "signature",
    "digest",
    "on trial",
    "worn",
    "no boot loader",
)
TRIALS = ("none", "waiting", "running")
RESETS = ("watchdog", "software", "power on", "brown-out", "pin", "unknown")
CLOCKS = ("crystal", "internal", "internal, slow", "emulated")


# postcard: integers of more than a byte are varints, signed ones zigzag first; an option has a byte in front, a sequence its length.


class Reader:
    """Reads fields from the front of bytes. Every method raises ValueError if they do not fit."""

    def __init__(self, data: bytes) -> None:
        self.rest = data

    def take(self, length: int) -> bytes:
        taken, self.rest = self.rest[:length], self.rest[length:]
        if len(taken) < length:
            raise ValueError(f"found {len(taken)} bytes, expected {length}")
        return taken

    def u8(self) -> int:
        return self.take(1)[0]

    def flag(self) -> bool:
        return self.choice(2) == 1

    def choice(self, count: int) -> int:
        """Which of so many variants."""
        found = self.varint(32)
        if found >= count:
            raise ValueError(f"found variant {found}, expected less than {count}")
        return found

    def varint(self, bits: int) -> int:
        value = 0
        for shift in range(0, bits, 7):
            byte = self.u8()
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                break
        else:
            raise ValueError(f"found a number without an end, expected one of {bits} bits")
        if value >= 1 << bits:
            raise ValueError(f"found {value}, expected a number of {bits} bits")
        return value

    def u16(self) -> int:
        return self.varint(16)

    def u32(self) -> int:
        return self.varint(32)

    def i16(self) -> int:
        value = self.varint(16)
        return value >> 1 ^ -(value & 1)

    def option(self, read: Callable[[], object]) -> object:
        return read() if self.flag() else None

    def trial(self) -> tuple[int, int | None]:
        trial = self.choice(len(TRIALS))
        return trial, self.u32() if TRIALS[trial] == "waiting" else None

    def chunk(self) -> bytes:
        return self.take(CHUNK_LEN)


def _varint(value: int, bits: int) -> bytes:
    if not 0 <= value < 1 << bits:
        raise ValueError(f"found {value}, expected a number of {bits} bits")
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def _i16(value: int) -> bytes:
    if not -(1 << 15) <= value < 1 << 15:
        raise ValueError(f"found {value}, expected -32768 to 32767")
    return _varint(value << 1 if value >= 0 else ~(value << 1), 16)


def _option(write: Callable[..., bytes]) -> Callable[..., bytes]:
    return lambda value: b"\0" if value is None else b"\1" + write(value)


WRITERS: dict[str, Callable[..., bytes]] = {
    "u8": lambda value: value.to_bytes(1, "little"),
    "flag": lambda value: bytes([value]),
    "u16": lambda value: _varint(value, 16),
    "u32": lambda value: _varint(value, 32),
    "i16": _i16,
    "trial": lambda value: bytes([value[0]]) + (b"" if value[1] is None else _varint(value[1], 32)),
    "chunk": bytes,
}


class Frame:
    """A frame: the numbers of its variant, outermost first, and the kinds of its fields in their order."""

    VARIANT: ClassVar[tuple[int, ...]]
    KINDS: ClassVar[tuple[str, ...]] = ()

    def fields(self) -> bytes:
        """The fields as postcard has them."""
        encoded = bytes(self.VARIANT)
        # A dataclass keeps its fields in their order.
        for value, kind in zip(vars(self).values(), self.KINDS, strict=True):
            write = WRITERS[kind.removeprefix("?")]
            encoded += (_option(write) if kind.startswith("?") else write)(value)
        return encoded

    @classmethod
    def read(cls, reader: Reader) -> Frame:
        """The frame of the fields behind its variant."""
        return cls(*(reader.option(getattr(reader, kind[1:])) if kind.startswith("?") else getattr(reader, kind)() for kind in cls.KINDS))


# From the modem.


@dataclass(frozen=True)
class Hello(Frame):
    """Asks for the version of a unit's frames."""

    VARIANT = (0,)


@dataclass(frozen=True)
class Measurement(Frame):
    """A slot's readings; `firmware/src/measurement.rs` says what they mean."""

    VARIANT = (6,)
    FIXED: ClassVar = struct.Struct("<BBBBIIIHHHhB")
    """Kind, sub-channels, flags, weight, slot, last acknowledged, threshold, places, place, open, most power, salt."""

    slot: int
    gain: tuple[int, ...]
    """Level at full power on each sub-channel."""
    interference: tuple[int, ...]
    """Noise and interference on each sub-channel in the slot before."""
    last_acknowledged: int | None
    """Latest slot whose message the base station acknowledged."""
    place: tuple[int, bool] | None
    """The vehicle's place in the ring, and whether it was handed out."""
    awaits_acknowledgement: bool
    places: int
    """Places of the ring."""
    open: int
    """One bit for every sub-channel: open in this slot."""
    threshold: int
    salt: int
    gains_hold: bool
    weight: int
    """What the vehicle's age is weighed with, in 1/32."""
    max_power: int

    def fields(self) -> bytes:
        """The fields, each at its place."""
        if len(self.gain) != len(self.interference):
            raise ValueError(f"found {len(self.interference)} interferences, expected one for each of {len(self.gain)} gains")
        place, assigned = self.place or (0, False)
        flags = (self.last_acknowledged is not None, self.place is not None, assigned, self.awaits_acknowledgement, self.gains_hold)
        fixed = (
            *(self.VARIANT[0], len(self.gain), sum(flag << bit for bit, flag in enumerate(flags)), self.weight),
            *(self.slot, self.last_acknowledged or 0, self.threshold),
            *(self.places, place, self.open, self.max_power, self.salt),
        )
        try:
            return self.FIXED.pack(*fixed) + struct.pack(f"<{2 * len(self.gain)}h", *self.gain, *self.interference)
        except struct.error as error:
            raise ValueError(f"found {fixed}, expected numbers that fit: {error}") from None

    @classmethod
    def read(cls, reader: Reader) -> Measurement:
        fixed = bytes(cls.VARIANT) + reader.take(cls.FIXED.size - 1)
        _, count, flags, weight, slot, acknowledged, threshold, places, place, open_, max_power, salt = cls.FIXED.unpack(fixed)
        if count > MAX_SUB_CHANNELS or flags >= 1 << 5:
            raise ValueError(f"found {count} sub-channels and flags {flags:#x}, expected at most {MAX_SUB_CHANNELS} and 0x1f")
        levels = struct.unpack(f"<{2 * count}h", reader.take(4 * count))
        return cls(
            slot=slot,
            gain=levels[:count],
            interference=levels[count:],
            last_acknowledged=acknowledged if flags & 1 else None,
            place=(place, bool(flags & 4)) if flags & 2 else None,
            awaits_acknowledgement=bool(flags & 8),
            places=places,
            open=open_,
            threshold=threshold,
            salt=salt,
            gains_hold=bool(flags & 16),
            weight=weight,
            max_power=max_power,
        )


@dataclass(frozen=True)
class Missed(Frame):
    """A slot in which the modem could not measure."""

    VARIANT = (1,)
    KINDS = ("u32",)

    slot: int


@dataclass(frozen=True)
class SlotLength(Frame):
    """How long a slot is, for units in an emulator."""

    VARIANT = (2,)
    KINDS = ("u32",)

    microseconds: int


@dataclass(frozen=True)
class Begin(Frame):
    """A table's signed package of this length is coming."""

    VARIANT = (3, 0)
    KINDS = ("u32",)

    length: int


@dataclass(frozen=True)
class Chunk(Frame):
    """The package's next bytes."""

    VARIANT = (3, 1)
    KINDS = ("u32", "chunk")

    offset: int
    data: bytes


@dataclass(frozen=True)
class Commit(Frame):
    """The package is complete."""

    VARIANT = (3, 2)


@dataclass(frozen=True)
class BeginImage(Frame):
    """An image's signed package of this length is coming; its chunks and its commit are as a table's."""

    VARIANT = (3, 3)
    KINDS = ("u32",)

    length: int


@dataclass(frozen=True)
class Identity(Frame):
    """The number under which the base station knows the vehicle."""

    VARIANT = (4,)
    KINDS = ("u32",)

    number: int


@dataclass(frozen=True)
class StatusRequest(Frame):
    """Asks how the unit is."""

    VARIANT = (5,)


# From the unit.


@dataclass(frozen=True)
class Decision(Frame):
    """A slot's decision."""

    VARIANT = (3,)
    FIXED: ClassVar = struct.Struct("<BIBhB")
    """Kind, slot, sub-channel or `SILENCE`, power, state."""
    SILENCE: ClassVar = 255

    slot: int
    transmit: tuple[int, int] | None
    """Sub-channel and power, or None: silent."""
    state: int
    """Which of `STATES`."""

    def fields(self) -> bytes:
        """The fields, each at its place."""
        sub_channel, power = self.transmit or (self.SILENCE, 0)
        return self.FIXED.pack(self.VARIANT[0], self.slot, sub_channel, power, self.state)

    @classmethod
    def read(cls, reader: Reader) -> Decision:
        fixed = bytes(cls.VARIANT) + reader.take(cls.FIXED.size - 1)
        _, slot, sub_channel, power, state = cls.FIXED.unpack(fixed)
        return cls(slot, None if sub_channel == cls.SILENCE else (sub_channel, power), state)


@dataclass(frozen=True)
class Continue(Frame):
    """Send the package from this offset on."""

    VARIANT = (1, 0)
    KINDS = ("u32",)

    offset: int


@dataclass(frozen=True)
class Stored(Frame):
    """The table or the image of this version is complete, and will be tried: `Status` says how that goes."""

    VARIANT = (1, 1)
    KINDS = ("u32",)

    version: int


@dataclass(frozen=True)
class Refused(Frame):
    """The update is over."""

    VARIANT = (1, 2)
    KINDS = ("u8",)

    reason: int
    """Which of `REFUSALS`."""


@dataclass(frozen=True)
class Busy(Frame):
    """Send the step again."""

    VARIANT = (1, 3)


@dataclass(frozen=True)
class Status(Frame):
    """How a unit is."""

    VARIANT = (2,)
    KINDS = ("u32", "u32", "trial", "u32", "u32", "u32", "u32", "u32", "u32", "u32", "u32", "u8", "u8", "u16", "u32", "flag")

    version: int
    """Of the running table, 0 for the one that is built in."""
    checksum: int
    trial: tuple[int, int | None]
    """Which of `TRIALS`, and the version that waits."""
    floor: int
    """Only versions above it are taken."""
    erases: int
    slots: int
    transmissions: int
    degraded: int
    overdue: int
    dropped_frames: int
    doubted_frames: int
    reset: int
    """Which of `RESETS`."""
    clock: int
    """Which of `CLOCKS`."""
    stack_bytes: int
    image_version: int
    """0 if the image's build named none."""
    image_on_trial: bool
    """Whether the next start takes the image back unless it proves itself."""


@dataclass(frozen=True)
class Protocol(Frame):
    """Which frames the unit speaks."""

    VARIANT = (0,)
    KINDS = ("u8",)

    version: int


FROM_MODEM: tuple[type[Frame], ...] = (
    Hello,
    Measurement,
    Missed,
    SlotLength,
    Begin,
    Chunk,
    Commit,
    BeginImage,
    Identity,
    StatusRequest,
)
FROM_UNIT: tuple[type[Frame], ...] = (Decision, Continue, Stored, Refused, Busy, Status, Protocol)
Frames: TypeAlias = tuple[type[Frame], ...]


def encode(frame: Frame) -> bytes:
    """The frame as it goes over the wire, delimiter included."""
    data = frame.fields()
    return _stuff(data + zlib.crc32(data).to_bytes(4, "little")) + b"\0"


def decode(wire: bytes, kinds: Frames) -> Frame:
    """The frame in these bytes, without their delimiter. Raises ValueError if it is damaged or of no such kind."""
    data = _unstuff(wire)
    data, checksum = data[:-4], data[-4:]
    if zlib.crc32(data).to_bytes(4, "little") != checksum:
        raise ValueError("found another checksum than the fields', expected a whole frame")
    reader = Reader(data)
    variant: tuple[int, ...] = ()
    while True:
        variant += (reader.choice(128),)
        found = [kind for kind in kinds if kind.VARIANT[: len(variant)] == variant]
        if not found:
            raise ValueError(f"found variant {variant}, expected a frame that this end sends")
        if found[0].VARIANT == variant:
            break
    frame = found[0].read(reader)
    if reader.rest:
        raise ValueError(f"found {len(reader.rest)} bytes behind the fields, expected none")
    return frame


def _stuff(data: bytes) -> bytes:
    """COBS: no zeros, each replaced by the distance to the next. No frame has blocks of COBS's longest."""
    return b"".join(bytes([len(block) + 1]) + block for block in data.split(b"\0"))


def _unstuff(wire: bytes) -> bytes:
    reader, blocks = Reader(wire), []
    while reader.rest:
        blocks.append(reader.take(max(reader.u8(), 1) - 1))
    return b"\0".join(blocks)


def split(data: bytes) -> Iterator[bytes]:
    """The frames in a recording, still as on the wire; empty ones are none."""
    return (wire for wire in data.split(b"\0") if wire)


class Line:
    """A line to a unit: two binary streams, of which the first is what the unit sends."""

    def __init__(self, from_unit: IO[bytes], to_unit: IO[bytes]) -> None:
        self._from_unit, self._to_unit = from_unit, to_unit

    def send(self, frame: Frame) -> None:
        """Sends a frame."""
        self._to_unit.write(encode(frame))
        self._to_unit.flush()

    def receive(self) -> Frame:
        """The unit's next frame; a damaged one is dropped, as its slot's answer then is. Raises EOFError if the line ends."""
        wire = bytearray()
        while True:
            byte = self._from_unit.read(1)
            if not byte:
                raise EOFError("found the line's end, expected an answer")
            if byte != b"\0":
                wire += byte
                continue
            try:
                return decode(bytes(wire), FROM_UNIT)
            except ValueError:
                wire.clear()


def words(frame: Frame) -> str:
    """A decision for people; any other frame as it is."""
    if not isinstance(frame, Decision):
        return repr(frame)
    state = STATES[frame.state]
    if frame.transmit is None:
        return f"slot {frame.slot}: silent, {state}"
    sub_channel, power = frame.transmit
    return f"slot {frame.slot}: sub-channel {sub_channel}, {power / 256:.2f} dBm, {state}"


def _read() -> None:
    for wire in split(sys.stdin.buffer.read()):
        try:
            print(words(decode(wire, FROM_UNIT)))
        except ValueError as error:
            print(f"damaged: {error}")


def _talk(command: list[str], slots: int) -> None:
    """A vehicle with a place in a ring of 22; whatever it sends is acknowledged."""
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as unit:
        assert unit.stdin and unit.stdout
        line = Line(unit.stdout, unit.stdin)
        line.send(Hello())
        if (answer := line.receive()) != Protocol(PROTOCOL):
            raise EOFError(f"found {answer}, expected a unit of protocol {PROTOCOL}")
        # This end is not in a hurry, so nothing may be overdue.
        line.send(SlotLength(60_000_000))
        line.send(Identity(7))
        acknowledged = None
        for slot in range(slots):
            line.send(
                Measurement(
                    slot=slot,
                    gain=(31 * 256, 26 * 256, 40 * 256),
                    interference=(256, 0, 256),
                    last_acknowledged=acknowledged,
                    place=(7, True),
                    awaits_acknowledgement=False,
                    places=22,
                    open=0,
                    threshold=1_000,
                    salt=9,
                    gains_hold=True,
                    weight=32,
                    max_power=23 * 256,
                )
            )
            answer = line.receive()
            print(words(answer))
            if isinstance(answer, Decision) and answer.transmit:
                acknowledged = slot
        unit.kill()


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Speaks with a unit as its modem does.")
    commands = parser.add_subparsers(dest="command", required=True)
    commands.add_parser("read", help="what a unit sent, from standard input, in words")
    talk = commands.add_parser("talk", help="converse with a unit over a program's standard streams")
    talk.add_argument("--slots", type=int, default=100)
    talk.add_argument("unit", nargs="+", metavar="COMMAND")
    arguments = parser.parse_args()
    try:
        if arguments.command == "read":
            _read()
        else:
            _talk(arguments.unit, arguments.slots)
    except (EOFError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
