"""The robot in Exudyn: rigid bodies and revolute joints in absolute coordinates, panels of ANCF cable elements.

Nothing is shared with the simulator but the numbers of the configuration and the initial positions. The panels are
geometrically exact beams (any displacement, axial and bending strain); the joints are algebraic constraints.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import exudyn as exu
import numpy as np
from exudyn import itemInterface as item

from sffr_gym.config.params import Params
from sffr_gym.config.sections import Panel
from sffr_gym.physics.kinematics import rotation
from sffr_gym.physics.simulator import Simulator
from sffr_gym.types import Array
from sffr_workbench.verify.motion import RECORD, Motion, Piece, panel_displacement, stack

Coordinates = exu.OutputVariableType.Coordinates
Force = exu.OutputVariableType.Force
Position = exu.OutputVariableType.Position


class Robot(NamedTuple):
    """The assembled system and the numbers of its items that are driven or observed.

    Attributes:
        system: Exudyn's main system.
        base_load: number of the force and of the torque on the base.
        torques: (n_l,) pairs of loads, on each link and on the body before it.
        base: sensor; tips, grippers, grasps: sensors of panels, arms and joints to the object.
        obj: sensor, or None; obj_start: (3,) pose from which Exudyn counts its displacement.
    """

    system: Any
    base_loads: tuple[int, int]
    torques: list[tuple[int, int]]
    base: int
    tips: list[int]
    grippers: list[int]
    obj: int | None
    grasps: list[int]
    obj_start: Array


def simulate(params: Params, pieces: Sequence[Piece], elements: int = 16, step: float = 4.0e-3) -> Motion:
    """Run an experiment of ``sffr_workbench.verify.motion``.

    Args:
        params: the robot; ``panel.elements`` and the damping are ignored.
        pieces: the forces.
        elements: ANCF cable elements per panel.
        step: of the generalised-alpha method [s], second order.
    """
    robot = _build(params, elements)
    settings = _settings(elements if params.n_panels else 0)
    rows: list[tuple[Array, ...]] = []
    start = 0.0
    for piece in pieces:
        end = start + piece.duration
        _drive(robot, piece)
        settings.timeIntegration.startTime, settings.timeIntegration.endTime = start, end
        settings.timeIntegration.numberOfSteps = round(piece.duration / step)
        robot.system.SolveDynamic(settings, updateInitialValues=True)
        recorded = _recorded(robot, params, start, end)
        rows += recorded if not rows else recorded[1:]
        start = end
    return stack(rows)


def _settings(elements: int) -> Any:
    settings = exu.SimulationSettings()
    settings.solution.file.write = False
    settings.solution.sensors.writePeriod = RECORD
    settings.linearSolver.solverType = exu.LinearSolverType.EigenSparse
    integration = settings.timeIntegration
    integration.verboseMode = 0
    integration.adaptiveStep = False
    integration.generalizedAlpha.spectralRadius = 0.9  # damps what the step cannot resolve: the axial modes
    # N: rounding of the axial strain times EA, which no residual of a cable falls below; it grows with 1 / length.
    integration.newton.absoluteTolerance = 4.0e-6 * (elements / 8) ** 2 if elements else 1.0e-10
    integration.newton.relativeTolerance = 1.0e-6 if elements else 1.0e-10
    return settings


def _build(params: Params, elements: int) -> Robot:
    start = Simulator(params).initial_state()
    system = exu.SystemContainer().AddSystem()
    base, base_node = _body(system, params.base.mass, params.base.inertia, start.q[:3])
    centre = _marker(system, base, (0.0, 0.0))
    load = system.AddLoad(item.LoadForceVector(markerNumber=centre, loadVector=[0, 0, 0]))
    moment = system.AddLoad(item.LoadTorqueVector(markerNumber=centre, loadVector=[0, 0, 0]))
    ends, torques = _add_arms(system, params, base, start.q)
    panels = zip(params.panel.each, params.panel.mounts, strict=True)
    tips = [_add_panel(system, panel, base, start.q, mount, elements) for panel, mount in panels]
    obj, grasps = None, []
    if params.object is not None and start.obj is not None:
        body, node = _body(system, params.object.mass, params.object.inertia, start.obj)
        obj = _sensor(system, item.SensorNode, Coordinates, nodeNumber=node)
        names = [arm.name for arm in params.arms]
        for grasp in params.object.grasps:
            pins = [_marker(system, body, grasp.point), ends[names.index(grasp.arm)]]
            joint = system.AddObject(item.ObjectJointRevolute2D(markerNumbers=pins))
            grasps.append(_sensor(system, item.SensorObject, Force, objectNumber=joint))
    robot = Robot(
        system, (load, moment), torques,
        base=_sensor(system, item.SensorNode, Coordinates, nodeNumber=base_node),
        tips=[_sensor(system, item.SensorNode, Position, nodeNumber=node) for node in tips],
        grippers=[_sensor(system, item.SensorMarker, Position, markerNumber=end) for end in ends],
        obj=obj, grasps=grasps, obj_start=np.zeros(3) if start.obj is None else start.obj,
    )  # fmt: skip
    system.Assemble()
    return robot


def _body(system: Any, mass: float, inertia: float, pose: Array) -> tuple[int, int]:
    """Add a rigid body with its centre of mass at ``pose`` (3,), and return body and node."""
    node = system.AddNode(item.NodeRigidBody2D(referenceCoordinates=list(pose)))
    return system.AddObject(item.ObjectRigidBody2D(mass=mass, inertia=inertia, nodeNumber=node)), node


def _marker(system: Any, body: int, point: Sequence[float]) -> int:
    """Add a marker at a point (2,) of a body's frame, whose origin is the centre of mass."""
    return system.AddMarker(item.MarkerBodyRigid(bodyNumber=body, localPosition=[*point, 0.0]))


