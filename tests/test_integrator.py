"""Steps of the plant: conservation, order, agreement of the methods, exact oscillators and what a step is."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from sffr_gym import Params, Simulator, State, load_params
from sffr_gym.compile.library import load_library
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.physics.etdrk4 import _quadratic_forcing, etdrk4_shapes
from sffr_gym.physics.integrator import INTEGRATORS, advance, step_shapes
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import joint_slice, modal, mode_slice
from sffr_gym.physics.stiff_modes import _jacobi, _transition

Array = NDArray[np.float64]

ALONE, UNDAMPED = "object=null", "panel.strain_rate_damping=0"
OPPOSITE = [{"name": str(k), "root": [0, 0.5 * k], "angle": k * np.pi / 2} for k in (1, -1)]  # panels along +y, -y
SOFT = ("panel.E=1.0e+6", "simulation.max_step=0.1")  # axial modes at 13 rad/s; the caller's dt sets the step

STARTS: dict[str, dict[str, Any]] = {
    "Table IV": {},
    "turning": {"qd": [0.85, 0, 0.1, -0.2, -0.1, 0.05, 0.1, 0.2, 0.25]},
    "swinging": {"qd": [0.85, 0, 0.1, -0.2, -0.1, 0.05, 0.1, 0.2, 0.25], "qfd": [[0, -0.1, 0.05], [0, 0.15, -0.08]]},
}
STARTS["ringing"] = STARTS["swinging"] | {"qf": [[1e-7, 0, 0], [-6e-8, 0, 0]]}  # axial modes, 2.4 and 1.4 N


def case_study(*overrides: str) -> Params:
    """Return the shipped parameters with changes."""
    return load_params().with_overrides(*overrides)


def started(simulator: Simulator, name: str) -> State:
    """Return the initial state with the changes of `STARTS`."""
    return replace(simulator.initial_state(), **{key: np.array(value, float) for key, value in STARTS[name].items()})


def vector(state: State) -> Array:
    """Return all the numbers of a state in one vector."""
    parts = (state.q, state.qd, state.qf, state.qfd, state.obj, state.objd)
    return np.concatenate([part.ravel() for part in parts if part is not None])


def random_command(rng: np.random.Generator) -> dict[str, Array]:
    """Return moderate forces on every actuator."""
    scale = {"base": (5.0, 3), "joints": (1.0, 6), "piezo_tau": (0.3, (2, 3))}
    return {name: rng.uniform(-size, size, shape) for name, (size, shape) in scale.items()}


@pytest.mark.parametrize(
    ("name", "max_step"),
    [
        ("Table IV", 2e-3),
        ("turning", 2e-3),
        ("swinging", 2e-3),
        ("ringing", 2e-3),
        ("swinging", 1e-3),
        ("ringing", 1e-3),
    ],
)
def test_free_motion_conserves_energy_and_momentum(name: str, max_step: float) -> None:
    """Undamped, no object, the default integrator: 1e-8 of each over 10 s."""
    simulator = Simulator(case_study(ALONE, UNDAMPED, f"simulation.max_step={max_step}"))
    state = started(simulator, name)
    energy, momentum = simulator.energy(state), simulator.momentum(state)
    linear = np.hypot(*momentum[:2])
    # Lz passes through zero as the robot moves past the origin; p times a metre is its scale then.
    scale = np.array([energy, linear, linear, max(linear * 1.0, abs(momentum[2]))])
    worst = np.zeros(4)
    for _ in range(500):
        state = simulator.step(state, dt=0.02)
        drift = np.append(simulator.energy(state) - energy, simulator.momentum(state) - momentum)
        worst = np.maximum(worst, np.abs(drift) / scale)
    assert state.t == pytest.approx(10.0)
    assert np.abs(state.qf[:, 1]).max() > 1e-3  # it did swing
    np.testing.assert_array_less(worst, 1e-8)


@pytest.mark.parametrize("max_step", [2e-3, 1e-2, 5e-2])
def test_axial_vibration_stays_bounded_at_any_step(max_step: float) -> None:
    """An undamped axial mode of 2.4 N turns up to 160 rad in a step; its energy neither grows nor fades by 1e-4."""
    simulator = Simulator(case_study(ALONE, UNDAMPED, f"simulation.max_step={max_step}"))
    state = replace(simulator.initial_state(), qfd=np.zeros((2, 3)), qd=np.zeros(9), qf=STARTS["ringing"]["qf"])
    state = replace(state, qf=np.array(state.qf))
    energy = simulator.energy(state)
    assert energy == pytest.approx(0.5 * 9.6e7 / 4 * (1e-14 + 3.6e-15))
    for _ in range(100):
        state = simulator.step(state, dt=0.1)
        assert simulator.energy(state) == pytest.approx(energy, rel=1e-4)


@pytest.mark.parametrize("overrides", [(ALONE,), ()], ids=["free", "with object"])
@pytest.mark.parametrize(("integrator", "max_step"), [("rk4", 0.1), ("etdrk4", 0.1), ("etdrk4", 0.01)])
def test_order_is_four(overrides: tuple[str, ...], integrator: str, max_step: float) -> None:
    """Fitted slope of the state's error on a softened panel, all its axial modes frozen (0.1 s) or none (0.01 s)."""
    simulator = Simulator(case_study(*overrides, *SOFT), integrator=integrator, max_step=max_step)
    start = simulator.initial_state()
    start = replace(start, qfd=np.array([[0.02, 0.05, 0.1], [-0.01, 0.15, -0.08]]))
    if overrides:
        start = replace(start, qd=np.array([0.85, 0, 0.3, *np.linspace(-0.5, 0.6, 6)]))
    command = random_command(np.random.default_rng(0))
    counts = np.array([100, 200, 400])
    fastest = simulator.frequencies(start).max()
    assert 0.02 < fastest / counts.max() < fastest / counts.min() < 0.15
    assert (len(simulator.model.stiff.omega) > 0) == (max_step == 0.1)

    def end(count: int) -> Array:
        state = start
        for _ in range(count):
            state = simulator.step(state, **command, dt=1.0 / count)
        return vector(state)

    exact = end(3200)
    errors = [np.abs(end(int(count)) - exact).max() for count in counts]
    assert np.polyfit(np.log(counts), np.log(errors), 1)[0] == pytest.approx(-4.0, abs=0.2)


