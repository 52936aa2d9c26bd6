"""Checks of the coupled solution: the compiled elimination against the paper's equations as one linear system.

``sffr_gym.physics.monolithic`` has Eqs. 2, 4, 40, 45, 48, 49 readably; here they are solved with the pins as one matrix
and held against the kernels that the simulator runs. Both sides are held against other engines elsewhere.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import NamedTuple

import numpy as np

from sffr_gym.compile.workspace import new_workspace
from sffr_gym.config.params import Params, load_params
from sffr_gym.physics import monolithic
from sffr_gym.physics.dynamics import work_shapes
from sffr_gym.physics.each_panel import panel_beams
from sffr_gym.physics.energy import energy_of
from sffr_gym.physics.integrator import INTEGRATORS
from sffr_gym.physics.kinematics import arm_points, rotation
from sffr_gym.physics.model import N_BASE, Model, modal, mode_slice, nodal, tip_rows
from sffr_gym.physics.plant import Plant, evaluate
from sffr_gym.physics.simulator import Simulator, State
from sffr_gym.types import Array
from sffr_workbench.verify.check import Check, make_check, relative
from sffr_workbench.verify.motion import UNLIKE

ROUNDING = "Rounding, times the condition of the mass matrix; relative to the largest entry."
ALL_MODES = ("panel.axial_cut=1.0e+9", "panel.bending_cut=1.0e+9")
OTHER_ROBOT = (  # another structure: a single slanted panel, mounts and angles that are not special
    "panel.mounts=[{name: only, root: [0.3, -0.7], angle: 2.1}]",
    "arms.0.mount_angle=0.4", "arms.2.links.0.com=0.1",
)  # fmt: skip
OFF_CENTRE = ("object.grasps.0.point=[0.05, 0.11]", "object.grasps.1.point=[0.03, -0.1]")  # both beside the y axis

Errors = Callable[[State, dict[str, Array]], list[float]]  # at a state under a command


class Solution(NamedTuple):
    """Accelerations and inner forces at one state."""

    qdd: Array  #: (n,)
    qfdd: Array  #: (n_p, n_f)
    objdd: Array  #: (3,), empty without an object
    q_flex: Array  #: (n,) Eq. 4
    lam: Array  #: (n_g, 2) grasp forces, inertial axes


def checks(quick: bool) -> list[partial[Check]]:
    """List the checks of this module."""
    states = 10 if quick else 100
    robots = [
        ("one element", load_params().with_overrides(*ALL_MODES)),
        ("three elements", load_params().with_overrides(*ALL_MODES, "panel.elements=3")),
        ("object held beside its centre", load_params().with_overrides(*ALL_MODES, *OFF_CENTRE)),
        ("one element, no object", load_params().with_overrides(*ALL_MODES, "object=null")),
        ("panels that differ", load_params().with_overrides(*ALL_MODES, "panel.elements=2", *UNLIKE)),
        ("another robot", load_params().with_overrides(*ALL_MODES, "panel.elements=2", "object=null", *OTHER_ROBOT)),
    ]
    listed = [partial(solution, name, params, states) for name, params in robots]
    others = (object_force, held_force, straight_elbow, panel_forces, foreshortened)
    return listed + [partial(check, states) for check in others]


def solution(name: str, params: Params, states: int) -> Check:
    """Check compiled accelerations, Q_flex and grasp forces against one linear solve of all equations."""
    sim = Simulator(params)

    def errors(state: State, command: dict[str, Array]) -> list[float]:
        expected = monolithic_solution(sim, state, command)
        qdd, qfdd, objdd = sim.acceleration(state, **command)
        found = Solution(qdd, qfdd, objdd, sim.q_flex(state, **command), sim.grasp_forces(state, **command))
        return [relative(ours, theirs) for ours, theirs in zip(found, expected, strict=True) if theirs.size]

    name = f"Coupled solution (Eqs. 2-4, 8, 40): {name}"
    return _rounding_check(name, "one linear system", sim, states, errors, "Accelerations, Q_flex and grasp forces.")


def object_force(states: int) -> Check:
    """Check the same with a force and moment of the surroundings on the object (F_o of Eq. 8)."""
    sim, rng = Simulator(load_params().with_overrides(*ALL_MODES)), np.random.default_rng(1)
    model, work, out = sim.model, new_workspace(work_shapes(sim.model)), np.zeros(sim.model.at.end)

    def errors(state: State, command: dict[str, Array]) -> list[float]:
        command["obj"] = rng.uniform(-5.0, 5.0, 3)
        evaluate(model, *_packed(model, state, command), work, out, False)
        expected = monolithic_solution(sim, state, command)
        return [relative(out[: len(state.q)], expected.qdd), relative(out[-3:], expected.objdd)]

    name = "Coupled solution, force on the object"
    return _rounding_check(name, "one linear system", sim, states, errors, "Accelerations of robot and object.")


def held_force(states: int) -> Check:
    """Check that the staggered coupling is exact if the base is held to the Q_flex that it feels anyway."""
    sim = Simulator(load_params().with_overrides(*ALL_MODES))
    model, work = sim.model, new_workspace(work_shapes(sim.model))
    exact, held = np.zeros((2, model.at.end))

    def errors(state: State, command: dict[str, Array]) -> list[float]:
        packed = _packed(model, state, command)
        evaluate(model, *packed, work, exact, False)
        work.held[:] = sim.q_flex(state, **command)[:3]
        evaluate(model, *packed, work, held, True)
        return [relative(held, exact)]

    name = "Coupled solution with Q_flex given (Fig. 1)"
    return _rounding_check(name, "exact coupling", sim, states, errors, "Accelerations of all coordinates.")


def straight_elbow(states: int) -> Check:
    """Check the same with an elbow as straight as the task allows, where eliminating the arm loses digits."""
    sim = Simulator(load_params().with_overrides(*ALL_MODES))
    elbow = N_BASE + int(sim.model.arm_first[sim.model.grasp_arm[1]]) + 1
    least = sim.params.limits.arm_singularity

    def errors(state: State, command: dict[str, Array]) -> list[float]:
        state.q[elbow] = np.arcsin(least)
        expected = monolithic_solution(sim, state, command)
        qdd, _, objdd = sim.acceleration(state, **command)
        pairs = (qdd, expected.qdd), (objdd, expected.objdd), (sim.grasp_forces(state, **command), expected.lam)
        return [relative(ours, theirs) for ours, theirs in pairs]

    return make_check(
        f"Coupled solution, |sin| of an elbow {least:g}", f"one linear system, {states} random states",
        _worst(sim, states, errors), 1.0e-7, "",
        "Where an episode ends. Eliminating a straight arm is singular, though the robot is not: the error grows about "
        "as the inverse seventh power of the angle.",
    )  # fmt: skip


def panel_forces(states: int) -> Check:
    """Check Q_flex of the compiled code against Eq. 52 from root forces in the panels' axes, moments with the minus."""
    params = load_params().with_overrides(*ALL_MODES)
    sim = Simulator(params)
    l_cos, l_sin = -params.panel.mounts[0].root[0], params.panel.mounts[0].root[1]

    def errors(state: State, command: dict[str, Array]) -> list[float]:
        qdd, qfdd, _ = sim.acceleration(state, **command)
        V, M = np.zeros((2, 2)), np.zeros(2)
        for i in range(2):
            J_f, Jd_qd = monolithic.root_jacobian(sim.model, state.q, state.qd, i)
            delta = state.q[2] + params.panel.mounts[i].angle
            p = monolithic.panel_equations(panel_beams(sim.params)[i], delta, state.qd[2], state.qf[i], state.qfd[i])
            Q_e = p.m_rr @ (J_f @ qdd + Jd_qd) + p.m_rf @ qfdd[i] - p.Q_vr
            V[i], M[i] = rotation(delta).T @ Q_e[:2], Q_e[2]
        (V1L, V2L), (V1R, V2R) = V
        moment = -(M[0] + M[1]) - (V2L + V2R) * l_sin + (V1L - V1R) * l_cos
        force = rotation(state.q[2]) @ [V2L - V2R, V1R - V1L]
        return [relative(sim.q_flex(state, **command)[:3], [*force, moment])]

    return _rounding_check("Q_flex of the case study", "Eq. 52 with Eqs. 45, 48, 50", sim, states, errors)


