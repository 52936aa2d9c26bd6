"""Equations of motion: assembled form and compiled kernels against the independent Lagrangian, for many robots."""

import json
from typing import Any, NamedTuple

import numpy as np
import pytest
import scipy.linalg
from case_study import FREQUENCIES
from numpy.typing import NDArray
from oracle import Oracle

from sffr_gym import Params, Simulator, State, load_params
from sffr_gym.compile.arguments import Block
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.beam import beam, clamped_modes
from sffr_gym.physics.dynamics import accelerations, work_shapes
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import joint_slice, modal, object_slice, pack
from sffr_gym.physics.monolithic import constraint_jacobian, rigid_equations

Array = NDArray[np.float64]

NO_CUT = ("panel.axial_cut=1.0e+9", "panel.bending_cut=1.0e+9")
ALL_MODES = (*NO_CUT, "simulation.baumgarte=0")  # as the oracle: all modes, no stabilisation
ALONE = "object=null"
OBLIQUE = [{"name": "only", "root": [0.35, -0.7], "angle": 2.1}]
THREE = [{"name": f"panel{k}", "root": [0.4 - 0.3 * k, 0.2 + 0.1 * k], "angle": 1.0 + 1.7 * k} for k in range(3)]


def structure(links: list[int], holders: tuple[int, ...] = (), **panel: Any) -> list[str]:
    """Return the overrides for a robot with arms of so many links, no number twice; `holders` hold the object."""
    rng = np.random.default_rng(sum(links) + len(links))
    arms = []
    for index, count in enumerate(links):
        bodies = []
        for _ in range(count):
            mass, length, inertia, part = rng.uniform(0.5, 1.5, 4)
            bodies.append({"mass": 3 * mass, "length": length, "inertia": 0.4 * inertia, "com": 0.6 * part * length})
        mount, angle = rng.uniform(-0.6, 0.6, 2).tolist(), float(rng.uniform(-3, 3))
        arms.append({"name": f"a{index}", "mount": mount, "mount_angle": angle, "links": bodies})
    grasps = [{"arm": f"a{index}", "point": rng.uniform(-0.2, 0.2, 2).tolist()} for index in holders]
    carried = {"mass": 2.7, "inertia": 0.35, "grasps": grasps} if holders else None
    q = [0.0] * (3 + sum(links))
    settings = {"arms": arms, "object": carried, "initial.q": q, "initial.qd": q}
    settings |= {f"panel.{key}": value for key, value in panel.items()}
    return [f"{key}={json.dumps(value)}" for key, value in settings.items()]


ROBOTS = {
    "case study, free": [ALONE],
    "case study": [],
    "two elements": ["panel.elements=2"],
    "four elements, free": ["panel.elements=4", ALONE],
    "three-link arms": structure([3, 1, 3], (2, 0)),
    "three arms hold": structure([2, 3, 2], (1, 2, 0)),
    "one arm holds": structure([1, 2], (1,), mounts=OBLIQUE, elements=2),
    "one oblique panel, free": structure([2], mounts=OBLIQUE, elements=3),
    "three panels, free": structure([1, 2], mounts=THREE),
    "no panels": structure([2, 2], (0, 1), mounts=[]),
    "no panels, free": structure([4], mounts=[]),
    "no arms, free": structure([], elements=2),
    "base alone, free": structure([], mounts=[]),
}


class Case(NamedTuple):
    """A robot in a random state under a random command, and what the oracle makes of it."""

    simulator: Simulator
    oracle: Oracle
    state: State
    command: dict[str, Array]
    z: Array
    zd: Array
    Q: Array  # the command as a generalised force, inertial axes
    zdd: Array
    objdd: Array | None
    lam: Array | None


def random_state(params: Params, seed: int) -> State:
    """Return a state with every coordinate and rate at random, open grasps included; only axial strains are small."""
    rng = np.random.default_rng(seed)
    n, panels = 3 + params.n_links, (params.n_panels, 3 * params.panel.elements)
    q, qd = rng.uniform(-3, 3, n), rng.uniform(-1, 1, n)
    scale = np.tile([1e-6, 0.3, 0.3], params.panel.elements)
    qf, qfd = scale * rng.uniform(-1, 1, panels), scale * rng.uniform(-1, 1, panels)
    body = params.object is not None
    return State(0.0, q, qd, qf, qfd, rng.uniform(-2, 2, 3) if body else None, rng.uniform(-1, 1, 3) if body else None)


