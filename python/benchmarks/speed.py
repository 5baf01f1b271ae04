"""How fast environments are from Python: the batch beside the same loop in Rust, and PettingZoo's dictionaries beside the batch.

All loops run on the calling thread and alternate; speeds are slots of a world per second of this process's processor
time, so that other programs disturb little. In every slot everybody's observation is encoded, and every fifth vehicle sends.

    python benchmarks/speed.py
"""

import argparse
import statistics
import time
from collections.abc import Callable

import numpy as np

from freshlane import ACTIONS, INPUTS, BatchEnvironment, Scenario, parallel_env
from freshlane._native import native_loop


def speeds(loops: dict[str, Callable[[], int]], repetitions: int) -> dict[str, list[float]]:
    """World-slots a processor second of loops that say how many they played, in turn."""
    found: dict[str, list[float]] = {name: [] for name in loops}
    for _ in range(repetitions):
        for name, loop in loops.items():
            start = time.process_time()
            played = loop()
            found[name].append(played / (time.process_time() - start))
    return found


def beside_rust(scenario: Scenario, actions: np.ndarray, slots: int, repetitions: int) -> None:
    worlds, vehicles = actions.shape
    sums = {}

    def from_python() -> int:
        env = BatchEnvironment(scenario, worlds=worlds, slots=None, seed=1, threads=1)
        for _ in range(slots):
            env.step(actions)
        sums["Python"] = int(env.ages.sum())
        return worlds * slots

    def in_rust() -> int:
        sums["Rust"] = native_loop(scenario, worlds, slots, 1)
        return worlds * slots

    found = speeds({"from Python": from_python, "in Rust": in_rust}, repetitions)
    assert sums["Python"] == sums["Rust"], "not the same loop"
    ratios = [python / rust for python, rust in zip(*found.values(), strict=True)]
    print(f"{worlds} worlds x {vehicles} vehicles x {slots} slots, {repetitions} repetitions, one thread; world-slots a second, medians")
    for name, column in found.items():
        print(f"{name:40} {statistics.median(column):12,.0f}")
    print(f"ratio {statistics.median(ratios):.3f} ({min(ratios):.3f} to {max(ratios):.3f})")


def beside_dictionaries(scenario: Scenario, actions: np.ndarray, slots: int, repetitions: int) -> None:
    """PettingZoo's form of a world, what its dictionaries cost by themselves, and the batch in that form's encoding."""
    worlds, vehicles = actions.shape
    env = parallel_env(scenario, seed=1, slots=2**32 - 1)
    env.reset()
    agents = env.agents
    chosen = dict(zip(agents, actions[0].tolist(), strict=True))
    one, many = (
        BatchEnvironment(scenario, worlds=count, slots=None, seed=1, encoding="float32", threads=1) for count in (1, worlds)
    )
    observations, masks = np.zeros((vehicles, INPUTS), np.float32), np.zeros((vehicles, ACTIONS), np.int8)
    rewards, ages, received = np.zeros(vehicles, np.float32), np.zeros(vehicles, np.uint16), np.zeros(vehicles, np.bool_)

    def parallel() -> int:
        for _ in range(slots):
            env.step(chosen)
        return slots

    def dictionaries() -> int:
        for _ in range(slots):
            bytes([chosen[agent] for agent in agents])
            dict(zip(agents, observations.copy()))
            dict(zip(agents, rewards.tolist()))
            dict.fromkeys(agents, False), dict.fromkeys(agents, False)
            {
                agent: {"age_ms": age, "received": heard, "replaced": False, "action_mask": mask}
                for agent, age, heard, mask in zip(agents, ages.tolist(), received.tolist(), masks.copy())
            }
        return slots

    def batch(env: BatchEnvironment, actions: np.ndarray, slots: int) -> int:
        for _ in range(slots):
            env.step(actions)
        return env.worlds * slots

    found = speeds(
        {
            "parallel_env": parallel,
            "its dictionaries alone": dictionaries,
            "batch of one world": lambda: batch(one, actions[:1], slots),
            f"batch of {worlds} worlds": lambda: batch(many, actions, max(slots // 20, 1)),
        },
        repetitions,
    )
    print(f"\nPettingZoo's form, {vehicles} vehicles; world-slots a second, medians, and how many of parallel_env's these are")
    for name, column in found.items():
        ratios = [other / own for other, own in zip(column, found["parallel_env"], strict=True)]
        print(f"{name:40} {statistics.median(column):12,.0f} {statistics.median(ratios):8.2f}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=256)
    parser.add_argument("--vehicles", type=int, default=20)
    parser.add_argument("--slots", type=int, default=500)
    parser.add_argument("--repetitions", type=int, default=9)
    args = parser.parse_args()
    scenario = Scenario(settings={"cell.vehicles": args.vehicles})
    worlds, vehicles = np.ogrid[: args.worlds, : args.vehicles]
    # The same vehicles as in the native loop.
    actions = ((worlds % 32 + vehicles) % 5 == 0).astype(np.uint8)
    beside_rust(scenario, actions, args.slots, args.repetitions)
    beside_dictionaries(scenario, actions, 10 * args.slots, args.repetitions)


if __name__ == "__main__":
    main()
