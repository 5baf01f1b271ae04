"""IPPO and MAPPO of BenchMARL, side by side: the same learner, whose critic sees one vehicle or all of them.

    pip install 'freshlane[benchmarl]'
    python examples/benchmarl_ippo_mappo.py --iterations 40
"""

import argparse
import tempfile

from benchmarl.algorithms import IppoConfig, MappoConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig

from freshlane import Scenario
from freshlane.adapters.benchmarl import FreshlaneTask


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=20)
    parser.add_argument("--worlds", type=int, default=16)
    parser.add_argument("--vehicles", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    scenario = Scenario(settings={"cell.vehicles": args.vehicles})
    for algorithm in (IppoConfig.get_from_yaml(), MappoConfig.get_from_yaml()):
        config = ExperimentConfig.get_from_yaml()
        config.max_n_iters, config.max_n_frames = args.iterations, None
        config.on_policy_n_envs_per_worker = args.worlds
        config.on_policy_collected_frames_per_batch = 100 * args.worlds
        config.on_policy_minibatch_size, config.on_policy_n_minibatch_iters = 400, 4
        config.lr, config.gamma = 1e-3, 0.97
        config.evaluation, config.render, config.loggers = False, False, []
        config.checkpoint_interval, config.checkpoint_at_end = 0, False
        config.save_folder = tempfile.mkdtemp()
        model = MlpConfig.get_from_yaml()
        model.num_cells = [64, 64]
        experiment = Experiment(
            task=FreshlaneTask(config={"scenario": scenario, "slots": 100, "threads": 1}),
            algorithm_config=algorithm,
            model_config=model,
            critic_model_config=model,
            seed=args.seed,
            config=config,
        )
        experiment.run()
        print(f"{type(algorithm).__name__}: mean return of an agent {experiment.mean_return:.2f}")


if __name__ == "__main__":
    main()
