"""Gymnasium's vector wrappers around many worlds: statistics of episodes and scaled rewards.

    pip install freshlane
    python examples/gymnasium_wrappers.py
"""

import numpy as np
from gymnasium.wrappers.vector import RecordEpisodeStatistics, TransformReward

from freshlane import Table
from freshlane.adapters.gymnasium import VectorEnvironment


def main() -> None:
    env = VectorEnvironment(worlds=32, seed=1, slots=200, encoding="int8", threads=1)
    wrapped = TransformReward(RecordEpisodeStatistics(env), lambda reward: 10 * reward)
    table = Table.shipped()
    observations, _ = wrapped.reset()
    returns = []
    for _ in range(400):
        actions = table.act(np.ascontiguousarray(observations))
        observations, rewards, terminations, truncations, infos = wrapped.step(actions)
        if "episode" in infos:
            returns.extend(infos["episode"]["r"][infos["_episode"]])
    print(f"{len(returns)} episodes of one vehicle each, mean return {np.mean(returns):.2f}")


if __name__ == "__main__":
    main()
