"""What a policy sees and what info measures, against plain kinematics and the paper's own matrices."""

import re

import numpy as np
import pytest
from grasping_robots import VARIANTS, make_params
from observer import Observer, expected_fields
from oracle import Oracle

from sffr_gym.config.params import load_params
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.simulator import Simulator
from sffr_gym.task.observation import reference_turning
from sffr_gym.task.reference import desired
from sffr_gym.task.task_model import make_task_model

N_ACTIONS = 15
GROUPS = ("piezo", "thruster", "joint")
# The fields that each row of the environment's table stands for.
ROWS = [
    ("base_error", "yaw_error", "base_error_rate", "yaw_error_rate"),
    ("tip_error", "tip_error_rate"),
    ("object_error", "object_angle_error", "object_error_rate", "object_angle_error_rate"),
    ("hold_error",),
    ("joint_angle",),
    ("joint_rate",),
    ("yaw_rate",),
    ("elastic",),
    ("elastic_rate",),
    ("reference_velocity", "reference_turn"),
    ("reference_acceleration",),
]


def actions(count):
    """Random actions that the robot survives for a while."""
    return 0.3 * np.random.default_rng(0).uniform(-1.0, 1.0, (count, N_ACTIONS))


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize(("seed", "phase", "tick"), [(0, 0.0, 0), (1, 2.0, 7_000), (2, -1.0, 90_000)])
def test_every_field_follows_from_the_kinematics(variant, seed, phase, tick):
    """Each field equals its definition at random states anywhere on the circle, without noise."""
    observer = Observer(make_params(variant), phase)
    p, v = observer.perturbed(seed)
    obs = observer(p, v, tick)
    expected = expected_fields(observer, p, v, tick * observer.params.control.period, phase)
    for name, field in observer.fields.items():
        np.testing.assert_allclose(obs[field.slice], np.ravel(expected.get(name, [])), rtol=0, atol=1e-11, err_msg=name)
    assert obs.size == sum(field.size for field in observer.fields.values())
    np.testing.assert_array_equal(obs, observer(p, v, tick))


@pytest.mark.parametrize("heading", ["fixed", "tangent"])
def test_a_circle_is_turned_along_evenly(heading):
    """No angular acceleration, nor a change of it, whether the heading turns or not."""
    observer = Observer(load_params().with_overrides(f"path.heading={heading}"))
    at = make_task_model(observer.params).at
    assert reference_turning(at, observer(observer.p, observer.v, 700)) == (0.0, 0.0)


@pytest.mark.parametrize("turns", [0.2, 5.3])
def test_nothing_grows_around_the_circle(turns):
    """With a tangent heading, a robot carried along the circle as one sees exactly what it saw at the start."""
    observer = Observer(make_params("tangent"))
    params = observer.params
    p, v = observer.perturbed(3)
    tick = round(turns * params.path.period / params.control.period)
    angle = params.path.speed / params.path.radius * tick * params.control.period
    centre = observer.p[-3:-1] + np.array([0.0, params.path.radius])
    moved, moving = p.copy(), v.copy()
    for body in (slice(0, 3), slice(len(p) - 3, len(p))):
        moved[body][:2] = centre + rotation(angle) @ (p[body][:2] - centre)
        moved[body][2] += angle
        moving[body][:2] = rotation(angle) @ v[body][:2]
    np.testing.assert_allclose(observer(moved, moving, tick), observer(p, v, 0), rtol=0, atol=1e-10)


@pytest.mark.parametrize("phase", [0.0, 2.5])
def test_reference_velocity_and_acceleration_are_derivatives(phase):
    """The desired motion's rates are differences of its position; it starts at the object, at constant speed."""
    observer = Observer(make_params("paper"), phase)
    reference = observer.reference
    h = 1.0e-3
    for t in (0.0, 31.0):
        before, now, after = (np.array(desired(reference, t + shift)) for shift in (-h, 0.0, h))
        np.testing.assert_allclose((after[:4] - before[:4]) / (2 * h), now[2:6], rtol=0, atol=1e-8)
        assert np.hypot(*now[2:4]) == pytest.approx(0.85, rel=1e-12)
    start = desired(reference, 0.0)
    np.testing.assert_allclose([start.x, start.y], observer.p[-3:-1], rtol=0, atol=1e-14)
    around = desired(reference, 2.0 * np.pi / reference.rate)
    np.testing.assert_allclose([around.x, around.y], observer.p[-3:-1], rtol=0, atol=1e-12)


