"""Optuna around the trainer: every trial is a run of `trainer train`, which can be killed and goes on like any other.

    pip install optuna
    cargo build --release -p trainer
    python python/examples/optuna_search.py --trials 20 --trainer target/release/trainer
"""

import argparse
import json
import pathlib
import subprocess

import optuna


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trainer", default="target/release/trainer")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--episodes", type=int, default=8)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/optuna"))
    args = parser.parse_args()

    def mean_age(trial: optuna.Trial) -> float:
        """Of the last training episode, in ms; choose with it, and report what `trainer eval` finds in worlds held out."""
        rate = trial.suggest_float("learning_rate", 1e-4, 1e-2, log=True)
        settings = {
            "ppo.learning_rate": [rate, rate / 100],
            "ppo.entropy": [trial.suggest_float("entropy", 1e-4, 1e-2, log=True), 1e-4],
            "ppo.discount": trial.suggest_float("discount", 0.9, 0.99),
            "ppo.episodes": args.episodes,
        }
        command = [args.trainer, "train", "--preset", "ppo", "--json", "--seed", str(trial.number)]
        command += ["--out", str(args.out / f"trial-{trial.number}"), "--resume"]
        for key, value in settings.items():
            command += ["--set", f"{key}={value}"]
        report = json.loads(subprocess.run(command, check=True, capture_output=True, text=True).stdout)
        return float(report["last"]["mean_age_ms"])

    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=1))
    study.optimize(mean_age, n_trials=args.trials)
    print(f"best: {study.best_value:.3f} ms with {study.best_params}")


if __name__ == "__main__":
    main()
