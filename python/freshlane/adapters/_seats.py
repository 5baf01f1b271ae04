"""A batch whose every vehicle is an environment of its own, for libraries that know no agents."""

from __future__ import annotations

from typing import Any, NamedTuple, SupportsIndex

import numpy as np
from numpy.typing import NDArray

from ..batch import INPUTS, BatchEnvironment


class Slot(NamedTuple):
    """What a slot was for every vehicle; rows are `[world][vehicle]`, one after the other, in memory of their own."""

    observations: NDArray[Any]
    """Of what goes on: whoever ended is followed by the first observation of who comes next."""
    rewards: NDArray[np.float32]
    terminated: NDArray[np.bool_]
    """Its vehicle left the cell."""
    truncated: NDArray[np.bool_]
    """The episode's slots are over for who did not leave."""
    last_observations: NDArray[Any] | None
    """Of those who ended, the last that they made; other rows mean nothing. None where nobody ended."""


class Seats:
    """Steps a batch, and begins the next episode as soon as one is over."""

    def __init__(self, batch: BatchEnvironment) -> None:
        self.batch = batch
        self.count = batch.worlds * batch.vehicles
        self._observations = self._copy()
        self._present = batch.present.copy()
        self._nobody = np.zeros(self.count, np.bool_)
        self._nobody.flags.writeable = False

    def _copy(self) -> NDArray[Any]:
        return self.batch._observed().reshape(self.count, INPUTS).copy()

    def reset(self, seed: SupportsIndex | None = None) -> NDArray[Any]:
        """The first observations of the next worlds, or of a seed's first."""
        self.batch.reset(seed=seed)
        return self._begin()

    def _begin(self) -> NDArray[Any]:
        self._present = self.batch.present.copy()
        self._observations = self._copy()
        return self._observations

    def step(self, actions: NDArray[Any]) -> Slot:
        """Carries out an action for each vehicle."""
        batch, before = self.batch, self._observations
        _, rewards, _, truncations, _ = batch.step(np.reshape(actions, (batch.worlds, batch.vehicles)))
        paid = rewards.ravel().copy()
        self._observations = self._copy()
        left = batch.replaced | (self._present & ~batch.present)
        self._present = batch.present.copy()
        over = bool(truncations[0])
        if not over and not left.any():
            return Slot(self._observations, paid, self._nobody, self._nobody, None)
        terminated = left.ravel()
        truncated = ~terminated if over else self._nobody
        last = np.where(terminated[:, np.newaxis], before, self._observations)
        if over:
            batch.reset()
            self._begin()
        return Slot(self._observations, paid, terminated, truncated, last)
