"""What the impedance law asks for, from Eqs. 9 and 12 in inertial axes."""

import numpy as np
from observer import expected_fields

from sffr_baselines import make_policy
from sffr_gym.physics.kinematics import perpendicular, rotation
from sffr_gym.physics.simulator import Simulator


class Commanded:
    """What the law asks for at a state, in inertial axes, from the definitions alone.

    Attributes:
        base: (3,) acceleration; tips: (n_g, 2); held: {joint: acceleration}; object: (3,).
        grip: (n_g, 2) force on the object at each gripper, by the pseudo-inverse of the grasp matrix.
        Q: (n,) generalised forces that the law applies.

    """

    def __init__(self, observer, p, v, tick):
        params, model = observer.params, observer.model
        t = tick * params.control.period
        fields = expected_fields(observer, p, v, t, 0.0)
        Kp, Kd = params.control.Kp, params.control.Kd
        turn = fields["reference_turn"]
        axes = rotation(turn * t)
        state = Simulator(params).unflatten(t, p, v)
        forward = axes @ fields["reference_acceleration"]

        def law(error, rate, offset):
            """Return Eq. 12 for a point at an offset from the object's desired position, reference axes."""
            return forward - turn**2 * axes @ offset + axes @ (Kp * np.array(error) + Kd * np.array(rate))

        start = Simulator(params).unflatten(0.0, observer.p, observer.v)
        carried = start.q[:3] if start.obj is None else start.obj
        yaw = Kp * fields["yaw_error"] + Kd * fields["yaw_error_rate"]
        self.base = np.append(law(fields["base_error"], fields["base_error_rate"], start.q[:2] - carried[:2]), yaw)
        points = [rotation(carried[2]) @ point for point in model.grasp_point]
        self.tips = np.array([
            law(*motion) for motion in zip(fields["tip_error"], fields["tip_error_rate"], points, strict=True)
        ])  # fmt: skip
        rates = fields["joint_rate"][observer.robot.held]
        self.held = dict(zip(observer.robot.held, Kp * fields["hold_error"] - Kd * rates, strict=True))
        self.object, self.grip = None, np.zeros((0, 2))
        if state.obj is not None:
            angular = Kp * fields["object_angle_error"] + Kd * fields["object_angle_error_rate"]
            self.object = np.append(law(fields["object_error"], fields["object_error_rate"], np.zeros(2)), angular)
            arms = [rotation(state.obj[2]) @ point for point in model.grasp_point]
            G = np.vstack([np.tile(np.eye(2), len(arms)), np.concatenate([perpendicular(r) for r in arms])])
            inertia = np.array([params.object.mass, params.object.mass, params.object.inertia])
            self.grip = (np.linalg.pinv(G) @ (inertia * self.object)).reshape(-1, 2)
        self.Q = self._applied(observer, state, p, v, tick)

    @staticmethod
    def _applied(observer, state, p, v, tick):
        command = make_policy("none", observer.params)(observer(p, v, tick)) * observer.robot.scale
        volts = observer.robot.actuators.at.thrust
        assert not command[:volts].any()
        return np.concatenate([rotation(state.q[2]) @ command[volts : volts + 2], command[volts + 2 :]])
