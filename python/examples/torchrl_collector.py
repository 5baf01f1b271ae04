"""Experience from many worlds through a TorchRL collector, and how fast it comes.

    pip install 'freshlane[torchrl]'
    python examples/torchrl_collector.py
"""

import argparse
import time

import torch
from tensordict.nn import TensorDictModule
from torch import nn
from torchrl.collectors import SyncDataCollector
from torchrl.modules import ProbabilisticActor

from freshlane import ACTIONS, INPUTS
from freshlane.adapters.torchrl import GROUP, TorchRLEnvironment


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--worlds", type=int, default=256)
    parser.add_argument("--slots", type=int, default=100, help="a batch of experience")
    parser.add_argument("--batches", type=int, default=3)
    args = parser.parse_args()
    torch.set_num_threads(1)
    env = TorchRLEnvironment(worlds=args.worlds, seed=1, threads=1)
    network = nn.Sequential(nn.Linear(INPUTS, 32), nn.ReLU(), nn.Linear(32, ACTIONS))
    actor = ProbabilisticActor(
        TensorDictModule(network, in_keys=[(GROUP, "observation")], out_keys=[(GROUP, "logits")]),
        in_keys=[(GROUP, "logits")],
        out_keys=[(GROUP, "action")],
        distribution_class=torch.distributions.Categorical,
    )
    frames = args.worlds * args.slots
    collector = SyncDataCollector(
        lambda: env, actor, frames_per_batch=frames, total_frames=args.batches * frames, device="cpu"
    )
    start = time.process_time()
    for batch in collector:
        seconds = time.process_time() - start
        reward = batch["next", GROUP, "reward"].mean()
        print(f"{tuple(batch.shape)} slots, mean reward {reward:.3f}, {frames / seconds:,.0f} slots a processor second")
        start = time.process_time()
    collector.shutdown()


if __name__ == "__main__":
    main()