def make_case(name: str, seed: int) -> Case:
    """Build a robot of `ROBOTS` and solve it with the oracle."""
    params = load_params().with_overrides(*ROBOTS[name], *ALL_MODES)
    simulator, oracle, state = Simulator(params), Oracle(params.to_dict()), random_state(params, seed)
    rng = np.random.default_rng([seed, 1])
    command = {
        "base": rng.uniform(-90, 90, 3),
        "joints": rng.uniform(-6, 6, params.n_links),
        "piezo_tau": rng.uniform(-40, 40, (params.n_panels, 3)),
    }
    z, zd = np.concatenate([state.q, state.qf.ravel()]), np.concatenate([state.qd, state.qfd.ravel()])
    tips = np.zeros_like(state.qf)
    tips[:, -3:] = command["piezo_tau"]
    Q = np.concatenate([command["base"], command["joints"], tips.ravel()])
    Q[:2] = rotation(state.q[2]) @ command["base"][:2]
    if state.obj is None:
        return Case(simulator, oracle, state, command, z, zd, Q, oracle.acceleration(z, zd, Q), None, None)
    return Case(simulator, oracle, state, command, z, zd, Q, *oracle.constrained(z, zd, state.obj, state.objd, Q))


@pytest.fixture(params=[(name, seed) for name in ROBOTS for seed in (0, 1)], ids=lambda p: f"{p[0]} {p[1]}")
def case(request: pytest.FixtureRequest) -> Case:
    """Return each robot in two states."""
    return make_case(*request.param)


def assert_close(actual: Any, expected: Any, tolerance: float = 1e-10) -> None:
    """Compare numbers of one unit: relative to each, and to the largest, since small ones are differences of large."""
    largest = np.abs(expected).max(initial=0.0)
    np.testing.assert_allclose(actual, expected, rtol=tolerance, atol=tolerance * largest)


def assert_accelerations(actual: tuple[Array, Array, Array], case: Case, tolerance: float = 1e-10) -> None:
    """Compare rigid, elastic and object's accelerations with the oracle's."""
    n = case.oracle.n_rigid
    assert_close(actual[0], case.zdd[:n], tolerance)
    elastic = case.zdd[n:].reshape(case.state.qf.shape)
    for kind in range(3):  # axial, transverse, slope
        assert_close(actual[1][:, kind::3], elastic[:, kind::3], tolerance)
    if case.objdd is not None:
        assert_close(actual[2], case.objdd, tolerance)


def test_assembled_equations_are_the_lagrangian_ones(case: Case) -> None:
    """M and h of M zdd + h = Q."""
    assert_close(case.simulator.mass_matrix(case.state), case.oracle.mass_matrix(case.z))
    assert_close(case.simulator.bias(case.state), case.oracle.bias(case.z, case.zd))


def test_accelerations_are_those_of_the_lagrangian(case: Case) -> None:
    """The exact coupling by elimination equals the monolithic equations of all coordinates, grasp forces included."""
    assert_accelerations(case.simulator.acceleration(case.state, **case.command), case)
    if case.lam is not None:
        assert_close(case.simulator.grasp_forces(case.state, **case.command), case.lam)


def test_accelerations_solve_the_assembled_equations(case: Case) -> None:
    """M zdd + h = Q plus the grasp forces at the tips: the two forms that the package has agree."""
    qdd, qfdd, _ = case.simulator.acceleration(case.state, **case.command)
    M, h = case.simulator.mass_matrix(case.state), case.simulator.bias(case.state)
    force = case.Q - h
    if case.state.obj is not None:
        J, _ = constraint_jacobian(case.simulator.model, case.state.q, case.state.qd, case.state.obj)
        lam = case.simulator.grasp_forces(case.state, **case.command)
        force[: len(qdd)] += J[:, : len(qdd)].T @ lam.ravel()
    zdd = np.linalg.solve(M, force)
    assert_accelerations((qdd, qfdd, case.objdd), case._replace(zdd=zdd))


def test_panels_push_on_the_rigid_part(case: Case) -> None:
    """Q_flex is the oracle's, and H qdd + C = Q + Q_flex + J' lam (Eq. 3) with H and C of the rigid part alone."""
    n, state = case.oracle.n_rigid, case.state
    q_flex = case.simulator.q_flex(state, **case.command)
    expected = case.oracle.q_flex(case.z, case.zd, case.zdd)
    assert_close(q_flex[:3], expected[:3])
    assert not q_flex[3:].any()
    H, C = rigid_equations(case.simulator.model, state.q, state.qd)
    force = case.Q[:n] + q_flex
    if case.lam is not None:
        J, _ = constraint_jacobian(case.simulator.model, state.q, state.qd, state.obj)
        force += J[:, :n].T @ case.lam.ravel()
    assert_close(H @ case.zdd[:n] + C, force)


