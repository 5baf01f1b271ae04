"""Export: a network becomes a table that decides like it."""

import numpy as np
import pytest

from freshlane import ACTIONS, INPUTS, BatchEnvironment, Scenario, evaluate, export

SCENARIO = Scenario()
EXTENT = {"worlds": 16, "slots": 300, "warmup": 200}


def rules():
    """Two layers by hand: send at full power in the own turn where the gain suffices; who is called sends at the first level."""
    weights = np.zeros((2, INPUTS), np.float32)
    weights[0, [0, 9]] = 1.0, 1.0
    weights[0, 1] = -1.0
    weights[1, [13, 18, 11]] = 1.0, 1.0, 1.0
    hidden = weights, np.array([-1.0, -2.0], np.float32)
    output = np.zeros((ACTIONS, 2), np.float32)
    output[1, 0], output[2, 1] = 1.0, 1.0
    return [hidden, (output, np.array([0.5, 0, 0, -9, -9, -9, -9], np.float32))]


def forward(layers, codes):
    values = codes.astype(np.float32) / 64
    for index, (weights, biases) in enumerate(layers):
        values = values @ weights.T + biases
        if index + 1 < len(layers):
            values = np.maximum(values, 0)
    return values


def test_a_network_becomes_its_table():
    layers = rules()
    exported = export(layers, seed=4, **EXTENT)
    assert exported.table.widths == [INPUTS, 2, ACTIONS] and exported.table.seed == 4
    assert exported.table.max_vehicles == 20
    assert exported.agreement > 0.999
    # The comparison's numbers are evaluate's.
    found = evaluate(exported.table, **EXTENT)
    assert exported.int8_age_ms == found.mean_age_ms
    by_float = evaluate(lambda codes: forward(layers, codes).argmax(axis=-1), **EXTENT)
    assert exported.float_age_ms == by_float.mean_age_ms
    assert by_float.mean_age_ms < evaluate("age-threshold", **EXTENT).mean_age_ms
    env = BatchEnvironment(worlds=50, seed=8)
    for _ in range(100):
        actions = exported.table.act(env.observations)
        assert (actions == forward(layers, env.observations).argmax(axis=-1)).mean() > 0.99
        env.step(actions)


def test_a_seed_gives_the_same_table():
    first, second = (export(rules(), seed=4, **EXTENT) for _ in range(2))
    assert bytes(first.table) == bytes(second.table) and first.agreement == second.agreement


def test_own_calibration_and_limits():
    codes = BatchEnvironment(worlds=200).observations.reshape(-1, INPUTS)
    exported = export(rules(), calibration=codes, max_vehicles=30, **EXTENT)
    in_another_order = export(rules(), calibration=np.asfortranarray(codes), max_vehicles=30, **EXTENT)
    assert bytes(in_another_order.table) == bytes(exported.table)
    assert exported.table.max_vehicles == 30
    wider = Scenario(settings={"radio.sub_channels": 5})
    assert export(rules(), wider, **EXTENT).table.max_sub_channels == 5 and exported.table.max_sub_channels == 3


def changed(layer, part, value):
    layers = [list(pair) for pair in rules()]
    layers[layer][part] = value
    return layers


@pytest.mark.parametrize(
    ("network", "error", "message"),
    [
        ([], ValueError, "network: found 0 layers, expected 1 to 4 layers"),
        (rules() + 3 * rules()[1:], ValueError, "network: found 5 layers"),
        ([(np.zeros((ACTIONS, INPUTS)),)], TypeError, "network: layer 0: found tuple, expected a pair of weights and biases"),
        (3, TypeError, "network: found int, expected a torch module, or pairs"),
        (changed(0, 0, np.zeros((2, 19))), ValueError, "network: layer 0: found 19 inputs, expected 22"),
        (changed(0, 1, np.zeros(3)), ValueError, "network: layer 0: found 3 biases, expected 2"),
        (rules()[:1], ValueError, "network: layer 0: found 2 outputs, expected 7, one an action"),
        (changed(0, 0, np.zeros((2, INPUTS), int)), TypeError, "layer 0 weights: found an array of int64"),
        (changed(0, 0, np.zeros(20)), ValueError, r"layer 0 weights: found shape \(20,\)"),
        (changed(1, 0, np.full((ACTIONS, 2), np.nan)), ValueError, "^network: layer 1: found a parameter that is not finite, expected finite weights and biases$"),
    ],
)
def test_bad_networks_are_named(network, error, message):
    with pytest.raises(error, match=message):
        export(network, **EXTENT)


def test_bad_calibration_is_named():
    with pytest.raises(TypeError, match="calibration: found an array of float64, expected int8"):
        export(rules(), calibration=np.zeros((3, INPUTS)))
    with pytest.raises(ValueError, match="found shape"):
        export(rules(), calibration=np.zeros((3, 19), np.int8))
    with pytest.raises(ValueError, match="calibration: found no observations"):
        export(rules(), calibration=np.zeros((0, INPUTS), np.int8))
    with pytest.raises(ValueError, match="max_vehicles: found 0, expected 1 to 4000"):
        export(rules(), max_vehicles=0)
