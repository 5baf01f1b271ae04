"""Arguments: a precise exception for what makes no sense, and no silent conversion."""

from __future__ import annotations

import operator
from typing import Any, SupportsIndex, TypeVar

import numpy as np
from numpy.typing import NDArray

from ._native import ACTIONS, Scenario

MAX_SEED = 2**64 - 1
"""Seeds have 64 bits."""

Chosen = TypeVar("Chosen")


def whole(name: str, value: SupportsIndex, least: int, most: int, otherwise: str = "") -> int:
    """The argument as a whole number of a range; `otherwise` says what else there is.

    Raises TypeError for what is no whole number, ValueError for one out of range.
    """
    expected = f"a whole number from {least} to {most}{otherwise}"
    try:
        found = operator.index(value)
    except TypeError:
        raise TypeError(f"{name}: found {value!r}, expected {expected}") from None
    if not least <= found <= most:
        raise ValueError(f"{name}: found {found}, expected {expected}")
    return found


def seed(value: SupportsIndex) -> int:
    """The argument as a seed."""
    return whole("seed", value, 0, MAX_SEED)


def threads(value: SupportsIndex | None) -> int | None:
    """The argument as a number of worker threads; None is one a core."""
    return None if value is None else whole("threads", value, 1, 65535, ", or None for one a core")


def slots(value: SupportsIndex | None, name: str = "slots") -> int | None:
    """The argument as the length of an episode; None is one without end."""
    return None if value is None else whole(name, value, 1, 2**32 - 1, ", or None for an episode without end")


def scenario(value: Scenario | None) -> Scenario:
    """The argument as a scenario; None is the paper's."""
    if value is None:
        return Scenario()
    if not isinstance(value, Scenario):
        expected = 'a freshlane.Scenario, such as Scenario(settings={"cell.vehicles": 40})'
        raise TypeError(f"scenario: found a {type(value).__name__}, expected {expected}")
    return value


def choice(name: str, value: Chosen, known: tuple[Chosen, ...]) -> Chosen:
    """The argument as one of the known values.

    Raises ValueError for another one.
    """
    if value not in known:
        listed = ", ".join(f'"{one}"' if isinstance(one, str) else str(one) for one in known)
        raise ValueError(f'{name}: found "{value}", expected {listed}')
    return value


def array(name: str, value: object, kinds: str, expected: str) -> NDArray[Any]:
    """The argument as an array whose dtype is of one of the numpy kinds ("i", "u", "f").

    Raises TypeError for another dtype.
    """
    detach = getattr(value, "detach", None)
    if detach is not None:  # a torch tensor, perhaps on another device
        value = detach().cpu()
    try:
        found = np.asarray(value)
    except ValueError:
        raise ValueError(f"{name}: found a list of lists of several lengths, expected {expected}") from None
    if found.dtype.kind not in kinds:
        raise TypeError(f"{name}: found an array of {found.dtype}, expected {expected}")
    return found


def floats(name: str, value: object) -> NDArray[np.float64]:
    """The argument as a vector of float64; whole numbers are numbers, too."""
    found = array(name, value, "fiu", "numbers")
    if found.ndim != 1:
        raise ValueError(f"{name}: found shape {found.shape}, expected one dimension")
    return np.ascontiguousarray(found, dtype=np.float64)


def actions(value: object) -> NDArray[np.uint8] | NDArray[np.int64]:
    """The argument as actions, uint8 or int64; range and shape are checked where they are used."""
    found = array("actions", value, "iu", "whole numbers such as uint8 or int64")
    if found.dtype == np.uint64 and found.size and int(found.max()) > 255:
        raise ValueError(f"actions: found {int(found.max())}, expected 0 to {ACTIONS - 1}")
    if found.ndim != 2:
        raise ValueError(f"actions: found shape {found.shape}, expected (worlds, vehicles)")
    if found.dtype == np.uint8:
        return np.ascontiguousarray(found, dtype=np.uint8)
    return np.ascontiguousarray(found, dtype=np.int64)
