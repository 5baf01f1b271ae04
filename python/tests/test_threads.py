"""Threads that write an argument while it is used: what was handed over is what is checked and carried out."""

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Event, Thread
from time import sleep

import numpy as np
import pytest

from freshlane import BatchEnvironment, Table

WORLDS, VEHICLES, ROUNDS = 200, 20, 100


@pytest.fixture
def in_turns() -> Iterator[None]:
    """Threads take turns only where one lets the others run, as Rust does while it works without the interpreter."""
    interval = sys.getswitchinterval()
    sys.setswitchinterval(60)
    yield
    sys.setswitchinterval(interval)


@contextmanager
def writing(*writes: Callable[[], None]) -> Iterator[None]:
    """Other threads that write whenever they may."""
    stop = Event()

    def work(write: Callable[[], None]) -> None:
        while not stop.is_set():
            write()
            sleep(0)

    threads = [Thread(target=work, args=[write]) for write in writes]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


class Memory:
    """An array that is filled at once: while numpy assigns, other threads run."""

    def __init__(self, good: np.ndarray, bad: np.ndarray):
        self.good, self.bad, self.memory = good.tobytes(), bad.tobytes(), bytearray(good.tobytes())
        self.array = np.frombuffer(self.memory, good.dtype).reshape(good.shape)

    def fill(self) -> np.ndarray:
        self.memory[:] = self.good
        return self.array

    def spoil(self) -> None:
        self.memory[:] = self.bad


def test_transmissions_are_those_that_were_handed_over(in_turns):
    shape = (WORLDS, VEHICLES)
    quiet, disturbed = (BatchEnvironment(worlds=WORLDS, seed=1, threads=2) for _ in range(2))
    # In turns, one vehicle a sub-channel: many are received.
    vehicles = np.arange(VEHICLES)
    powers = Memory(np.full(shape, 20.0, np.float32), np.full(shape, np.nan, np.float32))
    for slot in range(ROUNDS):
        turn = (vehicles - slot) % VEHICLES
        channels = np.broadcast_to(np.where(turn < quiet.sub_channels, turn, -1), shape).astype(np.int8)
        sent = Memory(channels, np.full(shape, 100, np.int8))
        quiet.transmit(channels, np.full(shape, 20.0, np.float32))
        with writing(sent.spoil, powers.spoil):
            # Below the checks in Python, which read the arrays before they are handed over.
            disturbed._batch.transmit(sent.fill(), powers.fill())
        assert (quiet.ages == disturbed.ages).all(), slot
    assert quiet.received.any()


def test_rows_are_those_that_were_handed_over(in_turns):
    table = Table.shipped()
    shape = (20_000, BatchEnvironment(worlds=1).observations.shape[-1])
    good, bad = np.zeros(shape, np.int8), np.full(shape, 127, np.int8)
    rows, expected = Memory(good, bad), table.outputs(good)
    assert (expected != table.outputs(bad)).any()
    with writing(rows.spoil):
        for _ in range(ROUNDS):
            assert (table.outputs(rows.fill()) == expected).all()
