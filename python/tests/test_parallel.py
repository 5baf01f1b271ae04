"""The PettingZoo environment: PettingZoo's own tests, and what it says beyond them."""

import numpy as np
import pytest
from pettingzoo.test import parallel_api_test, parallel_seed_test

from freshlane import ParallelEnvironment, Scenario, parallel_env


@pytest.mark.parametrize("encoding", ["int8", "float32"])
@pytest.mark.filterwarnings("ignore")  # PettingZoo warns of spaces that it does not prefer.
def test_parallel_api(encoding):
    parallel_api_test(parallel_env(encoding=encoding, slots=100), num_cycles=500)


@pytest.mark.filterwarnings("ignore")
def test_seeds():
    parallel_seed_test(lambda: parallel_env(slots=200))


def test_an_episode():
    env = ParallelEnvironment(Scenario(settings={"cell.vehicles": 5}), slots=50, reward="team")
    observations, infos = env.reset(seed=3)
    assert list(observations) == env.agents == [f"vehicle_{i}" for i in range(5)]
    kept = observations["vehicle_0"].copy()
    while env.agents:
        agents = env.agents
        observations_now, rewards, terminations, truncations, infos = env.step(
            {agent: int(infos[agent]["age_ms"] % 2) for agent in agents}
        )
        assert all(env.observation_space(agent).contains(observations_now[agent]) for agent in agents)
        assert len(set(rewards.values())) == 1 and not any(terminations.values())
    assert all(truncations.values())
    assert (observations["vehicle_0"] == kept).all(), "agents may keep observations"
    assert env.step({}) == ({}, {}, {}, {}, {})


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
    with pytest.raises(ValueError, match=r"actions\[0, 3\]: found 6, expected 0 to 5"):
        env.step({**good, "vehicle_3": 6})
    with pytest.raises(TypeError, match="actions: found an array of float64"):
        env.step({**good, "vehicle_3": np.float64(1)})
