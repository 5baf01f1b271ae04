"""What type checkers say of calls: `python/test` runs them over this file, nobody runs it. An `ignore` that nothing needs is an error there, too."""

import numpy as np
from numpy.typing import NDArray

import freshlane
from freshlane import BatchEnvironment, Scenario, Table, evaluate, parallel_env

env = parallel_env(Scenario(), seed=1, slots=50, encoding="int8", reward="paper", render_mode="rgb_array")
aec = freshlane.env(max_cycles=25)
batch = BatchEnvironment(worlds=np.int64(3), slots=None, reward="team")
observations, infos = batch.reset(seed=1, options={})
masks: NDArray[np.bool_] = batch.action_masks
age: float = evaluate("clock").mean_age_ms
evaluate(Table.shipped().act)
evaluate(lambda codes: np.zeros(codes.shape[:2], np.uint8))

parallel_env(sedd=1)  # type: ignore[call-arg]
parallel_env(encoding="float64")  # type: ignore[arg-type]
freshlane.env(render_mode="human")  # type: ignore[arg-type]
BatchEnvironment({"cell.vehicles": 3})  # type: ignore[arg-type]
BatchEnvironment(worlds=2.5)  # type: ignore[arg-type]
BatchEnvironment(reward="papers")  # type: ignore[arg-type]
evaluate("clok")  # type: ignore[arg-type]
evaluate(3)  # type: ignore[arg-type]
