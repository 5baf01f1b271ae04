"""Many worlds as a Gymnasium `VectorEnv`, whose environments are vehicles."""

from __future__ import annotations

import copy
from typing import Any, SupportsIndex

import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from .._native import Scenario, Trace
from ..batch import ACTIONS, BatchEnvironment, Encoding, Reward, observation_space, reopen
from ._seats import Seats


class VectorEnvironment(VectorEnv[NDArray[Any], NDArray[Any], NDArray[Any]]):
    """`worlds` x vehicles environments, `[world][vehicle]` one after the other: every agent learns for itself, and all may share a network.

    Arguments are those of `BatchEnvironment`. An environment ends when its vehicle leaves the cell (termination: see
    `BatchEnvironment.replaced`) or its episode is over (truncation), and begins again in the same step (`AutoresetMode.SAME_STEP`); what
    was seen last is in `infos["final_obs"]`, at the rows that `infos["_final_obs"]` marks. `batch.action_masks` are the masks of actions.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        worlds: SupportsIndex = 256,
        seed: SupportsIndex = 0,
        slots: SupportsIndex | None = 1000,
        encoding: Encoding = "float32",
        reward: Reward = "own",
        mobility: str | Trace = "grid",
        threads: SupportsIndex | None = None,
    ) -> None:
        self.batch = BatchEnvironment(
            scenario,
            worlds=worlds,
            seed=seed,
            slots=slots,
            encoding=encoding,
            reward=reward,
            mobility=mobility,
            threads=threads,
        )
        self._seats = Seats(self.batch)
        self.num_envs = self._seats.count
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP, "render_modes": []}
        self.single_observation_space = observation_space(encoding)
        self.single_action_space = spaces.Discrete(ACTIONS)
        self.observation_space = observation_space(encoding, self.num_envs)
        self.action_space = spaces.MultiDiscrete(np.full(self.num_envs, ACTIONS))

    def __reduce__(self) -> tuple[Any, ...]:
        return reopen, (type(self), self.batch._arguments)

    def __deepcopy__(self, memo: dict[int, Any]) -> VectorEnvironment:
        same = type(self).__new__(type(self))
        memo[id(self)] = same
        same.__dict__.update(copy.deepcopy(self.__dict__, memo))
        return same

    def reset(
        self, *, seed: SupportsIndex | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[Any], dict[str, Any]]:
        """Begins all episodes anew, in other worlds or in the first ones of a seed; one for each environment is too many."""
        if isinstance(seed, list):
            raise TypeError(f"seed: found a list of {len(seed)}, expected one number for all worlds")
        return self._seats.reset(seed), {}

    def step(
        self, actions: NDArray[Any]
    ) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Carries out an action for each environment, (environments,)."""
        slot = self._seats.step(actions)
        infos: dict[str, Any] = {}
        if slot.last_observations is not None:
            ended = slot.terminated | slot.truncated
            infos = {"final_obs": slot.last_observations, "_final_obs": ended}
        return slot.observations, slot.rewards, slot.terminated, slot.truncated, infos
