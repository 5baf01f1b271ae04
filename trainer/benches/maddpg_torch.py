"""The update of `trainer bench` in PyTorch, as fast as it is known to go there: all vehicles in one batched product (baddbmm),
fused Adam, targets by one foreach call. Same sizes, same batch, same delay.

    python3 -m venv /tmp/torch && /tmp/torch/bin/pip install torch
    /tmp/torch/bin/python trainer/benches/maddpg_torch.py --threads 2 --updates 40

Prints updates per second of wall time, and per second of processor time times threads, which other work on the machine disturbs
less.
"""

import argparse
import math
import time

import torch

arguments = argparse.ArgumentParser()
arguments.add_argument("--threads", type=int, default=2)
arguments.add_argument("--updates", type=int, default=40)
arguments = arguments.parse_args()
torch.set_num_threads(arguments.threads)
torch.manual_seed(1)

# Table I of the paper, and presets/paper.toml.
VEHICLES, OBSERVED, ACTION, BATCH, DELAY = 20, 7, 2, 64, 2
GAMMA, TAU, ACTOR_RATE, CRITIC_RATE = 0.99, 5e-4, 1e-4, 1e-3
STORED = 20_000


class Networks:
    """`copies` perceptrons of one shape; x is [copies, batch, inputs]."""

    def __init__(self, copies, widths):
        self.parameters = []
        for inputs, outputs in zip(widths, widths[1:]):
            limit = 1 / math.sqrt(inputs)
            weight = torch.empty(copies, inputs, outputs).uniform_(-limit, limit).requires_grad_()
            bias = torch.empty(copies, 1, outputs).uniform_(-limit, limit).requires_grad_()
            self.parameters += [weight, bias]

    def __call__(self, x, parameters=None):
        parameters = parameters or self.parameters
        for index in range(0, len(parameters), 2):
            x = torch.baddbmm(parameters[index + 1], x, parameters[index])
            if index + 2 < len(parameters):
                x = torch.relu(x)
        return x


actors = Networks(VEHICLES, [OBSERVED, 1024, 512, ACTION])
local = Networks(VEHICLES, [OBSERVED + ACTION, 1024, 512, 256, 1])
twins = Networks(2, [VEHICLES * (OBSERVED + ACTION), 1024, 512, 256, 1])
targets = [[p.detach().clone() for p in n.parameters] for n in (actors, local, twins)]
optimisers = [
    torch.optim.Adam(n.parameters, lr=rate, fused=True)
    for n, rate in ((actors, ACTOR_RATE), (local, CRITIC_RATE), (twins, CRITIC_RATE))
]
store = {
    "now": torch.randn(STORED, VEHICLES, OBSERVED),
    "later": torch.randn(STORED, VEHICLES, OBSERVED),
    "action": torch.rand(STORED, VEHICLES, ACTION) * 2 - 1,
    "reward": -torch.rand(STORED, VEHICLES),
}


def joint(observation, action):
    """[batch, vehicles x (observed + action)], once for each twin."""
    return torch.cat([observation, action], -1).flatten(1).expand(2, -1, -1)


def follow(target, networks):
    with torch.no_grad():
        torch._foreach_lerp_(target, [p.detach() for p in networks.parameters], TAU)


def update(count):
    index = torch.randint(0, STORED, (BATCH,))
    now, later, action, reward = (store[name][index] for name in ("now", "later", "action", "reward"))
    now_by, later_by, action_by = (x.transpose(0, 1) for x in (now, later, action))
    with torch.no_grad():
        next_by = torch.tanh(actors(later_by, targets[0]))
        noise = (0.2 * torch.randn_like(next_by)).clamp(-0.5, 0.5)
        next_by = (next_by + noise).clamp(-1, 1)
        least = twins(joint(later, next_by.transpose(0, 1)), targets[2]).min(0).values
        goal = reward.mean(1, keepdim=True) + GAMMA * least
    loss = ((twins(joint(now, action)) - goal) ** 2).mean((1, 2)).sum()
    optimisers[2].zero_grad()
    loss.backward()
    optimisers[2].step()
    follow(targets[2], twins)
    if count % DELAY:
        return
    with torch.no_grad():
        own = local(torch.cat([later_by, next_by], -1), targets[1])
        goal = reward.t().unsqueeze(-1) + GAMMA * own
    loss = ((local(torch.cat([now_by, action_by], -1)) - goal) ** 2).mean((1, 2)).sum()
    optimisers[1].zero_grad()
    loss.backward()
    optimisers[1].step()
    chosen = torch.tanh(actors(now_by))
    for network in (local, twins):
        for parameter in network.parameters:
            parameter.requires_grad_(False)
    first = [p[:1] for p in twins.parameters]
    worth = twins(joint(now, chosen.transpose(0, 1))[:1], first).mean()
    worth = worth + local(torch.cat([now_by, chosen], -1)).mean((1, 2)).sum()
    optimisers[0].zero_grad()
    (-worth).backward()
    for network in (local, twins):
        for parameter in network.parameters:
            parameter.requires_grad_(True)
    optimisers[0].step()
    follow(targets[0], actors)
    follow(targets[1], local)


for count in range(4):
    update(count)
wall, processor = time.perf_counter(), time.process_time()
for count in range(arguments.updates):
    update(count)
wall, processor = time.perf_counter() - wall, time.process_time() - processor
print(
    f"torch {torch.__version__}: {arguments.updates / wall:.2f} updates/s, "
    f"{arguments.updates * arguments.threads / processor:.2f} by processor time on {arguments.threads} threads"
)
