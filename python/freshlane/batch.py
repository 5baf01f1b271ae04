"""Many worlds at once: one numpy array for everybody's observation, one for everybody's action."""

from __future__ import annotations

import copy
import secrets
from collections.abc import Callable
from typing import Any, Literal, SupportsIndex, get_args

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from . import _arguments, _native
from ._native import Batch, Scenario, Table, Trace
from .trace import mobility_of

INPUTS: int = _native.INPUTS
"""Length of an encoded observation."""
ONE = 64
"""The int8 code of 1.0 in an observation."""
ACTIONS: int = _native.ACTIONS
"""Number of actions: 0 silent, 1 full power where the vehicle's place in the ring is, 2 to 5 received at the joiner levels 1 to 4 where
it likes an open sub-channel best, 6 at the first of them where its gain is largest of the sub-channels that carry others' places. Without such a
sub-channel in the slot all of them are silence."""

MAX_WORLDS = 1_000_000
"""The most worlds of a batch."""

Encoding = Literal["int8", "float32"]
Reward = Literal["own", "team", "paper"]
RenderMode = Literal["rgb_array"]


def observation_space(encoding: Encoding, *leading: int) -> spaces.Box:
    """The space of encoded observations: int8 codes, or these over 64 as float32."""
    if _arguments.choice("encoding", encoding, get_args(Encoding)) == "int8":
        return spaces.Box(-128, 127, (*leading, INPUTS), np.int8)
    return spaces.Box(-2.0, 127 / ONE, (*leading, INPUTS), np.float32)


def reopen(kind: Callable[..., Any], arguments: dict[str, Any]) -> Any:
    """An environment with these arguments, whose worlds are of a seed that the operating system draws: what a pickle becomes."""
    return kind(**arguments, seed=secrets.randbits(64))


