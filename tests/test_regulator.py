"""The regulator: an optimum of the sampled panel, about the quasi-static shape, and a law that contains HSC."""

import numpy as np
import pytest
from observer import Observer
from scipy.linalg import block_diag
from scipy.signal import cont2discrete

from sffr_baselines import make_policy
from sffr_baselines.laws import make_law
from sffr_baselines.panel_reaction import BENDING
from sffr_baselines.regulator import deviate, optimal_gain, root_acceleration, sampled_panel, worth_of_effort
from sffr_baselines.rollout import result_of, rollout
from sffr_baselines.settings import load_settings
from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.beam import beam
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import pack
from sffr_gym.task.metrics import measure
from sffr_gym.task.score import costs

PARAMS = load_params()
DOUBLINGS = 15  # of a period: 66 s
EFFORT = 3.3e-3
K_PZ = pack_actuators(PARAMS, pack(PARAMS)).K_PZ[0]  # diagonal: a channel for each of q4, q5 and q6
WEAK = ["actuators.piezo.force=0.04", "actuators.piezo.moment=0.04"]


def panel():
    """Mass and stiffness of q5 and q6, and the sampled step of [q5, q6, q5d, q6d]."""
    shape = beam(PARAMS.panel.mass, PARAMS.panel.length, PARAMS.panel.EI, PARAMS.panel.E * PARAMS.panel.area, 1)
    M, K = shape.M_ff[BENDING, BENDING], shape.K[BENDING, BENDING]
    A, G = sampled_panel(M, PARAMS.panel.strain_rate_damping * K, K, PARAMS.control.period)
    return M, K, A, G


def total(F, W):
    """Matrix of the sum of x' W x over 66 s of x -> F x, by doubling: what follows n periods is as what began them."""
    P = W
    for _ in range(DOUBLINGS):
        P, F = P + F.T @ P @ F, F @ F
    return P


def cost(gain, starts, effort):
    """Energy and priced volts of a clamped panel under volts (2, 4) on q5 and q6, from starts (4, n)."""
    M, K, A, G = panel()
    G = G * 47.5 / 200.0
    W = block_diag(K, M) / 2.0 + effort * gain.T @ gain
    return np.trace(starts.T @ total(A - G @ gain, W) @ starts) * PARAMS.control.period


def observation(env, seed, still=False):
    """An observation on the circle with made-up panel states, or with the panels at their quasi-static shape."""
    rng, fields = np.random.default_rng(seed), env.fields
    obs = env.reset(seed=seed)[0]
    phase, speed, radius = rng.uniform(0.0, 2.0 * np.pi), PARAMS.path.speed, PARAMS.path.radius
    along = np.array([np.cos(phase), np.sin(phase)])
    push = np.array([-along[1], along[0]]) * speed**2 / radius
    obs[fields["reference_velocity"].slice], obs[fields["reference_acceleration"].slice] = speed * along, push
    obs[fields["elastic"].slice], obs[fields["elastic_rate"].slice] = 0.2 * rng.uniform(-1.0, 1.0, (2, 6))
    if still:
        shape = beam(9.0, 4.0, 20.0, 9.6e7, 1)
        tip = -np.linalg.solve(shape.K, shape.S_y)
        across = np.array([[-1.0, 0.0], [1.0, 0.0]])  # of the left and the right panel
        turned = speed / radius * np.array([-push[1], push[0]])  # the acceleration turns with the path
        obs[fields["elastic"].slice] = np.outer(across @ push, tip).ravel()
        obs[fields["elastic_rate"].slice] = np.outer(across @ turned, tip).ravel()
    return obs


def test_sampled_panel_is_the_free_vibration():
    """Without force a period turns each mode by its frequency; energy is lost by the material's damping alone."""
    M, K, A, _ = panel()
    frequencies = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).real)
    turned = np.abs(np.angle(np.linalg.eigvals(A))) / PARAMS.control.period
    np.testing.assert_allclose(np.sort(turned)[::2], np.sort(frequencies), rtol=1e-6)
    _, _, free, _ = (*panel()[:2], *sampled_panel(M, 0.0 * K, K, PARAMS.control.period))
    energy = block_diag(K, M)
    np.testing.assert_allclose(free.T @ energy @ free, energy, atol=1e-10)


def test_held_force_gives_its_static_deflection():
    """The fixed point of the step under a constant force is K^-1 tau."""
    _, K, A, G = panel()
    tau = np.array([0.3, -0.2])
    rest = np.linalg.solve(np.eye(4) - A, G @ tau)
    np.testing.assert_allclose(rest, [*np.linalg.solve(K, tau), 0.0, 0.0], atol=1e-9)


