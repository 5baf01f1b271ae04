"""Who reaches a mean age of 5 ms first from nothing, and of 4.1 ms: the trainer's PPO, or a PPO in PyTorch on our own batch of worlds.

Both learn in the paper's cell with 20 vehicles, on one thread, and play equally many slots. The other side is `examples/train_ppo.py`, one
file in the style of CleanRL's ppo.py at the batch's speed, with the preset's first scores, actor's rate, discount, entropy and number of worlds. For
every seed both run, one after the other, so that other programs disturb them alike. As they learn, their actors are set aside;
afterwards each is judged in the same way: its int8 form, greedy, on the same held-out worlds. Time is processor time of learning
alone: without importing PyTorch, without judging, without what the trainer writes at its end, but with the checkpoints from which
its actors come, one an episode: it may have been there earlier.

    cargo build --release -p trainer
    python benchmarks/race.py --trainer ../target/release/trainer --figure race.svg
"""

import argparse
import ctypes
import json
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import freshlane

sys.path.append(str(Path(__file__).parents[1] / "examples"))
import train_ppo

VEHICLES = 20
GOALS_MS = (5.0, 4.1)
"""What playing the own place gives, and what joining where others are silent gives as well."""
EPISODES = 40
"""Of the trainer's preset `ppo`, of 6,144 slots each: 24 batches of a world x 8 updates x 32 slots."""

SIDES = ("trainer", "PyTorch")


class Moment(NamedTuple):
    """An actor on its way."""

    seconds: float
    """Processor time until then."""
    slots: int
    """Slots of a world that were played."""
    layers: list[tuple[np.ndarray, np.ndarray]]


def in_pytorch(seed: int) -> Iterator[Moment]:
    """The example with its defaults, an actor after each of the first rollouts and then after every eighth: the slots of an episode of the trainer's."""
    args = train_ppo.arguments(["--seed", str(seed), "--vehicles", str(VEHICLES)])
    scenario = freshlane.Scenario(settings={"cell.vehicles": VEHICLES})
    next(train_ppo.learn(train_ppo.arguments(["--worlds", "1"]), scenario))  # PyTorch imports parts of itself where they are first used.
    seconds, start = 0.0, time.process_time()
    for iteration, actor, _ in train_ppo.learn(args, scenario):
        seconds += time.process_time() - start
        if iteration <= 40 or iteration % 8 == 0:
            linear = [part for part in actor if hasattr(part, "weight")]
            layers = [(part.weight.detach().numpy().copy(), part.bias.detach().numpy().copy()) for part in linear]
            yield Moment(seconds, iteration * args.worlds * args.rollout, layers)
        start = time.process_time()


def in_trainer(program: Path, seed: int) -> Iterator[Moment]:
    """The preset as it is, for 20 vehicles; actors from its checkpoints, which it writes after each episode."""
    with tempfile.TemporaryDirectory() as folder:
        keys = ("scenario.cell.vehicles", "ppo.min_vehicles", "ppo.max_vehicles")
        settings = [part for key in keys for part in ("--set", f"{key}={VEHICLES}")]
        command = [program, "train", "--preset", "ppo", *settings, "--seed", str(seed), "--threads", "1", "--checkpoint-every", "0"]
        silent = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        run = subprocess.Popen([*command, "--out", folder], **silent)
        clock = ctypes.c_int()
        if ctypes.CDLL(None).clock_getcpuclockid(run.pid, ctypes.byref(clock)) != 0:
            raise OSError("the trainer's processor time cannot be read")
        known = 0
        try:
            while known < EPISODES:
                seconds, ended = time.clock_gettime(clock.value), run.poll() is not None
                tensors, state = checkpoint(Path(folder) / "checkpoint.safetensors")
                done = state["counters"]["done"] if state else 0
                if done > known:
                    known = done
                    layers = [(tensors[f"actor.{layer}.weights"].T, tensors[f"actor.{layer}.biases"]) for layer in range(3)]
                    yield Moment(seconds, state["counters"]["world_slots"], layers)
                elif ended:
                    raise RuntimeError(f"{program}: ended after {known} episodes, expected {EPISODES}")
                time.sleep(0.005)
        finally:
            run.wait()


