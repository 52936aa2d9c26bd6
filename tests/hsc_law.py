"""HSC as a user writes it: multiple impedance control and virtual damping (Eqs. 5 to 13 and 20), on numbers alone."""

from math import cos, pi, sin

import numpy as np

from sffr_baselines import ControlLaw, UnfitError
from sffr_gym.physics.beam import one_element_beam
from sffr_gym.task.reference import path_reference


class HSC(ControlLaw):
    """The paper's law for two-link arms that hold an object, single-link ones that hold their angles, and panels."""

    def design(self, params, simulator):
        if params.object is None or not params.panel.mounts:
            raise UnfitError("needs an object and panels")
        self.model, self.Kp, self.Kd = simulator.model, params.control.Kp, params.control.Kd
        state = simulator.initial_state()
        self.reference = path_reference(params, simulator.model, np.concatenate([*simulator._flat(state)[:1]]))
        self.at = {name: field.start for name, field in self.fields.items()}
        self.holding = {grasp.arm: g for g, grasp in enumerate(params.object.grasps)}
        model = self.model
        self.links = list(
            zip(
                *(a.tolist() for a in (model.link_length, model.link_com, model.link_mass, model.link_inertia)),
                strict=True,
            )
        )
        self.arms, first, held = [], 0, 0
        for arm in params.arms:
            n = len(arm.links)
            grasp = self.holding.get(arm.name)
            if (grasp is None) != (n == 1) or n > 2:
                raise UnfitError(f"{arm.name}: holds with arms of two links, and keeps those of one at their angles")
            self.arms.append((first, n, arm.mount, arm.mount_angle, grasp, held))
            held += grasp is None
            first += n
        self.points = [tuple(grasp.point) for grasp in params.object.grasps]
        self.mass, self.inertia = params.object.mass, params.object.inertia
        beam = one_element_beam(params.panel)
        omega = np.sqrt(np.diag(beam.K) / np.diag(beam.M_ff))
        damped = [k for k in range(3) if omega[k] * self.period < pi / 2]
        gyro, allocation = beam.N - beam.N.T, simulator.actuators.allocation.tolist()
        self.damping = [
            (k, params.suppression.B0[k], beam.c_x[k].item(), beam.M_ff[k].tolist(), gyro[k].tolist()) for k in damped
        ]
        self.panels = [
            (self.at["elastic"] + 3 * i, self.at["elastic_rate"] + 3 * i, allocation[i])
            for i in range(len(params.panel.mounts))
        ]
        self.scale = self.limit.tolist()

    def __call__(self, obs):
        o = obs.tolist()
        command = [*self.volts(o), *self.forces(o)]
        return [value / scale for value, scale in zip(command, self.scale, strict=True)]

    def volts(self, o):
        w = o[self.at["yaw_rate"]]
        w2, twice, volts = w * w, 2.0 * w, []
        for at, rate_at, allocation in self.panels:
            (x, y, slope), (xd, yd, sloped) = o[at : at + 3], o[rate_at : rate_at + 3]
            tau = []
            for k, B, c_x, M, N in self.damping:
                Q_v = w2 * c_x
                Q_v = Q_v + w2 * M[0] * x - twice * N[0] * xd
                Q_v = Q_v + w2 * M[1] * y - twice * N[1] * yd
                Q_v = Q_v + w2 * M[2] * slope - twice * N[2] * sloped
                tau.append((k, -B * o[rate_at + k] - Q_v))
            for row in allocation:
                own = 0.0
                for k, force in tau:
                    own += row[k] * force
                volts.append(own)
        return volts

    def forces(self, o):
        at, ref, Kp, Kd = self.at, self.reference, self.Kp, self.Kd
        turn, a = o[at["reference_turn"]], at["reference_acceleration"]
        axd, ayd = o[a], o[a + 1]
        yaw = ref.yaw - o[at["yaw_error"]]
        cb, sb = cos(yaw), sin(yaw)
        e, ed = at["base_error"], at["base_error_rate"]
        ax = axd - turn * turn * ref.base_x + Kp * o[e] + Kd * o[ed]
        ay = ayd - turn * turn * ref.base_y + Kp * o[e + 1] + Kd * o[ed + 1]
        alpha = Kp * o[at["yaw_error"]] + Kd * o[at["yaw_error_rate"]]
        ax, ay = cb * ax + sb * ay, cb * ay - sb * ax
        w, grips = o[at["yaw_rate"]], self.grips(o, cb, sb)
        cg, sg = cos(ref.phi), sin(ref.phi)
        fx, fy, moment = self.model.base_mass * ax, self.model.base_mass * ay, self.model.base_inertia * alpha
        torques = []
        for first, n, (x, y), angle, grasp, held in self.arms:
            links, rate, chain = self.links[first : first + n], w, []
            for k in range(first, first + n):
                angle += o[at["joint_angle"] + k]
                rate += o[at["joint_rate"] + k]
                chain.append((cos(angle), sin(angle), rate))
            if grasp is None:
                turns = [alpha + (Kp * o[at["hold_error"] + held] - Kd * o[at["joint_rate"] + first])]
                gx = gy = 0.0
            else:
                px, py = self.points[grasp]
                px, py = cg * px - sg * py, sg * px + cg * py
                e, ed = at["tip_error"] + 2 * grasp, at["tip_error_rate"] + 2 * grasp
                tx = axd - turn * turn * px + Kp * o[e] + Kd * o[ed]
                ty = ayd - turn * turn * py + Kp * o[e + 1] + Kd * o[ed + 1]
                tx, ty = cb * tx + sb * ty, cb * ty - sb * tx
                turns = reach(links, chain, x, y, tx - ax, ty - ay, alpha, w)
                gx, gy = grips[grasp]
            px, py = ax - alpha * y - w * w * x, ay + alpha * x - w * w * y
            bodies = []
            for (length, com, mass, inertia), (c, s, rate), turned in zip(links, chain, turns, strict=True):
                w2 = rate * rate
                ux, uy = turned * s + w2 * c, turned * c - w2 * s
                px -= length * ux
                py += length * uy
                bodies.append((length, com, mass, inertia, c, s, ux, uy, turned))
            load, own = 0.0, []
            for length, com, mass, inertia, c, s, ux, uy, turned in reversed(bodies):
                px += length * ux
                py -= length * uy
                mx, my = mass * (px - com * ux), mass * (py + com * uy)
                load += inertia * turned + com * (c * my - s * mx) + length * (c * gy - s * gx)
                own.append(load)
                gx += mx
                gy += my
            torques += own[::-1]
            fx += gx
            fy += gy
            moment += x * gy - y * gx + load
        return [fx, fy, moment, *torques]

    def grips(self, o, cb, sb):
        at, ref, Kp, Kd, n = self.at, self.reference, self.Kp, self.Kd, len(self.points)
        e, ed, a = at["object_error"], at["object_error_rate"], at["reference_acceleration"]
        fx = self.mass * (o[a] + Kp * o[e] + Kd * o[ed])
        fy = self.mass * (o[a + 1] + Kp * o[e + 1] + Kd * o[ed + 1])
        moment = self.inertia * (Kp * o[at["object_angle_error"]] + Kd * o[at["object_angle_error_rate"]])
        fx, fy = cb * fx + sb * fy, cb * fy - sb * fx
        phi = ref.phi - o[at["object_angle_error"]] - ref.yaw + o[at["yaw_error"]]
        c, s = cos(phi), sin(phi)
        points = [(c * x - s * y, s * x + c * y) for x, y in self.points]
        sum_x = sum_y = square = 0.0
        for x, y in points:
            sum_x += x
            sum_y += y
            square += x * x + y * y
        spread = square - (sum_x * sum_x + sum_y * sum_y) / n
        twist = (moment - (sum_x * fy - sum_y * fx) / n) / spread if n > 1 else 0.0
        push_x, push_y = (fx + twist * sum_y) / n, (fy - twist * sum_x) / n
        return [(push_x - twist * y, push_y + twist * x) for x, y in points]


def reach(links, chain, x, y, tx, ty, alpha, w):
    """Return the angular accelerations of two links whose tip accelerates by (tx, ty) relative to the base."""
    rx, ry = tx + alpha * y + w * w * x, ty - alpha * x + w * w * y
    (l1, *_), (l2, *_) = links
    (c1, s1, w1), (c2, s2, w2) = chain
    rx += w1 * w1 * (l1 * c1)
    ry += w1 * w1 * (l1 * s1)
    rx += w2 * w2 * (l2 * c2)
    ry += w2 * w2 * (l2 * s2)
    ux, uy = -(l2 * s2), l2 * c2
    nx, ny = -l1 * s1, l1 * c1
    det = nx * uy - ny * ux
    return (rx * uy - ry * ux) / det, (nx * ry - ny * rx) / det