def test_energy_and_momentum_are_the_lagrangian_ones(case: Case) -> None:
    """Robot by the oracle, object by hand."""
    energy, momentum = case.oracle.energy(case.z, case.zd), case.oracle.momentum(case.z, case.zd)
    body = case.simulator.params.object
    if body is not None:
        (x, y, _), (xd, yd, spin) = case.state.obj, case.state.objd
        energy += body.mass * (xd**2 + yd**2) / 2 + body.inertia * spin**2 / 2
        momentum += [body.mass * xd, body.mass * yd, body.mass * (x * yd - y * xd) + body.inertia * spin]
    assert case.simulator.energy(case.state) == pytest.approx(energy, rel=1e-12)
    assert_close(case.simulator.momentum(case.state), momentum, 1e-12)


@pytest.mark.parametrize("name", ["case study", "three arms hold"])
def test_surroundings_push_on_the_object(name: str) -> None:
    """The kernel's last three forces act on the object, in inertial axes."""
    case = make_case(name, 2)
    model, state = case.simulator.model, case.state
    wrench = np.array([3.0, -5.0, 0.7])
    p = np.concatenate([state.q, modal(model, state.qf), state.obj])
    v = np.concatenate([state.qd, modal(model, state.qfd), state.objd])
    tau, out = np.zeros_like(p), np.empty_like(p)
    tau[object_slice(model)] = wrench
    accelerations(model, p, v, tau, new_workspace(work_shapes(model)), out, False, True)
    zdd, objdd, _ = case.oracle.constrained(case.z, case.zd, state.obj, state.objd, 0 * case.Q, Q_obj=wrench)
    assert_close(out[: joint_slice(model).stop], zdd[: case.oracle.n_rigid])
    assert_close(out[object_slice(model)], objdd)


def test_errors_of_the_grasps_decay() -> None:
    """With Baumgarte's rate kappa the gaps obey d2 + 2 kappa d1 + kappa^2 d = 0, gaps and rates by the oracle."""
    kappa = 7.0
    case = make_case("three arms hold", 3)
    simulator = Simulator(case.simulator.params.with_overrides(f"simulation.baumgarte={kappa}"))
    state, oracle = case.state, case.oracle
    qdd, qfdd, objdd = simulator.acceleration(state, **case.command)
    zdd = np.concatenate([qdd, qfdd.ravel()])
    h = 1e-4

    def gaps(t: float) -> Array:
        z = case.z + t * case.zd + t**2 / 2 * zdd
        return oracle.grasp_gaps(z, state.obj + t * state.objd + t**2 / 2 * objdd)

    before, now, after = (gaps(t) for t in (-h, 0.0, h))
    expected = -2 * kappa * (after - before) / (2 * h) - kappa**2 * now
    # Three-point differences of gaps of metres: 1e-16 / h^2 = 1e-8, and h^2 of the fourth derivative.
    np.testing.assert_allclose((before - 2 * now + after) / h**2, expected, rtol=1e-5, atol=1e-4)
    assert np.abs(expected).min() > 1.0


@pytest.mark.parametrize("name", ["case study, free", "one arm holds"])
def test_kept_modes_obey_the_lagrangian_restricted_to_them(name: str) -> None:
    """With modes cut the motion is that of the oracle's equations with q_f confined to the kept modes (Galerkin)."""
    cut = 9.0  # rad/s, above the first bending mode alone
    params = load_params().with_overrides(
        *ROBOTS[name], ALONE, "panel.axial_cut=1", f"panel.bending_cut={cut}", "panel.elements=3"
    )
    panel, oracle = params.panel, Oracle(params.to_dict())
    modes = clamped_modes(beam(panel.mass, panel.length, panel.EI, panel.E * panel.area, panel.elements), 1.0, cut)
    assert 0 < len(modes.omega) < 3
    assert modes.n_axial == 0
    state, n, rng = random_state(params, 4), oracle.n_rigid, np.random.default_rng(4)
    qf, qfd = (rng.uniform(-1, 1, (params.n_panels, len(modes.omega))) @ modes.shapes.T for _ in range(2))
    state = State(0.0, state.q, state.qd, qf, qfd, None, None)
    z, zd = np.concatenate([state.q, qf.ravel()]), np.concatenate([state.qd, qfd.ravel()])
    kept = scipy.linalg.block_diag(np.eye(n), *[modes.shapes] * params.n_panels)
    M, h = kept.T @ oracle.mass_matrix(z) @ kept, kept.T @ oracle.bias(z, zd)
    zdd = kept @ np.linalg.solve(M, -h)
    qdd, qfdd, _ = Simulator(params).acceleration(state)
    assert_close(qdd, zdd[:n], 1e-9)
    assert_close(qfdd.ravel(), zdd[n:], 1e-9)