@pytest.mark.parametrize("changes", [(), (ALONE,)], ids=["case study", "free"])
@pytest.mark.parametrize("integrator", INTEGRATORS)
def test_one_step_follows_the_equations_of_motion(integrator: str, changes: tuple[str, ...]) -> None:
    """A step under forces on all actuators against SciPy's high-order method, on panels that it can follow."""
    simulator = Simulator(case_study(*changes, *SOFT, "panel.strain_rate_damping=0.02"), integrator=integrator)
    start = simulator.initial_state()
    rng = np.random.default_rng(5)
    if simulator.model.object_mass == 0:
        start = replace(start, qd=np.array([0.85, 0, 0.3, *np.linspace(-0.5, 0.6, 6)]))
    start = replace(start, qf=rng.uniform(-0.01, 0.01, start.qf.shape), qfd=rng.uniform(-0.1, 0.1, start.qfd.shape))
    command, n = random_command(rng), len(vector(start)) // 2
    shapes = [part.shape for part in (start.q, start.qf, start.obj) if part is not None]
    cuts = np.cumsum([np.prod(shape, dtype=int) for shape in shapes])

    def state(values: Array) -> State:
        halves = []
        for half in (values[:n], values[n:]):
            parts = [part.reshape(shape) for part, shape in zip(np.split(half, cuts[:-1]), shapes, strict=True)]
            halves.append([*parts, None][:3])
        (q, qf, obj), (qd, qfd, objd) = halves
        return State(0.0, q, qd, qf, qfd, obj, objd)

    def flat(*parts: Array | None) -> Array:
        return np.concatenate([part.ravel() for part in parts if part is not None])

    def rates(t: float, values: Array) -> Array:
        return np.concatenate([values[n:], flat(*simulator.acceleration(state(values), **command))])

    h = 0.02
    begin = np.concatenate([flat(start.q, start.qf, start.obj), flat(start.qd, start.qfd, start.objd)])
    exact = solve_ivp(rates, (0.0, h), begin, "DOP853", rtol=1e-11, atol=1e-13).y[:, -1]
    end = simulator.step(start, **command, dt=h)
    found = np.concatenate([flat(end.q, end.qf, end.obj), flat(end.qd, end.qfd, end.objd)])
    np.testing.assert_allclose(found, exact, rtol=0, atol=1e-6)
    assert len(simulator.model.stiff) > 0


