"""A free-flying space robot with flexible panels: simulator, Gymnasium environments and benchmark task."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

import gymnasium

from sffr_gym.config.params import Params, load_params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.physics.simulator import Simulator, State

__all__ = ["ConfigError", "Params", "SFFRFlexEnv", "SFFRFlexVectorEnv", "Simulator", "State", "load_params"]

if TYPE_CHECKING:
    from sffr_gym.envs.single import SFFRFlexEnv
    from sffr_gym.envs.vector import SFFRFlexVectorEnv
else:
    _ENVIRONMENTS = {"SFFRFlexEnv": "sffr_gym.envs.single", "SFFRFlexVectorEnv": "sffr_gym.envs.vector"}

    def __getattr__(name: str) -> Any:
        """Import an environment at its first use; who needs the simulator alone does not load the task's kernels."""
        if name not in _ENVIRONMENTS:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        return getattr(import_module(_ENVIRONMENTS[name]), name)

    def __dir__() -> list[str]:
        """List the environments among the names, also before they are imported."""
        return sorted({*globals(), *__all__})


if "SFFRFlex-v0" not in gymnasium.registry:
    # No max_episode_steps: the environment itself truncates when its scenario's time is over. No wrappers: it checks
    # actions and the order of calls itself, and help(env) is that of the environment.
    gymnasium.register(
        id="SFFRFlex-v0",
        entry_point="sffr_gym.envs.single:SFFRFlexEnv",
        vector_entry_point="sffr_gym.envs.backends:make_flex",
        order_enforce=False,
        disable_env_checker=True,
    )
    gymnasium.register(  # one list of the project's ids; nothing of the baselines is imported before it is made
        id="SFFRFlexDamping-v0",
        entry_point="sffr_baselines.damping_env:SFFRFlexDampingEnv",
        vector_entry_point="sffr_baselines.damping_env:make_damping_envs",
        order_enforce=False,
        disable_env_checker=True,
    )
