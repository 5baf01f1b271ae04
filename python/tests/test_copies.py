"""Copies: the same state for a search, other worlds for a worker; processes."""

import copy
import multiprocessing
import pickle
import queue

import cloudpickle
import numpy as np
import pytest

import freshlane
from freshlane import BatchEnvironment, Scenario, Table, assign, parallel_env, read_trace
from freshlane.adapters.gymnasium import VectorEnvironment

HARD = Scenario(
    settings={
        "cell.replacement_probability": 0.01,
        "knowledge.gain_delay_slots": 2,
        "feedback.measurement_loss": 0.1,
        "fading.follows_speed": True,
    }
)

PICKLERS = (pickle, cloudpickle)


def environment(**arguments):
    return BatchEnvironment(HARD, **{"worlds": 40, "seed": 5, "threads": 2, **arguments})


def play(env, slots):
    table = Table.shipped()
    for _ in range(slots):
        env.step(table.act(env.observations))


def test_a_deep_copy_goes_on_from_the_same_state():
    env = environment()
    env.reset()
    play(env, 60)
    # Also arrays that were read before.
    gains = env.gains_db.copy()
    same, apart = copy.deepcopy(env), copy.deepcopy(env)
    assert (same.gains_db == gains).all() and same.gains_db is not env.gains_db
    for _ in range(60):
        for each in (env, same):
            play(each, 1)
        apart.step(np.zeros((40, 20), np.uint8))
        for name in ("observations", "ages", "rewards", "replaced", "received", "gains_db", "thresholds"):
            assert (getattr(env, name) == getattr(same, name)).all()
    assert (env.ages != apart.ages).any() and env.elapsed == same.elapsed == 120
    assert (env.reset()[0] == same.reset()[0]).all(), "and to the same next worlds"


def test_one_world_goes_on_from_the_same_state():
    env = parallel_env(HARD, seed=3, slots=200)
    _, infos = env.reset()
    for _ in range(50):
        _, _, _, _, infos = env.step({agent: int(infos[agent]["action_mask"][1]) for agent in env.agents})
    for number, agent in enumerate(env.agents):
        env.action_space(agent).seed(number)
    same = copy.deepcopy(env)
    actions = [env.action_space(agent).sample() for agent in env.agents]
    assert [same.action_space(agent).sample() for agent in same.agents] == actions
    taken = dict(zip(env.agents, actions, strict=True))
    for mine, other in zip(env.step(taken), same.step(taken), strict=True):
        assert repr(mine) == repr(other)
    assert env.agents == same.agents


@pytest.mark.parametrize("picklers", PICKLERS)
@pytest.mark.parametrize("make", [environment, lambda: parallel_env(HARD), lambda: VectorEnvironment(HARD, worlds=2)])
def test_a_pickle_plays_other_worlds_of_the_same_kind(make, picklers):
    env = make()
    text = picklers.dumps(env)
    first, second = picklers.loads(text), picklers.loads(text)
    seen = [each.reset()[0] for each in (env, first, second)]
    state = [np.asarray(list(one.values()) if isinstance(one, dict) else one).copy() for one in seen]
    assert (state[0] != state[1]).any() and (state[1] != state[2]).any()
    again = [each.reset(seed=9)[0] for each in (env, first)]
    assert repr(again[0]) == repr(again[1]), "a seed makes them alike"
    assert pickle.dumps(env) == pickle.dumps(first), "the same arguments"


def test_results_and_descriptions_are_kept_whole(tmp_path):
    trace_file = tmp_path / "fcd.xml"
    steps = "".join(
        f'<timestep time="{time}"><vehicle id="a" x="{370.1 + time}" y="650" speed="1.7"/></timestep>' for time in range(3)
    )
    trace_file.write_text(f"<fcd-export>{steps}</fcd-export>")
    trace = read_trace(trace_file)
    scenario = Scenario("street", settings={"cell.vehicles": 7, "radio.shadowing_deviation_db": 3.3})
    evaluation = freshlane.evaluate("clock", worlds=3, slots=50, warmup=5)
    roads = assign([1, 1], [2, 2], [10.0, 10.0], [1.0, 2.0], [0.15, 0.15], [4.0, 4.0], [[0.0, 15.0], [0.0, 0.0]])
    for how in (lambda one: pickle.loads(pickle.dumps(one)), cloudpickle_round, copy.deepcopy, copy.copy):
        assert how(scenario) == scenario and how(Table.shipped()) == Table.shipped()
        assert how(evaluation).mean_age_ms == evaluation.mean_age_ms and repr(how(evaluation)) == repr(evaluation)
        assert (how(evaluation).distribution == evaluation.distribution).all()
        assert (how(roads).flows == roads.flows).all() and how(roads).stopped == roads.stopped
        assert how(trace).vehicles == ["a"] and how(trace).slots == trace.slots == 2000
    with pytest.raises(ValueError, match="scenario: found .*missing field"):
        Scenario._of_json("{}")
    with_trace = BatchEnvironment(worlds=1, slots=100, mobility=trace, threads=1)
    assert pickle.loads(pickle.dumps(with_trace)).positions_m(0)[0] == pytest.approx(with_trace.positions_m(0)[0])


def cloudpickle_round(one):
    return cloudpickle.loads(cloudpickle.dumps(one))


def worker(seed):
    env = BatchEnvironment(worlds=4, seed=seed)
    env.reset()
    for _ in range(20):
        env.step(np.zeros((4, 20), np.uint8))
    return float(env.ages.mean())


@pytest.mark.parametrize("method", ["spawn", "forkserver", "fork"])
@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_processes_make_their_own(method):
    worker(0)  # This one has had threads, too.
    with multiprocessing.get_context(method).Pool(2) as pool:
        assert pool.map_async(worker, [1, 2]).get(timeout=120) == [120.0, 120.0]


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")
def test_a_fork_says_that_the_threads_are_gone():
    fork = multiprocessing.get_context("fork")
    answers: multiprocessing.Queue = fork.Queue()

    def child(*environments):
        for env in environments:
            try:
                env.step(np.zeros((40, 20), np.uint8))
                answers.put("stepped")
            except RuntimeError as error:
                answers.put(str(error))

    process = fork.Process(target=child, args=(environment(), environment(threads=1)))
    process.start()
    try:
        refused, stepped = (answers.get(timeout=60) for _ in range(2))
    except queue.Empty:
        pytest.fail("a fork waits for threads that it does not have")
    finally:
        process.kill()
        process.join()
    assert "expected that one: make the environment in the process that uses it" in refused
    assert stepped == "stepped"