def test_coupled_modes_are_turned_into_exact_oscillators() -> None:
    """Jacobi's rotations against LAPACK: the same eigenvalues, and vectors that bring the matrix into that form."""
    A = np.random.default_rng(4).normal(size=(5, 5))
    A, V = A @ A.T + np.diag([1.0, 5.0, 2.0, 9.0, 3.0]), np.zeros((5, 5))
    turned = A.copy()
    _jacobi(turned, V, 5, 1.0e-13)
    np.testing.assert_allclose(np.sort(np.diag(turned)), np.linalg.eigvalsh(A), rtol=1e-12)
    np.testing.assert_allclose(V.T @ A @ V, np.diag(np.diag(turned)), rtol=0, atol=1e-11)


def test_slow_accelerations_that_are_quadratic_in_time_are_integrated_exactly() -> None:
    """The last stage of a step against polynomials and, for the oscillators, SciPy."""
    model, rng, h = Simulator(case_study()).model, np.random.default_rng(6), 0.3
    step: Any = new_workspace(etdrk4_shapes(model))
    n, n_s = model.at.end, len(model.stiff.omega)
    times = np.array([0.0, h / 2, h / 2, h])[:, None]
    slow = [rng.normal(size=(3, size)) for size in (n, n_s)]  # constant, linear, quadratic coefficients
    step.a[:], step.g[:, :n_s] = (c[0] + c[1] * times + c[2] * times**2 for c in slow)
    step.z[0], step.zd[0], step.stiff.R[:] = (
        rng.normal(size=np.shape(x)) for x in (step.z[0], step.zd[0], step.stiff.R)
    )
    p, v = rng.normal(size=(2, n))
    powers = np.array([[h**2 / 2, h**3 / 6, h**4 / 12], [h, h**2 / 2, h**3 / 3]])
    expected = np.array([p + h * v, v]) + powers @ slow[0]
    for j in range(n_s):
        mu2, damping, z, zd, c = 3.0 + j, 0.7, step.z[0, j], step.zd[0, j], slow[1][:, j]
        _transition(mu2, damping, h / 2, step.stiff.oscillators, j)

        def rates(t: float, x: Array, mu2: float = mu2, damping: float = damping, c: Array = c) -> Array:
            return np.array([x[1], c[0] + c[1] * t + c[2] * t**2 - damping * x[1] - mu2 * x[0]])

        moved = solve_ivp(rates, (0.0, h), [z, zd], "DOP853", rtol=1e-13, atol=1e-13).y[:, -1]
        expected += np.outer(moved - [z + h * zd, zd] - powers @ c, step.stiff.R[j])
    _quadratic_forcing(model, p, v, h, step)
    assert n_s > 0
    np.testing.assert_allclose([p, v], expected, rtol=0, atol=1e-12)


@pytest.mark.skipif(load_library() is None, reason="a million evaluations, too many for the interpreter")
@pytest.mark.parametrize("overrides", [(), (ALONE,), ("panel.elements=2",)], ids=["case study", "free", "two elements"])
def test_default_steps_equal_tiny_classical_ones(overrides: tuple[str, ...]) -> None:
    """The real robot for 2 s of random held forces: 2 ms against Runge-Kutta at 0.01 ms, at a tenth of its limit."""
    params = case_study(*overrides)
    default, tiny = Simulator(params), Simulator(params, integrator="rk4", max_step=1e-5)
    coarse, fine, rng = default.initial_state(), tiny.initial_state(), np.random.default_rng(1)
    start = vector(coarse)
    for _ in range(1000):
        command = random_command(rng)
        coarse, fine = default.step(coarse, **command), tiny.step(fine, **command)
    assert np.abs(vector(fine) - start).max() > 0.4
    # 5e-8 seen, after a thousand jumps of the forces.
    for name in ("q", "qd", "qf"):
        np.testing.assert_allclose(getattr(coarse, name), getattr(fine, name), rtol=0, atol=1e-7, err_msg=name)


