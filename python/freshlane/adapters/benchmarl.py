"""Many worlds as a task of BenchMARL, for every algorithm of discrete actions there."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from benchmarl.environments.common import TaskClass
from torchrl.data import Composite
from torchrl.envs import EnvBase

from .torchrl import GROUP, TorchRLEnvironment


class FreshlaneTask(TaskClass):
    """Give it to an `Experiment`: worlds are the environments that it asks for, and its configuration is arguments of
    `TorchRLEnvironment` but `worlds` and `seed`, such as {"scenario": ..., "slots": 200, "reward": "team", "action_masks": True}.
    """

    def __init__(self, name: str = "cell", config: dict[str, Any] | None = None) -> None:
        super().__init__(name, {"slots": 1000, **(config or {})})

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: torch.device | str | int
    ) -> Callable[[], EnvBase]:
        """What makes an environment of so many worlds. A seed is one of the training worlds', for evaluations, too."""
        return lambda: TorchRLEnvironment(worlds=num_envs, seed=seed or 0, **self.config).to(device)

    def supports_continuous_actions(self) -> bool:
        """No."""
        return False

    def supports_discrete_actions(self) -> bool:
        """Yes."""
        return True

    def max_steps(self, env: EnvBase) -> int:
        """Slots of an episode."""
        return int(self.config["slots"])

    def has_render(self, env: EnvBase) -> bool:
        """No."""
        return False

    def group_map(self, env: EnvBase) -> dict[str, list[str]]:
        """All vehicles are one group."""
        return {GROUP: [f"vehicle_{vehicle}" for vehicle in range(env.action_spec[GROUP, "action"].shape[-1])]}

    def observation_spec(self, env: EnvBase) -> Composite:
        """Of the group's "observation"."""
        return self._only(env.full_observation_spec_unbatched, "observation")

    def action_mask_spec(self, env: EnvBase) -> Composite | None:
        """Of the group's "action_mask", where the configuration asks for masks."""
        masked = "action_mask" in env.observation_spec[GROUP].keys()
        return self._only(env.full_observation_spec_unbatched, "action_mask") if masked else None

    def action_spec(self, env: EnvBase) -> Composite:
        """Of the group's "action"."""
        return env.full_action_spec_unbatched

    def state_spec(self, env: EnvBase) -> Composite | None:
        """There is no state beside the observations: central critics see all of these."""
        return None

    def info_spec(self, env: EnvBase) -> Composite | None:
        """No infos."""
        return None

    @staticmethod
    def env_name() -> str:
        """The environment's name in results."""
        return "freshlane"

    @staticmethod
    def _only(spec: Composite, kept: str) -> Composite:
        spec = spec.clone()
        for key in list(spec[GROUP].keys()):
            if key != kept:
                del spec[GROUP, key]
        return spec
