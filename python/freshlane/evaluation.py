"""Policies on held-out worlds, with the command line's protocol and numbers."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any, Literal, Protocol, SupportsIndex, TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arguments
from ._native import Batch, Evaluation, Scenario, Table, Trace, evaluate_policy, policies
from .batch import ACTIONS
from .trace import mobility_of

POLICIES: dict[str, str] = dict(policies())
"""The simulator's own policies with what each does; "actor" is the shipped table."""

PolicyName = Literal[
    "actor",
    "central",
    "clock",
    "assigned",
    "grants",
    "max-weight",
    "sps",
    "age-threshold",
    "aloha",
    "random",
    "always",
]
"""The names in `POLICIES`, for type checkers."""

Policy = Callable[[NDArray[np.int8]], ArrayLike]


class Module(Protocol):
    """A torch module, for type checkers: they need no torch."""

    def parameters(self) -> Iterator[Any]: ...

    def __call__(self, *args: Any, **kwargs: Any) -> Any: ...


def evaluate(
    policy: PolicyName | Table | Policy | Module,
    scenario: Scenario | None = None,
    *,
    worlds: SupportsIndex = 256,
    slots: SupportsIndex = 2000,
    warmup: SupportsIndex = 500,
    seed: SupportsIndex = 1,
    mobility: str | Trace = "grid",
    threads: SupportsIndex | None = None,
) -> Evaluation:
    """Runs a policy on held-out worlds; no training world is among them, whatever the seeds.

    Named policies and tables are run by the simulator itself: numbers equal `host-sim run`'s to the last digit. A callable is
    asked in every slot and steps the same worlds; the numbers are the same for the same decisions.

    Args:
        policy: one of `POLICIES`; a `Table`; a torch module, which gets float32 observations over 64, (rows, 22), and gives
            scores (rows, 7) of which the largest wins; or a function that gets int8 observations (worlds, vehicles, 22), a
            read-only view that changes with the next slot, and gives actions (worlds, vehicles).
        scenario: the cell; the paper's by default.
        worlds: independent worlds, 1 to 1,000,000.
        slots: slots of 1 ms that count.
        warmup: slots before them.
        seed: which held-out worlds.
        mobility: "grid", a file of SUMO floating-car data (.xml, .xml.gz), or what `read_trace` made of it.
        threads: worker threads; one a core without it. The numbers do not depend on it.

    Raises:
        TypeError: a policy that is none of these, or one that gives no integers.
        ValueError: an argument out of range, a table for another C_min or for fewer vehicles or sub-channels, or actions
            of another shape or out of range.
    """
    scenario, trace = _arguments.scenario(scenario), mobility_of(mobility)
    worlds, slots, warmup = (
        _arguments.whole(name, value, 0, 2**32 - 1)
        for name, value in (("worlds", worlds), ("slots", slots), ("warmup", warmup))
    )
    seed, threads = _arguments.seed(seed), _arguments.threads(threads)
    if isinstance(policy, str):
        return evaluate_policy(policy, Table.shipped(), scenario, trace, worlds, slots, warmup, seed, threads)
    if isinstance(policy, Table):
        return evaluate_policy("actor", policy, scenario, trace, worlds, slots, warmup, seed, threads)
    if not callable(policy):
        expected = "a name, a Table, a torch module or a function"
        raise TypeError(f"policy: found {type(policy).__name__}, expected {expected}")
    batch = Batch.held_out(scenario, trace, worlds, slots, warmup, seed, threads)
    act = _module_policy(policy, batch) if _is_module(policy) else policy
    for _ in range(warmup + slots):
        batch.step(_arguments.actions(act(batch.observations)))
    return batch.summary(getattr(policy, "__name__", type(policy).__name__))


def _is_module(policy: object) -> TypeGuard[Module]:
    """Whether it is a torch module. Whoever has one has imported torch."""
    torch = sys.modules.get("torch")
    return torch is not None and isinstance(policy, torch.nn.Module)


def _module_policy(module: Module, batch: Batch) -> Policy:
    """The module's best-scored actions."""
    import torch

    parameter = next(module.parameters(), None)
    device = "cpu" if parameter is None else parameter.device

    def act(observations: NDArray[np.int8]) -> ArrayLike:
        shape = observations.shape[:-1]
        # Copied: torch has no read-only tensors.
        inputs = torch.tensor(batch.float_observations).reshape(-1, observations.shape[-1])
        with torch.no_grad():
            scores = module(inputs.to(device))
        if tuple(scores.shape) != (len(inputs), ACTIONS):
            found = tuple(scores.shape)
            raise ValueError(f"policy: found scores of shape {found}, expected ({len(inputs)}, {ACTIONS})")
        best: NDArray[np.int64] = scores.argmax(dim=-1).cpu().numpy()
        return best.reshape(shape)

    return act
