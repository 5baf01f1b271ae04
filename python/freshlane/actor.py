"""A trained actor of the trainer as a torch module."""

from __future__ import annotations

import json
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np


def read_actor(path: str | PathLike[str]) -> Any:
    """The float network in a run folder's `actor.safetensors`, for `evaluate`, `export` or further training in torch.

    Returns a torch `Sequential` of `Linear` and `ReLU`: float32 observations over 64, (rows, 22), to scores (rows, 7).

    Raises OSError for a file that cannot be read, ValueError for one that holds no such network, such as the paper's form, whose
    inputs differ and which has a network for each vehicle.
    """
    from torch import nn, tensor

    data = Path(path).read_bytes()
    first = 8 + int.from_bytes(data[:8], "little")
    try:
        header = json.loads(data[8:first])
        form = json.loads(header["__metadata__"]["freshlane"])
        if (form["observation"], form["output"]) != ("firmware", {"form": "actions"}):
            raise ValueError(f"found {form}")

        def values(name: str) -> Any:
            begin, end = header[name]["data_offsets"]
            return tensor(np.frombuffer(data[first + begin : first + end], "<f4").reshape(header[name]["shape"]))

        parts: list[Any] = []
        for layer in range(max(1, sum(name.endswith("weight") for name in header))):
            weights, biases = values(f"layers.{layer}.weight"), values(f"layers.{layer}.bias")
            parts += [nn.ReLU()] * (layer > 0) + [nn.Linear(weights.shape[1], weights.shape[0])]
            parts[-1].load_state_dict({"weight": weights, "bias": biases})
    except (KeyError, TypeError, ValueError, RuntimeError) as error:
        raise ValueError(f"{path}: {error!r}, expected one network with the firmware's inputs and actions") from None
    return nn.Sequential(*parts)
