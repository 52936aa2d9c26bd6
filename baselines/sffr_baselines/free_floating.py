"""A base that nothing pushes: the inverse dynamics of what the joints can still move.

Without thrusters the base gives way to whatever the arms do. The law then leaves out its task: grippers, object and
held joints keep theirs, and the base's acceleration is the one under which no wrench is asked of it,

    wrench(a) = wrench(0) + (d wrench / d a) a = 0,

the panels' reaction included, since the base moves as the momentum of the whole robot lets it. With that acceleration
the joints' accelerations follow from those of the grippers as by the generalised Jacobian, and the torques as before.

Source: Y. Umetani and K. Yoshida, "Resolved motion rate control of space manipulators with generalized Jacobian
matrix", IEEE Transactions on Robotics and Automation 5 (1989), here for accelerations and forces.
"""

from __future__ import annotations

from typing import NamedTuple

from sffr_baselines.mic import answer
from sffr_baselines.panel_reaction import add_panel_reaction
from sffr_gym.compile.kernels import kernel
from sffr_gym.physics.model import N_BASE
from sffr_gym.types import Array


class FloatWork(NamedTuple):
    """Memory of :func:`float_base`."""

    wrench: Array  #: (3,) that an acceleration of the base asks for [N, N, N m]
    rest: Array  #: (3,) that none asks for
    inertia: Array  #: (3, 3) what it changes by for a unit of each acceleration


def float_shapes():
    """Shapes of the :class:`FloatWork`."""
    return FloatWork((N_BASE,), (N_BASE,), (N_BASE, N_BASE))


@kernel(inline=False)
def float_base(law, seen, state, work, volts, torque):
    """Write into ``work.mic.base`` the acceleration (3,) of a base that nothing pushes, base axes.

    law: a :class:`control_law.Law`; seen: (n_o,) what it acts on, for which :func:`mic.ask` has been called.
    state: its :class:`control_law.LawState`; work: :class:`control_law.LawWork`.
    volts: (n_p n_c,) as commanded; torque: (n_l,) overwritten.

    The wrench is linear in the acceleration, so that four evaluations give its three columns.
    """
    base, memory = work.mic.base, work.floating
    for k in range(N_BASE + 1):
        for j in range(N_BASE):
            base[j] = 1.0 if j == k - 1 else 0.0
        answer(law.prior, law.reference, law.gains, law.at, seen, state.integral, work.mic, memory.wrench, torque)
        add_panel_reaction(law.reaction, law.scale, law.at, seen, volts, base, state.share, memory.wrench)
        for j in range(N_BASE):
            if k == 0:
                memory.rest[j] = memory.wrench[j]
            else:
                memory.inertia[j, k - 1] = memory.wrench[j] - memory.rest[j]
    _solve(memory.inertia, memory.rest, base)


@kernel
def _solve(A, b, x):
    """Write ``x`` (3,) with ``A x + b = 0`` by Cramer's rule; A: (3, 3), not singular."""
    c0 = A[1, 1] * A[2, 2] - A[1, 2] * A[2, 1]
    c1 = A[1, 2] * A[2, 0] - A[1, 0] * A[2, 2]
    c2 = A[1, 0] * A[2, 1] - A[1, 1] * A[2, 0]
    det = A[0, 0] * c0 + A[0, 1] * c1 + A[0, 2] * c2
    for k in range(N_BASE):
        i, j = (k + 1) % N_BASE, (k + 2) % N_BASE
        total = 0.0
        for row in range(N_BASE):
            r, s = (row + 1) % N_BASE, (row + 2) % N_BASE
            total -= b[row] * (A[r, i] * A[s, j] - A[r, j] * A[s, i])
        x[k] = total / det