def test_sampled_panel_is_scipys():
    """Forward in time, whatever the force: SciPy's zero-order hold of the same equations."""
    M, K, _, _ = panel()
    D, zero, one, period = 0.03 * K, np.zeros((2, 2)), np.eye(2), 0.1
    A, B = (
        np.block([[zero, one], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]]),
        np.vstack([zero, np.linalg.inv(M)]),
    )
    expected = cont2discrete((A, B, np.eye(4), np.zeros((4, 2))), period)
    for found, known in zip(sampled_panel(M, D, K, period), expected[:2], strict=True):
        np.testing.assert_allclose(found, known, rtol=1e-10, atol=1e-12)


@pytest.mark.parametrize("effort", [EFFORT, 1.0e-6])  # a price at which volts count, and one at which they do not
def test_no_other_gain_costs_less(effort):
    """The cost rises whichever entry of the gain moves, and either way."""
    best = optimal_gain(PARAMS, K_PZ, effort)[1:]
    starts = np.diag([0.1, 0.03, 0.1, 0.05])
    least = cost(best, starts, effort)
    for entry in np.ndindex(best.shape):
        for step in -0.02, 0.02:
            other = best.copy()
            other[entry] += step * np.abs(best).max()
            assert cost(other, starts, effort) > least


def test_a_channel_that_does_not_bend_is_left_alone():
    """The one along the panel; and all, if none bends it."""
    gain = optimal_gain(PARAMS, K_PZ, EFFORT)
    assert not gain[0].any() and gain[1:].all()
    assert not optimal_gain(PARAMS, K_PZ[:, :1], EFFORT).any()


def test_patches_share_the_work_by_what_they_do():
    """A pair's faces pull against each other, and the volts have the least square that gives the forces."""
    params = PARAMS.with_overrides("actuators.piezo.array=patches")
    patches = pack_actuators(params, pack(params)).K_PZ[0]
    gain = optimal_gain(params, patches, 1.0e-9)
    np.testing.assert_allclose(gain[0::2], -gain[1::2], rtol=1e-9)
    least = np.linalg.pinv(patches[BENDING]) @ (patches[BENDING] @ gain)
    np.testing.assert_allclose(least, gain, rtol=1e-6, atol=1e-6 * np.abs(gain).max())


def test_the_worth_of_effort_is_that_of_the_score():
    """Of a free swing under AHSC's start, simulated: energy over effort, times their weights."""
    assert worth_of_effort(PARAMS, K_PZ, swing=0.1) == pytest.approx(swing_worth(np.diag([1.5, 5.0])), rel=1e-6)


def test_a_law_without_damping_counts_as_critical():
    """There the worth is that of critical damping of the first mode."""
    M, K, _, _ = panel()
    omega = np.sqrt(np.linalg.eigvals(np.linalg.solve(M, K)).min())
    none = PARAMS.with_overrides("suppression.B0=[0, 0, 0]")
    assert worth_of_effort(none, K_PZ, swing=1.0e-3) == pytest.approx(swing_worth(2.0 * omega * M), rel=1e-6)


def swing_worth(B):
    """Energy over squared volts of a first-mode swing under a virtual damping (2, 2), as the score weighs them."""
    M, K, A, G = panel()
    volts = np.hstack([np.zeros((2, 2)), B]) * 200.0 / 47.5
    squares, shapes = np.linalg.eig(np.linalg.solve(M, K))
    x, F = np.append(shapes[:, squares.argmin()], [0.0, 0.0]), A - G @ (47.5 / 200.0 * volts)
    energy, effort = (x @ total(F, W) @ x for W in (block_diag(K, M) / 2.0, volts.T @ volts))
    return 0.05 / 0.60 * energy / effort


def test_the_worth_of_effort_goes_with_authority():
    """A tenth of the force takes ten times the volts, until they end; a larger swing ends them sooner."""
    worth = worth_of_effort(PARAMS, K_PZ, 0.1)
    assert worth_of_effort(PARAMS, K_PZ / 10.0, 0.1) == pytest.approx(worth / 100.0, rel=1e-9)
    weak = PARAMS.with_overrides(*WEAK)
    K_weak = pack_actuators(weak, pack(weak)).K_PZ[0]
    scaled = worth * (0.04 / 47.5) ** 2
    assert scaled < worth_of_effort(weak, K_weak, 0.1) < worth_of_effort(weak, K_weak, 0.2) < 100.0 * scaled


