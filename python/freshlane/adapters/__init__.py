"""Many worlds as other libraries' environments, at the batch's speed.

Each module needs its library, which `pip install 'freshlane[...]'` brings under the module's name:

* `gymnasium`: a `VectorEnv` whose environments are vehicles; needs nothing else.
* `stable_baselines3`: the same as a `VecEnv`.
* `torchrl`: an `EnvBase` whose batch is worlds, with one group of agents.
* `benchmarl`: that as a task.
"""
