"""The same robot in MuJoCo on the same circle under the same law: panels of two rigid segments, pinned object."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout

from sffr_gym.physics.beam import N_TIP
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.model import modal
from sffr_gym.types import Array
from sffr_workbench.speed.circle import Controller, Course, Drive
from sffr_workbench.verify import mujoco_robot

SEGMENTS = 2  # hinges per panel: as many bending coordinates as one Hermite element has
SOFTNESS = 1.0e-6  # of the grasps; see sffr_workbench.verify.mujoco_robot
TOLERANCE = 1.0e-8  # of the solver, MuJoCo's default
INTEGRATORS = {"RK4": mujoco.mjtIntegrator.mjINT_RK4, "implicitfast": mujoco.mjtIntegrator.mjINT_IMPLICITFAST}
_PHYSICS, _FORCES = mujoco.mjtState.mjSTATE_FULLPHYSICS.value, mujoco.mjtState.mjSTATE_QFRC_APPLIED.value


class MujocoPlant:
    """The robot at the start of the course.

    Args:
        course: where it starts; its panels must have one element.
        integrator: of ``INTEGRATORS``.
        step: [s], a whole part of the control period.
        tolerance: of the solver for the grasps. A small step starts so near to its solution that the default lets
            the solver do nothing, which leaves an error that no smaller step removes; 0 does not.
    """

    def __init__(self, course: Course, integrator: str, step: float, tolerance: float = TOLERANCE) -> None:
        params = course.params
        self._course, self._steps = course, round(course.plant.period / step)
        self.model, self.data = mujoco_robot.assemble(params, SEGMENTS, SOFTNESS, step)
        self.model.opt.integrator, self.model.opt.tolerance = INTEGRATORS[integrator], tolerance
        joints = mujoco_robot.joint_names(params)
        hinges = [f"panel {i} {k}" for i in range(params.n_panels) for k in range(1, SEGMENTS + 1)]
        self._rigid, self._body, self._hinges = (
            self._places(names) for names in (joints, mujoco_robot.OBJECT_JOINTS, hinges)
        )
        hinge_stiffness = self.model.jnt_stiffness[self._hinges]
        self.model.dof_damping[self._hinges] = params.panel.strain_rate_damping * hinge_stiffness
        # A hinge's turn moves the tip across by its distance from it: (axial, transverse, slope) of the tip per radian.
        size = params.panel.length / SEGMENTS
        levers = params.panel.length - size * (np.arange(SEGMENTS) + 0.5)
        self._tip = np.array([np.zeros(SEGMENTS), levers, np.ones(SEGMENTS)])
        self._start(course)

    def drive(self) -> tuple[Drive, Array]:
        """Drive the whole course under AHSC; also the generalised forces (ticks, nv) of every period.

        The state is afterwards that of the start, for :meth:`replay`.

        Raises:
            RuntimeError: if the simulation blows up.
        """
        course, forces = self._course, np.zeros((self._course.ticks, self.model.nv))
        controller, rigid, tips, total = Controller(course), [], [], 0.0
        start = self._state()
        for tick in range(course.ticks):
            controller(tick, *self._observed())
            forces[tick] = self.data.qfrc_applied[:] = self._forces(controller.applied)
            begun = perf_counter()
            mujoco.mj_step(self.model, self.data, self._steps)
            total += perf_counter() - begun
            if (tick + 1) % course.every == 0:
                rigid.append(np.concatenate([self.data.qpos[self._rigid], self.data.qpos[self._body]]))
                tips.append(self.data.qpos[self._hinges].reshape(-1, SEGMENTS) @ self._tip[1])
        if abs(self.data.time - course.ticks * course.plant.period) > 1e-6:  # it starts again when it diverges
            raise RuntimeError(f"MuJoCo's simulation diverges at a step of {self.model.opt.timestep} s")
        mujoco.mj_setState(self.model, self.data, start, _PHYSICS)
        return Drive(total, np.array(rigid), np.array(tips)), forces

    def replay(self, forces: Array) -> float:
        """Measure the time [s] that recorded forces (periods, nv) take from the present state on, in one call.

        The state is afterwards what it was.
        """
        control = np.repeat(forces, self._steps, axis=0)[None]
        start = self._state()
        states = np.zeros((1, control.shape[1], len(start)))
        begun = perf_counter()
        rollout.rollout(self.model, self.data, start, control, control_spec=_FORCES, state=states)
        elapsed = perf_counter() - begun
        mujoco.mj_setState(self.model, self.data, start, _PHYSICS)
        return elapsed

    def _state(self) -> Array:
        """Return everything that the library's simulation depends on."""
        state = np.zeros(mujoco.mj_stateSize(self.model, _PHYSICS))
        mujoco.mj_getState(self.model, self.data, state, _PHYSICS)
        return state

    def _places(self, names: Any) -> Array:
        """Return the places of scalar joints, the same in positions and velocities of this tree."""
        return np.array([self.model.joint(name).qposadr[0] for name in names])

    def _start(self, course: Course) -> None:
        """Take over the start: rigid coordinates as they are, panels with the same tip deflection and slope."""
        inverse = np.linalg.pinv(self._tip[1:])
        model, n = course.plant.model, len(self._rigid)
        for values, ours in (self.data.qpos, course.p), (self.data.qvel, course.v):
            tips = np.einsum("pfm,pm->pf", model.shapes, ours[n:-3].reshape(model.omega2.shape))[:, -N_TIP:]
            values[self._rigid], values[self._body] = ours[:n], ours[-3:]
            values[self._hinges] = (tips[:, 1:] @ inverse.T).ravel()

    def _observed(self) -> tuple[Array, Array]:
        """Return positions and velocities in the coordinates of our model."""
        model, parts = self._course.plant.model, []
        for values in self.data.qpos, self.data.qvel:
            tips = values[self._hinges].reshape(-1, SEGMENTS) @ self._tip.T
            parts.append(np.concatenate([values[self._rigid], modal(model, tips), values[self._body]]))
        return parts[0], parts[1]

    def _forces(self, applied: Array) -> Array:
        """Return generalised forces of MuJoCo's coordinates for an applied command."""
        K_PZ, forces = self._course.plant.actuators.K_PZ, np.zeros(self.model.nv)
        n_v = K_PZ.shape[0] * K_PZ.shape[2]
        forces[self._rigid] = applied[n_v:]
        forces[self._rigid[:2]] = rotation(self.data.qpos[self._rigid[2]]) @ applied[n_v : n_v + 2]
        tips = np.einsum("pfc,pc->pf", K_PZ, applied[:n_v].reshape(len(K_PZ), -1))
        forces[self._hinges] = (tips @ self._tip).ravel()
        return forces
