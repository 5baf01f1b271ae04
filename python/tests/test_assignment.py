"""Assignment: the command line's flows, a network by hand, bad input."""

import csv

import numpy as np
import pytest
from conftest import WORKSPACE

from freshlane import assign

FIXTURES = WORKSPACE / "assignment" / "tests" / "fixtures"


def read_tntp(name):
    """A TNTP network and its trips, read by other means than the simulator's."""
    lines = (FIXTURES / f"{name}_net.tntp").read_text().splitlines()
    rows = [line.strip().strip(";").split() for line in lines if line.strip()[:1].isdigit()]
    columns = np.array(rows, dtype=float).T
    trips_text = (FIXTURES / f"{name}_trips.tntp").read_text().split("<END OF METADATA>")[1]
    blocks = trips_text.split("Origin")[1:]
    trips = np.zeros((len(blocks), len(blocks)))
    for block in blocks:
        origin, _, pairs = block.strip().partition("\n")
        for pair in pairs.replace("\n", " ").split(";"):
            if ":" in pair:
                destination, volume = pair.split(":")
                trips[int(origin) - 1, int(destination) - 1] = float(volume)
    names = ["init_node", "term_node", "capacity", "length", "free_flow_time", "b", "power"]
    network = dict(zip(names, columns[:7], strict=True))
    for node in ("init_node", "term_node"):
        network[node] = network[node].astype(int)
    return network, trips


@pytest.mark.parametrize("objective", ["ue", "so"])
@pytest.mark.parametrize(("algorithm", "gap"), [("path", 1e-12), ("bfw", 1e-3)])
def test_sioux_falls_is_the_command_line_s(command_line, tmp_path, objective, algorithm, gap):
    network, trips = read_tntp("SiouxFalls")
    found = assign(**network, trips=trips, objective=objective, algorithm=algorithm, gap=gap)
    flows = tmp_path / "flows.csv"
    net, demand = FIXTURES / "SiouxFalls_net.tntp", FIXTURES / "SiouxFalls_trips.tntp"
    options = ["--algorithm", algorithm, "--objective", objective, "--gap", gap, "--flows", flows]
    expected = command_line("assign", "--net", net, "--trips", demand, *options)
    for key in ("relative_gap", "objective", "total_travel_time", "iterations", "converged", "stopped"):
        assert getattr(found, key) == expected[key]
    with flows.open() as file:
        rows = list(csv.DictReader(file))
    assert found.flows.tolist() == [float(row["volume"]) for row in rows]
    assert found.costs.tolist() == [float(row["cost"]) for row in rows]
    assert found.converged and found.relative_gap <= gap


# Pigou: a constant road of cost 1 beside one of cost x; all drive the second, half of them should.
PIGOU = {
    "init_node": [1, 1, 3],
    "term_node": [2, 3, 2],
    "capacity": [1.0, 1.0, 1.0],
    "free_flow_time": [1.0, 1e-12, 0.0],
    "b": [0.0, 1e12, 0.0],
    "power": [1, 1, 1],
    "trips": [[0, 1], [0, 0]],
}


def test_pigou_by_hand():
    equilibrium, optimum = assign(**PIGOU), assign(**PIGOU, objective="so")
    assert np.allclose(equilibrium.flows, [0, 1, 1], atol=1e-6)
    assert np.allclose(optimum.flows, [0.5, 0.5, 0.5], atol=1e-6)
    assert abs(equilibrium.total_travel_time - 1) < 1e-6 and abs(optimum.total_travel_time - 0.75) < 1e-6
    toll = assign(**PIGOU, toll=[0.0, 0.5, 0.0], toll_weight=1.0)
    assert np.allclose(toll.flows, [0.5, 0.5, 0.5], atol=1e-6)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"capacity": [1.0, 1.0]}, ValueError, "capacity: found length 2, expected 3, one a link"),
        ({"capacity": [[1.0]]}, ValueError, r"capacity: found shape \(1, 1\), expected one dimension"),
        ({"capacity": ["a", "b", "c"]}, TypeError, "capacity: found an array of <U1, expected numbers"),
        ({"capacity": [1.0, -1.0, 1.0]}, ValueError, "link 2: capacity: found -1"),
        ({"power": [1.0, np.nan, 1.0]}, ValueError, "link 2: power: found NaN"),
        ({"init_node": [1.0, 1.0, 3.0]}, TypeError, "init_node: found an array of float64"),
        ({"init_node": [0, 1, 3]}, ValueError, "init_node: found node 0, expected nodes from 1"),
        ({"term_node": [2, 3]}, ValueError, "term_node: found length 2, expected 3"),
        ({"trips": [[0, 1]]}, ValueError, r"trips: found shape \(1, 2\), expected a square matrix"),
        ({"trips": [[0, -1], [0, 0]]}, ValueError, "trips from 1 to 2: found -1"),
        ({"trips": [[0, 0], [1, 0]]}, ValueError, "2.* 1|path"),
        ({"algorithm": "simplex"}, ValueError, 'algorithm: found "simplex", expected "fw", "cfw"'),
        ({"objective": "me"}, ValueError, 'objective: found "me", expected "ue", "so"'),
        ({"gap": -1.0}, ValueError, "relative gap: found -1"),
        ({"gap": np.nan}, ValueError, "relative gap: found NaN"),
        ({"first_thru_node": 9}, ValueError, "FIRST THRU NODE: found 9"),
    ],
)
def test_bad_input_is_named(change, error, message):
    with pytest.raises(error, match=message):
        assign(**{**PIGOU, **change})