@pytest.mark.parametrize("B0", ["[0, 0, 0]", "[0, 1.0e6, 1.0e6]"])
def test_the_worth_of_effort_is_defined_without_a_usable_damping(B0):
    """None at all, or what the sampled loop cannot run."""
    worth = worth_of_effort(PARAMS.with_overrides(f"suppression.B0={B0}"), K_PZ, 1.0e-6)
    assert 0.0 < worth < 1.0
    if "e" in B0:  # halved until it is stable
        B, (_, _, A, G) = 1.0e6, panel()
        while np.abs(np.linalg.eigvals(A - G @ np.hstack([np.zeros((2, 2)), B * np.eye(2)]))).max() >= 1.0:
            B /= 2.0
        stable = PARAMS.with_overrides(f"suppression.B0=[0, {B}, {B}]")
        assert worth == pytest.approx(worth_of_effort(stable, K_PZ, 1.0e-6), rel=1e-9)


@pytest.mark.parametrize("overrides", [["actuators.piezo.array=patches"], WEAK], ids=["patches", "weak"])
def test_lqr_costs_less_than_ahsc_with_other_piezos(overrides):
    """Its price is that of the volts at hand, so that it neither idles nor squanders them."""
    env = SFFRFlexEnv("excited", overrides=overrides)
    results = {name: [result_of(rollout(env, make_policy(name, env), 7))] for name in ("ahsc", "lqr")}
    assert costs(results)["lqr"] < 0.9


def test_dearer_effort_means_smaller_gains():
    sizes = [np.abs(optimal_gain(PARAMS, K_PZ, EFFORT * factor)).sum() for factor in (0.1, 1.0, 10.0)]
    assert sizes[0] > sizes[1] > sizes[2]
    with pytest.raises(ValueError, match="effort_weight must be positive"):
        optimal_gain(PARAMS, K_PZ, 0.0)


def test_no_force_at_the_quasi_static_motion():
    """Panels that follow the path's turning acceleration are left alone, whatever the phase of the path."""
    env = SFFRFlexEnv()
    policy = make_policy("lqr", env)
    for seed in range(5):
        forces = policy(observation(env, seed, still=True))[:6]
        np.testing.assert_allclose(forces, 0.0, atol=1e-12)
        assert np.abs(policy(observation(env, seed))[:6]).max() > 1e-3


@pytest.mark.parametrize("yaw", [0.0, 0.4])
def test_no_force_at_the_quasi_static_motion_of_a_tangent_path(yaw):
    """Robot and path turn together: a root's acceleration is constant in the robot's axes, with its own part."""
    straight = "initial.qd=[0.85, 0, 0, 0, 0, 0, 0, 0, 0]"
    env = SFFRFlexEnv(overrides=["path.heading=tangent", f"initial.q.2={yaw}", straight])
    obs, fields, params = env.reset(seed=0)[0], env.fields, env.params
    turn, speed = params.path.speed / params.path.radius, params.path.speed
    obs[fields["reference_velocity"].slice], obs[fields["reference_turn"].slice] = [speed, 0.0], turn
    obs[fields["reference_acceleration"].slice] = [0.0, speed * turn]
    element = beam(9.0, 4.0, 20.0, 9.6e7, 1)
    tip = -np.linalg.solve(element.K, element.S_y)
    base = np.array([env.episode.reference.base_x, env.episode.reference.base_y])
    shapes = []
    for mount in params.panel.mounts:
        root = base + rotation(yaw) @ mount.root
        across = rotation(yaw + mount.angle)[:, 1]
        shapes.append(across @ ([0.0, speed * turn] - turn**2 * root) * tip)
    obs[fields["elastic"].slice], obs[fields["elastic_rate"].slice] = np.ravel(shapes), 0.0
    np.testing.assert_allclose(make_policy("lqr", env)(obs)[:6], 0.0, atol=1e-12)


