"""One world as a PettingZoo `ParallelEnv`: one agent a vehicle."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray
from pettingzoo import ParallelEnv  # type: ignore[import-untyped]

from ._native import Scenario
from .batch import ACTIONS, BatchEnvironment, Encoding, Reward, observation_space

Observations = dict[str, NDArray[Any]]
Infos = dict[str, dict[str, Any]]


class ParallelEnvironment(ParallelEnv):  # type: ignore[misc]
    """One world on the urban grid; agents are called "vehicle_0" and so on, and all of them stay to the episode's end.

    Observations are the firmware's 20 inputs, actions its 6 actions, rewards minus an age (see `BatchEnvironment`, whose
    arguments these are). `infos` has each agent's "age_ms" and whether it was "received". Worlds are training worlds: a reset
    without a seed goes on to the next one of the seed in use. Observations are copies: agents may keep them.
    """

    metadata: dict[str, Any] = {"name": "freshlane_v0", "render_modes": [], "is_parallelizable": True}
    render_mode: str | None = None

    def __init__(
        self,
        scenario: Scenario | None = None,
        *,
        seed: int = 0,
        slots: int = 1000,
        encoding: Encoding = "float32",
        reward: Reward = "own",
    ) -> None:
        self._batch = BatchEnvironment(
            scenario, worlds=1, seed=seed, slots=slots, encoding=encoding, reward=reward, threads=1
        )
        self.possible_agents: list[str] = [f"vehicle_{vehicle}" for vehicle in range(self._batch.vehicles)]
        self.agents: list[str] = []
        # The same objects for every call: what a user seeds stays seeded.
        self.observation_spaces: dict[str, spaces.Space[Any]] = {
            agent: observation_space(encoding) for agent in self.possible_agents
        }
        self.action_spaces: dict[str, spaces.Space[Any]] = {
            agent: spaces.Discrete(ACTIONS) for agent in self.possible_agents
        }

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """One agent's observations: int8 or float32 (20,)."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """One agent's actions: 0 to 5."""
        return self.action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observations, Infos]:
        """Begins an episode in the next world, or in the first one of a seed. There are no options."""
        self._batch.reset(seed=seed)
        self.agents = list(self.possible_agents)
        return self._observations(), self._infos()

    def step(
        self, actions: dict[str, int]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Carries out one action for every agent.

        Raises ValueError for a missing or unknown agent and for an action out of range, TypeError for one that is no integer.
        """
        for agent in actions:
            if agent not in self.agents:
                raise ValueError(f'actions: found agent "{agent}", expected one of env.agents')
        for agent in self.agents:
            if agent not in actions:
                raise ValueError(f'actions: found none for "{agent}", expected one for each of env.agents')
        if not self.agents:
            return {}, {}, {}, {}, {}
        row = np.asarray([actions[agent] for agent in self.agents])[np.newaxis]
        _, rewards, _, truncations, _ = self._batch.step(row)
        agents = self.agents
        over = bool(truncations[0])
        results = (
            self._observations(),
            {agent: float(reward) for agent, reward in zip(agents, rewards[0], strict=True)},
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, over),
            self._infos(),
        )
        if over:
            self.agents = []
        return results

    def state(self) -> NDArray[Any]:
        """All agents' observations: int8 or float32 (vehicles, 20)."""
        state: NDArray[Any] = self._batch._observed()[0].copy()
        return state

    def render(self) -> None:
        """Nothing to see: there are no render modes."""

    def close(self) -> None:
        """Nothing to close."""

    def _observations(self) -> Observations:
        return dict(zip(self.agents, self.state(), strict=True))

    def _infos(self) -> Infos:
        ages, received = self._batch.ages[0].tolist(), self._batch.received[0].tolist()
        return {
            agent: {"age_ms": ages[vehicle], "received": received[vehicle]}
            for vehicle, agent in enumerate(self.agents)
        }


def parallel_env(scenario: Scenario | None = None, **arguments: Any) -> ParallelEnvironment:
    """`ParallelEnvironment` under the name that PettingZoo's tools call."""
    return ParallelEnvironment(scenario, **arguments)
