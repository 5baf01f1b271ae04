"""Arguments as arrays: a precise exception for what is no such array, and no silent conversion."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def array(name: str, value: object, kinds: str, expected: str) -> NDArray[Any]:
    """The argument as an array whose dtype is of one of the numpy kinds ("i", "u", "f").

    Raises TypeError for another dtype.
    """
    if hasattr(value, "detach"):  # a torch tensor, perhaps on another device
        value = value.detach().cpu()
    found = np.asarray(value)
    if found.dtype.kind not in kinds:
        raise TypeError(f"{name}: found an array of {found.dtype}, expected {expected}")
    return found


def floats(name: str, value: object) -> NDArray[np.float64]:
    """The argument as a vector of float64; whole numbers are numbers, too."""
    found = array(name, value, "fiu", "numbers")
    if found.ndim != 1:
        raise ValueError(f"{name}: found shape {found.shape}, expected one dimension")
    return np.ascontiguousarray(found, dtype=np.float64)


def actions(value: object) -> NDArray[Any]:
    """The argument as actions, uint8 or int64; range and shape are checked where they are used."""
    found = array("actions", value, "iu", "whole numbers such as uint8 or int64")
    if found.dtype == np.uint64 and found.size and int(found.max()) > 255:
        raise ValueError(f"actions: found {int(found.max())}, expected 0 to 5")
    if found.ndim != 2:
        raise ValueError(f"actions: found shape {found.shape}, expected (worlds, vehicles)")
    wanted = np.uint8 if found.dtype == np.uint8 else np.int64
    return np.ascontiguousarray(found, dtype=wanted)
