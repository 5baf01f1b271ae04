"""How fast the batched environment is from Python, beside the same loop in Rust.

Both loops run on the calling thread and alternate; speeds are slots of all worlds per second of this process's processor
time, so that other programs disturb little. In every slot both encode everybody's observation, and every fifth vehicle sends.

    python benchmarks/speed.py
"""

import argparse
import statistics
import time

import numpy as np

from freshlane import BatchEnvironment, Scenario
from freshlane._native import native_loop


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

    def from_python() -> int:
        env = BatchEnvironment(scenario, worlds=args.worlds, slots=None, seed=1, threads=1)
        for _ in range(args.slots):
            env.step(actions)
        return int(env.ages.sum())

    def in_rust() -> int:
        return native_loop(scenario, args.worlds, args.slots, 1)

    assert from_python() == in_rust(), "not the same loop"
    ratios, speeds = [], []
    for _ in range(args.repetitions):
        seconds = []
        for loop in (from_python, in_rust):
            start = time.process_time()
            loop()
            seconds.append(time.process_time() - start)
        speeds.append([args.worlds * args.slots / elapsed for elapsed in seconds])
        ratios.append(seconds[1] / seconds[0])
    python, rust = (statistics.median(column) for column in zip(*speeds, strict=True))
    print(f"{args.worlds} worlds x {args.vehicles} vehicles x {args.slots} slots, {args.repetitions} repetitions, one thread")
    print(f"from Python  {python:12,.0f} world-slots a second ({python * args.vehicles:,.0f} decisions)")
    print(f"in Rust      {rust:12,.0f} world-slots a second")
    print(f"ratio        {statistics.median(ratios):.3f} (median; {min(ratios):.3f} to {max(ratios):.3f})")


if __name__ == "__main__":
    main()
