"""The observation of any state, and what it must be by the definitions of the task."""

import numpy as np

from sffr_baselines.laws import LawPolicy, make_law
from sffr_gym.compile.arguments import Structures
from sffr_gym.compile.workspace import new_workspace
from sffr_gym.envs.batch import make_batch, observe_range, put_episode
from sffr_gym.physics.initial import close_grasps, initial_positions, match_joint_rates
from sffr_gym.physics.kinematics import arm_points, perpendicular, rotation
from sffr_gym.physics.model import mode_slice
from sffr_gym.physics.simulator import Simulator
from sffr_gym.task.control_period import period_shapes
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.observation import observation_fields
from sffr_gym.task.reference import path_reference
from sffr_gym.task.scenario import load_scenario
from sffr_gym.task.task_model import make_task_model


class Observer:
    """The observation of any state at any time, in an episode that starts at a phase of the circle."""

    def __init__(self, params, phase=0.0):
        self.params = params
        robot = make_task_model(params)
        self.robot = robot._replace(bound=np.full_like(robot.bound, 1000.0))  # nothing is cut off
        self.plants, self.model = Structures([self.robot]), self.robot.model
        self.p, self.v = initial_positions(params, self.model)
        self.reference = path_reference(params, self.model, self.p, phase=phase)
        self.fields = observation_fields(self.model, params)
        self.episode = draw(load_scenario("nominal"), nominal(self.params), np.random.default_rng(0))

    def __call__(self, p, v, tick):
        """Return the observation (n_o,) of positions and velocities at a control tick."""
        batch = make_batch(self.robot, 1)
        put_episode(batch, 0, self.episode._replace(p=p, v=v, reference=self.reference))
        batch.tick[0] = tick
        observe_range(self.plants, batch, np.ones(1, dtype=np.bool_), new_workspace(period_shapes(self.robot)), 0, 1)
        return batch.obs[0]

    def perturbed(self, seed):
        """Positions and velocities off the start."""
        rng = np.random.default_rng(seed)
        return self.p + rng.uniform(-0.2, 0.2, self.p.shape), self.v + rng.uniform(-0.5, 0.5, self.v.shape)


def expected_fields(observer, p, v, t, phase):
    """Every field of the observation, from the definitions of the task and the kinematics in inertial axes."""
    params, model = observer.params, observer.model
    start = Simulator(params).unflatten(0.0, observer.p, observer.v)
    state = Simulator(params).unflatten(t, p, v)
    radius, rate = params.path.radius, params.path.speed / params.path.radius
    turn = rate if params.path.heading == "tangent" else 0.0
    angle, heading = phase + rate * t, turn * t
    carried = start.q[:3] if start.obj is None else start.obj
    centre = carried[:2] + radius * np.array([-np.sin(phase), np.cos(phase)])
    x = centre + radius * np.array([np.sin(angle), -np.cos(angle)])
    xd = radius * rate * np.array([np.cos(angle), np.sin(angle)])
    xdd = radius * rate**2 * np.array([-np.sin(angle), np.cos(angle)])
    axes = rotation(heading)

    def error(offset, actual, actual_rate):
        """Position and velocity error of a point at ``offset`` from the object in the reference axes."""
        r = axes @ offset
        return (x + r - actual) @ axes, (xd + turn * perpendicular(r) - actual_rate) @ axes

    def angle_error(wanted, actual):
        return (wanted - actual + np.pi) % (2 * np.pi) - np.pi

    base, base_rate = error(start.q[:2] - carried[:2], state.q[:2], state.qd[:2])
    tips = [arm_points(model, state.q, state.qd, int(arm))[1] for arm in model.grasp_arm]
    points = [rotation(carried[2]) @ point for point in model.grasp_point]
    grips = [error(point, tip.x, tip.J @ state.qd) for point, tip in zip(points, tips, strict=True)]
    moving = {3 + int(model.arm_first[arm]) + k for arm in model.grasp_arm for k in (0, 1)}
    held = [k for k in range(3, len(state.q)) if k not in moving]
    fields = {
        "base_error": base,
        "yaw_error": angle_error(heading + start.q[2], state.q[2]),
        "base_error_rate": base_rate,
        "yaw_error_rate": turn - state.qd[2],
        "tip_error": [grip[0] for grip in grips],
        "tip_error_rate": [grip[1] for grip in grips],
        "hold_error": angle_error(start.q[held], state.q[held]),
        "joint_angle": angle_error(state.q[3:], 0.0),
        "joint_rate": state.qd[3:],
        "yaw_rate": state.qd[2],
        "elastic": state.qf[:, -3:],
        "elastic_rate": state.qfd[:, -3:],
        "reference_velocity": xd @ axes,
        "reference_turn": turn,
        "reference_acceleration": xdd @ axes,
    }
    if state.obj is not None:
        fields["object_error"], fields["object_error_rate"] = error(np.zeros(2), state.obj[:2], state.objd[:2])
        fields["object_angle_error"] = angle_error(heading + carried[2], state.obj[2])
        fields["object_angle_error_rate"] = turn - state.objd[2]
    return fields


def bent(params, seed):
    """An observer of the robot, and positions and velocities off the path with its panels bent and swinging."""
    observer, rng = Observer(params), np.random.default_rng(seed)
    p, v = observer.p.copy(), observer.v.copy()
    turn = params.path.speed / params.path.radius if params.path.heading == "tangent" else 0.0
    p[:3] += [0.011, -0.013, 0.012]
    v[:3] += [0.02, -0.03, 0.25 + turn]
    if params.object is not None:
        p[-3:-1] += [-0.007, 0.009]
        v[-3:] += [0.03, 0.02, turn]
        close_grasps(observer.model, p)
        match_joint_rates(observer.model, p, v)
    at = mode_slice(observer.model)
    p[at], v[at] = rng.uniform(-0.6, 0.6, p[at].shape), rng.uniform(-0.6, 0.6, v[at].shape)
    return observer, p, v


def command_of(law, observer, p, v):
    """The command (n_u,) of a law for a state at the start, as keywords of the simulator."""
    policy = LawPolicy(law, make_law(law, observer.params))
    command = policy(observer(p, v, 0)) * observer.robot.scale
    volts, base, joints = Simulator(observer.params).split(command)
    return {"base": base, "joints": joints, "piezo_volts": volts}
