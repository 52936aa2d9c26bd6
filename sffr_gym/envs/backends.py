"""What ``gym.make_vec`` calls for ``SFFRFlex-v0``: the vector environment on the processor or on a GPU."""

from __future__ import annotations

from typing import Any

from gymnasium.vector import AutoresetMode, VectorEnv

from sffr_gym.envs.vector import SFFRFlexVectorEnv

BACKENDS = ("cpu", "cuda")


def make_flex(num_envs: int = 1, *, backend: str = "cpu", **kwargs: Any) -> VectorEnv[Any, Any, Any]:
    """Return many ``SFFRFlex-v0`` environments; see :func:`make_on`."""
    return make_on(backend, SFFRFlexVectorEnv, num_envs, **kwargs)


def make_on(
    backend: str, environments: type[SFFRFlexVectorEnv], num_envs: int, **kwargs: Any
) -> VectorEnv[Any, Any, Any]:
    """Return environments on a backend.

    Args:
        backend: ``cpu``, or ``cuda`` for an NVIDIA GPU; see :class:`sffr_gym.envs.device.DeviceVectorEnv`.
        environments: their class on the processor.
        num_envs: number of environments.
        **kwargs: of that class.

    Raises:
        ValueError: for an unknown backend, or a render mode on a GPU.
        ConfigError: for a GPU that cannot be used.
    """
    if backend not in BACKENDS:
        raise ValueError(f"backend = {backend!r}: must be one of {', '.join(BACKENDS)}")
    if backend == "cpu":
        return environments(num_envs, **kwargs)
    if kwargs.get("render_mode") is not None:
        raise ValueError("render_mode: backend 'cuda' draws no pictures; leave it out")
    gpu = find_gpu()
    from sffr_gym.envs.device import DeviceVectorEnv

    mode = kwargs.pop("autoreset_mode", AutoresetMode.NEXT_STEP)
    return DeviceVectorEnv(environments(1, **kwargs), num_envs, mode, gpu)


def find_gpu() -> Any:
    """Return this machine's GPU; raises ConfigError without one, or without the extra ``gpu``."""
    from sffr_gym.compile.cuda.program import Gpu

    return Gpu()
