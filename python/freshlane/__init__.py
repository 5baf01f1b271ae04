"""Age-of-information scheduling for connected vehicles, from training to microcontroller.

Vehicles share a few radio sub-channels to one base station. In every slot of 1 ms each decides, from what it alone can
sense, whether and how loudly to send, so that what the base station knows stays fresh.

* `BatchEnvironment`: many worlds at once, numpy arrays that are not copied.
* `ParallelEnvironment`: one world as a PettingZoo `ParallelEnv`, one agent a vehicle; `env` the same as an `AECEnv`.
* `freshlane.adapters`: many worlds as environments of Gymnasium, Stable-Baselines3, TorchRL and BenchMARL.
* `evaluate`: a policy on held-out worlds, with the command line's protocol and numbers.
* `Table`, `export`: the firmware's frozen int8 networks, and how a torch network becomes one.
* `read_actor`, `write_actor`: a network of the trainer as a torch module, and the way back.
* `read_trace`: recorded vehicles, SUMO's floating-car data.
* `assign`: static traffic assignment from arrays.
* `Scenario`: the same presets, files and settings as on the command line.

Everything is computed by the simulator, trainer and firmware library that the command line and the chip run.
"""

from ._native import VERSION as __version__
from ._native import Assignment, Evaluation, Scenario, Table, Trace
from .actor import read_actor, write_actor
from .assignment import assign
from .batch import ACTIONS, INPUTS, ONE, BatchEnvironment, Encoding, Reward
from .evaluation import POLICIES, PolicyName, evaluate
from .export import Export, export
from .parallel import ParallelEnvironment, env, parallel_env
from .trace import read_trace

__all__ = [
    "ACTIONS",
    "INPUTS",
    "ONE",
    "POLICIES",
    "Assignment",
    "BatchEnvironment",
    "Encoding",
    "Evaluation",
    "Export",
    "ParallelEnvironment",
    "PolicyName",
    "Reward",
    "Scenario",
    "Table",
    "Trace",
    "__version__",
    "assign",
    "env",
    "evaluate",
    "export",
    "parallel_env",
    "read_actor",
    "read_trace",
    "write_actor",
]
