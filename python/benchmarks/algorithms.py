"""Other libraries' algorithms in the paper's cell with 20 vehicles, for the table in docs/train.md.

Stable-Baselines3's PPO and A2C and BenchMARL's IPPO and MAPPO, through the adapters, on one thread. All play as many slots of a world as the
trainer's preset `ppo` and have its networks: an actor of 32 and 32 units for all vehicles, a critic of 64 and 64. Actors are judged as in
`trainer/studies/benchmark.toml`: int8, greedy, on 128 held-out worlds x 1,000 slots after 500 of seed 77. Settings were chosen in a
dozen runs, most of training seeds 21 and 22, which the table has not.

    pip install 'freshlane[stable-baselines3,benchmarl]'
    python benchmarks/algorithms.py --out algorithms.jsonl

Every run is a line of the file as soon as it is done. Called again, it goes on with what is missing; all algorithms have a seed before
the next one begins. The table is of the whole file: interquartile means over training seeds with 95 % intervals by a bootstrap over them, as
`trainer study` has them (R. Agarwal and others, "Deep reinforcement learning at the edge of the statistical precipice", 2021).
"""

import argparse
import json
import tempfile
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

import freshlane

VEHICLES = 20
WORLDS = 24
ROLLOUT = 32
"""Slots between two updates, but of A2C, which has no second pass and looks at fewer more often."""
EPISODE = 640
"""Slots until all worlds are replaced."""
SLOTS = 245_760
"""Of a world: 320 rollouts."""
ACTOR, CRITIC = [32, 32], [64, 64]
EPOCHS, MINIBATCHES = 2, 8
LEARNING_RATE, DISCOUNT, TRACE, ENTROPY, GRADIENT_LIMIT, EPSILON = 3e-3, 0.95, 0.9, 3e-3, 0.5, 1e-5
REWARD = "team"
"""With "own", PPO stayed at 8.9 ms (one run, of seed 1) and IPPO at 11.7 (seed 21); A2C was where it is with "team"."""


def scenario() -> freshlane.Scenario:
    return freshlane.Scenario(settings={"cell.vehicles": VEHICLES})


