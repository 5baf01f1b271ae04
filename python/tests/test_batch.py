"""The batched environment: views, determinism, actions, bad input."""

import gc

import numpy as np
import pytest

from freshlane import BatchEnvironment, Scenario, Table


def environment(**arguments):
    arguments = {"worlds": 40, "seed": 5, **arguments}
    return BatchEnvironment(**arguments)


def run(env, slots=150):
    """The shipped table's trajectory: all ages."""
    table = Table.shipped()
    return [env.step(table.act(env.observations)) and env.ages.copy() for _ in range(slots)]


def test_views_are_the_simulator_s_memory():
    env = environment()
    names = (
        "observations float_observations rewards ages received present gains_db interference_db "
        "places assigned weights awaits ring_places open_sub_channels thresholds"
    ).split()
    views = {name: getattr(env, name) for name in names}
    addresses = {name: view.__array_interface__["data"] for name, view in views.items()}
    assert all(read_only for _, read_only in addresses.values())
    before = env.ages.copy()
    observations, rewards, *_ = env.step(np.ones((40, 20), np.uint8))
    assert observations is views["observations"] and rewards is views["rewards"]
    assert (views["ages"] != before).any(), "a view shows the next slot"
    env.reset()
    for name, view in views.items():
        assert getattr(env, name) is view
        assert view.__array_interface__["data"] == addresses[name]
        assert not view.flags.owndata and not view.flags.writeable
        with pytest.raises(ValueError, match="read-only"):
            view[...] = 0
        with pytest.raises(ValueError):
            view.flags.writeable = True


def test_views_outlive_their_environment():
    env = environment()
    run(env, 20)
    ages, expected = env.ages, env.ages.copy()
    del env
    gc.collect()
    others = [environment() for _ in range(20)]
    assert (ages == expected).all() and others


def test_a_seed_gives_the_same_bytes_for_any_number_of_threads():
    one, two = run(environment(threads=1)), run(environment(threads=3))
    assert all((a == b).all() for a, b in zip(one, two, strict=True))
    other = run(environment(seed=6))
    assert any((a != b).any() for a, b in zip(one, other, strict=True))


def test_a_world_does_not_depend_on_its_batch():
    whole, few = environment(worlds=40), environment(worlds=3)
    for _ in range(50):
        actions = Table.shipped().act(whole.observations)
        whole.step(actions)
        few.step(actions[:3])
    assert (whole.ages[:3] == few.ages).all() and (whole.observations[:3] == few.observations).all()


def test_resets_go_on_to_new_worlds_and_return_to_a_seed_s_first():
    env = environment()
    first = env.reset()[0].copy()
    assert env.first_world == 0
    second = env.reset()[0].copy()
    assert env.first_world == 40
    assert (first != second).any()
    assert (env.reset(seed=5)[0] == first).all()
    assert env.first_world == 0 and env.elapsed == 0 and (env.ages == 100).all()


def test_ages_and_rewards_follow_receptions():
    env, team = environment(), environment(reward="team")
    table = Table.shipped()
    for _ in range(200):
        before = env.ages.copy()
        actions = table.act(env.observations)
        env.step(actions)
        team.step(actions)
        assert (env.ages == np.where(env.received, 1, before + 1)).all()
        assert np.allclose(env.rewards, -np.minimum(env.ages, 100).astype(np.float32) / 100)
        assert np.allclose(team.rewards, env.rewards.mean(axis=1, keepdims=True))
        assert not env.received[actions == 0].any()
    assert env.received.any() and env.ages.mean() < 20


def test_the_paper_s_reward():
    env = environment(reward="paper", scenario=Scenario(settings={"cell.vehicles": 8}))
    for _ in range(100):
        env.step(Table.shipped().act(env.observations))
        expected = -np.minimum(env.ages, 100.0) / 8 + 0.05 * env.received
        assert np.allclose(env.rewards, expected, atol=1e-6)
    assert env.received.any()


