"""PPO of Stable-Baselines3 on one world through SuperSuit, as for any PettingZoo environment, and on many through the adapter.

    pip install 'freshlane[stable-baselines3]' supersuit
    python examples/supersuit_sb3_ppo.py --steps 200000
"""

import argparse
import time

import supersuit
from stable_baselines3 import PPO

from freshlane import Scenario, parallel_env
from freshlane.adapters.stable_baselines3 import VecEnvironment


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=20_000, help="of agents, in all")
    parser.add_argument("--worlds", type=int, default=16)
    parser.add_argument("--vehicles", type=int, default=5)
    args = parser.parse_args()
    scenario = Scenario(settings={"cell.vehicles": args.vehicles})
    one = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(scenario, slots=200))
    through_supersuit = supersuit.concat_vec_envs_v1(one, args.worlds, base_class="stable_baselines3")
    adapter = VecEnvironment(scenario, worlds=args.worlds, slots=200, threads=1)
    for name, env in (("SuperSuit", through_supersuit), ("adapter", adapter)):
        model = PPO("MlpPolicy", env, n_steps=64, batch_size=1024, n_epochs=4, gamma=0.97, device="cpu")
        start = time.process_time()
        model.learn(args.steps)
        seconds = time.process_time() - start
        print(f"{name}: {model.num_timesteps} steps of agents in {seconds:.1f} processor seconds")


if __name__ == "__main__":
    main()
