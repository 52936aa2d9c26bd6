"""Angles in the kernels: wrapped, and cosines and sines from those of a near angle."""

import numpy as np
import pytest

from sffr_gym.compile.angles import NEAR, anchor_shapes, cos_sin_near, wrap
from sffr_gym.compile.kernels import kernel
from sffr_gym.compile.workspace import new_workspace

ANGLES = np.random.default_rng(0).uniform(-40.0, 40.0, 2000)


@kernel
def both(start, turn, refresh, anchor, out):
    cos_sin_near(anchor, 0, start, True)
    out[0], out[1] = cos_sin_near(anchor, 0, start + turn, refresh)


@pytest.mark.parametrize("refresh", [True, False])
@pytest.mark.parametrize("turn", [0.0, 1e-9, 0.3 * NEAR, -0.999 * NEAR, 1.001 * NEAR, 2.0, -1e4])
def test_cosine_and_sine_of_near_and_far_angles_are_exact_to_rounding(turn, refresh):
    anchor, out = new_workspace(anchor_shapes(1)), np.zeros(2)
    for start in ANGLES:
        both(start, turn, refresh, anchor, out)
        angle = start + turn
        assert abs(out[0] - np.cos(angle)) < 3e-16
        assert abs(out[1] - np.sin(angle)) < 3e-16
        moved = refresh or abs(angle - start) >= NEAR
        assert anchor.angle[0] == (angle if moved else start)


def test_an_angle_that_is_not_finite_gives_nan():
    out = np.zeros(2)
    with np.errstate(invalid="ignore"):  # where the kernels are not compiled
        both(1.0, np.nan, False, new_workspace(anchor_shapes(1)), out)
    assert np.isnan(out).all()


def test_wrapped_angles_differ_by_turns_and_lie_within_half_a_turn():
    for angle in [*ANGLES, 0.0, -np.pi, np.pi, 1e-300, -1e-300]:
        wrapped = wrap(angle)
        assert -np.pi - 1e-14 <= wrapped <= np.pi + 1e-14
        turns = (angle - wrapped) / (2.0 * np.pi)
        assert turns == pytest.approx(round(turns), abs=1e-12)
    assert wrap(-np.pi) == -np.pi and wrap(np.pi) == -np.pi and wrap(0.5) == 0.5
