"""The PettingZoo environment: PettingZoo's own tests, and what it says beyond them."""

import time

import numpy as np
import pytest
from pettingzoo.test import api_test, parallel_api_test, parallel_seed_test, seed_test
from pettingzoo.utils import aec_to_parallel, parallel_to_aec

import freshlane
from freshlane import ParallelEnvironment, Scenario, parallel_env

CHURN = Scenario(settings={"cell.vehicles": 6, "cell.replacement_probability": 0.05})


@pytest.mark.parametrize("encoding", ["int8", "float32"])
@pytest.mark.parametrize("scenario", [None, CHURN])
@pytest.mark.filterwarnings("ignore:.*")  # PettingZoo warns of spaces that it does not prefer, and that not every number was needed.
def test_parallel_api(encoding, scenario):
    parallel_api_test(parallel_env(scenario, encoding=encoding, slots=100), num_cycles=500)


@pytest.mark.filterwarnings("ignore:.*")
def test_agents_one_after_the_other():
    few = Scenario(settings={"cell.vehicles": 4})
    api_test(freshlane.env(few, slots=60), num_cycles=300)
    seed_test(lambda: freshlane.env(few, slots=60), num_cycles=100)
    parallel_api_test(aec_to_parallel(parallel_to_aec(parallel_env(few, slots=60))), num_cycles=100)


@pytest.mark.filterwarnings("ignore:.*")
def test_seeds():
    parallel_seed_test(lambda: parallel_env(slots=200))


def test_an_episode():
    env = ParallelEnvironment(Scenario(settings={"cell.vehicles": 5}), max_cycles=50, reward="team")
    observations, infos = env.reset(seed=3, options={"unknown": 1})
    assert list(observations) == env.agents == env.possible_agents == [f"vehicle_{i}" for i in range(5)]
    kept = observations["vehicle_0"].copy()
    slots = 0
    while env.agents:
        agents = env.agents
        observations_now, rewards, terminations, truncations, infos = env.step(
            {agent: int(infos[agent]["age_ms"] % 2) for agent in agents}
        )
        slots += 1
        assert all(env.observation_space(agent).contains(observations_now[agent]) for agent in agents)
        assert env.state_space.contains(env.state())
        assert (env.state() == np.stack(list(observations_now.values()))).all()
        assert len(set(rewards.values())) == 1 and not any(terminations.values())
    assert all(truncations.values()) and slots == 50
    assert (observations["vehicle_0"] == kept).all(), "agents may keep observations"
    assert env.step({}) == ({}, {}, {}, {}, {})


def test_who_is_replaced_is_terminated_and_who_comes_is_somebody_new():
    env = parallel_env(CHURN, seed=1, slots=400)
    observations, infos = env.reset()
    ages = {agent: info["age_ms"] for agent, info in infos.items()}
    known, ended, over = set(env.agents), 0, {}
    while env.agents:
        before, agents = observations, env.agents
        observations, rewards, terminations, truncations, infos = env.step(
            {agent: int(infos[agent]["action_mask"][1]) for agent in agents}
        )
        gone = {agent for agent in agents if terminations[agent]}
        come = observations.keys() - set(agents)
        assert len(come) == len(gone) and not come & known, "numbers are given once"
        for agent in agents:
            ages[agent] = 1 if infos[agent]["received"] else ages[agent] + 1
            assert infos[agent]["age_ms"] == ages[agent]
            assert rewards[agent] == pytest.approx(-min(ages[agent], 100) / 100, rel=1e-6)
            assert infos[agent]["replaced"] == (agent in gone)
        for agent in gone:
            assert (observations[agent] == before[agent]).all(), "the last that it made itself"
            assert not truncations[agent]
        for agent in come:
            ages[agent] = 100
            assert infos[agent]["age_ms"] == 100 and rewards[agent] == 0 and not terminations[agent]
        known |= come
        ended += len(gone)
        assert env.agents == [] or len(env.agents) == 6
        over = truncations
    # 120 expected.
    assert 80 < ended < 160 and sum(over.values()) == 6
    # A name stays its own to the episode's end, and begins anew with the next one.
    assert list(env.reset()[0]) == [f"vehicle_{i}" for i in range(6)]