def test_who_was_replaced_is_told_and_paid_for_its_own_age():
    env = environment(scenario=Scenario(settings={"cell.replacement_probability": 0.02}))
    team = environment(scenario=env.scenario, reward="team")
    count = 0
    for _ in range(100):
        before = env.ages.copy()
        actions = Table.shipped().act(env.observations)
        env.step(actions)
        team.step(actions)
        own = np.where(env.received, 1, before + 1)
        assert (env.ages == np.where(env.replaced, 100, own)).all()
        assert np.allclose(env.rewards, -np.minimum(own, 100.0) / 100)
        assert np.allclose(team.rewards, env.rewards.mean(axis=1, keepdims=True))
        count += env.replaced.sum()
    # 1600 expected.
    assert 1400 < count < 1800
    env.reset()
    assert not env.replaced.any()


def test_masks_allow_silence_and_what_the_unit_expects_to_be_heard():
    env = environment(scenario=Scenario(settings={"feedback.measurement_loss": 0.3}))
    assert env.action_masks.shape == (40, 20, 7)
    for _ in range(20):
        nothing = (env.observations == 0).all(axis=-1)
        assert env.action_masks[..., 0].all() and not env.action_masks[nothing][:, 1:].any()
        # Inputs 9 and 11: the own, and the best open sub-channel carries C_min.
        assert (env.action_masks[..., 1] == (env.observations[..., 9] > 0)).all()
        assert (env.action_masks[..., 2:6] == (env.observations[..., 11:12] > 0)).all()
        env.step(np.where(env.action_masks[..., 1], 1, 0))


def test_ages_go_on_beyond_the_least_reward():
    env = environment(worlds=2)
    for _ in range(300):
        env.step(np.zeros((2, 20), np.uint8))
    assert (env.ages == 400).all() and (env.rewards == -1).all()


def test_float_observations_are_the_codes_over_64():
    env = environment(encoding="float32")
    run(env, 5)
    assert (env.float_observations * 64 == env.observations).all()
    observations, _ = env.reset()
    assert observations is env.float_observations and env.observation_space.contains(observations)


def carriers(env):
    """The sub-channel that carries each vehicle's place in this slot, -1 where none does: as the firmware's `ring.rs` has it."""
    slot = 100 + env.elapsed
    hop = ((slot * 0x9E3779B1) % 2**32 >> 16) * env.sub_channels >> 16
    offsets = (env.places.astype(int) - env.sub_channels * slot) % np.maximum(env.ring_places, 1)
    carried = (env.places >= 0) & (offsets < env.sub_channels)
    return np.where(carried, (offsets + hop) % env.sub_channels, -1)


@pytest.mark.parametrize("sub_channels", [1, 3, 7])
def test_observations_are_the_encoded_measurements(sub_channels):
    env = environment(scenario=Scenario("edge", settings={"radio.sub_channels": sub_channels}))
    run(env, 30)
    codes = env.observations.astype(int)
    turns = 0
    for _ in range(20):
        run(env, 1)
        codes, own = env.observations.astype(int), carriers(env)
        assert env.gains_db.shape == env.interference_db.shape == env.open_sub_channels.shape == (40, 20, sub_channels)
        turn = own >= 0
        turns += turn.sum()
        assert (codes[..., 0] == 64 * turn).all()
        gain = np.take_along_axis(env.gains_db, np.maximum(own, 0)[..., None], axis=2)[..., 0]
        # Input 8 is (dB / 10 - 3.5) / 2 in steps of 1/64, at most 1.06 steps off; saturated ones say nothing.
        code = 3.2 * gain - 112
        inside = turn & (code > -127) & (code < 126)
        assert (np.abs(codes[..., 8] - code)[inside] < 1.1).all()
        assert (codes[..., 4] == 64 * env.assigned).all() and (codes[..., 5] == 64 * env.awaits).all()
        assert (codes[..., 12] == 64 * env.gains_hold).all()
        assert (codes[..., 15] == np.minimum(16 * env.weights, 127).astype(int)).all()
        # Levels when contending: whoever has the highest has one of the upper two, and so not the lowest.
        assert (codes[..., 20] <= codes[..., 17]).all() and (codes[..., 17] <= codes[..., 16]).all()
        assert (codes[..., 18] == 64 * env.open_sub_channels.any(axis=-1)).all()
        # Nobody is called who has nowhere to contend.
        assert (env.thresholds == 2**32 - 1)[~env.open_sub_channels.any(axis=-1)].all()
        # A place that is one's own is open to nobody.
        own_is_open = np.take_along_axis(env.open_sub_channels, np.maximum(own, 0)[..., None], axis=2)[..., 0]
        assert not own_is_open[turn & env.assigned].any()
    assert turns > 0 and (env.interference_db >= 0).all()


