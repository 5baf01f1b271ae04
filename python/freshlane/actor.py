"""Actors of the trainer as torch modules, and torch modules as the trainer's actors."""

from __future__ import annotations

from os import PathLike
from typing import Any

from ._native import FloatNetwork
from .export import layers_of


def read_actor(path: str | PathLike[str]) -> Any:
    """The float network in a run folder's `actor.safetensors`, for `evaluate`, `export` or further training in torch.

    Returns a torch `Sequential` of `Linear` and `ReLU`: float32 observations over 64, (rows, 22), to scores (rows, 7).

    Raises OSError for a file that cannot be read, ValueError for one that is damaged or holds no such network, such as the paper's
    form, whose inputs differ and which has a network for each vehicle.
    """
    from torch import from_numpy, nn

    parts: list[Any] = []
    for weights, biases in FloatNetwork.read(path).layers():
        parts += [nn.ReLU()] * bool(parts) + [nn.Linear(weights.shape[1], weights.shape[0])]
        parts[-1].load_state_dict({"weight": from_numpy(weights), "bias": from_numpy(biases)})
    return nn.Sequential(*parts)


def write_actor(network: Any, path: str | PathLike[str], *, min_vehicles: int, max_vehicles: int) -> None:
    """Writes a network as the trainer's `actor.safetensors`, for `trainer export`, `eval` or further training there.

    Args:
        network: what `export` takes.
        path: the file, which appears whole or not at all.
        min_vehicles, max_vehicles: fewest and most vehicles in the cells that the network was trained in.

    Raises:
        TypeError: a network of other modules or types.
        ValueError: layers that do not fit each other or the firmware, numbers that are not finite, vehicles in the wrong order.
        OSError: a file that cannot be written.
    """
    FloatNetwork(layers_of(network)).write(path, (min_vehicles, max_vehicles))
