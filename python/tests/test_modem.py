"""The modem's reference speaks the frames that the library, and so every chip in QEMU, reads and answers."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]
PROGRAM = REPOSITORY / "python/examples/modem.py"

specification = importlib.util.spec_from_file_location("modem", PROGRAM)
assert specification and specification.loader
modem = importlib.util.module_from_spec(specification)
sys.modules["modem"] = modem
specification.loader.exec_module(modem)

# `firmware/examples/replay.rs`.
FRAME = bytes(
    [7, 6, 3, 23, 32, 239, 3, 1, 3, 232, 3, 1, 4, 128, 56, 1, 2, 22, 2, 7, 2, 4, 1, 3, 30, 9, 7, 31, 64, 26]
    + [128, 40, 130, 1, 1, 2, 200, 5, 156, 220, 44, 88, 0]
)
# A status, from `firmware/tests/session.rs`.
STATUS = "2102078cdfe2f90e01080603c0843df09309c8011e04010301a01f0901a2d2954300"
ANSWER = bytes([4, 3, 239, 3, 1, 2, 1, 2, 30, 5, 129, 93, 97, 216, 0])
# A question and its answer that never change, from `firmware/tests/session.rs`.
HELLO = bytes([1, 5, 0x8D, 0xEF, 2, 0xD2, 0])
PROTOCOL = bytes.fromhex("010602d373d7af00")


def golden(name: str) -> list[bytes]:
    return list(modem.split((REPOSITORY / "tests/golden" / name).read_bytes()))


def test_the_documented_slot() -> None:
    frame = modem.decode(FRAME[:-1], modem.FROM_MODEM)
    assert frame.slot == 1007 and frame.last_acknowledged == 1000
    assert [level / 256 for level in frame.gain] == [31, 26.25, 40.5]
    assert frame.place == (7, True) and frame.places == 22 and frame.weight == 32
    assert modem.encode(frame) == FRAME
    answer = modem.decode(ANSWER[:-1], modem.FROM_UNIT)
    assert answer == modem.Decision(slot=1007, transmit=(1, 30 * 256), state=0)
    assert modem.encode(answer) == ANSWER


def test_the_frames_have_a_version() -> None:
    assert modem.encode(modem.Hello()) == HELLO
    assert modem.decode(PROTOCOL[:-1], modem.FROM_UNIT) == modem.Protocol(modem.PROTOCOL)


def test_recorded_frames_come_back_to_the_byte_and_have_their_answers() -> None:
    answers = iter([modem.decode(wire, modem.FROM_UNIT) for wire in golden("slots.answers")])
    kinds: dict[str, int] = {}
    answered = None
    for wire in golden("slots.frames"):
        try:
            frame = modem.decode(wire, modem.FROM_MODEM)
        except ValueError:
            kinds["damaged"] = kinds.get("damaged", 0) + 1
            continue
        kinds[type(frame).__name__] = kinds.get(type(frame).__name__, 0) + 1
        assert modem.encode(frame) == wire + b"\0"
        if not isinstance(frame, modem.Measurement | modem.Missed):
            continue
        answer = next(answers)
        assert answer.slot == frame.slot != answered
        answered = answer.slot
        if isinstance(frame, modem.Measurement):
            assert answer.state == 0
            if answer.transmit:
                assert answer.transmit[0] < len(frame.gain) and answer.transmit[1] <= frame.max_power
        else:
            assert answer.state in (1, 3)
    assert next(answers, None) is None
    assert kinds["Measurement"] > 300 and kinds["Missed"] > 100 and kinds["damaged"] > 20, kinds


def test_frames_of_an_update() -> None:
    for frame in (modem.Begin(3_100), modem.Chunk(64, bytes(range(32))), modem.Commit(), modem.BeginImage(64_000), modem.StatusRequest()):
        assert modem.decode(modem.encode(frame)[:-1], modem.FROM_MODEM) == frame
    for frame in (modem.Continue(96), modem.Stored(4), modem.Refused(10), modem.Busy()):
        assert modem.decode(modem.encode(frame)[:-1], modem.FROM_UNIT) == frame


def test_a_status() -> None:
    # As `firmware/tests/session.rs` has it: the library's own bytes.
    wire = bytes.fromhex(STATUS)
    status = modem.decode(wire[:-1], modem.FROM_UNIT)
    assert modem.encode(status) == wire
    assert (status.version, status.checksum, status.trial) == (7, 0xEF38AF8C, (1, 8))
    assert modem.RESETS[status.reset] == "brown-out" and modem.CLOCKS[status.clock] == "internal"
    assert (status.slots, status.doubted_frames, status.stack_bytes) == (1_000_000, 1, 4_000)
    assert (status.image_version, status.image_on_trial) == (9, True)


@pytest.mark.parametrize("position", range(len(FRAME) - 1))
def test_a_damaged_frame_is_refused(position: int) -> None:
    damaged = bytearray(FRAME[:-1])
    damaged[position] ^= 0x10
    with pytest.raises(ValueError):
        modem.decode(bytes(damaged), modem.FROM_MODEM)


def test_numbers_that_do_not_fit_are_refused() -> None:
    with pytest.raises(ValueError, match="expected a number of 32 bits"):
        modem.encode(modem.Missed(1 << 32))
    with pytest.raises(ValueError, match="expected less than 2"):
        modem.Reader(b"\2").flag()
    with pytest.raises(ValueError, match="without an end"):
        modem.Reader(b"\xff" * 6).u32()


def test_it_talks_to_a_unit() -> None:
    unit = ["cargo", "run", "--quiet", "--locked", "--manifest-path", str(REPOSITORY / "Cargo.toml")]
    unit += ["-p", "firmware", "--example", "unit"]
    command = [sys.executable, str(PROGRAM), "talk", "--slots", "44", "--", *unit]
    lines = subprocess.run(command, check=True, capture_output=True, text=True).stdout.splitlines()
    assert len(lines) == 44 and all(line.endswith("nominal") for line in lines)
    # Three sub-channels carry the 22 places, and whose turn it is sends.
    turns = [slot for slot in range(44) if 7 in {(3 * slot + sub_channel) % 22 for sub_channel in range(3)}]
    assert len(turns) == 6 and all("dBm" in lines[slot] for slot in turns), lines
    silent = subprocess.run([sys.executable, str(PROGRAM), "talk", "--", "true"], capture_output=True, text=True)
    assert silent.returncode == 2 and len(silent.stderr.splitlines()) == 1
