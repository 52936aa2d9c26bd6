"""Every sign of the equations matters: flipped, it turns a check red."""

import os
import subprocess
import sys

import pytest

from sffr_workbench.verify import flip_terms, flips

TERMS = """
sffr_gym/physics/panel.py condense: 2.0 * w * first_yd
sffr_gym/physics/panel.py condense: omega2[j] * a
sffr_gym/physics/panel.py expand: turn[j] * alpha
sffr_gym/physics/monolithic.py panel_equations: 2 * delta_d * dR @ first_d
sffr_gym/physics/monolithic.py panel_equations: beam.N.T
sffr_gym/physics/monolithic.py rigid_equations: inertia * np.outer(point.w, point.w)
sffr_gym/physics/beam.py beam: EI * np.outer(d2W, d2W)
sffr_gym/physics/beam.py shape_functions: 3 * xi**2
sffr_gym/physics/arms.py articulate: w2 * length * (Mxx * c + Mxy * s)
sffr_gym/physics/dynamics.py _attach: w2 * (hx * x + hy * y)
sffr_gym/physics/dynamics.py flexible_wrench: y * bx
sffr_gym/physics/etdrk4.py _quadratic_forcing: second / mu2
sffr_gym/task/signals.py measure_state: turn2 * first_x
baselines/sffr_baselines/mic.py _inverse_dynamics: com * (turn * c - w2 * s)
baselines/sffr_baselines/suppression.py suppress: 2.0 * yaw_rate * law.gyroscopic[i, k, j] * obs[qd + j]
baselines/sffr_baselines/regulator.py root_acceleration: turn
configs/sffr.yaml panel.mounts: 1.5707963267948966
configs/sffr.yaml panel.mounts: -1.5707963267948966
""".strip().splitlines()
MOTION = [*flip_terms.EQUATIONS_OF_MOTION, flips.CONFIG]


@pytest.mark.parametrize(
    ("files", "options", "least"),
    [
        pytest.param(MOTION, [], 500, id="motion"),
        pytest.param([*flip_terms.LOOP], ["--sample"], 35, id="loop, sample"),
    ],
)
@pytest.mark.slow
def test_a_flipped_sign_is_found(files, options, least):
    for library in "sympy", "pinocchio":
        pytest.importorskip(library)
    expected = [flip for flip in flips.all_flips() if flip.file in files]
    expected = flips.sample(expected) if options else expected
    assert len(expected) >= least
    command = [sys.executable, "-m", "sffr_workbench.verify.flips", *options, *files]
    done = subprocess.run(command, env=os.environ | {"SFFR_INTERPRETED": "1"}, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == f"{len(expected)} flips, 0 stay green"


def test_terms_of_the_paper_are_among_the_flips():
    """Named terms: a change of the search that loses them would go unseen."""
    found = {f"{flip.file} {flip.function}: {flip.text}" for flip in flips.all_flips()}
    assert set(TERMS) <= found


def test_every_function_of_the_table_has_terms():
    """A function that is renamed or moved would be left out without a word."""
    found = {(flip.file, flip.function) for flip in flips.all_flips()}
    assert {(file, function) for file, functions in flips.TERMS.items() for function in functions} <= found
    assert flip_terms.LOOP.keys() <= flip_terms.TESTS.keys() <= flip_terms.TERMS.keys()