class BatchEnvironment:
    """Many independent worlds of one scenario; in each slot of 1 ms every vehicle of every world decides.

    Worlds are *training* worlds, drawn from streams that no evaluation meets, whatever its seed; `evaluate` alone runs held-out
    ones. A seed and an order of calls give the same bytes for any number of threads. A reset goes on to worlds that were not
    seen before; a reset with a seed starts at the first worlds of that seed. All vehicles start at the largest age, 100 slots.

    Arrays are **read-only views of the simulator's own memory**: nothing is copied, and every property gives the same array
    object for the life of the environment. `observations`, `ages`, `received`, `rewards` and `present` change with every
    `step`, `transmit` and `reset`; the others (`float_observations` and the raw measurements) when their property is next
    read. Copy what must outlive the slot, such as `observations.copy()` for a replay buffer. A view keeps its memory alive,
    also without the environment. Python's lock is released while worlds are stepped; another thread that reads a view
    meanwhile sees a mixture of two slots.

    `copy.deepcopy` gives an environment in the same state, which goes on by itself: for tree search. `pickle` and `cloudpickle` give
    one for a worker: the same arguments, but worlds of a seed that the operating system draws, so that no two workers play the same
    ones; `reset(seed=...)` makes them repeatable. Worker threads do not survive a fork: what was made before with other than `threads=1`
    raises RuntimeError after it.

    Where the scenario replaces vehicles, `replaced` says whose index another vehicle has from this slot on. The agent ends there: its reward
    is for its own last age, and the observation in that row is the other one's.

    What an agent may know is what its unit does: `observations`, or the measurement that they encode (`gains_db`, `interference_db`,
    `places`, `assigned`, `weights`, `awaits`) and what it heard of the broadcasts (`ring_places`, `open_sub_channels`, `thresholds`,
    `gains_hold`). A vehicle whose modem measured nothing in a slot has zeros as observation and levels, and its action is silence.
    `ages`, `received` and `present` are the truth, which a unit may know late.

    Args:
        scenario: the cell; the paper's by default.
        worlds: how many.
        seed: which training worlds.
        slots: length of an episode in slots, or None for one without end.
        encoding: what `reset` and `step` return, the firmware's "int8" codes or these over 64 as "float32".
        reward: "own", minus the vehicle's own age after the slot, at most 100, over 100 slots; "team", the mean of these in its
            world; or "paper", minus the own age, at most 100, over the number of vehicles, plus 0.05 where it was received.
        mobility: "grid", a file of SUMO floating-car data (.xml, .xml.gz), or what `read_trace` made of it; an absent vehicle's
            values are 0, its place is -1, its action counts for nothing.
        threads: worker threads; one a core without it, and with 1 the caller's own.

    Raises:
        TypeError: an argument of another type.
        ValueError: an argument out of range, more than 4000 vehicles at once, more than 16 sub-channels, or a file that makes no
            sense.
        OSError: a file that cannot be read.
    """

    metadata: dict[str, Any] = {"autoreset_mode": AutoresetMode.DISABLED, "render_modes": []}
    """An episode that is over stays so until `reset`."""

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        worlds: SupportsIndex = 256,
        seed: SupportsIndex = 0,
        slots: SupportsIndex | None = 1000,
        encoding: Encoding = "int8",
        reward: Reward = "own",
        mobility: str | Trace = "grid",
        threads: SupportsIndex | None = None,
    ) -> None:
        scenario, trace = _arguments.scenario(scenario), mobility_of(mobility)
        worlds, slots = _arguments.whole("worlds", worlds, 1, MAX_WORLDS), _arguments.slots(slots)
        threads = _arguments.threads(threads)
        single = observation_space(encoding)
        self._batch = Batch(scenario, trace, worlds, _arguments.seed(seed), reward, threads)
        self._fresh = True
        self._arguments: dict[str, Any] = {
            "scenario": scenario,
            "worlds": worlds,
            "slots": slots,
            "encoding": encoding,
            "reward": reward,
            "mobility": trace or "grid",
            "threads": threads,
        }
        self.scenario: Scenario = scenario
        """The cell."""
        self.slots: int | None = slots
        """Length of an episode in slots; None for one without end."""
        self.encoding: Encoding = encoding
        self.worlds: int = self._batch.worlds
        """Number of worlds."""
        self.vehicles: int = self._batch.vehicles
        """Number of vehicles that ever appear in a world."""
        self.sub_channels: int = self._batch.sub_channels
        """Number of sub-channels."""
        self.gains_hold: bool = self._batch.gains_hold
        """Whether a gain as it was measured still says that a transmission will be received, as the base station broadcasts."""
        self.single_observation_space: spaces.Box = single
        """One vehicle's observation: int8 or float32 (22,)."""
        self.single_action_space: spaces.Discrete[Any] = spaces.Discrete(ACTIONS)
        """One vehicle's action."""
        self.observation_space: spaces.Box = observation_space(encoding, self.worlds, self.vehicles)
        """Everybody's observations: int8 or float32 (worlds, vehicles, 22)."""
        self.action_space: spaces.MultiDiscrete = spaces.MultiDiscrete(
            np.full((self.worlds, self.vehicles), ACTIONS)
        )
        """Everybody's actions: (worlds, vehicles)."""
        self._never: NDArray[np.bool_] = np.zeros(self.worlds, np.bool_)
        self._always: NDArray[np.bool_] = np.ones(self.worlds, np.bool_)
        for ends in (self._never, self._always):
            ends.flags.writeable = False

    def __reduce__(self) -> tuple[Any, ...]:
        return reopen, (type(self), self._arguments)

    def __deepcopy__(self, memo: dict[int, Any]) -> BatchEnvironment:
        same = type(self).__new__(type(self))
        memo[id(self)] = same
        for name, value in self.__dict__.items():
            same.__dict__[name] = value.copy() if isinstance(value, Batch) else copy.deepcopy(value, memo)
        for ends in (same._never, same._always):
            ends.flags.writeable = False
        return same

    def __repr__(self) -> str:
        return f"<BatchEnvironment: {self.worlds} worlds from {self.first_world} on, seed {self.seed}, {self.vehicles} vehicles>"

    def close(self) -> None:
        """Nothing to close."""

    def reset(
        self, *, seed: SupportsIndex | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begins an episode in worlds that were not seen before, or with a seed in that seed's first worlds. There are no options: what
        they hold means nothing.

        Returns the observations and an empty dictionary.
        """
        if seed is not None or not self._fresh:
            self._batch.reset(None if seed is None else _arguments.seed(seed))
        self._fresh = False
        return self._observed(), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Carries out everybody's action and begins the next slot.

        Args:
            actions: integers from 0 to 6, (worlds, vehicles). uint8 in C order is taken as it is, int64 too.

        Returns:
            observations (worlds, vehicles, 22); rewards, float32 (worlds, vehicles); terminations, bool (worlds,), always
            False, since worlds never end (`replaced` says which agents do); truncations, bool (worlds,), True once the episode's slots
            are over, and until `reset`; an empty dictionary.

        Raises:
            TypeError: actions that are no integers.
            ValueError: actions of another shape or out of range, or a trace at its end. Nothing is carried out then.
            RuntimeError: in a fork of the process that made the environment, if it has worker threads.
        """
        self._batch.step(_arguments.actions(actions))
        return self._after_slot()

    def transmit(
        self, sub_channels: ArrayLike, powers_dbm: ArrayLike
    ) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """`step` with free choice of sub-channel and power in place of the firmware's actions.

        Args:
            sub_channels: integers (worlds, vehicles), from 0 to one less than there are, or -1 for silence.
            powers_dbm: numbers (worlds, vehicles), -100 dBm to the scenario's full power; rounded down to 1/256 dB. Those of
                silent vehicles mean nothing.

        Raises:
            TypeError, ValueError: as `step`.
        """
        channels = _arguments.array("sub_channels", sub_channels, "iu", "whole numbers such as int8")
        if channels.size and (channels.min() < -1 or channels.max() >= self.sub_channels):
            # Before int8 could wrap it.
            worst = channels.min() if channels.min() < -1 else channels.max()
            raise ValueError(f"sub_channels: found {worst}, expected -1 (silent) to {self.sub_channels - 1}")
        powers = _arguments.array("powers_dbm", powers_dbm, "fiu", "numbers such as float32")
        for name, found in (("sub_channels", channels), ("powers_dbm", powers)):
            if found.ndim != 2:
                raise ValueError(f"{name}: found shape {found.shape}, expected (worlds, vehicles)")
        self._batch.transmit(
            np.ascontiguousarray(channels, dtype=np.int8), np.ascontiguousarray(powers, dtype=np.float32)
        )
        return self._after_slot()

    def check_table(self, table: Table) -> None:
        """Raises ValueError if the table was made for another C_min, or for fewer vehicles or sub-channels than these worlds have."""
        self._batch.check_table(table)

    def _observed(self) -> NDArray[Any]:
        return self.observations if self.encoding == "int8" else self.float_observations

    def _after_slot(
        self,
    ) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        self._fresh = False
        over = self.slots is not None and self._batch.elapsed >= self.slots
        return self._observed(), self._batch.rewards, self._never, self._always if over else self._never, {}

    @property
    def elapsed(self) -> int:
        """Slots since the last reset."""
        return self._batch.elapsed

    @property
    def seed(self) -> int:
        """The seed of the present worlds."""
        return self._batch.seed

    @property
    def first_world(self) -> int:
        """Index of the first of the present worlds; the others follow it."""
        return self._batch.first_world

    @property
    def observations(self) -> NDArray[np.int8]:
        """The firmware's encoded observations: int8 (worlds, vehicles, 22), in steps of 1/64."""
        return self._batch.observations

    @property
    def float_observations(self) -> NDArray[np.float32]:
        """The same over 64: float32 (worlds, vehicles, 22)."""
        return self._batch.float_observations

    @property
    def rewards(self) -> NDArray[np.float32]:
        """Rewards of the last slot: float32 (worlds, vehicles); "own" and "team" are -1 to -0.01."""
        return self._batch.rewards

    @property
    def replaced(self) -> NDArray[np.bool_]:
        """Whose index another vehicle has from this slot on: bool (worlds, vehicles). Everybody's reward is that of who acted before."""
        return self._batch.replaced

    @property
    def action_masks(self) -> NDArray[np.bool_]:
        """What each vehicle may do in this slot that is not in vain as far as its unit can tell: bool (worlds, vehicles, 7). Silence always
        is; another action is not where there is no sub-channel for it, so that it is silence, or where the measured level is
        below what a lone transmission at full power needs."""
        return self._batch.action_masks

    def positions_m(self, world: SupportsIndex) -> NDArray[np.float64]:
        """Where a world's vehicles are, east and north in metres: float64 (vehicles, 2), NaN for an absent one."""
        return self._batch.positions_m(_arguments.whole("world", world, 0, self.worlds - 1))

    @property
    def ages(self) -> NDArray[np.uint16]:
        """Ages of information at the beginning of the slot: uint16 (worlds, vehicles), 1 to 65535 slots of 1 ms, from 100 on."""
        return self._batch.ages

    @property
    def received(self) -> NDArray[np.bool_]:
        """Who was received in the slot before: bool (worlds, vehicles)."""
        return self._batch.received

    @property
    def present(self) -> NDArray[np.bool_]:
        """Who is in the cell: bool (vehicles,), the same in every world."""
        return self._batch.present

    @property
    def gains_db(self) -> NDArray[np.float32]:
        """Level at the base station at full power, this slot: float32 (worlds, vehicles, sub-channels), dB over noise."""
        return self._batch.gains_db

    @property
    def interference_db(self) -> NDArray[np.float32]:
        """Noise plus others' power in the slot before: float32 (worlds, vehicles, sub-channels), dB over noise."""
        return self._batch.interference_db

    @property
    def places(self) -> NDArray[np.int16]:
        """The place in the ring that each vehicle knows as its own: int16 (worlds, vehicles), -1 for none."""
        return self._batch.places

    @property
    def assigned(self) -> NDArray[np.bool_]:
        """Whether that was handed out at association, and not found: bool (worlds, vehicles)."""
        return self._batch.assigned

    @property
    def weights(self) -> NDArray[np.float32]:
        """What the base station weighs each vehicle's age with: float32 (worlds, vehicles), 1 as it is."""
        return self._batch.weights

    @property
    def awaits(self) -> NDArray[np.bool_]:
        """Whether an acknowledgement of what it sent may be under way: bool (worlds, vehicles)."""
        return self._batch.awaits

    @property
    def ring_places(self) -> NDArray[np.uint16]:
        """How many places the ring has, as each vehicle last heard: uint16 (worlds, vehicles), 0 where it never did."""
        return self._batch.ring_places

    @property
    def open_sub_channels(self) -> NDArray[np.bool_]:
        """Where anybody may contend in this slot, as each vehicle heard: bool (worlds, vehicles, sub-channels)."""
        return self._batch.open_sub_channels

    @property
    def thresholds(self) -> NDArray[np.uint32]:
        """The least priority with which to contend in this slot, as each vehicle heard: uint32 (worlds, vehicles); 2^32 - 1 calls nobody."""
        return self._batch.thresholds