@pytest.mark.parametrize("antisymmetric", [False, True])
@pytest.mark.parametrize("damping", [0.0, 3.5e-5, 2.0e-3], ids=["undamped", "as configured", "overdamped"])
@pytest.mark.parametrize(("duration", "begun"), [(2e-3, 0.0), (0.03, 0.0), (2e-3, 0.7)])
def test_axial_modes_are_exact_oscillators(antisymmetric: bool, damping: float, duration: float, begun: float) -> None:
    """Two panels along +y and -y of a bare base: closed-form frequency with and without the base's motion."""
    params = case_study(
        ALONE,
        "arms=[]",
        "initial.q=[0,0,0]",
        "initial.qd=[0,0,0]",
        f"panel.mounts={OPPOSITE}",
        f"panel.strain_rate_damping={damping}",
    )
    simulator = Simulator(params)
    base, m, stiffness = params.base.mass, params.panel.mass, params.panel.E * params.panel.area / params.panel.length
    omega2 = stiffness / (m / 3 - antisymmetric * m**2 / 2 / (base + 2 * m))
    sign, amplitude = np.array([1.0, -1.0 if antisymmetric else 1.0]), 1e-6
    qf = np.outer(sign, [amplitude, 0.0, 0.0])
    begun *= np.sqrt(omega2)  # rate over amplitude, the base moving against it
    drawn = antisymmetric * m / (base + 2 * m) * begun * amplitude
    state = State(0.0, np.zeros(3), np.array([0.0, -drawn, 0.0]), qf, begun * qf, None, None)
    state = simulator.step(state, dt=duration)
    roots = np.roots([1.0, damping * omega2, omega2]).astype(complex)
    weights = np.linalg.solve(np.vstack([np.ones(2), roots]), [amplitude, begun * amplitude])
    expected = (weights * np.exp(roots * duration)).sum().real
    rate = (weights * roots * np.exp(roots * duration)).sum().real
    np.testing.assert_allclose(state.qf[:, 0], sign * expected, rtol=0, atol=1e-11 * amplitude)
    np.testing.assert_allclose(state.qfd[:, 0], sign * rate, rtol=0, atol=1e-11 * amplitude * np.sqrt(omega2))
    # The base moves against the panels: y = -m / (m_base + 2 m) * q4.
    moved = -antisymmetric * m / (base + 2 * m) * (expected - amplitude)
    np.testing.assert_allclose(state.q, [0.0, moved, 0.0], rtol=0, atol=1e-11 * amplitude)


def test_held_forces_do_the_work_that_the_energy_shows() -> None:
    """Undamped: E(t) - E(0) = sum of joint torques times angles and piezo forces times tip coordinates; no momentum."""
    simulator = Simulator(case_study(UNDAMPED))
    command = random_command(np.random.default_rng(2)) | {"base": np.zeros(3)}
    start = simulator.initial_state()
    end = simulator.step(start, **command, dt=1.0)
    work = command["joints"] @ (end.q - start.q)[3:] + np.sum(command["piezo_tau"] * (end.qf - start.qf)[:, -3:])
    assert abs(work) > 0.1
    assert simulator.energy(end) - simulator.energy(start) == pytest.approx(work, rel=1e-6)  # of 30 J, kept to 1e-9
    np.testing.assert_allclose(simulator.momentum(end), simulator.momentum(start), rtol=0, atol=1e-6)


def test_strain_rate_damping_takes_energy_out_steadily() -> None:
    """The energy falls in every step, in all by the integral of eta qfd' K qfd; both momenta stay."""
    eta = 0.03  # s, so that even bending loses energy in 2 s
    simulator = Simulator(case_study(ALONE, f"panel.strain_rate_damping={eta}"))
    state = started(simulator, "turning")
    state = replace(state, qfd=np.array(STARTS["swinging"]["qfd"]))
    K = np.array([[20 * 12 / 4**3, -20 * 6 / 4**2], [-20 * 6 / 4**2, 20 * 4 / 4]])  # Eq. 47
    momentum, energies, powers = simulator.momentum(state), [simulator.energy(state)], []
    for _ in range(1000):
        powers.append(eta * np.einsum("pf,fg,pg->", state.qfd[:, 1:], K, state.qfd[:, 1:]))
        state = simulator.step(state)
        energies.append(simulator.energy(state))
    assert (np.diff(energies) < 0).all()
    lost = 2e-3 * (np.sum(powers) - powers[0] / 2)  # trapezoids, the last half of one missing
    assert lost > 0.005
    assert energies[0] - energies[-1] == pytest.approx(lost, rel=1e-3)
    np.testing.assert_allclose(simulator.momentum(state), momentum, rtol=0, atol=1e-6)


