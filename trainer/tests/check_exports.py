"""Checks what a training run exports with the programs that it is exported for.

    python3 -m venv /tmp/check && /tmp/check/bin/pip install torch onnx onnxruntime numpy safetensors tensorboard pyarrow
    /tmp/check/bin/python trainer/tests/check_exports.py RUN_FOLDER

PyTorch loads the safetensors weights by name and shape, onnxruntime runs the ONNX model to the same numbers, TensorBoard
reads the event file, and all three files of metrics agree.
"""

import csv
import json
import pathlib
import sys

import numpy
import onnx
import onnxruntime
import pyarrow.parquet
import torch
from safetensors import safe_open
from safetensors.torch import load_file
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

folder = pathlib.Path(sys.argv[1])
report = json.loads((folder / "report.json").read_text())


class Actor(torch.nn.Module):
    def __init__(self, widths):
        super().__init__()
        self.layers = torch.nn.ModuleList(torch.nn.Linear(a, b) for a, b in zip(widths, widths[1:]))

    def forward(self, x):
        for layer in self.layers[:-1]:
            x = torch.relu(layer(x))
        return self.layers[-1](x)


class Vehicles(torch.nn.Module):
    def __init__(self, count, widths):
        super().__init__()
        self.vehicles = torch.nn.ModuleList(Actor(widths) for _ in range(count))


shared = report["networks"] == 1
actor = Actor(report["widths"]) if shared else Vehicles(report["networks"], report["widths"])
actor.load_state_dict(load_file(folder / "actor.safetensors"), strict=True)
with safe_open(folder / "actor.safetensors", "pt") as file:
    form = json.loads(file.metadata()["freshlane"])
print("PyTorch loads", sum(p.numel() for p in actor.parameters()), "parameters; form", form)

if shared:
    model = onnx.load(folder / "actor.onnx")
    onnx.checker.check_model(model, full_check=True)
    session = onnxruntime.InferenceSession(folder / "actor.onnx", providers=["CPUExecutionProvider"])
    observations = numpy.random.default_rng(1).uniform(-2, 2, (1000, report["widths"][0])).astype(numpy.float32)
    with torch.no_grad():
        expected = actor(torch.from_numpy(observations))
    if form["output"]["form"] == "sub-channel-and-power":
        expected = torch.tanh(expected)
    (found,) = session.run(None, {"observation": observations})
    scale = numpy.abs(expected.numpy()).max()
    difference = numpy.abs(found - expected.numpy()).max() / scale
    print("onnxruntime: largest difference from PyTorch", difference, "of the largest output")
    assert difference < 1e-6

with open(folder / "metrics.csv", newline="") as file:
    rows = list(csv.DictReader(file))
assert len(rows) == report["episodes"]
table = pyarrow.parquet.read_table(folder / "metrics.parquet")
events = EventAccumulator(str(folder), size_guidance={"scalars": 0})
events.Reload()
for name in table.column_names[1:]:
    in_csv = [float(row[name]) if row[name] else None for row in rows]
    assert table[name].to_pylist() == in_csv, name
    known = [(episode, value) for episode, value in enumerate(in_csv, 1) if value is not None]
    scalars = [(event.step, event.value) for event in events.Scalars(name)] if known else []
    assert scalars == [(episode, float(numpy.float32(value))) for episode, value in known], name
print("metrics: CSV, Parquet and TensorBoard agree on", len(rows), "episodes of", len(table.column_names) - 1, "metrics")
