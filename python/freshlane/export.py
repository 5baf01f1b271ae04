"""A float network as a firmware table."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arguments
from ._native import FloatNetwork, Scenario, Table

Layers = list[tuple[NDArray[np.float32], NDArray[np.float32]]]


@dataclass(frozen=True)
class Export:
    """A table, and how it compares with its float network on held-out worlds."""

    table: Table
    """What a unit runs."""
    agreement: float
    """Fraction of decisions on which float and int8 agree, along the float network's trajectories."""
    float_age_ms: float
    """Mean age of information with the float network."""
    int8_age_ms: float
    """Mean age of information with the table."""
    worlds: int
    """Held-out worlds, as all of the following."""
    slots: int
    """Slots that count."""
    warmup: int
    """Slots before them."""
    seed: int
    """Seed of the held-out worlds."""


def export(
    network: Any,
    scenario: Scenario | None = None,
    *,
    max_vehicles: int | None = None,
    seed: int = 0,
    calibration: ArrayLike | None = None,
    worlds: int = 64,
    slots: int = 1000,
    warmup: int = 500,
    evaluation_seed: int = 1,
    threads: int | None = None,
) -> Export:
    """Quantises a network with the trainer's quantiser, and compares float and int8 on held-out worlds.

    Args:
        network: dense layers with ReLU between them, 22 inputs (observations over 64) and 7 outputs, at most 4 layers: a torch
            module made of `Linear` and `ReLU` (in `Sequential`s), or pairs of arrays, weights (outputs, inputs) and biases
            (outputs,), from the input on.
        scenario: whose C_min and number of sub-channels the table serves; the paper's by default.
        max_vehicles: most vehicles in a cell that the table may serve; the scenario's without it.
        seed: of the training, kept in the table; also of the training worlds that calibrate the activations.
        calibration: encoded observations, int8 (rows, 22), whose largest activations set the int8 scales. Without it: those of
            32 training worlds x 400 slots in which the network decides.
        worlds, slots, warmup, evaluation_seed: the held-out worlds of the comparison.
        threads: worker threads; one a core without it.

    Raises:
        TypeError: a network of other modules or types.
        ValueError: layers that do not fit each other or the firmware, or parameters that the integers cannot hold.
    """
    scenario = scenario or Scenario()
    floats = FloatNetwork(layers_of(network))
    if calibration is None:
        rows = floats.calibration(scenario, seed)
    else:
        rows = _arguments.array("calibration", calibration, "i", "int8")
        if rows.dtype != np.int8:
            raise TypeError(f"calibration: found an array of {rows.dtype}, expected int8")
        if not rows.size:
            raise ValueError("calibration: found no observations, expected at least one")
        rows = np.ascontiguousarray(rows)
    if max_vehicles is None:
        max_vehicles = int(scenario["cell.vehicles"])
    table = floats.quantise(scenario, rows, max_vehicles, seed)
    agreement, int8_age_ms, float_age_ms = floats.compare(
        table, scenario, worlds, slots, warmup, evaluation_seed, threads
    )
    return Export(table, agreement, float_age_ms, int8_age_ms, worlds, slots, warmup, evaluation_seed)


def layers_of(network: Any) -> Layers:
    """Weights and biases of a network's layers, from the input on.

    Raises TypeError for a torch module with other parts than `Linear` and `ReLU`, ValueError for ReLUs at other places than between
    layers.
    """
    if hasattr(network, "named_children"):
        return _of_module(network)
    if not isinstance(network, Iterable):
        expected = "a torch module, or pairs of weights and biases"
        raise TypeError(f"network: found {type(network).__name__}, expected {expected}")
    return [_layer(index, pair) for index, pair in enumerate(network)]


def _layer(index: int, pair: Any) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    name = f"network: layer {index}"
    try:
        weights, biases = pair
    except (TypeError, ValueError):
        raise TypeError(f"{name}: found {type(pair).__name__}, expected a pair of weights and biases") from None
    matrix = _arguments.array(f"{name} weights", weights, "f", "numbers such as float32")
    vector = _arguments.array(f"{name} biases", biases, "f", "numbers such as float32")
    for what, found, dimensions in (("weights", matrix, 2), ("biases", vector, 1)):
        if found.ndim != dimensions:
            raise ValueError(f"{name} {what}: found shape {found.shape}, expected {dimensions} dimensions")
    return np.ascontiguousarray(matrix, dtype=np.float32), np.ascontiguousarray(vector, dtype=np.float32)


def _leaves(module: Any) -> list[Any]:
    """The parts of nested `Sequential`s in their order."""
    if type(module).__name__ != "Sequential":
        return [module]
    return [leaf for _, child in module.named_children() for leaf in _leaves(child)]


def _of_module(module: Any) -> Layers:
    leaves = _leaves(module)
    layers: Layers = []
    for place, leaf in enumerate(leaves):
        kind, expected = type(leaf).__name__, "Linear" if place % 2 == 0 else "ReLU"
        if kind not in ("Linear", "ReLU"):
            raise TypeError(f"network: found {kind}, expected Linear and ReLU in a Sequential")
        if kind != expected:
            raise ValueError(f"network: part {place}: found {kind}, expected {expected}")
        if kind == "Linear":
            if leaf.bias is None:
                raise ValueError(f"network: part {place}: found a Linear without bias, expected one with it")
            layers.append(_layer(len(layers), (leaf.weight, leaf.bias)))
    if len(leaves) % 2 == 0:
        raise ValueError("network: found a ReLU at the end, expected a Linear")
    return layers