def test_everybody_has_a_place_where_nobody_fails():
    env = environment(scenario=Scenario(settings={"radio.max_power_dbm": 50}))
    assert (np.sort(env.places, axis=1) == np.arange(20)).all() and (env.ring_places == 20).all()
    assert env.assigned.all() and env.gains_hold and not env.open_sub_channels.any() and not env.awaits.any()


def test_who_measures_nothing_sees_nothing():
    env = environment(scenario=Scenario(settings={"feedback.measurement_loss": 0.5}))
    for _ in range(5):
        env.step(np.ones((40, 20), np.uint8))
        nothing = (env.observations == 0).all(axis=-1)
        assert 0.4 < nothing.mean() < 0.6
        assert (env.gains_db == 0).all(axis=-1)[nothing].all() and (env.gains_db != 0).any(axis=-1)[~nothing].all()


def test_truncation_at_the_episode_s_end():
    env = environment(slots=3)
    ends = [env.step(np.zeros((40, 20), np.uint8))[3].all() for _ in range(3)]
    assert ends == [False, False, True]


def test_action_types_agree():
    rng = np.random.default_rng(1)
    actions = rng.integers(0, 6, (50, 40, 20))
    envs = [environment() for _ in range(3)]
    for slot in actions:
        for env, kind in zip(envs, (np.uint8, np.int64, np.int32), strict=True):
            env.step(slot.astype(kind))
    assert (envs[0].ages == envs[1].ages).all() and (envs[0].ages == envs[2].ages).all()


def test_actions_in_any_order_are_the_same():
    """Fortran's order, gaps, reversed rows, other bytes and lists."""
    actions = np.random.default_rng(3).integers(0, 6, (40, 20)).astype(np.uint8)
    same = (
        np.asfortranarray(actions),
        np.repeat(actions, 2, axis=1)[:, ::2],
        actions[::-1].copy()[::-1],
        actions.astype(">i4"),
        actions.tolist(),
    )
    expected = environment()
    expected.step(actions)
    for other in same:
        env = environment()
        env.step(other)
        assert (env.ages == expected.ages).all() and (env.observations == expected.observations).all()
    by_power = environment()
    channels, powers = np.where(actions > 0, carriers(by_power), -1), np.full((40, 20), 30.0)
    by_power.transmit(np.asfortranarray(channels), np.asfortranarray(powers))
    expected = environment()
    expected.transmit(channels, powers)
    assert (by_power.ages == expected.ages).all()


def test_transmissions_are_the_actions_in_sub_channels_and_dbm():
    by_action, by_power = environment(), environment()
    rng = np.random.default_rng(2)
    for _ in range(100):
        send = rng.random((40, 20)) < 0.5
        channels = np.where(send, carriers(by_power), -1)
        by_action.step(send.astype(np.uint8))
        by_power.transmit(channels, np.full((40, 20), 30.0))
        assert (by_action.ages == by_power.ages).all()
    assert by_action.received.any()
    by_power.transmit(np.zeros((40, 20), np.int8), np.full((40, 20), -100.0, np.float32))
    assert not by_power.received.any(), "nobody hears -100 dBm"