def _sensor(system: Any, kind: Any, variable: Any, **owner: int) -> int:
    return system.AddSensor(kind(storeInternal=True, outputVariableType=variable, **owner))


def _add_arms(system: Any, params: Params, base: int, q: Array) -> tuple[list[int], list[tuple[int, int]]]:
    """Add links and joints; return the marker at the end of each arm and both torque loads of each joint."""
    ends, torques, joint = [], [], 3
    for arm in params.arms:
        before, pin = base, _marker(system, base, arm.mount)
        place, angle = q[:2] + rotation(q[2]) @ arm.mount, q[2] + arm.mount_angle
        for link in arm.links:
            angle += q[joint]
            joint += 1
            along = np.array([np.cos(angle), np.sin(angle)])
            body, _ = _body(system, link.mass, link.inertia, np.append(place + link.com * along, angle))
            near = _marker(system, body, (-link.com, 0.0))
            system.AddObject(item.ObjectJointRevolute2D(markerNumbers=[pin, near]))
            torques.append((_torque(system, body), _torque(system, before)))
            before, pin = body, _marker(system, body, (link.length - link.com, 0.0))
            place = place + link.length * along
        ends.append(pin)
    return ends, torques


def _torque(system: Any, body: int) -> int:
    marker = _marker(system, body, (0.0, 0.0))
    return system.AddLoad(item.LoadTorqueVector(markerNumber=marker, loadVector=[0, 0, 0]))


def _add_panel(system: Any, panel: Panel, base: int, q: Array, mount: Any, elements: int) -> int:
    """Add a straight panel clamped to the base, and return the node at its tip."""
    size, angle = panel.length / elements, q[2] + mount.angle
    along = np.array([np.cos(angle), np.sin(angle)])
    root = q[:2] + rotation(q[2]) @ mount.root
    nodes = [
        system.AddNode(item.NodePoint2DSlope1(referenceCoordinates=[*(root + k * size * along), *along]))
        for k in range(elements + 1)
    ]
    cables = [
        system.AddObject(
            item.ObjectANCFCable2D(
                length=size, massPerLength=panel.mass / panel.length, bendingStiffness=panel.EI,
                axialStiffness=panel.E * panel.area, nodeNumbers=[near, far],
            )
        )
        for near, far in pairwise(nodes)
    ]  # fmt: skip
    frame = np.eye(4)  # of the clamped end, in the base
    frame[:2, :2], frame[:2, 3] = rotation(mount.angle), mount.root
    clamp = [
        system.AddMarker(item.MarkerBodyRigid(bodyNumber=base, localHT=frame)),
        _marker(system, cables[0], (0.0, 0.0)),
    ]
    system.AddObject(item.ObjectJointGeneric(markerNumbers=clamp, constrainedAxes=[1, 1, 0, 0, 0, 1]))
    return nodes[-1]


def _drive(robot: Robot, piece: Piece) -> None:
    system, (load, moment) = robot.system, robot.base_loads
    system.SetLoadParameter(load, "loadVector", [*piece.wrench[:2], 0.0])
    system.SetLoadParameter(moment, "loadVector", [0.0, 0.0, piece.wrench[2]])
    for (on_link, on_before), torque in zip(robot.torques, piece.joints, strict=True):
        system.SetLoadParameter(on_link, "loadVector", [0.0, 0.0, torque])
        system.SetLoadParameter(on_before, "loadVector", [0.0, 0.0, -torque])


def _recorded(robot: Robot, params: Params, start: float, end: float) -> list[tuple[Array, ...]]:
    """Return rows of ``sffr_workbench.verify.motion.stack`` of the last solution."""

    def read(sensor: int) -> Array:
        return np.asarray(robot.system.GetSensorStoredData(sensor))[:, 1:]

    base = read(robot.base)[:, :3]
    k = len(base)
    assert k == round((end - start) / RECORD) + 1, "Exudyn recorded at other times"
    tips = np.array([read(tip)[:, :2] for tip in robot.tips]).reshape(-1, k, 2).swapaxes(0, 1)
    displacement = [panel_displacement(params, pose, places) for pose, places in zip(base, tips, strict=True)]
    grippers = np.array([read(end)[:, :2] for end in robot.grippers]).swapaxes(0, 1)
    obj = np.zeros((k, 0)) if robot.obj is None else robot.obj_start + read(robot.obj)[:, :3]
    lam = np.array([-read(grasp)[:, :2] for grasp in robot.grasps]).reshape(-1, k, 2).swapaxes(0, 1)
    return list(zip(base, np.array(displacement), grippers, obj, lam, strict=True))
