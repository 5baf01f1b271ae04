"""Torch modules as policies and exports, and the example."""

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from freshlane import ACTIONS, INPUTS, Table, evaluate, export, read_actor, write_actor

EXTENT = {"worlds": 8, "slots": 100, "warmup": 50}
EXAMPLE = Path(__file__).parents[1] / "examples" / "train_ppo.py"


def network(*parts):
    torch.manual_seed(1)
    return nn.Sequential(*(parts or (nn.Linear(INPUTS, 16), nn.ReLU(), nn.Linear(16, ACTIONS))))


def test_a_module_decides_as_its_arrays():
    module = network()
    layers = [(part.weight.detach().numpy(), part.bias.detach().numpy()) for part in module[::2]]
    by_module, by_arrays = export(module, **EXTENT), export(layers, **EXTENT)
    assert bytes(by_module.table) == bytes(by_arrays.table)
    assert evaluate(module, **EXTENT).mean_age_ms == by_module.float_age_ms


def test_a_module_gets_floats_and_a_function_gets_codes():
    class Probe(nn.Module):
        def forward(self, inputs):
            assert inputs.dtype == torch.float32 and inputs.shape == (160, INPUTS) and not inputs.requires_grad
            assert (inputs * 64).frac().abs().max() == 0
            return nn.functional.one_hot(torch.zeros(160, dtype=torch.int64), ACTIONS).float()

    assert evaluate(Probe(), **EXTENT).mean_age_ms == 100.0
    actions = torch.zeros((8, 20), dtype=torch.int64)
    assert evaluate(lambda codes: actions, **EXTENT).mean_age_ms == 100.0


def test_nested_modules():
    flat = network()
    nested = nn.Sequential(nn.Sequential(flat[0], flat[1]), flat[2])
    assert bytes(export(nested, **EXTENT).table) == bytes(export(flat, **EXTENT).table)


def test_an_actor_of_the_trainer_is_a_module(tmp_path):
    path = tmp_path / "actor.safetensors"
    module = network(nn.Linear(INPUTS, 16), nn.ReLU(), nn.Linear(16, 8), nn.ReLU(), nn.Linear(8, ACTIONS))
    write_actor(module, path, min_vehicles=5, max_vehicles=20)
    read = read_actor(path)
    inputs = torch.randn(50, INPUTS)
    assert (read(inputs) == module(inputs)).all() and all(parameter.requires_grad for parameter in read.parameters())
    assert bytes(export(read, **EXTENT).table) == bytes(export(module, **EXTENT).table)
    whole = path.read_bytes()
    weight = whole[:-1] + bytes([whole[-1] ^ 1])
    for damaged, message in [(b"", ""), (whole[:100], ""), (whole[:-4], ""), (b"\xff" * 100, ""), (weight, "checksum: found ")]:
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=f"{path}: {message}"):
            read_actor(path)
    with pytest.raises(FileNotFoundError):
        read_actor(tmp_path / "none")
    with pytest.raises(ValueError, match="found 7 to 5 vehicles, expected 1 to "):
        write_actor(module, path, min_vehicles=7, max_vehicles=5)


@pytest.mark.parametrize(
    ("module", "error", "message"),
    [
        (lambda: network(nn.Linear(INPUTS, ACTIONS), nn.Tanh()), TypeError, "network: found Tanh, expected Linear and ReLU"),
        (lambda: network(nn.ReLU()), ValueError, "part 0: found ReLU, expected Linear"),
        (lambda: network(nn.Linear(INPUTS, ACTIONS), nn.ReLU()), ValueError, "found a ReLU at the end"),
        (lambda: network(nn.Linear(INPUTS, 9), nn.Linear(9, ACTIONS)), ValueError, "part 1: found Linear, expected ReLU"),
        (lambda: network(nn.Linear(INPUTS, ACTIONS, bias=False)), ValueError, "found a Linear without bias"),
        (lambda: network(nn.Linear(19, ACTIONS)), ValueError, "layer 0: found 19 inputs, expected 22"),
    ],
)
def test_bad_modules_are_named(module, error, message):
    with pytest.raises(error, match=message):
        export(module(), **EXTENT)


def test_scores_of_another_shape_are_named():
    with pytest.raises(ValueError, match=r"policy: found scores of shape \(160, 5\), expected \(160, 7\)"):
        evaluate(nn.Linear(INPUTS, 5), **EXTENT)


def test_the_example_trains_and_exports(tmp_path):
    """At a small fraction of its size: a table that the firmware reads, and the numbers that it prints."""
    out = tmp_path / "table.bin"
    options = ["--iterations", "10", "--worlds", "8", "--out", str(out)]
    done = subprocess.run([sys.executable, EXAMPLE, *options], check=True, capture_output=True, text=True)
    table = Table.read(out)
    assert table.widths == [INPUTS, 32, 32, ACTIONS] and table.seed == 1
    printed = float(re.search(r"learned, firmware table +([\d.]+)", done.stdout)[1])
    assert printed == round(evaluate(table).mean_age_ms, 3)
    assert 0 < float(re.search(r"agree on ([\d.]+)%", done.stdout)[1]) <= 100
    assert np.isfinite(printed)