def quasi_static(env, oracle, t):
    """Return the static shapes (n_p, 3) under the reference's motion, and the wrench (3,) of panels that keep them."""
    params, want = env.params, desired(env.reference, t)
    panel, offset = params.panel, np.array([env.reference.base_x, env.reference.base_y])
    m, L, EI = panel.mass, panel.length, panel.EI
    K = EI / L**3 * np.array([[12.0, -6.0 * L], [-6.0 * L, 4.0 * L**2]])
    yaw, turn, r = want.heading + env.reference.yaw, want.turn, rotation(want.heading) @ offset
    acceleration = np.array([want.xdd, want.ydd]) - turn**2 * r
    shapes = []
    for mount in panel.mounts:
        root = acceleration - turn**2 * rotation(yaw) @ np.array(mount.root)
        across = rotation(yaw + mount.angle)[:, 1]
        shapes.append([0.0, *-np.linalg.solve(K, m * np.array([0.5, -L / 12.0]) * (across @ root))])
    z, zd, zdd = np.zeros((3, oracle.N))
    z[:3], zd[:2] = [want.x + r[0], want.y + r[1], yaw], [want.xd, want.yd] + turn * perpendicular(r)
    zd[2], zdd[:2], z[oracle.n_rigid :] = turn, acceleration, np.ravel(shapes)
    return np.array(shapes), oracle.q_flex(z, zd, zdd)[:3]


@pytest.mark.parametrize("heading", ["fixed", "tangent"])
@pytest.mark.parametrize("scenario", ["excited", "offset"])
def test_info_is_the_state(scenario, heading):
    """Every measure in info follows from the state in the paper's coordinates (Eqs. 45 and 47)."""
    env = SFFRFlexEnv(scenario, overrides=[f"path.heading={heading}", "initial.q.2=0.3"])
    env.reset(seed=6)
    params, simulator, limit = env.params, Simulator(env.params), env.prior_task.scale
    oracle = Oracle(params.to_dict())
    m, L, EI = params.panel.mass, params.panel.length, params.panel.EI
    M = m * np.array([[13.0 / 35.0, -11.0 / 210.0 * L], [-11.0 / 210.0 * L, L**2 / 105.0]])
    K = EI / L**3 * np.array([[12.0, -6.0 * L], [-6.0 * L, 4.0 * L**2]])
    for action in actions(40):
        before = env.state()
        obs, _, _, _, info = env.step(action)
        state, t = env.state(), env.time
        shape, wrench = quasi_static(env, oracle, t)
        bend, bend_rate = (state.qf - shape)[:, 1:], state.qfd[:, 1:]
        energy = 0.5 * np.einsum("pi,ij,pj->", bend_rate, M, bend_rate) + 0.5 * np.einsum("pi,ij,pj->", bend, K, bend)
        command = action * limit
        volts, base, joints = command[:6].reshape(2, 3), command[6:9], command[9:]
        deviation = simulator.q_flex(before, base=base, joints=joints, piezo_volts=volts)[:3] - wrench
        fields = {name: obs[field.slice] for name, field in env.fields.items()}
        assert info["time"] == t == state.t
        assert info["object_error"] == pytest.approx(np.linalg.norm(fields["object_error"]), rel=1e-12)
        assert info["attitude_error"] == abs(fields["object_angle_error"][0])
        assert info["tip"] == pytest.approx(np.abs(state.qf[:, 1]).max(), rel=1e-12)
        assert info["vibration"] == pytest.approx(energy, rel=1e-9)
        assert info["force_deviation"] == pytest.approx(np.hypot(*deviation[:2]), rel=1e-9)
        assert info["moment_deviation"] == pytest.approx(abs(deviation[2]), rel=1e-9)
        assert info["piezo_square"] == pytest.approx(np.sum(volts**2), rel=1e-12)
        assert info["thrust"] == pytest.approx(np.abs(base[:2]).sum(), rel=1e-12)
        assert info["joint_square"] == pytest.approx(np.sum(joints**2), rel=1e-12)
        np.testing.assert_array_equal(info["applied"], command)


@pytest.mark.parametrize(("integrator", "step"), [("etdrk4", 2.0e-3), ("rk4", 3.0e-4), ("rk4", 2.5e-4)])
def test_a_step_is_the_simulators(integrator, step):
    """One control period of the environment is that of the simulator under the same forces and with the same steps."""
    env = SFFRFlexEnv("offset", overrides=[f"simulation.integrator={integrator}", f"simulation.max_step={step}"])
    env.reset(seed=2)
    simulator, state = Simulator(env.params), env.state()
    for action in actions(5):
        env.step(action)
        command = action * env.prior_task.scale
        state = simulator.step(state, base=command[6:9], joints=command[9:], piezo_volts=command[:6].reshape(2, 3))
        for name in ("q", "qd", "qf", "qfd", "obj", "objd"):
            scale = np.abs(getattr(state, name)).max()
            np.testing.assert_allclose(getattr(env.state(), name), getattr(state, name), rtol=0, atol=1e-12 * scale)