def test_an_episode_ends_where_numbers_run_out():
    env = parallel_env(CHURN, seed=1, slots=400)
    env.possible_agents = env.possible_agents[:8]
    env.reset()
    slots = 0
    while env.agents:
        *_, terminations, truncations, _ = env.step(dict.fromkeys(env.agents, 0))
        slots += 1
    assert 1 < slots < 100
    assert all(terminations[agent] != truncations[agent] for agent in terminations) and any(terminations.values())


def test_masks_leave_what_can_be_heard():
    env = parallel_env(Scenario(settings={"radio.max_power_dbm": 20}), slots=10**6)
    _, infos = env.reset(seed=1)
    in_vain = heard = 0
    rng = np.random.default_rng(1)
    for _ in range(2000):
        # One vehicle sends alone.
        agent, action = env.agents[rng.integers(20)], int(rng.integers(1, 7))
        mask = infos[agent]["action_mask"]
        assert mask.shape == (7,) and mask.dtype == np.int8 and mask[0] == 1
        *_, infos = env.step({each: action * (each == agent) for each in env.agents})
        assert infos[agent]["received"] == bool(mask[action])
        heard += infos[agent]["received"]
        in_vain += not mask[action]
    assert heard > 100 and in_vain > 100


def test_pictures():
    env = parallel_env(slots=20, render_mode="rgb_array")
    env.reset(seed=1)
    first = env.render()
    for _ in range(10):
        env.step(dict.fromkeys(env.agents, 1))
    second = env.render()
    assert first.dtype == np.uint8 and first.shape == second.shape and first.shape[0] == 400 and first.shape[2] == 3
    assert (first != second).any() and "rgb_array" in env.metadata["render_modes"]
    with pytest.raises(ValueError, match='render_mode: found "human", expected "rgb_array"'):
        parallel_env(render_mode="human")
    with pytest.warns(UserWarning, match="render without a mode"):
        assert parallel_env().render() is None


def test_resets_go_on_to_other_worlds():
    env = parallel_env()
    states = [env.reset(seed=1) and env.state(), env.reset() and env.state(), env.reset(seed=1) and env.state()]
    assert (states[0] != states[1]).any() and (states[0] == states[2]).all()


def test_bad_actions_are_named():
    env = parallel_env()
    env.reset()
    good = dict.fromkeys(env.agents, 0)
    with pytest.raises(ValueError, match='found agent "bus", expected one of env.agents'):
        env.step({**good, "bus": 0})
    with pytest.raises(ValueError, match='found none for "vehicle_19"'):
        env.step({agent: 0 for agent in env.agents[:-1]})
    with pytest.raises(ValueError, match=r"actions\[0, 3\]: found 7, expected 0 to 6"):
        env.step({**good, "vehicle_3": 7})
    with pytest.raises(TypeError, match="actions: found an array of float64"):
        env.step({**good, "vehicle_3": np.float64(1)})
    with pytest.raises(ValueError, match="max_cycles: found 0, expected a whole number from 1"):
        parallel_env(max_cycles=0)


def test_one_world_s_dictionaries_are_within_ten_times_of_the_batch_of_one_world():
    """Two to three times are measured; more than half of what is added is building the dictionaries."""
    env, batch = parallel_env(slots=10**6), freshlane.BatchEnvironment(worlds=1, slots=None, encoding="float32", threads=1)
    env.reset()
    actions = {agent: int(number % 5 == 0) for number, agent in enumerate(env.agents)}
    row = np.array([list(actions.values())], np.uint8)

    def seconds(step, slots=500):
        start = time.process_time()
        for _ in range(slots):
            step()
        return time.process_time() - start

    # The best of a few: other programs only slow them down.
    dictionaries = min(seconds(lambda: env.step(actions)) for _ in range(5))
    arrays = min(seconds(lambda: batch.step(row)) for _ in range(5))
    assert dictionaries < 10 * arrays


@pytest.mark.parametrize("kind", [int, np.int64, np.uint8, np.array])
def test_actions_of_any_whole_kind_are_the_same(kind):
    env, other = parallel_env(seed=1), parallel_env(seed=1)
    env.reset(), other.reset()
    for slot in range(50):
        actions = {agent: (slot + number) % 7 for number, agent in enumerate(env.agents)}
        told = env.step({agent: kind(action) for agent, action in actions.items()})
        assert told[1] == other.step(actions)[1]
    for bad in (-1, 256, 10**6):
        with pytest.raises(ValueError, match=rf"actions\[0, 0\]: found {bad}, expected 0 to 6"):
            env.step({**actions, "vehicle_0": bad})