def test_stiff_panels_make_a_rigid_robot() -> None:
    """As EI grows the motion tends, in proportion to 1/EI, to that of one rigid base with the panels' inertia."""
    flexible = case_study(ALONE, f"panel.mounts={OPPOSITE}", "initial.qfd=[0,0,0]", "panel.strain_rate_damping=1.0e-2")
    m, L, base = flexible.panel.mass, flexible.panel.length, flexible.base
    inertia = base.inertia + 2 * m * (L**2 / 12 + (0.5 + L / 2) ** 2)
    rigid = Simulator(
        flexible.with_overrides("panel.mounts=[]", f"base.mass={base.mass + 2 * m}", f"base.inertia={inertia}")
    )
    force = {"base": [30.0, -20.0, 40.0], "joints": [1.0, -0.5, 0.8, -0.4, 0.1, 0.05]}
    expected = rigid.step(rigid.initial_state(), **force, dt=1.0).q
    distances = []
    for EI in (2e5, 2e6):
        simulator = Simulator(
            flexible.with_overrides(f"panel.EI={EI}", "panel.axial_cut=1.0e+6", "panel.bending_cut=1.0e+6")
        )
        state = simulator.step(simulator.initial_state(), **force, dt=1.0)
        distances.append(np.abs(state.q - expected).max())
    assert distances[1] < 3e-5
    assert distances[0] / distances[1] == pytest.approx(10.0, rel=0.1)


def test_pulse_on_the_base_ends_where_the_case_study_says() -> None:
    """physics.md, section 6: 2 N along the inertial x and 0.5 N m for 1 s, from rest, then free until 20 s."""
    rest = f"initial.qd={[0.0] * 9}"
    simulator = Simulator(case_study(ALONE, UNDAMPED, rest, "initial.qfd=[0,0,0]"))
    state = simulator.initial_state()
    for _ in range(500):
        state = simulator.step(state, base=[*rotation(-state.q[2]) @ [2.0, 0.0], 0.5])
    state = simulator.step(state, dt=19.0)
    np.testing.assert_allclose(state.q[:3], [0.48684, -0.00124, 0.07650], atol=1e-5)  # the digits given


def test_long_steps_are_cut_into_equal_ones_of_at_most_max_step() -> None:
    """2.5 times max_step is three steps of equal length; a whole number of them is the same as one by one."""
    simulator = Simulator(case_study(), max_step=1e-3)
    start, command = simulator.initial_state(), random_command(np.random.default_rng(3))
    model, work = simulator.model, new_workspace(step_shapes(simulator.model))
    tau = np.zeros(joint_slice(model).stop + model.omega2.size + 3)
    tau[:3], tau[joint_slice(model)] = command["base"], command["joints"]
    tips = np.zeros_like(start.qf)
    tips[:, -3:] = command["piezo_tau"]
    tau[mode_slice(model)] = np.einsum("pfm,pf->pm", model.shapes, tips).ravel()
    p = np.concatenate([start.q, modal(model, start.qf), start.obj])
    v = np.concatenate([start.qd, modal(model, start.qfd), start.objd])
    advance(model, p, v, tau, 2.5e-3, 3, INTEGRATORS["etdrk4"], work)
    np.testing.assert_allclose(
        vector(simulator.unflatten(0.0, p, v)), vector(simulator.step(start, **command, dt=2.5e-3)), atol=1e-15
    )

    one_by_one = start
    for _ in range(8):
        one_by_one = simulator.step(one_by_one, **command, dt=1e-3)
    at_once = simulator.step(start, **command, dt=8e-3)
    np.testing.assert_allclose(vector(at_once), vector(one_by_one), rtol=0, atol=1e-13)
    longer = Simulator(case_study(), max_step=8e-3).step(start, **command, dt=8e-3)
    assert np.abs(vector(longer) - vector(at_once)).max() > 1e-12  # another step, another error
    np.testing.assert_allclose(vector(longer), vector(at_once), rtol=0, atol=1e-6)


def test_steps_are_deterministic_and_keep_nothing() -> None:
    """The same bits from two simulators, though one of them steps another state in between."""
    one, other = Simulator(), Simulator()
    a = b = one.initial_state()
    apart = replace(a, q=a.q + 0.01, qfd=-a.qfd)
    rng = np.random.default_rng(4)
    for _ in range(50):
        command = random_command(rng)
        a, b = one.step(a, **command), other.step(b, **command)
        apart = one.step(apart)
    np.testing.assert_array_equal(vector(a), vector(b))
    assert np.abs(vector(apart) - vector(a)).max() > 1e-3
