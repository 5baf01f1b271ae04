"""Evaluation: the command line's numbers to the last digit, for every way of running a policy."""

import gzip

import numpy as np
import pytest

from freshlane import ACTIONS, INPUTS, POLICIES, BatchEnvironment, Scenario, Table, evaluate, read_trace

KEYS = (
    "mean_age_ms mean_age_ci95_ms median_world_age_ms p99_age_ms first100_age_ms success_per_slot "
    "uncapped_mean_age_ms uncapped_worst_vehicles_ms "
    "peak_age_ms age_above_10_ms age_above_20_ms age_above_50_ms worst_vehicles_ms "
    "transmissions_per_vehicle_slot energy_mj_per_vehicle_slot "
    "vehicles worlds slots"
).split()
EXTENT = {"worlds": 40, "slots": 300, "warmup": 100, "seed": 9}
OPTIONS = [part for key, value in EXTENT.items() for part in (f"--{key}", value)]


def numbers(found):
    return {key: found[key] if isinstance(found, dict) else getattr(found, key) for key in KEYS}


def test_named_policies_give_the_command_line_s_numbers(command_line):
    expected = command_line("run", *OPTIONS)
    assert [entry["policy"] for entry in expected["policies"]] == list(POLICIES)
    for entry in expected["policies"]:
        found = evaluate(entry["policy"], **EXTENT)
        assert numbers(found) == numbers(entry)
        assert found.bound_age_ms == expected["bound_age_ms"] and found.policy == entry["policy"]


def test_a_function_s_decisions_give_the_command_line_s_numbers(command_line):
    options = ["--preset", "companion", "--vehicles", 12, "--policy", "actor"]
    (entry,) = command_line("run", *options, *OPTIONS)["policies"]
    scenario = Scenario("companion", settings={"cell.vehicles": 12})
    table = Table.shipped()
    assert numbers(evaluate(table, scenario, **EXTENT)) == numbers(entry)
    assert numbers(evaluate(table.act, scenario, **EXTENT)) == numbers(entry)
    assert numbers(evaluate(table.act, scenario, **EXTENT, threads=1)) == numbers(entry)


def test_the_default_protocol_is_the_command_line_s(command_line):
    (entry,) = command_line("run", "--policy", "actor")["policies"]
    assert numbers(evaluate("actor")) == numbers(entry)


def test_a_file_and_a_trace(command_line, tmp_path):
    file = tmp_path / "scenario.toml"
    file.write_text("[broadcast]\ncall_delay_slots = 4\n")
    trace = tmp_path / "trace.xml"
    steps = "".join(
        f'<timestep time="{time}">'
        + "".join(
            f'<vehicle id="v{v}" x="{300 + 10 * v + time}" y="{600 + 5 * v}" speed="10"/>' for v in range(time % 2, 6)
        )
        + "</timestep>"
        for time in range(4)
    )
    trace.write_text(f"<fcd-export>{steps}</fcd-export>")
    options = ["--scenario", file, "--mobility", trace, "--policy", "actor", *OPTIONS]
    (entry,) = command_line("run", *options)["policies"]
    found = evaluate(Table.shipped().act, Scenario(file=file), mobility=str(trace), **EXTENT)
    assert numbers(found) == numbers(entry)
    assert found.vehicles == 6
    with pytest.raises(ValueError, match="length of the trace"):
        evaluate("actor", mobility=str(trace), **{**EXTENT, "slots": 1_000_000})
    compressed = tmp_path / "compressed"
    compressed.write_bytes(gzip.compress(trace.read_bytes()))
    read = read_trace(compressed)
    assert (read.vehicles, read.slots) == ([f"v{v}" for v in range(6)], 3000)
    env = BatchEnvironment(mobility=read, worlds=2)
    for _ in range(1200):
        env.step(np.ones((2, 6), np.uint8))
    assert env.present.tolist() == [False] + 5 * [True]
    assert (env.ages[:, 0] == 0).all() and (env.observations[:, 0] == 0).all() and (env.gains_db[:, 0] == 0).all()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("<fcd-export>\n<timestep>", r":2: found <timestep> without 'time', expected an attribute 'time'"),
        ('<fcd-export>\n<timestep time="1.0"/>\n\n some </fcd-export>', r":4: found text 'some', expected <timestep>"),
        ("<fcd-export>\n<timestep>\n</fcd-export>", r":2: found <timestep> without 'time'"),
        ("<fcd-export>\n</fcd-import>", r":2: found broken XML \(mismatched tag\), expected well-formed XML"),
        ("<fcd-export/>\n", r":2: found no time step, expected at least one <timestep>"),
        ("", r"found broken XML \(no element found\)"),
    ],
)
def test_a_trace_that_makes_no_sense_is_named_with_its_line(tmp_path, text, message):
    trace = tmp_path / "trace.xml"
    trace.write_text(text)
    with pytest.raises(ValueError, match=message):
        read_trace(trace)