def test_presets_and_settings():
    scenario = Scenario("companion", settings={"cell.vehicles": 7})
    env = environment(scenario=scenario)
    assert env.vehicles == 7 and env.observations.shape == (40, 7, 22)
    assert scenario["mobility.block_x_m"] == 125.0 and scenario == Scenario(
        "companion", settings={"cell.vehicles": 7}
    )
    assert scenario != Scenario("companion") and scenario.to_dict()["cell"]["vehicles"] == 7


def test_a_table_for_other_worlds_is_refused():
    def refused(worlds=40, **settings):
        env = environment(worlds=worlds, scenario=Scenario(settings={key.replace("__", "."): v for key, v in settings.items()}))
        with pytest.raises(ValueError) as error:
            env.check_table(Table.shipped())
        return str(error.value)

    environment().check_table(Table.shipped())
    environment(scenario=Scenario(settings={"radio.max_power_dbm": 23, "radio.sub_channels": 8})).check_table(Table.shipped())
    assert refused(radio__sub_channels=9).startswith("radio.sub_channels: found 9, expected 1 to 8, which the table serves")
    assert refused(worlds=1, cell__vehicles=2001) == "vehicles: found 2001, expected at most 2000, which the table serves"
    assert "as in the table" in refused(radio__min_spectral_efficiency=2)


ZEROS = np.zeros((40, 20), np.uint8)


@pytest.mark.parametrize(
    ("actions", "error", "message"),
    [
        (ZEROS[:, :3], ValueError, r"actions: found shape \(40, 3\), expected shape \(40, 20\)"),
        (ZEROS[0], ValueError, r"actions: found shape \(20,\), expected \(worlds, vehicles\)"),
        (ZEROS + 7, ValueError, r"actions\[0, 0\]: found 7, expected 0 to 6"),
        (ZEROS.astype(int) - 1, ValueError, r"actions\[0, 0\]: found -1, expected 0 to 6"),
        (ZEROS.astype(np.uint64) + 2**63, ValueError, "actions: found 9223372036854775808, expected 0 to 6"),
        (np.where(np.arange(800).reshape(40, 20) == 799, 7, ZEROS), ValueError, r"actions\[39, 19\]: found 7"),
        (ZEROS.T, ValueError, r"actions: found shape \(20, 40\), expected shape \(40, 20\)"),
        (np.full((40, 20), np.nan), TypeError, "actions: found an array of float64, expected whole numbers"),
        (None, TypeError, "actions: found an array of object, expected whole numbers"),
        (ZEROS.astype(float), TypeError, "actions: found an array of float64, expected whole numbers"),
        (ZEROS.astype(bool), TypeError, "actions: found an array of bool, expected whole numbers"),
        ([["a"]], TypeError, "actions: found an array of <U1"),
        ([[0], [0, 1]], ValueError, "actions: found a list of lists of several lengths, expected whole numbers"),
    ],
)
def test_bad_actions_are_named_and_change_nothing(actions, error, message):
    env = environment()
    before = env.observations.copy()
    with pytest.raises(error, match=message):
        env.step(actions)
    assert env.elapsed == 0 and (env.observations == before).all()


@pytest.mark.parametrize(
    ("channels", "powers", "message"),
    [
        (3, 30.0, "sub_channels: found 3, expected -1"),
        (-2, 30.0, "sub_channels: found -2, expected -1"),
        (300, 30.0, "sub_channels: found 300, expected -1"),
        (0, 30.1, r"powers_dbm\[0, 0\]: found 30.1, expected -100 to 30 dBm"),
        (0, np.nan, r"powers_dbm\[0, 0\]: found NaN"),
        (0, np.inf, r"powers_dbm\[0, 0\]: found inf"),
    ],
)
def test_bad_transmissions_are_named_and_change_nothing(channels, powers, message):
    env = environment()
    before = env.observations.copy()
    with pytest.raises(ValueError, match=message):
        env.transmit(np.full((40, 20), channels), np.full((40, 20), powers))
    assert env.elapsed == 0 and (env.observations == before).all()
    # As if it had never been tried.
    other = environment()
    for each in (env, other):
        each.step(np.ones((40, 20), np.uint8))
    assert (env.ages == other.ages).all() and (env.observations == other.observations).all()