def checkpoint(path: Path) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Tensors and state in a checkpoint; nothing where there is none yet. It appears whole."""
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        return {}, {}
    begin = 8 + int.from_bytes(data[:8], "little")
    header = json.loads(data[8:begin])
    state = json.loads(header.pop("__metadata__")["freshlane"])
    tensors = {}
    for name, entry in header.items():
        if entry["dtype"] == "F32":
            first, last = entry["data_offsets"]
            tensors[name] = np.frombuffer(data[begin + first : begin + last], np.float32).reshape(entry["shape"])
    return tensors, state


def age_ms(layers: list[tuple[np.ndarray, np.ndarray]], rows: np.ndarray) -> float:
    """Mean age on held-out worlds, int8 and greedy; scales from these observations."""
    scenario = freshlane.Scenario(settings={"cell.vehicles": VEHICLES})
    contiguous = [(np.ascontiguousarray(weights), biases) for weights, biases in layers]
    table = freshlane.export(contiguous, scenario, calibration=rows, worlds=1, slots=1, warmup=0).table
    return freshlane.evaluate(table, scenario, worlds=64, slots=1000, warmup=500, seed=77, threads=1).mean_age_ms


def observations() -> np.ndarray:
    """What vehicles see that follow the clock in training worlds."""
    env = freshlane.BatchEnvironment(freshlane.Scenario(settings={"cell.vehicles": VEHICLES}), worlds=32, slots=None, threads=1)
    seen, _ = env.reset()
    rows = []
    for _ in range(400):
        rows.append(seen.reshape(-1, freshlane.INPUTS).copy())
        seen = env.step(freshlane.Table.shipped().act(seen))[0]
    return np.concatenate(rows)


Curve = list[tuple[float, int, float]]
"""Seconds, slots and mean age."""


def at(goal_ms: float, curve: Curve) -> tuple[float, float]:
    """Seconds and slots at the first actor that is there; infinite for none."""
    return next(((seconds, slots) for seconds, slots, age in curve if age <= goal_ms), (float("inf"), float("inf")))


def table(curves: dict[str, dict[int, Curve]]) -> str:
    seeds = list(curves[SIDES[0]])
    lines = [f"| | median | {' | '.join(f'seed {seed}' for seed in seeds)} |", "|---" * (len(seeds) + 2) + "|"]
    # Who never gets there takes longer than all others.
    row = lambda name, form, values: lines.append(  # noqa: E731
        f"| {name} | {' | '.join('never' if value == float('inf') else form.format(value) for value in [statistics.median(values), *values])} |"
    )
    for goal in GOALS_MS:
        reached = {side: [at(goal, curve) for curve in of_seeds.values()] for side, of_seeds in curves.items()}
        for side, found in reached.items():
            row(f"{side}, s to {goal:g} ms", "{:.2f}", [seconds for seconds, _ in found])
            row(f"{side}, slots", "{:,.0f}", [slots for _, slots in found])
        row(f"times of PyTorch to those of the trainer, {goal:g} ms", "{:.1f}", [slow / fast for (fast, _), (slow, _) in zip(*reached.values(), strict=True)])
    for side, of_seeds in curves.items():
        ends = [curve[-1] for curve in of_seeds.values()]
        row(f"{side}, ms after {statistics.median(seconds for seconds, _, _ in ends):.1f} s, the end", "{:.3f}", [age for _, _, age in ends])
    return "\n".join(lines)


def figure(curves: dict[str, dict[int, Curve]]) -> str:
    """The curves as an SVG: mean age, logarithmic, over processor time."""
    width, height, left, right, top, bottom = 720, 360, 50, 700, 40, 310
    first, last = 0.2, max(curve[-1][0] for of_seeds in curves.values() for curve in of_seeds.values())
    low, high = 3.9, 20.0
    x = lambda seconds: left + (right - left) * np.log(max(seconds, first) / first) / np.log(last / first)  # noqa: E731
    y = lambda age: bottom - (bottom - top) * np.log(min(age, high) / low) / np.log(high / low)  # noqa: E731
    text = lambda at_x, at_y, what, anchor="middle", colour="#222222": (  # noqa: E731
        f'<text x="{at_x:.1f}" y="{at_y:.1f}" text-anchor="{anchor}" font-size="13" fill="{colour}">{what}</text>'
    )
    parts = [
        f'<svg role="img" width="{width}" height="{height}" viewBox="0 0 {width} {height}" font-family="sans-serif" xmlns="http://www.w3.org/2000/svg">',
        "<title>Mean age of information over processor time of learning</title>",
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        text(left, 22, f"Mean age on held-out worlds, ms, at most {high:g}, over processor seconds of learning", "start"),
    ]
    for age in (*GOALS_MS, 6, 8, 10, 20):
        dash, ink = (' stroke-dasharray="5 4"', "#222222") if age in GOALS_MS else ("", "#e1e1e1")
        parts.append(f'<line x1="{left}" x2="{right}" y1="{y(age):.1f}" y2="{y(age):.1f}" stroke="{ink}"{dash}/>')
        parts.append(text(left - 8, y(age) + 4, f"{age:g}", "end"))
    for seconds in (second for second in (0.2, 0.5, 1, 2, 5, 10, 20, 50, 100) if second <= last):
        parts.append(text(x(seconds), bottom + 20, f"{seconds:g}"))
    for place, (side, colour, dash) in enumerate(zip(SIDES, ("#0072b2", "#c45500"), ("", ' stroke-dasharray="3 2"'), strict=True)):
        for curve in curves[side].values():
            points = " ".join(f"{x(seconds):.1f},{y(age):.1f}" for seconds, _, age in curve)
            parts.append(f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="1.5"{dash}/>')
        parts.append(text(right - 10, 62 + 20 * place, f"{side}, {len(curves[side])} seeds", "end", colour))
    return "\n".join([*parts, "</svg>\n"])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trainer", type=Path, default=Path(__file__).parents[2] / "target/release/trainer", help="the program")
    parser.add_argument("--seeds", type=int, default=5, help="as many training seeds, from 1 on")
    parser.add_argument("--figure", type=Path, help="write the curves to this SVG file")
    parser.add_argument("--curves", type=Path, help="keep the curves in this JSON file; seeds that are there are not repeated")
    args = parser.parse_args()
    curves: dict[str, dict[int, Curve]] = {side: {} for side in SIDES}
    if args.curves and args.curves.exists():
        known = json.loads(args.curves.read_text())
        curves = {side: {int(seed): curve for seed, curve in known[side].items()} for side in SIDES}
    rows = observations()
    for seed in range(1, args.seeds + 1):
        if seed in curves[SIDES[0]]:
            continue
        # Who begins changes, too.
        for side in SIDES[:: 1 if seed % 2 else -1]:
            moments = list(in_trainer(args.trainer, seed) if side == "trainer" else in_pytorch(seed))
            curves[side][seed] = curve = [(moment.seconds, moment.slots, age_ms(moment.layers, rows)) for moment in moments]
            times = ", ".join(f"{at(goal, curve)[0]:.2f} s to {goal:g} ms" for goal in GOALS_MS)
            print(f"{side}, seed {seed}: {times}; {curve[-1][2]:.3f} ms at the end", flush=True)
        if args.curves:
            args.curves.write_text(json.dumps(curves))
    print(table(curves))
    if args.figure:
        args.figure.write_text(figure(curves))


if __name__ == "__main__":
    main()