def stable_baselines(name: str, seed: int) -> nn.Sequential:
    """PPO or A2C; every vehicle is an environment, so that the critic sees what it sees."""
    from stable_baselines3 import A2C, PPO

    from freshlane.adapters.stable_baselines3 import VecEnvironment

    env = VecEnvironment(scenario(), worlds=WORLDS, seed=seed, slots=EPISODE, reward=REWARD, threads=1)
    own: dict[str, Any] = {"n_steps": 8, "rms_prop_eps": EPSILON}
    if name == "PPO":
        own = {"n_steps": ROLLOUT, "n_epochs": EPOCHS, "batch_size": env.num_envs * ROLLOUT // MINIBATCHES}
    model = {"PPO": PPO, "A2C": A2C}[name](
        "MlpPolicy",
        env,
        learning_rate=lambda left: LEARNING_RATE * left,
        gamma=DISCOUNT,
        gae_lambda=TRACE,
        ent_coef=ENTROPY,
        max_grad_norm=GRADIENT_LIMIT,
        policy_kwargs={"net_arch": {"pi": ACTOR, "vf": CRITIC}, "activation_fn": nn.ReLU},
        seed=seed,
        device="cpu",
        **own,
    )
    model.learn(SLOTS * VEHICLES)
    return nn.Sequential(*model.policy.mlp_extractor.policy_net, model.policy.action_net)


def benchmarl(name: str, seed: int) -> nn.Sequential:
    """IPPO or MAPPO; the library's learning rate stays what it is."""
    from benchmarl.algorithms import IppoConfig, MappoConfig
    from benchmarl.experiment import Experiment, ExperimentConfig
    from benchmarl.models.mlp import MlpConfig

    from freshlane.adapters.benchmarl import FreshlaneTask
    from freshlane.adapters.torchrl import GROUP

    algorithm = {"IPPO": IppoConfig, "MAPPO": MappoConfig}[name].get_from_yaml()
    algorithm.entropy_coef, algorithm.lmbda = ENTROPY, TRACE
    config = ExperimentConfig.get_from_yaml()
    config.max_n_iters, config.max_n_frames = None, SLOTS
    config.on_policy_n_envs_per_worker = WORLDS
    config.on_policy_collected_frames_per_batch = WORLDS * ROLLOUT
    config.on_policy_minibatch_size, config.on_policy_n_minibatch_iters = WORLDS * ROLLOUT // MINIBATCHES, EPOCHS
    config.lr, config.gamma, config.clip_grad_val, config.adam_eps = LEARNING_RATE, DISCOUNT, GRADIENT_LIMIT, EPSILON
    config.evaluation, config.render, config.loggers, config.create_json = False, False, [], False

    def perceptron(widths: list[int]) -> MlpConfig:
        model = MlpConfig.get_from_yaml()
        model.num_cells, model.activation_class = widths, nn.ReLU
        return model

    with tempfile.TemporaryDirectory() as folder:
        config.save_folder = folder
        experiment = Experiment(
            task=FreshlaneTask(config={"scenario": scenario(), "slots": EPISODE, "reward": REWARD, "threads": 1}),
            algorithm_config=algorithm,
            model_config=perceptron(ACTOR),
            critic_model_config=perceptron(CRITIC),
            seed=seed,
            config=config,
        )
        experiment.run()
    parameters = dict(experiment.group_policies[GROUP].named_parameters())
    parts: list[nn.Module] = []
    for weights, biases in zip(*([part for key, part in parameters.items() if key.endswith(kind)] for kind in ("weight", "bias")), strict=True):
        parts += [nn.ReLU()] * bool(parts) + [nn.Linear(weights.shape[1], weights.shape[0])]
        parts[-1].load_state_dict({"weight": weights, "bias": biases})
    return nn.Sequential(*parts)


ALGORITHMS: dict[str, tuple[Callable[[str, int], nn.Sequential], str]] = {
    "Stable-Baselines3 PPO": (stable_baselines, "stable-baselines3"),
    "Stable-Baselines3 A2C": (stable_baselines, "stable-baselines3"),
    "BenchMARL IPPO": (benchmarl, "benchmarl"),
    "BenchMARL MAPPO": (benchmarl, "benchmarl"),
}


def run(name: str, seed: int) -> dict[str, Any]:
    """Trains an actor and judges it."""
    learn, package = ALGORITHMS[name]
    start = time.process_time()
    actor = learn(name.split()[-1], seed)
    seconds = time.process_time() - start
    judged: dict[str, Any] = {"worlds": 128, "slots": 1000, "warmup": 500, "threads": 1}
    exported = freshlane.export(actor, scenario(), seed=seed, evaluation_seed=77, **judged)
    return {
        "algorithm": name,
        "seed": seed,
        "int8_age_ms": exported.int8_age_ms,
        "float_age_ms": exported.float_age_ms,
        "processor_s": round(seconds, 1),
        "versions": f"{package} {version(package)}, torch {version('torch')}",
    }


def interquartile(ages: np.ndarray) -> np.ndarray:
    """The mean without the lowest and the highest quarter, both rounded down, along the last axis."""
    cut = ages.shape[-1] // 4
    return np.sort(ages, axis=-1)[..., cut : ages.shape[-1] - cut].mean(axis=-1)


def table(lines: list[dict[str, Any]]) -> str:
    seeds = sorted({line["seed"] for line in lines})
    rows = [
        f"| | interquartile mean, 95 % | {' | '.join(map(str, seeds))} | processor s |",
        "|---" * (len(seeds) + 3) + "|",
    ]
    for name in ALGORITHMS:
        own = {line["seed"]: line for line in lines if line["algorithm"] == name}
        if not own:
            continue
        ages = np.array([line["int8_age_ms"] for line in own.values()])
        drawn = np.random.default_rng(0).choice(ages, (10_000, len(ages)))
        resampled = np.sort(interquartile(drawn))
        each = [f"{own[seed]['int8_age_ms']:.2f}" if seed in own else "" for seed in seeds]
        seconds = np.median([line["processor_s"] for line in own.values()])
        interval = f"{interquartile(ages):.3f} ({resampled[250]:.3f} to {resampled[-251]:.3f})"
        rows.append(f"| {name} | {interval} | {' | '.join(each)} | {seconds:.0f} |")
    return "\n".join([*rows, "", *sorted({line["versions"] for line in lines})])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="a line a run; runs that are there are not repeated")
    parser.add_argument("--seeds", type=int, default=10, help="as many training seeds, from 1 on [default: 10]")
    args = parser.parse_args()
    warnings.simplefilter("ignore")  # These libraries warn of each other.
    torch.set_num_threads(1)
    lines = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    for seed in range(1, args.seeds + 1):
        for name in ALGORITHMS:
            if not any(line["algorithm"] == name and line["seed"] == seed for line in lines):
                lines.append(run(name, seed))
                with args.out.open("a") as file:
                    file.write(json.dumps(lines[-1]) + "\n")
    print(table(lines))


if __name__ == "__main__":
    main()
