"""Every sign of the equations matters: flipped, it turns a check of ``sffr verify`` red."""

import os
import subprocess
import sys
from pathlib import Path

import flips
import pytest

PROGRAM = Path(flips.__file__)
TERMS = """
panel.py condense: 2.0 * w * first_yd
panel.py condense: omega2[j] * a
panel.py expand: turn[j] * alpha
monolithic.py panel_equations: 2 * delta_d * dR @ first_d
monolithic.py panel_equations: beam.N.T
monolithic.py rigid_equations: inertia * np.outer(point.w, point.w)
beam.py beam: EI * np.outer(d2W, d2W)
beam.py shape_functions: 3 * xi**2
arms.py articulate: w2 * length * (Mxx * c + Mxy * s)
dynamics.py _attach: w2 * (hx * x + hy * y)
dynamics.py flexible_wrench: y * bx
sffr.yaml panel.mounts: 1.5707963267948966
sffr.yaml panel.mounts: -1.5707963267948966
""".strip().splitlines()


@pytest.mark.parametrize("options", [["--sample"], pytest.param([], marks=pytest.mark.slow)], ids=["sample", "all"])
def test_a_flipped_sign_is_found(options):
    for library in "sympy", "pinocchio":
        pytest.importorskip(library)
    expected = flips.all_flips()
    expected = flips.sample(expected) if options else expected
    assert len(expected) >= (20 if options else 500)
    environment = os.environ | {"NUMBA_DISABLE_JIT": "1"}
    done = subprocess.run([sys.executable, PROGRAM, *options], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.splitlines()[-1] == f"{len(expected)} flips, 0 stay green"


def test_terms_of_the_paper_are_among_the_flips():
    """Named terms: a change of the search that loses them would go unseen."""
    found = {f"{flip.file} {flip.function}: {flip.text}" for flip in flips.all_flips()}
    assert set(TERMS) <= found
