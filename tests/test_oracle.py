"""The Lagrangian oracle checks itself: M and h against its energies, and the conservation laws."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import scipy.linalg
from case_study import CONFIG, FREQUENCIES, VARIANTS, make_config, random_state
from numpy.typing import NDArray
from oracle import Oracle

Array = NDArray[np.float64]

SEEDS = [0, 1, 2]


def rate(function: Callable[[float], Any], step: float = 1.0e-4) -> Any:
    """Differentiate at 0 by the five-point rule, exact for polynomials of degree 4."""
    outer, inner = function(2 * step) - function(-2 * step), function(step) - function(-step)
    return (8 * inner - outer) / (12 * step)


def second_rate(function: Callable[[float], Any], step: float = 2.0e-3) -> Any:
    """Differentiate twice at 0 by the five-point rule."""
    outer, inner = function(2 * step) + function(-2 * step), function(step) + function(-step)
    return (16 * inner - outer - 30 * function(0.0)) / (12 * step**2)


def path(z: Array, zd: Array, zdd: Array) -> Callable[[float], tuple[Array, Array]]:
    """Return t -> z, zd of the motion of constant acceleration."""
    return lambda t: (z + zd * t + zdd * t**2 / 2, zd + zdd * t)


def held_pose(oracle: Oracle, z: Array) -> Array:
    """Return the pose of the case study's object between the tips of arms 1 and 2; its grasps are on its y axis."""
    upper, lower = oracle.tip(z, 0), oracle.tip(z, 1)
    along = upper - lower
    return np.array([*(upper + lower) / 2, np.arctan2(-along[0], along[1])])


def held_points(obj: Array) -> Array:
    """Return the grasp points relative to the object's centre, in inertial axes, (2, 2)."""
    c, s = np.cos(obj[2]), np.sin(obj[2])
    return np.array([grasp["point"] for grasp in CONFIG["object"]["grasps"]]) @ np.array([[c, s], [-s, c]])


@pytest.fixture(params=VARIANTS)
def oracle(request: pytest.FixtureRequest) -> Oracle:
    """Return the oracle of each variant."""
    return Oracle(make_config(request.param))


@pytest.mark.parametrize("seed", SEEDS)
def test_mass_matrix_is_symmetric_and_positive_definite(oracle: Oracle, seed: int) -> None:
    """M = M^T > 0 at random states."""
    M = oracle.mass_matrix(random_state(oracle, seed)[0])
    np.testing.assert_allclose(M, M.T, rtol=0, atol=1e-13 * np.abs(M).max())
    assert np.linalg.eigvalsh(M).min() > 0