@pytest.mark.parametrize(("seed", "error"), [(-1, ValueError), (2**64, ValueError), (1.5, TypeError), ("x", TypeError)])
def test_bad_seeds_are_named_and_change_nothing(seed, error):
    env = environment()
    env.step(np.ones((40, 20), np.uint8))
    before = env.observations.copy()
    with pytest.raises(error, match=f"seed: found {seed!r}, expected a whole number from 0 to 18446744073709551615"):
        env.reset(seed=seed)
    assert env.elapsed == 1 and env.seed == 5 and (env.observations == before).all()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"worlds": 0}, ValueError, "worlds: found 0, expected a whole number from 1 to 1000000"),
        ({"worlds": -1}, ValueError, "worlds: found -1, expected a whole number from 1 to 1000000"),
        ({"worlds": 2.0}, TypeError, "worlds: found 2.0, expected a whole number from 1 to 1000000"),
        ({"seed": "x"}, TypeError, "seed: found 'x', expected a whole number"),
        ({"seed": -1}, ValueError, "seed: found -1, expected a whole number"),
        ({"slots": 0}, ValueError, "slots: found 0, expected a whole number from 1 to 4294967295, or None for an episode without end"),
        ({"threads": 0}, ValueError, "threads: found 0, expected a whole number from 1 to 65535, or None for one a core"),
        ({"encoding": "int4"}, ValueError, 'encoding: found "int4", expected "int8", "float32"'),
        ({"reward": "none"}, ValueError, 'reward: found "none", expected "own", "team", "paper"'),
        ({"mobility": "/nowhere.xml"}, FileNotFoundError, "/nowhere.xml"),
        ({"scenario": {"cell.vehicles": 3}}, TypeError, r"scenario: found a dict, expected a freshlane\.Scenario, such as Scenario\(settings="),
    ],
)
def test_bad_arguments_are_named(arguments, error, message):
    with pytest.raises(error, match=message):
        environment(**arguments)


def test_bad_scenarios_are_named(tmp_path):
    def message(error=ValueError, **arguments):
        with pytest.raises(error) as raised:
            Scenario(**arguments)
        return str(raised.value)

    unknown = message(settings={"radio.sub_chanels": 3})
    assert unknown.startswith("settings radio.sub_chanels: found an unknown key, expected radio.sub_channels")
    assert message(settings={"cell.vehicles": 0}) == "cell.vehicles: found 0, expected 1 to 10000 vehicles"
    assert "found many" in message(settings={"cell.vehicles": "many"}) or "many" in message(
        settings={"cell.vehicles": "many"}
    )
    assert message(preset="none") == 'preset: found "none", expected "paper", "companion", "street", "edge"'
    file = tmp_path / "scenario.toml"
    file.write_text("[cell]\nvehicels = 3\n")
    assert f"{file}: key cell.vehicels" in message(file=file)
    assert "scenario.toml" in message(FileNotFoundError, file=tmp_path / "no" / "scenario.toml")
    with pytest.raises(KeyError, match=r"expected cell\.vehicles"):
        Scenario()["cell.vehicels"]
    with pytest.raises(ValueError, match="vehicles: found 4001, expected 1 to 4000"):
        environment(scenario=Scenario(settings={"cell.vehicles": 4001}))
    with pytest.raises(ValueError, match="radio.sub_channels: found 17, expected at most 16, which units know"):
        environment(scenario=Scenario(settings={"radio.sub_channels": 17}))
