"""Many worlds as a TorchRL environment: its batch is worlds, its one group of agents is "vehicles"."""

from __future__ import annotations

from typing import Any, SupportsIndex

import torch
from numpy.typing import NDArray
from tensordict import TensorDict, TensorDictBase
from torchrl.data import Binary, Bounded, Categorical, Composite, Unbounded
from torchrl.envs import EnvBase

from .. import _arguments
from .._native import Scenario, Trace
from ..batch import ACTIONS, INPUTS, BatchEnvironment, Reward

GROUP = "vehicles"
"""Key of the agents' entries."""


class TorchRLEnvironment(EnvBase):
    """Entries of the group, (worlds, vehicles, ...): "observation", float32 (22); "action", int64 without a dimension; "reward" (1); "done",
    "terminated" and "truncated" (1), of each agent. With `action_masks` also "action_mask", bool (7): see `BatchEnvironment.action_masks`.

    The other arguments are those of `BatchEnvironment`. An agent is terminated when its vehicle leaves the cell (see
    `BatchEnvironment.replaced`), and the next observation in its row is that of who comes. All worlds are truncated together, when the
    episode's slots are over; only then the environment itself is done and resets, to the next worlds.
    """

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        worlds: SupportsIndex = 256,
        seed: SupportsIndex = 0,
        slots: SupportsIndex | None = 1000,
        reward: Reward = "own",
        mobility: str | Trace = "grid",
        threads: SupportsIndex | None = None,
        action_masks: bool = False,
    ) -> None:
        batch = BatchEnvironment(
            scenario,
            worlds=worlds,
            seed=seed,
            slots=slots,
            encoding="float32",
            reward=reward,
            mobility=mobility,
            threads=threads,
        )
        super().__init__(device="cpu", batch_size=(batch.worlds,))
        self.batch = batch
        self._masks = action_masks
        self._seed: int | None = None
        self._never = torch.zeros(batch.worlds, 1, dtype=torch.bool)
        self._always = torch.ones(batch.worlds, 1, dtype=torch.bool)
        self._nobody = torch.zeros(batch.worlds, batch.vehicles, 1, dtype=torch.bool)
        self._present = batch.present.copy()
        each, whole = (batch.worlds, batch.vehicles), (batch.worlds,)
        observed: dict[str, Any] = {"observation": Bounded(-2.0, 2.0, (*each, INPUTS), dtype=torch.float32)}
        if action_masks:
            observed["action_mask"] = Binary(ACTIONS, (*each, ACTIONS), dtype=torch.bool)
        self.observation_spec = Composite({GROUP: Composite(observed, shape=each)}, shape=whole)
        actions = Categorical(ACTIONS, each, dtype=torch.int64)
        self.action_spec = Composite({GROUP: Composite(action=actions, shape=each)}, shape=whole)
        rewards = Unbounded((*each, 1), dtype=torch.float32)
        self.reward_spec = Composite({GROUP: Composite(reward=rewards, shape=each)}, shape=whole)
        names = ("done", "terminated", "truncated")
        mine = {name: Binary(1, (*each, 1), dtype=torch.bool) for name in names}
        ends: dict[str, Any] = {name: Binary(1, (*whole, 1), dtype=torch.bool) for name in names}
        self.done_spec = Composite({GROUP: Composite(mine, shape=each)} | ends, shape=whole)

    def _set_seed(self, seed: int | None) -> None:
        self._seed = None if seed is None else _arguments.seed(seed)

    def _observed(self) -> dict[str, torch.Tensor]:
        observed = {"observation": torch.from_numpy(self.batch.float_observations.copy())}
        if self._masks:
            observed["action_mask"] = torch.from_numpy(self.batch.action_masks.copy())
        return observed

    def _told(self, agents: dict[str, torch.Tensor], over: torch.Tensor) -> TensorDictBase:
        """What an agent's entries and the worlds' end make together."""
        batch = self.batch
        group = TensorDict(agents, (batch.worlds, batch.vehicles))
        ends = {"done": over, "terminated": self._never, "truncated": over}
        return TensorDict({GROUP: group, **ends}, self.batch_size)

    def _reset(self, tensordict: TensorDictBase | None, **_: Any) -> TensorDictBase:
        """Begins the next worlds, or the first of the seed that was set.

        Raises ValueError for some of the worlds alone.
        """
        asked = None if tensordict is None else tensordict.get("_reset", None)
        if asked is not None and not asked.all():
            raise ValueError(f"reset: found {int(asked.sum())} of {self.batch.worlds} worlds, expected all of them")
        self.batch.reset(seed=self._seed)
        self._seed = None
        self._present = self.batch.present.copy()
        nobody = self._nobody
        return self._told(
            {**self._observed(), "done": nobody, "terminated": nobody, "truncated": nobody}, self._never
        )

    def _step_proc_data(self, next_tensordict_out: TensorDictBase) -> TensorDictBase:
        """Nothing to complete: a step has all entries in their shapes. The check is a fifth of its time."""
        return next_tensordict_out

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        batch = self.batch
        actions: NDArray[Any] = tensordict.get((GROUP, "action")).numpy()
        _, rewards, _, truncations, _ = batch.step(actions)
        left = batch.replaced | (self._present & ~batch.present)
        self._present = batch.present.copy()
        over = bool(truncations[0])
        terminated = torch.from_numpy(left).unsqueeze(-1) if left.any() else self._nobody
        truncated = ~terminated if over else self._nobody
        agents = {
            **self._observed(),
            "reward": torch.from_numpy(rewards.copy()).unsqueeze(-1),
            "done": terminated | truncated,
            "terminated": terminated,
            "truncated": truncated,
        }
        return self._told(agents, self._always if over else self._never)
