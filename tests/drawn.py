"""A scenario that draws all that can be drawn without another plant."""

from sffr_gym.task.scenario import Scenario

EVERYTHING = {
    "panel_modes": ({"mode": 1, "amplitude": (0.05, 0.1)},), "offset_position": 0.1, "offset_angle": 0.05,
    "speed": (0.6, 0.8), "random_phase": True, "impulses": {"count": 2, "linear": 2.0, "angular": 1.0},
    "sensors": {"position": 1e-4, "delay": 0.5, "quantisation": {"angle": (1e-4, 1e-3)}},
}  # fmt: skip


def everything() -> Scenario:
    """Return it."""
    return Scenario.model_validate({"name": "everything", "description": "a test's"} | EVERYTHING)
