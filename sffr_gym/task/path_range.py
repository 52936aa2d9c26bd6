"""Whether a path can be followed within the range of the observation."""

from __future__ import annotations

import numpy as np

from sffr_gym.config.params import Params
from sffr_gym.config.strict_yaml import ConfigError
from sffr_gym.task.reference import Desired, Reference, desired, on_circle

PATH_SAMPLES = 400  # times at which a path is looked at
SLOWEST = 0.05  # of the path's speed, at which its direction is still one


def check_path(params: Params, reference: Reference) -> None:
    """Make sure that a path's own motion lies within the range of the observation; else every episode would end.

    A circle's is checked with the parameters.

    Raises:
        ConfigError: with what the motion reaches, and the key of its bound.
    """
    if on_circle(reference):
        return
    path, limits = params.path, params.limits
    motions = [desired(reference, t) for t in np.linspace(0.0, path.period, PATH_SAMPLES).tolist()]
    motion = Desired._make(np.array(motions).T)
    slowest, usual = np.hypot(motion.xd, motion.yd).min(), path.speed
    if reference.turning and slowest < SLOWEST * usual:
        raise ConfigError(
            f"path.heading = 'tangent': must be fixed on a path that slows down to {slowest:.3g} m/s and turns on the "
            "spot there; move path.points, or keep the heading"
        )
    for bound, unit, size in (
        ("velocity", "m/s", np.hypot(motion.xd, motion.yd)),
        ("velocity", "m/s2", np.hypot(motion.xdd, motion.ydd)),
        ("velocity", "m/s3", np.hypot(motion.xddd, motion.yddd)),
        ("rate", "rad/s", motion.turn),
        ("rate", "rad/s2", motion.turn_acceleration),
        ("rate", "rad/s3", motion.turn_jerk),
    ):  # fmt: skip
        most, largest = getattr(limits, bound), np.abs(size).max()
        if not largest <= most:
            raise ConfigError(
                f"limits.{bound}: bounds the path's motion to {most:g} [{unit}], which path.kind = {path.kind!r} "
                f"exceeds with {largest:.4g}; give it more time, less speed or more room"
            )
