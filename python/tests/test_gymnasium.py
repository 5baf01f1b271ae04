"""Many worlds as a Gymnasium vector environment."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from freshlane import BatchEnvironment, Scenario, Table
from freshlane.adapters.gymnasium import VectorEnvironment

CHURN = Scenario(settings={"cell.vehicles": 6, "cell.replacement_probability": 0.02})


def test_it_is_the_batch_with_an_environment_a_vehicle():
    env, batch = VectorEnvironment(CHURN, worlds=3, seed=1, slots=50), BatchEnvironment(CHURN, worlds=3, seed=1, slots=50, encoding="float32")
    assert isinstance(env, VectorEnv) and env.num_envs == 18
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert batch.metadata["autoreset_mode"] is AutoresetMode.DISABLED
    observations, infos = env.reset(seed=4, options={})
    expected, _ = batch.reset(seed=4)
    assert (observations == expected.reshape(18, 22)).all() and infos == {}
    table, left = Table.shipped(), 0
    for slot in range(1, 121):
        assert env.observation_space.contains(observations)
        before = observations
        actions = table.act(batch.observations)
        observations, rewards, terminations, truncations, infos = env.step(actions.ravel())
        expected = batch.step(actions)[0].copy()
        assert (rewards == batch.rewards.ravel()).all()
        assert (terminations == batch.replaced.ravel()).all()
        over = slot % 50 == 0
        assert (truncations == (over & ~terminations)).all()
        ended = terminations | truncations
        assert ended.any() == ("final_obs" in infos)
        if ended.any():
            assert (infos["_final_obs"] == ended).all()
            last = np.where(terminations[:, None], before, expected.reshape(18, 22))
            assert (infos["final_obs"][ended] == last[ended]).all(), "the true last observation"
        if over:
            expected, _ = batch.reset()
        assert (observations == expected.reshape(18, 22)).all()
        left += terminations.sum()
    # 43 expected.
    assert 20 < left < 70
    kept = before.copy()
    env.step(np.zeros(18, int))
    assert (before == kept).all(), "observations may be kept"
    env.close()


def test_statistics_of_episodes():
    env = RecordEpisodeStatistics(VectorEnvironment(worlds=2, slots=30, seed=1))
    env.reset()
    for _ in range(30):
        *_, infos = env.step(env.action_space.sample())
    assert infos["_episode"].all() and (infos["episode"]["l"] == 30).all() and (infos["episode"]["r"] < 0).all()


def test_bad_arguments_are_named():
    env = VectorEnvironment(worlds=2)
    with pytest.raises(TypeError, match="seed: found a list of 2, expected one number for all worlds"):
        env.reset(seed=[1, 2])
    with pytest.raises(ValueError, match="seed: found -1, expected a whole number from 0"):
        env.reset(seed=-1)
    with pytest.raises(TypeError, match="actions: found an array of float64"):
        env.step(np.zeros(40))