@pytest.mark.parametrize("scenario", ["excited", "offset"])
def test_info_of_a_reset_is_the_state(scenario):
    """What depends on the state alone is measured at the start as well: a robot off the path is not reported on it."""
    env = SFFRFlexEnv(scenario)
    obs, info = env.reset(seed=6)
    fields = {name: obs[field.slice] for name, field in env.fields.items()}
    assert info["object_error"] == pytest.approx(np.linalg.norm(fields["object_error"]), rel=1e-12)
    assert info["attitude_error"] == abs(fields["object_angle_error"][0])
    assert info["tip"] == pytest.approx(np.abs(fields["elastic"][[1, 4]]).max(), rel=1e-12)
    assert info["vibration"] > 0.0
    commands = ["piezo_square", "thrust", "joint_square", *(f"{group}_saturated" for group in GROUPS)]
    assert not any(info[name] for name in commands)  # nothing has been commanded yet


def test_info_without_an_object_is_the_bases_error():
    env = SFFRFlexEnv("offset", overrides=["object=null"])
    obs, info = env.reset(seed=6)
    fields = {name: obs[field.slice] for name, field in env.fields.items()}
    assert info["object_error"] == pytest.approx(np.linalg.norm(fields["base_error"]), rel=1e-12)
    assert info["attitude_error"] == abs(fields["yaw_error"][0])
    assert np.abs(fields["base_error"]).min() > 1e-3


def test_saturation_is_reported():
    """Info has the fraction of each group's actuators at their limit, for actions on the bound or beyond."""
    env = SFFRFlexEnv()
    env.reset(seed=0)
    action = np.zeros(N_ACTIONS)
    assert not any(env.step(action)[4][f"{group}_saturated"] for group in GROUPS)
    action[[0, 7, 8, 9]] = [-1.0, 2.0, -1.5, 1.0]
    info = env.step(action)[4]
    fractions = [info[f"{group}_saturated"] for group in GROUPS]
    assert fractions == pytest.approx([1 / 6, 2 / 3, 1 / 6])


def test_docstring_tables_are_the_spaces():
    """The index ranges of the class's observation table are those of `fields`; its action table has the limits."""
    env = SFFRFlexEnv()
    _, action_part, observation_part = re.split(r"## (?:Action|Observation) space", SFFRFlexEnv.__doc__)
    spans = {}
    for part, text in ("action", action_part), ("observation", observation_part.partition("## Reward")[0]):
        rows = re.findall(r"^ *\| (\d+)(?:(?:-|, )(\d+))? \| (.*) \|$", text, re.MULTILINE)
        spans[part] = [(int(first), int(last or first) + 1, words) for first, last, words in rows]
    found = [(start, stop) for start, stop, _ in spans["observation"]]
    fields = [[env.fields[name] for name in names] for names in ROWS]
    assert found == [(row[0].start, row[-1].start + row[-1].size) for row in fields]
    assert [name for row in ROWS for name in row] == [name for name, field in env.fields.items() if field.size]
    for field in env.fields.values():
        np.testing.assert_array_equal(env.observation_space.high[field.slice], field.bound)
    # The right panel's row stands for the same limits as the left one's.
    limits = [200.0, 200.0, 100.0, 100.0, 7.0, 7.0]
    for (start, stop, words), limit in zip(spans["action"], limits, strict=True):
        np.testing.assert_array_equal(env.prior_task.scale[start:stop], limit)
        assert f"{limit:g} " in words or "right panel" in words


def test_every_number_has_its_unit():
    """Of a field whose parts have one unit, and of one whose parts repeat theirs for each panel."""
    fields = SFFRFlexEnv().fields
    assert all(len(field.units) == field.size for field in fields.values())
    assert fields["base_error"].units == ["m", "m"] and fields["elastic"].units == ["m", "m", "rad"] * 2


def test_observation_is_a_float64_of_its_space_and_nobody_elses():
    """Observations are new float64 arrays inside the space; nothing returned changes later."""
    env = SFFRFlexEnv("offset")
    obs, info = env.reset(seed=0)
    outputs = [(obs, info)] + [env.step(action)[::4] for action in actions(20)]
    arrays = [array for obs, info in outputs for array in (obs, info["applied"])]
    arrays += [env.positions, env.velocities, env.positions]
    assert all(array.dtype == np.float64 for array in arrays)
    assert all(env.observation_space.contains(obs) for obs, _ in outputs)
    for i, array in enumerate(arrays):
        assert not any(np.shares_memory(array, other) for other in arrays[:i])
    kept = obs.copy()
    env.step(np.ones(N_ACTIONS))
    np.testing.assert_array_equal(obs, kept)