def test_a_damaged_compressed_trace(tmp_path):
    trace = tmp_path / "trace.xml.gz"
    whole = gzip.compress(b"<fcd-export>" + b" " * 1000 + b"</fcd-export>")
    trace.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match=r"trace.xml.gz:1: found unreadable data .*, expected a whole, undamaged file"):
        read_trace(trace)


def test_training_never_meets_evaluation():
    """The same seed and world: the first observations differ."""
    seen = []
    with pytest.raises(StopIteration):

        def policy(observations):
            seen.append(observations.copy())
            raise StopIteration

        evaluate(policy, worlds=40, seed=3)
    env = BatchEnvironment(worlds=40, seed=3)
    assert (seen[0] != env.observations).mean() > 0.1


def test_results_in_detail():
    found = evaluate("actor", **EXTENT)
    assert abs(found.distribution.sum() - 1) < 1e-9 and found.distribution.shape == (101,)
    assert found.start_ms.shape == (300,) and found.start_ms[0] > 50
    assert abs((found.distribution * np.arange(101)).sum() - found.mean_age_ms) < 1e-9
    assert evaluate("actor", worlds=1, slots=50, warmup=0).mean_age_ci95_ms is None
    assert "actor" in repr(found)


def test_bad_input_is_named(tmp_path):
    with pytest.raises(ValueError, match='policy: found "best", expected "actor", "central"'):
        evaluate("best")
    with pytest.raises(TypeError, match="policy: found int, expected a name, a Table"):
        evaluate(3)
    with pytest.raises(ValueError, match="slots: found 0, expected 1 to 100000000"):
        evaluate("actor", slots=0)
    with pytest.raises(ValueError, match=r"actions: found shape \(40, 3\), expected shape \(40, 20\)"):
        evaluate(lambda observations: np.zeros((40, 3), int), **EXTENT)
    with pytest.raises(ValueError, match="vehicles: found 2001, expected at most 2000, which the table serves"):
        evaluate(Table.shipped(), Scenario(settings={"cell.vehicles": 2001}))


def test_tables(tmp_path):
    table = Table.shipped()
    path = tmp_path / "table.bin"
    table.write(path)
    assert path.read_bytes() == bytes(table) and Table.read(path) == Table.from_bytes(bytes(table))
    assert table.widths[0] == INPUTS and table.widths[-1] == ACTIONS and table.max_sub_channels == 8 and table.max_vehicles == 2000
    observations = BatchEnvironment(worlds=2).observations
    outputs = table.outputs(observations)
    assert outputs.shape == (2, 20, ACTIONS) and (outputs.argmax(axis=-1) == table.act(observations)).all()
    assert table.act(observations[0, 0]).shape == ()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda data: data[:50], "length|truncated"),
        (lambda data: b"FLAX" + data[4:], "magic"),
        (lambda data: data[:200] + bytes([data[200] ^ 1]) + data[201:], "checksum"),
        (lambda data: b"", "truncated"),
    ],
)
def test_damaged_tables_are_refused(change, message, tmp_path):
    data = change(bytes(Table.shipped()))
    with pytest.raises(ValueError, match=message):
        Table.from_bytes(data)
    path = tmp_path / "table.bin"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=f"{path}: .*({message})"):
        Table.read(path)


def test_bad_observations_are_named():
    table = Table.shipped()
    with pytest.raises(ValueError, match=r"observations: found shape \[3, 19\]"):
        table.act(np.zeros((3, 19), np.int8))
    for wrong in (np.zeros((3, INPUTS)), np.zeros((3, INPUTS), np.uint8), np.full((3, INPUTS), np.nan), [[0] * INPUTS], None):
        with pytest.raises(TypeError, match="observations"):
            table.act(wrong)
    # Never read in the wrong order.
    for wrong in (np.zeros((3, INPUTS), np.int8, order="F"), np.zeros((3, 2 * INPUTS), np.int8)[:, ::2]):
        for function in (table.act, table.outputs):
            with pytest.raises(ValueError, match="observations: found an array in another order, expected C order"):
                function(wrong)
