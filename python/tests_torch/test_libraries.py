"""SuperSuit, Stable-Baselines3, TorchRL and BenchMARL with worlds of ours: what they are told, that they learn, and how fast."""

import pickle
import runpy
import sys
import time
import warnings
from pathlib import Path

import numpy as np
import pytest
import torch

from freshlane import BatchEnvironment, Scenario, parallel_env

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import supersuit
    from torchrl.envs import check_env_specs
    from torchrl.envs.libs.pettingzoo import PettingZooWrapper

    from freshlane.adapters.stable_baselines3 import VecEnvironment
    from freshlane.adapters.torchrl import GROUP, TorchRLEnvironment

pytestmark = pytest.mark.filterwarnings("ignore:.*")  # These libraries warn of each other.

CHURN = Scenario(settings={"cell.vehicles": 6, "cell.replacement_probability": 0.02})
EXAMPLES = Path(__file__).parents[1] / "examples"


@pytest.fixture(autouse=True)
def one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.parametrize(("base", "processes"), [("gymnasium", 0), ("gymnasium", 2), ("stable_baselines3", 0)])
def test_supersuit_s_copies_play_different_worlds(base, processes):
    one = supersuit.pettingzoo_env_to_vec_env_v1(parallel_env(Scenario(settings={"cell.vehicles": 4}), slots=50))
    many = supersuit.concat_vec_envs_v1(one, 4, num_cpus=processes, base_class=base)
    found = many.reset()
    observations = (found[0] if isinstance(found, tuple) else found).copy()
    assert observations.shape == (16, 22)
    worlds = observations.reshape(4, -1)
    assert len({world.tobytes() for world in worlds}) == 4
    if base == "gymnasium":
        again = [many.reset(seed=3)[0].copy() for _ in range(2)]
        assert (again[0] == again[1]).all()
    many.close()


def test_stable_baselines_is_told_the_truth():
    env, batch = VecEnvironment(CHURN, worlds=3, slots=50), BatchEnvironment(CHURN, worlds=3, slots=50, encoding="float32")
    env.seed(4)
    observations, _ = env.reset(), batch.reset(seed=4)
    assert env.num_envs == 18 and pickle.loads(pickle.dumps(env)).num_envs == 18
    left = 0
    for slot in range(1, 121):
        assert (np.stack(env.env_method("action_masks")) == batch.action_masks.reshape(18, 7)).all()
        before, actions = observations, batch.action_space.sample()
        observations, rewards, done, infos = env.step(actions.ravel())
        expected = batch.step(actions)[0].reshape(18, 22).copy()
        replaced, over = batch.replaced.ravel(), slot % 50 == 0
        assert (rewards == batch.rewards.ravel()).all() and (done == (replaced | over)).all()
        for index in range(18):
            if not done[index]:
                assert not infos[index]
                continue
            assert infos[index]["TimeLimit.truncated"] == (not replaced[index])
            last = before if replaced[index] else expected
            assert (infos[index]["terminal_observation"] == last[index]).all()
        if over:
            expected = batch.reset()[0].reshape(18, 22)
        assert (observations == expected).all()
        left += replaced.sum()
    assert 20 < left < 70
    with pytest.raises(AttributeError, match="found a method for single environments"):
        env.env_method("render")


def test_torchrl_is_told_the_truth():
    env = TorchRLEnvironment(CHURN, worlds=3, slots=50, action_masks=True)
    check_env_specs(env)
    env.set_seed(4)
    batch = BatchEnvironment(CHURN, worlds=3, slots=50, encoding="float32")
    batch.reset(seed=4)
    played = env.rollout(120, break_when_any_done=False)
    now, after = played[GROUP], played["next", GROUP]
    left = 0
    for slot in range(120):
        assert (now["observation"][:, slot].numpy() == batch.float_observations).all()
        assert (now["action_mask"][:, slot].numpy() == batch.action_masks).all()
        batch.step(now["action"][:, slot].numpy())
        over = slot % 50 == 49
        assert (after["observation"][:, slot].numpy() == batch.float_observations).all()
        assert (after["reward"][:, slot, :, 0].numpy() == batch.rewards).all()
        assert (after["terminated"][:, slot, :, 0].numpy() == batch.replaced).all()
        assert (after["truncated"][:, slot, :, 0].numpy() == (over & ~batch.replaced)).all()
        assert (played["next", "done"][:, slot].numpy() == over).all()
        assert not played["next", "terminated"][:, slot].any()
        left += batch.replaced.sum()
        if over:
            batch.reset()
    assert 20 < left < 70
    with pytest.raises(ValueError, match="reset: found 1 of 3 worlds, expected all of them"):
        env.reset(env.reset().set("_reset", torch.tensor([[True], [False], [False]])))


def test_torchrl_s_own_wrapper_plays_one_world():
    env = PettingZooWrapper(parallel_env(Scenario(settings={"cell.vehicles": 4}), slots=9), return_state=True)
    check_env_specs(env)
    played = env.rollout(20, break_when_any_done=False)
    assert played["next", "done"].flatten().nonzero().flatten().tolist() == [8, 17]


def speed(step, slots=150):
    """World-slots of 256 worlds a processor second: the best of a few tries, since other programs only slow it down."""
    for _ in range(10):
        step()
    tries = []
    for _ in range(4):
        start = time.process_time()
        for _ in range(slots):
            step()
        tries.append(256 * slots / (time.process_time() - start))
    return max(tries)


def test_adapters_keep_the_batch_s_speed():
    """A tenth of what is measured on a free core, so that a busy one passes."""
    # Every fifth sends, as in benchmarks/speed.py.
    actions = (np.arange(256 * 20) % 5 == 0).astype(np.int64)
    baselines = VecEnvironment(worlds=256, threads=1)
    baselines.reset()
    assert speed(lambda: baselines.step(actions)) > 60_000
    env = TorchRLEnvironment(worlds=256, threads=1)
    state, chosen = [env.reset()], torch.from_numpy(actions.reshape(256, 20))

    def step():
        state[0].set((GROUP, "action"), chosen)
        _, state[0] = env.step_and_maybe_reset(state[0])

    assert speed(step) > 40_000


@pytest.mark.parametrize(
    ("name", "arguments", "says"),
    [
        ("supersuit_sb3_ppo", "--steps 2000 --worlds 2", ("SuperSuit: ", "adapter: ")),
        ("torchrl_collector", "--worlds 8 --slots 20", ("(8, 20) slots", "mean reward -")),
        ("benchmarl_ippo_mappo", "--iterations 1 --worlds 4", ("IppoConfig: mean return", "MappoConfig: mean return")),
        ("gymnasium_wrappers", "", ("1280 episodes of one vehicle each, mean return -",)),
    ],
)
def test_examples(name, arguments, says, capsys, monkeypatch):
    path = EXAMPLES / f"{name}.py"
    assert len(path.read_text().splitlines()) < 60
    monkeypatch.setattr(sys, "argv", [str(path), *arguments.split()])
    runpy.run_path(str(path), run_name="__main__")
    said = capsys.readouterr().out
    assert all(part in said for part in says), said
