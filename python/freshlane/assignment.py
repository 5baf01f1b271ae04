"""Static traffic assignment from arrays."""

from __future__ import annotations

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _arguments
from ._native import Assignment, assign_arrays

Algorithm = Literal["fw", "cfw", "bfw", "path"]
Objective = Literal["ue", "so"]


def assign(
    init_node: ArrayLike,
    term_node: ArrayLike,
    capacity: ArrayLike,
    free_flow_time: ArrayLike,
    b: ArrayLike,
    power: ArrayLike,
    trips: ArrayLike,
    *,
    length: ArrayLike | None = None,
    toll: ArrayLike | None = None,
    algorithm: Algorithm = "path",
    objective: Objective = "ue",
    gap: float | None = None,
    max_iterations: int = 10_000,
    first_thru_node: int = 1,
    toll_weight: float = 0.0,
    distance_weight: float = 0.0,
    threads: int = 0,
) -> Assignment:
    """Which roads a demand takes when every trip picks its cheapest route: `host-sim assign` as a function.

    A link's travel time is free_flow_time (1 + b (flow / capacity)^power), the BPR function, plus toll_weight times toll plus
    distance_weight times length. Flows and costs come in the order of the links. Equal input gives equal bytes for any
    number of threads.

    Args:
        init_node: number of the node that each link leaves: integers (links,), from 1.
        term_node: number of the node that each link enters: integers (links,), from 1.
        capacity: vehicles per unit of time: (links,).
        free_flow_time: travel time of the empty link: (links,).
        b: BPR's factor: (links,).
        power: BPR's power: (links,).
        trips: vehicles per unit of time from zone to zone: (zones, zones), zones are the nodes 1 to zones. What stays within a
            zone is not assigned.
        length, toll: (links,); 0 without them.
        algorithm: "fw", "cfw", "bfw", the (conjugate, bi-conjugate) Frank-Wolfe family, or "path", gradient projection.
        objective: "ue", user equilibrium, or "so", system optimum.
        gap: relative gap to stop at; 1e-10 with "path" and 1e-4 with the others without it.
        max_iterations: where to stop even if the gap is larger.
        first_thru_node: no trip passes through a node with a smaller number.
        threads: worker threads; 0 for one a core.

    Raises:
        TypeError: an array of another type.
        ValueError: arrays of another shape, unknown nodes, negative or infinite attributes, trips without a path.
    """
    columns: dict[str, NDArray[np.float64]] = {
        "capacity": _arguments.floats("capacity", capacity),
        "free_flow_time": _arguments.floats("free_flow_time", free_flow_time),
        "b": _arguments.floats("b", b),
        "power": _arguments.floats("power", power),
    }
    for name, values in (("length", length), ("toll", toll)):
        if values is not None:
            columns[name] = _arguments.floats(name, values)
    matrix = _arguments.array("trips", trips, "fiu", "numbers")
    if matrix.ndim != 2:
        raise ValueError(f"trips: found shape {matrix.shape}, expected (zones, zones)")
    if gap is None:
        gap = 1e-10 if algorithm == "path" else 1e-4
    return assign_arrays(
        _nodes("init_node", init_node),
        _nodes("term_node", term_node),
        columns,
        np.ascontiguousarray(matrix, dtype=np.float64),
        algorithm,
        objective,
        gap,
        max_iterations,
        first_thru_node,
        toll_weight,
        distance_weight,
        threads,
    )


def _nodes(name: str, value: ArrayLike) -> NDArray[np.uint32]:
    found = _arguments.array(name, value, "iu", "whole numbers")
    if found.ndim != 1:
        raise ValueError(f"{name}: found shape {found.shape}, expected one dimension")
    if found.size and (found.min() < 1 or found.max() > np.iinfo(np.uint32).max):
        worst = found.min() if found.min() < 1 else found.max()
        raise ValueError(f"{name}: found node {worst}, expected nodes from 1")
    return np.ascontiguousarray(found, dtype=np.uint32)
