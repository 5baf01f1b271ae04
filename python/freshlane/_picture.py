"""A cell from above, as an image."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ._native import Scenario

HEIGHT = 400
"""Pixels of the picture's height (chosen)."""
MARGIN_M = 20.0
"""Around the grid, in metres (chosen)."""
STREET_M = 14.0
"""Width of a street: two lanes in each direction, 3GPP TR 36.885 A.1.2."""
GROUND, STREET, STATION = (238, 238, 232), (200, 200, 196), (30, 60, 160)


def draw(
    scenario: Scenario,
    positions_m: NDArray[np.float64],
    ages: NDArray[np.uint16],
    received: NDArray[np.bool_],
) -> NDArray[np.uint8]:
    """The urban grid, its base station and its vehicles: uint8 (height, width, 3)."""
    block_m = np.array([scenario["mobility.block_x_m"], scenario["mobility.block_y_m"]])
    blocks = np.array([scenario["mobility.blocks_x"], scenario["mobility.blocks_y"]])
    extent_m = block_m * blocks + 2 * MARGIN_M
    scale = HEIGHT / extent_m[1]
    picture = np.full((HEIGHT, max(1, round(extent_m[0] * scale)), 3), GROUND, np.uint8)

    def fill(low_m: NDArray[np.float64], high_m: NDArray[np.float64], colour: NDArray[np.float64] | tuple[int, int, int]) -> None:
        """A rectangle in metres; the picture's rows go down, y goes up."""
        (left, bottom), (right, top) = ((edge + MARGIN_M) * scale for edge in (low_m, high_m))
        rows = slice(max(0, int(HEIGHT - top)), max(0, int(HEIGHT - bottom) + 1))
        picture[rows, max(0, int(left)) : max(0, int(right) + 1)] = colour

    half = np.full(2, STREET_M / 2)
    for axis in (0, 1):
        for street in range(int(blocks[axis]) + 1):
            low, high = np.zeros(2), block_m * blocks
            low[axis] = high[axis] = street * block_m[axis]
            fill(low - half, high + half, STREET)

    def mark(place_m: NDArray[np.float64], pixels: int, colour: NDArray[np.float64] | tuple[int, int, int]) -> None:
        """A square of so many pixels on each side of its middle."""
        fill(place_m - pixels / scale, place_m + pixels / scale, colour)

    mark(np.array([scenario["cell.base_station_x_m"], scenario["cell.base_station_y_m"]]), 6, STATION)
    # Green at 1 ms, red at 100 ms, by the logarithm: what matters is a factor.
    old = np.clip(np.log10(np.maximum(ages, 1)) / 2, 0, 1)
    for place_m, share, heard in zip(positions_m, old, received, strict=True):
        if np.isnan(place_m).any():
            continue
        if heard:
            mark(place_m, 5, (255, 255, 255))
        mark(place_m, 3, np.array([220 * share, 170 * (1 - share), 40]))
    return picture
