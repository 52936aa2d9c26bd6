"""A free-flying space robot with flexible panels: simulator, Gymnasium environments and benchmark task."""

import gymnasium

from sffr_gym.params import ConfigError, Params, load_params
from sffr_gym.simulator import Simulator, State

__all__ = ["ConfigError", "Params", "Simulator", "State", "load_params"]

if "SFFRFlex-v0" not in gymnasium.registry:
    # No max_episode_steps: the environment itself truncates when its scenario's time is over.
    gymnasium.register(
        id="SFFRFlex-v0",
        entry_point="sffr_gym.env:SFFRFlexEnv",
        vector_entry_point="sffr_gym.vector_env:SFFRFlexVectorEnv",
    )
    gymnasium.register(  # one list of the project's ids; nothing of agents is imported before it is made
        id="SFFRFlexDamping-v0",
        entry_point="agents.residual_env:SFFRFlexDampingEnv",
        vector_entry_point="agents.residual_env:SFFRFlexDampingVectorEnv",
    )
