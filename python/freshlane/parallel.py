"""One world as a PettingZoo `ParallelEnv`: one agent a vehicle."""

from __future__ import annotations

import copy
import math
from typing import Any, SupportsIndex, get_args

import numpy as np
from gymnasium import logger, spaces
from numpy.typing import NDArray
from pettingzoo import AECEnv, ParallelEnv  # type: ignore[import-untyped]
from pettingzoo.utils import parallel_to_aec  # type: ignore[import-untyped]

from . import _arguments, _picture
from ._native import Scenario
from .batch import ACTIONS, BatchEnvironment, Encoding, RenderMode, Reward, observation_space, reopen

Observations = dict[str, NDArray[Any]]
Infos = dict[str, dict[str, Any]]


class ParallelEnvironment(ParallelEnv):  # type: ignore[misc]
    """One world on the urban grid; agents are called "vehicle_0" and so on.

    Observations are the firmware's 22 inputs, actions its 7 actions, rewards minus an age (see `BatchEnvironment`, whose
    arguments these are). `infos` has each agent's "age_ms", whether it was "received", whether it was "replaced", and the "action_mask"
    of `BatchEnvironment.action_masks`. Worlds are training worlds: a reset without a seed goes on to the next one of the seed in use.
    Observations are copies: agents may keep them.

    Agents stay to the episode's end unless the scenario replaces vehicles ("cell.replacement_probability"). Then an agent whose vehicle
    leaves is terminated, with the reward for its own last age and the last observation that it made, and whoever comes is a new agent with
    a number that nobody had before in the episode. `possible_agents` has enough numbers for all but one episode in a million; where they
    run out, the episode is truncated.

    `copy.deepcopy` goes on from the same state, `pickle` gives a worker other worlds, as for a `BatchEnvironment`.

    Args:
        scenario, seed, encoding, reward: as of `BatchEnvironment`.
        slots: length of an episode in slots of 1 ms.
        max_cycles: the same under PettingZoo's name; it goes first.
        render_mode: "rgb_array", with which `render` gives a picture, or None.

    Raises:
        TypeError, ValueError: as `BatchEnvironment`.
    """

    metadata: dict[str, Any] = {
        "name": "freshlane_v0",
        "render_modes": list(get_args(RenderMode)),
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        seed: SupportsIndex = 0,
        slots: SupportsIndex = 1000,
        encoding: Encoding = "float32",
        reward: Reward = "own",
        max_cycles: SupportsIndex | None = None,
        render_mode: RenderMode | None = None,
    ) -> None:
        length = _arguments.slots(slots if max_cycles is None else max_cycles, "slots" if max_cycles is None else "max_cycles")
        if render_mode is not None:
            _arguments.choice("render_mode", render_mode, get_args(RenderMode))
        self._batch = BatchEnvironment(
            scenario, worlds=1, seed=seed, slots=length, encoding=encoding, reward=reward, threads=1
        )
        scenario = self._batch.scenario
        self._arguments: dict[str, Any] = {
            "scenario": scenario,
            "slots": length,
            "encoding": encoding,
            "reward": reward,
            "render_mode": render_mode,
        }
        self.render_mode: str | None = render_mode
        self.possible_agents: list[str] = [
            f"vehicle_{number}" for number in range(self._batch.vehicles + _newcomers(scenario, length or 0))
        ]
        self.agents: list[str] = []
        self._next = 0
        self._replaces = scenario["cell.replacement_probability"] > 0
        self._state: NDArray[Any] = self._batch._observed()[0].copy()
        # The same objects for every call: what a user seeds stays seeded.
        self.observation_spaces: dict[str, spaces.Space[Any]] = {
            agent: observation_space(encoding) for agent in self.possible_agents
        }
        self.action_spaces: dict[str, spaces.Space[Any]] = {
            agent: spaces.Discrete(ACTIONS) for agent in self.possible_agents
        }
        self.state_space: spaces.Box = observation_space(encoding, self._batch.vehicles)
        """What `state` gives: int8 or float32 (vehicles, 22)."""

    def __reduce__(self) -> tuple[Any, ...]:
        return reopen, (type(self), self._arguments)

    def __deepcopy__(self, memo: dict[int, Any]) -> ParallelEnvironment:
        same = type(self).__new__(type(self))
        memo[id(self)] = same
        same.__dict__.update(copy.deepcopy(self.__dict__, memo))
        return same

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """One agent's observations: int8 or float32 (22,)."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """One agent's actions: 0 to 6."""
        return self.action_spaces[agent]

    def reset(
        self, seed: SupportsIndex | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observations, Infos]:
        """Begins an episode in the next world, or in the first one of a seed. There are no options: what they hold means nothing."""
        observed, _ = self._batch.reset(seed=seed, options=options)
        self._state = observed[0].copy()
        # One agent a vehicle, in the order of the vehicles.
        self.agents = self.possible_agents[: self._batch.vehicles]
        self._next = len(self.agents)
        return dict(zip(self.agents, self._state, strict=True)), self._infos()

    def step(
        self, actions: dict[str, int]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Carries out one action for every agent.

        Raises ValueError for a missing or unknown agent and for an action out of range, TypeError for one that is no integer.
        """
        agents = self.agents
        try:
            row = [actions[agent] for agent in agents]
        except KeyError as missing:
            raise ValueError(f'actions: found none for "{missing.args[0]}", expected one for each of env.agents') from None
        if len(row) != len(actions):
            unknown = next(agent for agent in actions if agent not in agents)
            raise ValueError(f'actions: found agent "{unknown}", expected one of env.agents')
        if not agents:
            return {}, {}, {}, {}, {}
        batch = self._batch
        before, ages_before = self._state, batch.ages[0].tolist() if self._replaces else []
        try:
            # What is no byte is no action; whoever reads it as an array says what it is.
            array: NDArray[Any] = np.frombuffer(bytes(row), np.uint8)
        except (TypeError, ValueError):
            array = np.asarray(row)
        observed, rewards, _, truncations, _ = batch.step(array[np.newaxis])
        self._state = observed[0].copy()
        observations = dict(zip(agents, self._state, strict=True))
        paid: dict[str, float] = dict(zip(agents, rewards[0].tolist(), strict=True))
        over = bool(truncations[0])
        terminated, truncated = dict.fromkeys(agents, False), dict.fromkeys(agents, over)
        infos = self._infos()
        replaced = batch.replaced[0].nonzero()[0].tolist() if self._replaces else ()
        staying = list(agents)
        for vehicle in replaced:
            agent = agents[vehicle]
            age = 1 if infos[agent]["received"] else ages_before[vehicle] + 1
            come = infos[agent] | {"received": False}
            observations[agent] = before[vehicle]
            terminated[agent], truncated[agent] = True, False
            infos[agent] |= {"age_ms": age, "replaced": True}
            if self._next == len(self.possible_agents):
                over = True
                staying[vehicle] = ""
                continue
            newcomer = staying[vehicle] = self.possible_agents[self._next]
            self._next += 1
            observations[newcomer], infos[newcomer] = self._state[vehicle], come
            paid[newcomer], terminated[newcomer], truncated[newcomer] = 0.0, False, over
        if over:
            truncated = {agent: not terminated[agent] for agent in truncated}
        self.agents = [] if over else staying
        return observations, paid, terminated, truncated, infos

    def state(self) -> NDArray[Any]:
        """All vehicles' observations: int8 or float32 (vehicles, 22)."""
        return self._state.copy()

    def render(self) -> NDArray[np.uint8] | None:
        """The cell from above, uint8 (height, width, 3): streets, the base station, and vehicles from green for an age of 1 ms to red for
        100 ms and more; a ring of white around who was just received. None without a render mode."""
        if self.render_mode is None:
            logger.warn('render without a mode: make the environment with render_mode="rgb_array"')
            return None
        return _picture.draw(self._batch.scenario, self._batch.positions_m(0), self._batch.ages[0], self._batch.received[0])

    def close(self) -> None:
        """Nothing to close."""

    def _infos(self) -> Infos:
        batch = self._batch
        known = zip(self.agents, batch.ages[0].tolist(), batch.received[0].tolist(), batch.action_masks[0].view(np.int8).copy(), strict=True)
        return {
            agent: {"age_ms": age, "received": received, "replaced": False, "action_mask": mask}
            for agent, age, received, mask in known
        }


def _newcomers(scenario: Scenario, slots: int) -> int:
    """How many numbers newcomers of an episode have: five standard deviations above the mean, and a few."""
    mean = scenario["cell.replacement_probability"] * scenario["cell.vehicles"] * slots
    return math.ceil(mean + 5 * math.sqrt(mean) + 5) if mean > 0 else 0


def parallel_env(
    scenario: Scenario | None = None,
    *,
    seed: SupportsIndex = 0,
    slots: SupportsIndex = 1000,
    encoding: Encoding = "float32",
    reward: Reward = "own",
    max_cycles: SupportsIndex | None = None,
    render_mode: RenderMode | None = None,
) -> ParallelEnvironment:
    """`ParallelEnvironment` under the name that PettingZoo's tools call."""
    return ParallelEnvironment(
        scenario,
        seed=seed,
        slots=slots,
        encoding=encoding,
        reward=reward,
        max_cycles=max_cycles,
        render_mode=render_mode,
    )


def env(
    scenario: Scenario | None = None,
    *,
    seed: SupportsIndex = 0,
    slots: SupportsIndex = 1000,
    encoding: Encoding = "float32",
    reward: Reward = "own",
    max_cycles: SupportsIndex | None = None,
    render_mode: RenderMode | None = None,
) -> AECEnv:
    """The same as a PettingZoo `AECEnv`, whose agents act one after the other."""
    return parallel_to_aec(
        parallel_env(
            scenario,
            seed=seed,
            slots=slots,
            encoding=encoding,
            reward=reward,
            max_cycles=max_cycles,
            render_mode=render_mode,
        )
    )