@pytest.mark.parametrize(
    "keys",
    [["kind=slew"], ["kind=figure-eight", "heading=tangent"], ["kind=waypoints", "heading=tangent"], ["kind=circle"]],
)
def test_the_rate_of_a_roots_acceleration_is_its_derivative(keys):
    """On every path, whether the jerk is observed or follows from a circle; for roots at different places."""
    mounts = "panel.mounts=[{name: a, root: [0.3, -0.7], angle: 2.1}, {name: b, root: [0, 0.5], angle: 1.5708}]"
    observer = Observer(PARAMS.with_overrides(mounts, *(f"path.{key}" for key in keys)))
    law, h = make_law("lqr", observer.params), 1
    for tick in (500, 1700, 2900):
        seen = [observer(observer.p, observer.v, tick + shift) for shift in (-h, 0, h)]
        for i in range(2):
            (before, _), (_, rate), (after, _) = (root_acceleration(law.regulator, law.at, obs, i) for obs in seen)
            slope = (after - before) / (2 * h * observer.params.control.period)
            assert rate == pytest.approx(slope, rel=1e-3, abs=1e-6) and abs(rate) > 1e-5
            x = np.zeros((3, 4))  # of a panel that does not bend: less the shape, and its rate
            for obs, deviation in zip(seen, x, strict=True):
                obs[observer.fields["elastic"].slice] = obs[observer.fields["elastic_rate"].slice] = 0.0
                deviate(law.regulator, law.at, obs, i, deviation)
            slope = (x[2, :2] - x[0, :2]) / (2 * h * observer.params.control.period)
            np.testing.assert_allclose(x[1, 2:], slope, rtol=1e-3, atol=1e-6)


def test_forces_follow_the_gain():
    """volts = -G (x - x_qs) on each panel by itself; the shape is that of a clamped panel under its root's push."""
    env = SFFRFlexEnv()
    policy, fields = make_policy("lqr", env), env.fields
    moved, rest = observation(env, 3), observation(env, 3, still=True)
    weights, gap = load_settings("lqr"), moved - rest
    gain = optimal_gain(PARAMS, K_PZ, weights.effort * worth_of_effort(PARAMS, K_PZ, weights.swing))
    x, xd = (gap[fields[name].slice].reshape(2, 3)[:, BENDING] for name in ("elastic", "elastic_rate"))
    wanted = -np.hstack([x, xd]) @ gain.T
    np.testing.assert_allclose(policy(moved)[:6].reshape(2, 3) * 200.0, wanted, rtol=1e-9, atol=1e-9)


def test_hsc_is_the_gain_of_pure_damping():
    """With a gain of B0 on the rates and no quasi-static shape, the regulator's volts are HSC's."""
    env = SFFRFlexEnv()
    hsc, lqr = make_policy("hsc", env), make_policy("lqr", env)
    gain = np.zeros((2, 3, 4))
    gain[:, 1:, 2:] = np.diag([1.5, 5.0]) * 200.0 / 47.5
    lqr.law = lqr.law._replace(regulator=lqr.law.regulator._replace(gain=gain, shape=np.zeros((2, 3))))
    for seed in range(3):
        obs = observation(env, seed)
        np.testing.assert_allclose(lqr(obs), hsc(obs), rtol=1e-12, atol=1e-15)


def test_paper_laws_have_none():
    for name in "none", "hsc", "ahsc", "ahsc-filtered", "hsc-tuned":
        assert make_policy(name, PARAMS).law.regulator.active == 0.0
    assert make_policy("lqr", PARAMS).law.regulator.active == 1.0


@pytest.mark.slow
def test_lqr_vibrates_far_less_than_ahsc():
    """On the whole robot, over a full circle."""
    env = SFFRFlexEnv("excited")
    means = {}
    for name in "ahsc", "lqr":
        trajectory = rollout(env, make_policy(name, env), 3)
        means[name] = measure(trajectory.signals, trajectory.period, trajectory.failure)
    assert not means["lqr"]["failed"]
    assert means["lqr"]["vibration"] < 0.7 * means["ahsc"]["vibration"]
    assert means["lqr"]["track_rmse"] < 1.1 * means["ahsc"]["track_rmse"]


def test_no_force_at_the_quasi_static_motion_of_a_slanted_panel():
    """Its root's acceleration across it has parts of both axes, and so has the rate of that."""
    env = SFFRFlexEnv(overrides=["panel.mounts=[{name: only, root: [0.3, -0.7], angle: 2.1}]"])
    obs, fields, speed, radius = env.reset(seed=0)[0], env.fields, PARAMS.path.speed, PARAMS.path.radius
    along = np.array([np.cos(0.7), np.sin(0.7)])
    push = speed**2 / radius * np.array([-along[1], along[0]])
    obs[fields["reference_velocity"].slice], obs[fields["reference_acceleration"].slice] = speed * along, push
    element = beam(9.0, 4.0, 20.0, 9.6e7, 1)
    tip, across = -np.linalg.solve(element.K, element.S_y), rotation(2.1)[:, 1]
    obs[fields["elastic"].slice] = across @ push * tip
    obs[fields["elastic_rate"].slice] = across @ (speed / radius * np.array([-push[1], push[0]])) * tip
    np.testing.assert_allclose(make_policy("lqr", env)(obs)[:3], 0.0, atol=1e-12)