@pytest.mark.parametrize("name", [name for name in ROBOTS if "free" in name])
def test_robot_with_rigid_panels(name: str) -> None:
    """With every mode cut off, a panel is a rigid body: the oracle's equations with q_f held at zero."""
    params = load_params().with_overrides(*ROBOTS[name], "panel.axial_cut=1.0e-6", "panel.bending_cut=1.0e-6")
    oracle, state = Oracle(params.to_dict()), random_state(params, 5)
    state = State(0.0, state.q, state.qd, 0 * state.qf, 0 * state.qfd, None, None)
    z, zd, n = np.concatenate([state.q, state.qf.ravel()]), np.zeros(oracle.N), oracle.n_rigid
    zd[:n] = state.qd
    joints = np.random.default_rng(5).uniform(-5, 5, n - 3)
    force = np.concatenate([np.zeros(3), joints]) - oracle.bias(z, zd)[:n]
    qdd, qfdd, _ = Simulator(params).acceleration(state, joints=joints)
    assert_close(qdd, np.linalg.solve(oracle.mass_matrix(z)[:n, :n], force))
    assert not qfdd.any()


def test_massless_panels_leave_the_robot_alone() -> None:
    """Panels of a billionth of their mass, undeformed: the robot without any, to that order."""
    params = load_params().with_overrides(*ROBOTS["three panels, free"])
    state = random_state(params, 6)
    light = Simulator(params.with_overrides("panel.mass=9.0e-9", *NO_CUT))
    flat = State(0.0, state.q, state.qd, 0 * state.qf, 0 * state.qfd, None, None)
    without = Simulator(params.with_overrides("panel.mounts=[]"))
    bare = State(0.0, state.q, state.qd, np.zeros((0, 3)), np.zeros((0, 3)), None, None)
    base = [20.0, -30.0, 10.0]
    expected = without.acceleration(bare, base=base)[0]
    np.testing.assert_allclose(light.acceleration(flat, base=base)[0], expected, rtol=1e-8)
    heavy = Simulator(params).acceleration(flat, base=base)[0]
    assert np.abs(heavy - expected).max() > 0.05 * np.abs(expected).max()


@pytest.mark.parametrize(("elements", "expected"), FREQUENCIES)
def test_frequencies_of_the_free_robot(elements: int, expected: list[float]) -> None:
    """At the q(0) of Table IV; as many as there are elastic coordinates, rigid motion left out."""
    simulator = Simulator(load_params().with_overrides(ALONE, f"panel.elements={elements}"))
    omega = simulator.frequencies(simulator.initial_state())
    assert len(omega) == simulator.model.omega2.size
    np.testing.assert_allclose(omega[: len(expected)], expected, rtol=1e-5)


def test_frequencies_with_the_object() -> None:
    """The pins restrict the motion: the same as the oracle's mass and stiffness on the null space of its Jacobian."""
    simulator = Simulator()
    state, oracle = simulator.initial_state(), Oracle(simulator.params.to_dict())
    body = simulator.params.object
    z = np.concatenate([state.q, state.qf.ravel()])
    rows = np.zeros((4, oracle.N + 3))
    for g, (arm, grasp) in enumerate(zip((0, 1), body.grasps, strict=True)):
        x, y = rotation(state.obj[2]) @ grasp.point
        rows[2 * g : 2 * g + 2] = np.hstack([oracle.tip_jacobian(z, arm), [[-1, 0, y], [0, -1, -x]]])
    allowed = scipy.linalg.null_space(rows)
    M = scipy.linalg.block_diag(oracle.mass_matrix(z), np.diag([body.mass, body.mass, body.inertia]))
    K = scipy.linalg.block_diag(oracle.K, np.zeros((3, 3)))
    squares = scipy.linalg.eigh(allowed.T @ K @ allowed, allowed.T @ M @ allowed, eigvals_only=True)
    omega = simulator.frequencies(state)
    np.testing.assert_allclose(omega, np.sqrt(squares[-6:]), rtol=1e-7)  # the softest of 1e7 rad2/s2, by eigh
    free = Simulator(load_params().with_overrides(ALONE))
    assert np.abs(omega / free.frequencies(free.initial_state()) - 1).max() > 1e-3


def test_one_compilation_serves_every_robot() -> None:
    """The arrays of all robots are of the same form, which is the one that is compiled."""
    robots = ROBOTS | {
        "bending alone": ["panel.axial_cut=1"],
        "rigid panels": ["panel.axial_cut=1.0e-6", "panel.bending_cut=1.0e-6"],
    }
    forms = {}
    for name, robot in robots.items():
        params = load_params().with_overrides(*robot)
        forms[name] = Block((pack(params), pack_actuators(params, pack(params)))).form
    assert {name for name, form in forms.items() if form != forms["case study"]} == set()
