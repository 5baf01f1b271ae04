"""What an actor of another form could know that the shipped form's does not, measured before anybody builds it.

A form that sees and chooses all sub-channels one by one differs from the best open one only where several are open and several vehicles
contend. A memory helps as far as it predicts what a gain will be by the time it is used.

    python benchmarks/room_for_forms.py
"""

import argparse
from typing import Any

import numpy as np
from numpy.typing import NDArray

from freshlane import BatchEnvironment, Scenario, Table

# Inputs of the observation: called to contend, some sub-channel is open, the gain on the best one carries a report.
CALLED, OPEN, CARRIES = 13, 18, 11

CELLS: list[tuple[str, dict[str, Any]]] = [
    ("paper", {}),
    ("paper", {"cell.replacement_probability": 0.01}),
    ("paper", {"cell.replacement_probability": 0.03}),
    ("paper", {"cell.replacement_probability": 0.003, "cell.vehicles": 60}),
    ("paper", {"radio.max_power_dbm": 20}),
    ("edge", {}),
]

# Cells whose fading follows speed, and how old gains are there when they are used, in slots.
FADING: list[tuple[str, dict[str, Any], int]] = [
    ("edge", {"fading.follows_speed": True}, 4),
    ("street", {"knowledge.gain_delay_slots": 0, "knowledge.gain_error_db": 0.0}, 4),
]

# Gains that a memory keeps.
LENGTH = 32


def open_slots(env: BatchEnvironment, slots: int) -> tuple[float, float]:
    """Shares of slots in which several sub-channels are open, and in which several vehicles contend then."""
    table = Table.shipped()
    observations, _ = env.reset()
    several_open = []
    several_contend = []
    for slot in range(slots + 500):
        observations, *_ = env.step(table.act(observations))
        if slot >= 500:
            is_open = env.open_sub_channels[:, 0].sum(axis=-1) >= 2
            contends = (observations[:, :, [CALLED, OPEN, CARRIES]] > 0).all(axis=-1).sum(axis=1) >= 2
            several_open.append(is_open)
            several_contend.append(is_open & contends)
    return float(np.mean(several_open)), float(np.mean(several_contend))


def prediction_errors(env: BatchEnvironment, delay: int, slots: int) -> list[float]:
    """Root of the mean squared error, in dB, of the best linear prediction from the last gain, the mean of all that are kept, and all of
    them; fitted in one half of the worlds and judged in the other."""
    env.reset()
    silent = np.zeros(env.ages.shape, np.uint8)
    gains = []
    for _ in range(slots):
        env.step(silent)
        gains.append(env.gains_db[:, :, 0].copy())
    series = np.stack(gains)
    slots_used = range(LENGTH + delay, slots, 7)
    known = np.stack([series[slot - delay - LENGTH + 1 : slot - delay + 1] for slot in slots_used])
    wanted = np.stack([series[slot] for slot in slots_used])
    half = series.shape[1] // 2

    def error(features: NDArray[np.float32]) -> float:
        def rows(worlds: slice) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
            flat = features[:, :, worlds].transpose(0, 2, 3, 1).reshape(-1, features.shape[1])
            return np.column_stack([flat, np.ones(len(flat))]), wanted[:, worlds].reshape(-1).astype(float)

        inputs, targets = rows(slice(0, half))
        weights, *_ = np.linalg.lstsq(inputs, targets, rcond=None)
        inputs, targets = rows(slice(half, None))
        return float(np.sqrt(np.mean((targets - inputs @ weights) ** 2)))

    return [error(known[:, -1:]), error(known.mean(axis=1, keepdims=True)), error(known)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=64)
    parser.add_argument("--slots", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=5)
    args = parser.parse_args()

    def environment(preset: str, settings: dict[str, Any]) -> BatchEnvironment:
        scenario = Scenario(preset=preset, settings={"cell.vehicles": 20, **settings})
        return BatchEnvironment(scenario, worlds=args.worlds, slots=None, seed=args.seed)

    print(f"{args.worlds} worlds x {args.slots} slots, seed {args.seed}\n")
    print("several sub-channels open, several vehicles contend then: shares of slots")
    for preset, settings in CELLS:
        several_open, several_contend = open_slots(environment(preset, settings), args.slots)
        print(f"{several_open:8.2%} {several_contend:8.2%}  {preset} {settings}")
    print(f"\nerror of a predicted gain in dB: by the last one, the mean of {LENGTH}, all {LENGTH}")
    for preset, settings, delay in FADING:
        errors = prediction_errors(environment(preset, settings), delay, args.slots)
        print("".join(f"{error:8.2f}" for error in errors), f" {preset} {settings}, {delay} slots old")


if __name__ == "__main__":
    main()