def foreshortened(states: int, step: float = 1.0e-4) -> Check:
    """Check panels that keep their length against Lagrange's equations of their energy, and Q_flex against the base's.

    The momenta are derivatives of the energy by the velocities, exact by differences since it is quadratic in them;
    along the motion they change as the Lagrangian does with the coordinates.
    """
    robot = load_params().with_overrides("panel.foreshortening=true", "panel.elements=2", *UNLIKE)
    sim = Simulator(robot.with_overrides("object=null", "panel.strain_rate_damping=0"))
    model, directions, worst = sim.model, np.eye(sim.model.at.end), 0.0

    def by_velocity(p: Array, v: Array) -> Array:
        return np.array([(energy_of(model, p, v + each) - energy_of(model, p, v - each)) / 2.0 for each in directions])

    plant, still, rng = Plant(model, INTEGRATORS["etdrk4"]), np.zeros(model.at.end), np.random.default_rng(0)
    for _ in range(max(states // 10, 2)):
        p, v = rng.uniform(-3.0, 3.0, model.at.end), rng.normal(size=model.at.end)
        p[mode_slice(model)] = 0.5 * v[mode_slice(model)] / np.sqrt(model.omega2.ravel())
        state, a = sim.unflatten(0.0, p, v), plant.accelerations(p, v, still)
        rate = by_velocity(p + step * v, v + step * a) - by_velocity(p - step * v, v - step * a)
        ends = [p + step * each for each in directions], [p - step * each for each in directions]
        slope = np.array([
            energy_of(model, ahead, v) - 2.0 * energy_of(model, ahead, still)
            - energy_of(model, behind, v) + 2.0 * energy_of(model, behind, still)
            for ahead, behind in zip(*ends, strict=True)
        ])  # fmt: skip
        H, C = monolithic.rigid_equations(model, state.q, state.qd)
        base = (H @ a[: len(state.q)] + C)[:N_BASE]
        worst = max(worst, relative(rate, slope), relative(sim.q_flex(state)[:N_BASE], base))
    return make_check(
        "Panels that keep their length: accelerations and Q_flex", "Lagrange's equations of their energy",
        worst, 1.0e-6, "", f"By differences over {step:g} s; rounding and the third derivative are left.",
    )  # fmt: skip


def monolithic_solution(sim: Simulator, state: State, command: dict[str, Array]) -> Solution:
    """Solve ``M zdd + h = Q + J' lam`` with the pins ``J [zdd, objdd] + Jd zd = 0`` as one linear system."""
    model, n = sim.model, len(state.q)
    M, h = monolithic.assemble(model, panel_beams(sim.params), state.q, state.qd, state.qf, state.qfd)
    Q = np.zeros(len(M))
    base = command["wrench"]
    Q[:2], Q[2], Q[3:n] = rotation(state.q[2]) @ base[:2], base[2], command["joints"]
    Q[n:].reshape(state.qf.shape)[:, -3:] = command["piezo_tau"]
    J, drift = np.zeros((0, len(M))), np.zeros(0)
    if state.obj is not None and state.objd is not None:
        J, drift = _pins(sim, state, len(M))
        M = np.block([[M, np.zeros((len(M), 3))], [np.zeros((3, len(M))), np.diag(_object_inertia(sim))]])
        Q, h = np.append(Q, command.get("obj", np.zeros(3))), np.append(h, np.zeros(3))
    system = np.block([[M, -J.T], [J, np.zeros((len(J), len(J)))]])
    found = np.linalg.solve(system, np.concatenate([Q - h, -drift]))
    zdd, lam = found[: len(M)], found[len(M) :]
    end = n + state.qf.size
    H, C = monolithic.rigid_equations(model, state.q, state.qd)
    q_flex = H @ zdd[:n] + C - Q[:n] - J[:, :n].T @ lam
    return Solution(zdd[:n], zdd[n:end].reshape(state.qf.shape), zdd[end:], q_flex, lam.reshape(-1, 2))


def _rounding_check(name: str, against: str, sim: Simulator, states: int, errors: Errors, note: str = "") -> Check:
    """Make a check of errors that are all rounding."""
    worst = _worst(sim, states, errors)
    return make_check(name, f"{against}, {states} random states", worst, 1.0e-12, "", f"{note} {ROUNDING}".lstrip())


def _worst(sim: Simulator, states: int, errors: Errors) -> float:
    """Return the largest error at random states; NaN if one is."""
    return float(np.max([np.max(errors(state, command)) for state, command in _states(sim, states)]))


def _pins(sim: Simulator, state: State, size: int) -> tuple[Array, Array]:
    """Return the pins' rows over ``[z, obj]`` and their acceleration at zero accelerations; gaps decay."""
    assert state.obj is not None and state.objd is not None
    model, n, kappa = sim.model, len(state.q), sim.model.baumgarte
    short, gap = monolithic.constraint_jacobian(model, state.q, state.qd, state.obj)
    J = np.hstack([short[:, :n], np.zeros((len(short), size - n)), short[:, n:]])
    gap_d = short @ np.concatenate([state.qd, state.objd])
    drift = 2 * kappa * gap_d + kappa**2 * gap
    for g, arm in enumerate(model.grasp_arm):
        _, end = arm_points(model, state.q, state.qd, int(arm))
        centripetal = state.objd[2] ** 2 * rotation(state.obj[2]) @ model.grasp_point[g]
        drift[2 * g : 2 * g + 2] += end.Jd_qd + centripetal
    return J, drift


def _object_inertia(sim: Simulator) -> list[float]:
    return [sim.model.object_mass, sim.model.object_mass, sim.model.object_inertia]


def _packed(model: Model, state: State, command: Mapping[str, Array]) -> tuple[Array, Array, Array]:
    """Return ``p, v, tau`` (n,) of the kernels; ``obj`` is the wrench of the surroundings on the object."""
    tip = np.einsum("pfm,pf->pm", tip_rows(model), command["piezo_tau"]).ravel()
    tau = np.concatenate([command["wrench"], command["joints"], tip, command.get("obj", np.zeros(3))])
    p = np.concatenate([state.q, modal(model, state.qf), state.obj])
    return p, np.concatenate([state.qd, modal(model, state.qfd), state.objd]), tau


def _states(sim: Simulator, count: int, seed: int = 0) -> list[tuple[State, dict[str, Array]]]:
    """Draw random states and commands; grasps almost closed, so that the decay of gaps is seen as well."""
    rng = np.random.default_rng(seed)
    start = sim.initial_state()
    n, (n_p, n_f) = len(start.q), start.qf.shape
    states = []
    for _ in range(count):
        # Axial strains of the size of the bending ones' effects: the axial stiffness is a million times larger.
        scale = np.tile([1.0e-6, 0.1, 0.05], n_f // 3)
        qf, qfd = rng.normal(size=(2, n_p, n_f)) * scale * [[[1.0]], [[5.0]]]
        if start.obj is None:
            q, obj, objd = rng.uniform(-3.0, 3.0, n), None, None
        else:
            q = start.q + 1.0e-3 * rng.normal(size=n)
            obj, objd = start.obj + 1.0e-3 * rng.normal(size=3), rng.normal(size=3)
        state = State(0.0, q, rng.normal(size=n), qf, qfd, obj, objd)
        assert np.allclose(nodal(sim.model, modal(sim.model, qf)), qf), "a mode was cut"
        command = {
            "wrench": rng.uniform(-20.0, 20.0, 3),
            "joints": rng.uniform(-3.0, 3.0, n - 3),
            "piezo_tau": rng.uniform(-10.0, 10.0, (n_p, 3)),
        }
        states.append((state, command))
    return states
