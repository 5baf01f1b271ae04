"""Many worlds as a `VecEnv` of Stable-Baselines3, whose environments are vehicles."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from types import MappingProxyType
from typing import Any, SupportsIndex

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from .._native import Scenario, Trace
from ..batch import ACTIONS, BatchEnvironment, Encoding, Reward, observation_space, reopen
from ._seats import Seats

NOTHING: Any = MappingProxyType({})
"""What there is to tell of an environment that goes on; nobody can write into it, so all share it."""


class VecEnvironment(VecEnv):
    """`worlds` x vehicles environments, `[world][vehicle]` one after the other: every agent learns for itself, and all share a network.

    Arguments are those of `BatchEnvironment`. An environment is done when its vehicle leaves the cell (see `BatchEnvironment.replaced`), or
    when its episode is over, which "TimeLimit.truncated" says; its info then has the "terminal_observation". sb3-contrib's masking learners find
    `action_masks`.
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
        self._actions: NDArray[Any] = np.zeros(self._seats.count, np.uint8)
        self.metadata: dict[str, Any] = {"render_modes": []}
        self.render_mode = None
        super().__init__(self._seats.count, observation_space(encoding), spaces.Discrete(ACTIONS))

    def __reduce__(self) -> tuple[Any, ...]:
        return reopen, (type(self), self.batch._arguments)

    def reset(self) -> NDArray[Any]:
        """Begins all episodes anew, in other worlds or, after `seed`, in that seed's first."""
        seed = self._seeds[0]
        self._reset_seeds()
        self._reset_options()
        return self._seats.reset(seed)

    def step_async(self, actions: NDArray[Any]) -> None:
        """Takes an action for each environment, (environments,)."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray[Any], NDArray[np.float32], NDArray[np.bool_], list[dict[str, Any]]]:
        """Carries them out."""
        slot = self._seats.step(self._actions)
        infos: list[dict[str, Any]] = [NOTHING] * self.num_envs
        if slot.last_observations is None:
            return slot.observations, slot.rewards, slot.terminated, infos
        done = slot.terminated | slot.truncated
        for index in done.nonzero()[0].tolist():
            infos[index] = {
                "terminal_observation": slot.last_observations[index],
                "TimeLimit.truncated": bool(slot.truncated[index]),
            }
        return slot.observations, slot.rewards, done, infos

    def close(self) -> None:
        """Nothing to close."""

    def action_masks(self) -> NDArray[np.bool_]:
        """`BatchEnvironment.action_masks`, (environments, 7)."""
        return self.batch.action_masks.reshape(self.num_envs, ACTIONS).copy()

    def get_attr(self, attr_name: str, indices: None | int | Iterable[int] = None) -> list[Any]:
        """An attribute, the same of each environment."""
        value = getattr(self, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: None | int | Iterable[int] = None) -> None:
        """Environments have no attributes of their own.

        Raises AttributeError.
        """
        raise AttributeError(f"{attr_name}: found an attribute for single environments, expected none")

    def env_method(
        self, method_name: str, *method_args: Any, indices: None | int | Iterable[int] = None, **method_kwargs: Any
    ) -> list[Any]:
        """Of "action_masks" each environment's row; other methods are of all environments together.

        Raises AttributeError for another one.
        """
        if method_name != "action_masks":
            raise AttributeError(f'{method_name}: found a method for single environments, expected "action_masks"')
        masks = self.action_masks()
        return [masks[index] for index in self._get_indices(indices)]

    def env_is_wrapped(
        self, wrapper_class: type[Any], indices: None | int | Iterable[int] = None
    ) -> list[bool]:
        """No single environment is wrapped."""
        return [False for _ in self._get_indices(indices)]

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """No pictures."""
        return [None] * self.num_envs
