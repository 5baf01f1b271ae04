"""Trains a policy with proximal policy optimisation (PPO) in torch, compares it on held-out worlds, and exports a firmware table.

One file from top to bottom, in the style of CleanRL. All vehicles of all worlds share one small network, which sees only what
a unit senses; a critic that also sees its neighbours' observations helps in training and is thrown away. Trains in
half a minute of processor time on one thread; the comparisons behind it take as long again or longer:

    python examples/train_ppo.py --out table.bin

PPO: J. Schulman and others, "Proximal Policy Optimization Algorithms", 2017. Advantages: J. Schulman and others,
"High-Dimensional Continuous Control Using Generalized Advantage Estimation", 2016. A critic that sees more than the actors: C. Yu
and others, "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games", 2022.
"""

import argparse
import time
from collections.abc import Iterator

import torch
from torch import nn

import freshlane


def arguments(given: list[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    number = lambda name, default, text: parser.add_argument(  # noqa: E731
        f"--{name}", type=type(default), default=default, help=f"{text} [default: {default}]"
    )
    number("seed", 1, "of training worlds and of torch")
    number("vehicles", 20, "vehicles in a cell")
    number("worlds", 24, "worlds at once")
    number("iterations", 320, "rollouts")
    number("rollout", 32, "slots of a rollout")
    number("episode", 256, "slots until all worlds are replaced")
    number("epochs", 2, "passes over a rollout")
    number("minibatches", 4, "optimiser steps of a pass")
    number("learning-rate", 4e-3, "first learning rate; it falls linearly to 0")
    number("discount", 0.97, "of rewards, a slot")
    number("trace", 0.9, "lambda of the generalised advantage estimate")
    number("clip", 0.2, "largest change of a decision's probability ratio")
    number("entropy", 0.002, "weight of the entropy bonus")
    number("threads", 1, "torch's and the simulator's threads")
    parser.add_argument("--out", help="write the firmware's table to this file")
    return parser.parse_args(given)


def perceptron(*widths: int, last: float) -> nn.Sequential:
    """Dense layers with ReLU between them: what the firmware runs. Orthogonal at first, the last layer with this gain."""
    layers: list[nn.Module] = []
    for inputs, outputs in zip(widths, widths[1:]):
        layers += [nn.Linear(inputs, outputs), nn.ReLU()]
        nn.init.orthogonal_(layers[-2].weight, 2**0.5 if len(layers) < 2 * len(widths) - 2 else last)
        nn.init.zeros_(layers[-2].bias)
    return nn.Sequential(*layers[:-1])


def with_neighbours(observations: torch.Tensor) -> torch.Tensor:
    """What the critic sees: a vehicle's observation, and the mean of its world's."""
    mean = observations.mean(dim=-2, keepdim=True).expand_as(observations)
    return torch.cat([observations, mean], dim=-1)


def learn(args: argparse.Namespace, scenario: freshlane.Scenario) -> Iterator[tuple[int, nn.Sequential, float]]:
    """After each iteration its number, the actor so far, and the mean age in training in ms."""
    torch.manual_seed(args.seed)
    torch.set_num_threads(args.threads)
    env = freshlane.BatchEnvironment(
        scenario,
        worlds=args.worlds,
        seed=args.seed,
        slots=args.episode,
        encoding="float32",
        reward="team",
        threads=args.threads,
    )
    actor = perceptron(freshlane.INPUTS, 32, 32, freshlane.ACTIONS, last=0.01)
    critic = perceptron(2 * freshlane.INPUTS, 64, 64, 1, last=1.0)
    with torch.no_grad():
        # Silence first, then the own place: if everybody sends in every slot, nobody is received and nothing can be learned.
        actor[-1].bias[:2] = torch.tensor([6.0, 4.0])
    parameters = [*actor.parameters(), *critic.parameters()]
    optimiser = torch.optim.Adam(parameters, lr=args.learning_rate, eps=1e-5)

    shape = (args.rollout, env.worlds, env.vehicles)
    observations = torch.zeros(*shape, freshlane.INPUTS)
    actions = torch.zeros(shape, dtype=torch.int64)
    log_probabilities, rewards = torch.zeros(shape), torch.zeros(shape)
    values = torch.zeros(args.rollout + 1, *shape[1:])
    # Copied, because views change with every step.
    now = torch.tensor(env.reset()[0])
    for iteration in range(args.iterations):
        optimiser.param_groups[0]["lr"] = args.learning_rate * (1 - iteration / args.iterations)
        # Rollout.
        with torch.no_grad():
            for slot in range(args.rollout):
                policy = torch.distributions.Categorical(logits=actor(now))
                action = policy.sample()
                observations[slot], actions[slot] = now, action
                log_probabilities[slot] = policy.log_prob(action)
                values[slot] = critic(with_neighbours(now)).squeeze(-1)
                following, reward, _, _, _ = env.step(action)
                rewards[slot] = torch.tensor(reward)
                now = torch.tensor(following)
            values[-1] = critic(with_neighbours(now)).squeeze(-1)
            # Nothing ever terminates, so the last value stands for all that follows.
            advantages = torch.zeros(shape)
            later = torch.zeros(shape[1:])
            for slot in reversed(range(args.rollout)):
                error = rewards[slot] + args.discount * values[slot + 1] - values[slot]
                later = error + args.discount * args.trace * later
                advantages[slot] = later
            returns = advantages + values[:-1]
            if env.elapsed >= args.episode:
                now = torch.tensor(env.reset()[0])

        # Learning.
        critic_inputs = with_neighbours(observations).flatten(0, 2)
        flat = [array.flatten(0, 2) for array in (observations, actions, log_probabilities, advantages, returns)]
        for _ in range(args.epochs):
            for chosen in torch.randperm(len(critic_inputs)).chunk(args.minibatches):
                seen, done, old_log_probability, advantage, wanted = (array[chosen] for array in flat)
                policy = torch.distributions.Categorical(logits=actor(seen))
                ratio = (policy.log_prob(done) - old_log_probability).exp()
                advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
                clipped = ratio.clamp(1 - args.clip, 1 + args.clip)
                policy_loss = -torch.min(ratio * advantage, clipped * advantage).mean()
                value_loss = (critic(critic_inputs[chosen]).squeeze(-1) - wanted).square().mean()
                loss = policy_loss + value_loss - args.entropy * policy.entropy().mean()
                optimiser.zero_grad()
                loss.backward()
                nn.utils.clip_grad_norm_(parameters, 0.5)
                optimiser.step()
        yield iteration + 1, actor, float(-100 * rewards.mean())


def main() -> None:
    args = arguments()
    scenario = freshlane.Scenario(settings={"cell.vehicles": args.vehicles})
    start = time.process_time()
    for iteration, actor, age in learn(args, scenario):
        if iteration % 10 == 0:
            seconds = time.process_time() - start
            print(f"rollout {iteration:4}: mean age {age:6.2f} ms in training, {seconds:4.0f} s of processor time")

    # Held-out worlds: none of them was trained on.
    learned = freshlane.evaluate(actor, scenario, threads=args.threads)
    exported = freshlane.export(actor, scenario, seed=args.seed, threads=args.threads)
    table = freshlane.evaluate(exported.table, scenario, threads=args.threads)
    for name, found in (
        ("learned, float", learned),
        ("learned, firmware table", table),
        ("age-threshold ALOHA", freshlane.evaluate("age-threshold", scenario, threads=args.threads)),
        ("shipped table", freshlane.evaluate("actor", scenario, threads=args.threads)),
    ):
        print(f"{name:24} {found.mean_age_ms:6.3f} +- {found.mean_age_ci95_ms:.3f} ms")
    print(
        f"{learned.vehicles} vehicles, {learned.worlds} held-out worlds x {learned.slots} slots after {learned.warmup}, "
        f"seed {learned.seed}; float and int8 agree on {exported.agreement:.2%} of decisions "
        f"({exported.worlds} worlds x {exported.slots} slots)"
    )
    if args.out:
        exported.table.write(args.out)
        print(f"wrote {args.out}: {exported.table}")


if __name__ == "__main__":
    main()