@pytest.mark.parametrize("seed", SEEDS)
def test_equations_follow_from_the_energy(oracle: Oracle, seed: int) -> None:
    """M zdd + h = d/dt (dT/dzd) - d(T - V)/dz, every derivative a difference of the energy."""
    z, zd, zdd = random_state(oracle, seed)
    zdd[oracle.n_rigid :: 3] *= 1.0e-3
    identity = np.eye(oracle.N)

    def momenta(z: Array, zd: Array) -> Array:
        return np.array([rate(lambda s, e=e: oracle.energy(z, zd + s * e), 1.0) for e in identity])

    def lagrangian(z: Array, zd: Array) -> float:
        return oracle.energy(z, zd) - 2 * oracle.energy(z, 0 * zd)  # (T + V) - 2 V

    M, motion = oracle.mass_matrix(z), path(z, zd, zdd)
    np.testing.assert_allclose(momenta(z, zd), M @ zd, rtol=1e-10, atol=1e-11)
    steps = np.full(oracle.N, 1.0e-3)
    steps[oracle.n_rigid :: 3] = (
        1.0e-6  # V is quadratic in the axial strain: any step is exact, a small one rounds less
    )
    dL_dz = [rate(lambda s, e=e: lagrangian(z + s * e, zd), h) for e, h in zip(identity, steps, strict=True)]
    expected = rate(lambda t: momenta(*motion(t))) - np.array(dL_dz)
    # The axial rows are differences of energies of a spring of 1e8 N/m, hence their rounding.
    np.testing.assert_allclose(M @ zdd + oracle.bias(z, zd, damping=False), expected, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("damping", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_energy_rate_is_the_power(oracle: Oracle, seed: int, damping: bool) -> None:
    """dE/dt = zd^T Q, less zd^T D zd with damping."""
    z, zd, Q = random_state(oracle, seed)
    motion = path(z, zd, oracle.acceleration(z, zd, Q, damping))
    power = zd @ Q - damping * oracle.eta * zd @ oracle.K @ zd
    scale = np.abs(zd) @ np.abs(Q)
    assert rate(lambda t: oracle.energy(*motion(t))) == pytest.approx(power, rel=0, abs=1e-9 * scale)


def test_damping_takes_energy_out(oracle: Oracle) -> None:
    """The part of h that damping adds loses zd^T D zd > 0."""
    z, zd, _ = random_state(oracle, 0)
    lost = zd @ (oracle.bias(z, zd) - oracle.bias(z, zd, damping=False))
    assert lost == pytest.approx(oracle.eta * zd @ oracle.K @ zd, rel=1e-9)
    assert lost > 1.0e-6


@pytest.mark.parametrize("seed", SEEDS)
def test_momentum_changes_by_the_force_on_the_base_alone(oracle: Oracle, seed: int) -> None:
    """d/dt (px, py, Lz) is zero when free, whatever the damping, and the wrench on the base otherwise."""
    z, zd, Q = random_state(oracle, seed)
    motion = path(z, zd, oracle.acceleration(z, zd, 0 * Q))
    scale = np.abs(oracle.momentum(z, zd)).max()
    np.testing.assert_allclose(rate(lambda t: oracle.momentum(*motion(t))), 0.0, atol=1e-9 * scale)
    # Forces on the joints and on the panels are internal; the base's act at (x, y).
    motion = path(z, zd, oracle.acceleration(z, zd, Q))
    expected = [Q[0], Q[1], z[0] * Q[1] - z[1] * Q[0] + Q[2]]
    np.testing.assert_allclose(rate(lambda t: oracle.momentum(*motion(t))), expected, atol=1e-9 * scale)


@pytest.mark.parametrize("seed", SEEDS)
def test_momentum_is_that_of_noether(oracle: Oracle, seed: int) -> None:
    """The sums of m v and r x m v equal the momenta of translation and rotation, (M zd) along those motions."""
    z, zd, _ = random_state(oracle, seed)
    p = oracle.mass_matrix(z) @ zd
    np.testing.assert_allclose(oracle.momentum(z, zd), [p[0], p[1], z[0] * p[1] - z[1] * p[0] + p[2]], rtol=1e-11)


@pytest.mark.parametrize(("elements", "expected"), FREQUENCIES)
def test_frequencies_of_the_free_robot(elements: int, expected: list[float]) -> None:
    """Angular frequencies at the q(0) of Table IV, undamped and without the object."""
    config = make_config()
    config["panel"]["elements"] = elements
    oracle = Oracle(config)
    z = np.zeros(oracle.N)
    z[: oracle.n_rigid] = config["initial"]["q"]
    squares = scipy.linalg.eigh(oracle.K, oracle.mass_matrix(z), eigvals_only=True)
    np.testing.assert_allclose(squares[: oracle.n_rigid], 0.0, atol=1e-6)
    elastic = np.sqrt(squares[oracle.n_rigid :])
    np.testing.assert_allclose(elastic[: len(expected)], expected, rtol=1e-5)  # the digits given


def test_elements_are_nested() -> None:
    """Two elements that are given the cubic of one have its mass matrix, stiffness and energy."""
    config = make_config()
    one = Oracle(config)
    config["panel"]["elements"] = 2
    two = Oracle(config)
    L = config["panel"]["length"]
    # Middle u, w, slope, then those of the tip, from q4, q5, q6 by Eq. 44 at xi = 1/2.
    middle = [[0.5, 0, 0], [0, 0.5, -L / 8], [0, 1.5 / L, -0.25]]
    P = scipy.linalg.block_diag(np.eye(one.n_rigid), *[np.vstack([middle, np.eye(3)])] * one.n_panels)
    z, zd, _ = random_state(one, 0)
    np.testing.assert_allclose(P.T @ two.mass_matrix(P @ z) @ P, one.mass_matrix(z), rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(P.T @ two.K @ P, one.K, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(P.T @ two.bias(P @ z, P @ zd), one.bias(z, zd), rtol=1e-11, atol=1e-11)
    assert two.energy(P @ z, P @ zd) == pytest.approx(one.energy(z, zd), rel=1e-12)
    np.testing.assert_allclose(two.momentum(P @ z, P @ zd), one.momentum(z, zd), rtol=1e-12)


def test_tips_reach_the_grasp_points_at_the_start_of_table_iv() -> None:
    """At q(0) the tips are where trigonometry puts them and as far apart as the grasp points are."""
    oracle = Oracle(CONFIG)
    z = np.zeros(oracle.N)
    z[: oracle.n_rigid] = CONFIG["initial"]["q"]
    elbows = [[0.5 + np.cos(0.6), 0.5 + np.sin(0.6)], [0.5 + np.cos(5.6), -0.5 + np.sin(5.6)]]
    for arm, angle in enumerate((4.8, 7.7)):
        np.testing.assert_allclose(oracle.tip(z, arm), elbows[arm] + np.array([np.cos(angle), np.sin(angle)]))
    np.testing.assert_allclose(oracle.grasp_gaps(z, held_pose(oracle, z)), 0.0, atol=1e-14)


@pytest.mark.parametrize("variant", VARIANTS)
def test_bodies_are_where_the_configuration_puts_them(variant: str) -> None:
    """The rows of x, y and beta in M hold the mass, the first moments and the inertia of the undeformed robot."""
    config = make_config(variant)
    oracle = Oracle(config)
    z = np.zeros(oracle.N)
    z[: oracle.n_rigid] = np.random.default_rng(0).uniform(-1.0, 1.0, oracle.n_rigid)
    points = [(config["base"]["mass"], config["base"]["inertia"], 0.0j)]  # position from the base: x + i y
    joint = 3
    for index, arm in enumerate(config["arms"]):
        end, angle = np.exp(1j * z[2]) * complex(*arm["mount"]), z[2] + arm["mount_angle"]
        for link in arm["links"]:
            angle += z[joint]
            joint += 1
            points.append((link["mass"], link["inertia"], end + link["com"] * np.exp(1j * angle)))
            end += link["length"] * np.exp(1j * angle)
        np.testing.assert_allclose(oracle.tip(z, index), z[:2] + np.array([end.real, end.imag]), rtol=1e-13)
    panel = config["panel"]
    mass, length = panel["mass"], panel["length"]
    for mount in panel["mounts"]:
        centre = complex(*mount["root"]) + length / 2 * np.exp(1j * mount["angle"])
        points.append((mass, mass * length**2 / 12, np.exp(1j * z[2]) * centre))
    total, first = sum(m for m, _, _ in points), sum(m * r for m, _, r in points)
    second = sum(inertia + m * abs(r) ** 2 for m, inertia, r in points)
    expected = [[total, 0, -first.imag], [0, total, first.real], [-first.imag, first.real, second]]
    np.testing.assert_allclose(oracle.mass_matrix(z)[:3, :3], expected, rtol=1e-12, atol=1e-12)


def test_tip_jacobian_is_the_rate_of_the_tip(oracle: Oracle) -> None:
    """J zd and J zdd + Jd zd are the first two derivatives of the tip along a motion."""
    z, zd, zdd = random_state(oracle, 0)
    motion = path(z, zd, zdd)
    for arm in range(oracle.n_arms):
        J = oracle.tip_jacobian(z, arm)
        np.testing.assert_allclose(J @ zd, rate(lambda t, arm=arm: oracle.tip(motion(t)[0], arm)), atol=1e-10)
        acceleration = second_rate(lambda t, arm=arm: oracle.tip(motion(t)[0], arm))
        np.testing.assert_allclose(J @ zdd + oracle.tip_jacobian_dot_zd(z, zd, arm), acceleration, atol=1e-8)


@pytest.mark.parametrize("seed", SEEDS)
def test_panel_force_drives_the_robot_without_panels(oracle: Oracle, seed: int) -> None:
    """H qdd + C = Q + Q_flex (Eq. 3), with H and C of a robot that was built without panels."""
    z, zd, Q = random_state(oracle, seed)
    zdd = oracle.acceleration(z, zd, Q)
    variant = VARIANTS[2] if oracle.n_panels == 1 else VARIANTS[0]
    rigid = Oracle(make_config(variant) | {"panel": None})
    n = rigid.N
    assert n == oracle.n_rigid
    left = rigid.mass_matrix(z[:n]) @ zdd[:n] + rigid.bias(z[:n], zd[:n])
    np.testing.assert_allclose(left, Q[:n] + oracle.q_flex(z, zd, zdd), rtol=1e-10, atol=1e-10)


class TestObject:
    """The two arms and the object they hold."""

    @pytest.fixture(params=SEEDS)
    def state(self, request: pytest.FixtureRequest) -> dict[str, Any]:
        """Return a moving state in which both grasps are closed, and its accelerations."""
        oracle = Oracle(make_config(VARIANTS[request.param % 2]))
        z, zd, Q = random_state(oracle, request.param, with_object=True)
        obj, objd = held_pose(oracle, z), np.array([0.4, -0.3, 0.5])
        assert [len(arm["links"]) for arm in CONFIG["arms"][:2]] == [2, 2]
        for arm, (x, y) in enumerate(held_points(obj)):
            velocity = objd[:2] + objd[2] * np.array([-y, x])
            joints = slice(3 + 2 * arm, 5 + 2 * arm)
            J = oracle.tip_jacobian(z, arm)
            zd[joints] = 0.0
            zd[joints] = np.linalg.solve(J[:, joints], velocity - J @ zd)
        zdd, objdd, lam = oracle.constrained(z, zd, obj, objd, Q, damping=False)
        return {"oracle": oracle, "z": z, "zd": zd, "Q": Q, "obj": obj, "objd": objd} | {
            "zdd": zdd,
            "objdd": objdd,
            "lam": lam,
            "motion": path(z, zd, zdd),
            "object_motion": path(obj, objd, objdd),
        }

    def test_gaps_stay_closed(self, state: dict[str, Any]) -> None:
        """The gaps and their first two rates are zero."""

        def gaps(t: float) -> Array:
            return state["oracle"].grasp_gaps(state["motion"](t)[0], state["object_motion"](t)[0])

        np.testing.assert_allclose(gaps(0.0), 0.0, atol=1e-13)
        np.testing.assert_allclose(rate(gaps), 0.0, atol=1e-10)
        np.testing.assert_allclose(second_rate(gaps), 0.0, atol=1e-8)

    def test_object_feels_the_opposite_of_lam(self, state: dict[str, Any]) -> None:
        """Newton and Euler for the object with -lam at its grasps; +lam at the tips of the free robot."""
        mass, inertia = CONFIG["object"]["mass"], CONFIG["object"]["inertia"]
        lam, points = state["lam"], held_points(state["obj"])
        torque = -np.sum(points[:, 0] * lam[:, 1] - points[:, 1] * lam[:, 0])
        np.testing.assert_allclose(mass * state["objdd"][:2], -lam.sum(axis=0), rtol=1e-10, atol=1e-12)
        assert inertia * state["objdd"][2] == pytest.approx(torque, rel=1e-10)
        # The robot alone moves in the same way when lam is applied to its tips.
        oracle, Q = state["oracle"], state["Q"].copy()
        for arm in range(2):
            Q += oracle.tip_jacobian(state["z"], arm).T @ lam[arm]
        free = oracle.acceleration(state["z"], state["zd"], Q, damping=False)
        np.testing.assert_allclose(free, state["zdd"], rtol=1e-9, atol=1e-9)

    def test_grasp_forces_are_internal(self, state: dict[str, Any]) -> None:
        """Energy and momentum of robot and object together change by Q alone."""
        mass, inertia = CONFIG["object"]["mass"], CONFIG["object"]["inertia"]

        def energy(t: float) -> float:
            v = state["object_motion"](t)[1]
            return (
                state["oracle"].energy(*state["motion"](t)) + (mass * (v[0] ** 2 + v[1] ** 2) + inertia * v[2] ** 2) / 2
            )

        def momentum(t: float) -> Array:
            r, v = state["object_motion"](t)
            spin = mass * (r[0] * v[1] - r[1] * v[0]) + inertia * v[2]
            return state["oracle"].momentum(*state["motion"](t)) + np.array([mass * v[0], mass * v[1], spin])

        z, zd, Q = state["z"], state["zd"], state["Q"]
        assert rate(energy) == pytest.approx(zd @ Q, rel=0, abs=1e-9 * np.abs(zd) @ np.abs(Q))
        expected = [Q[0], Q[1], z[0] * Q[1] - z[1] * Q[0] + Q[2]]
        np.testing.assert_allclose(rate(momentum), expected, atol=1e-7)

    def test_no_object_raises(self) -> None:
        """Without an object nothing can be held."""
        oracle = Oracle(CONFIG | {"object": None})
        z = np.zeros(oracle.N)
        with pytest.raises(ValueError, match="no object"):
            oracle.constrained(z, z, np.zeros(3), np.zeros(3), z)
