"""Which values of the parameters are rejected, and in what words."""

import re

import numpy as np
import pytest
from plain_params import PATCHES, TIP, flatten, rejection

from sffr_gym.config.params import Params

POSITIVE = """base.mass base.inertia base.side arms.0.links.1.mass arms.0.links.1.length
    arms.0.links.1.inertia panel.mass panel.length panel.EI panel.area panel.axial_cut panel.bending_cut
    object.mass object.inertia actuators.thruster_force actuators.thruster_torque actuators.joint_torque
    actuators.piezo.force actuators.piezo.moment actuators.piezo.voltage path.radius path.speed control.period
    control.Kp control.Kd suppression.psi simulation.max_step limits.tip limits.arm_singularity limits.grasp_gap
    limits.position limits.angle limits.velocity limits.rate reward.tracking.scale reward.vibration.scale
    reward.effort.scale""".split()

NON_NEGATIVE = """arms.0.links.0.com panel.strain_rate_damping suppression.B0.1 suppression.Gamma.2 simulation.baumgarte
    reward.tracking.weight reward.vibration.weight reward.effort.weight""".split()


@pytest.mark.parametrize("key", POSITIVE)
def test_positive_quantities(params, key):
    """Zero, below, and what is nothing beside the rest is rejected; a thousandth is not."""
    for value in ("0", "-3.0", "1e-300"):
        assert f"{key} = {value}: must be at least " in rejection(params, f"{key}={value}")
    params.with_overrides(f"{key}=1e-3", "arms.0.links.1.com=0", "control.period=1e-6", "path.speed=1e-3")


@pytest.mark.parametrize("key", NON_NEGATIVE)
def test_nonnegative_quantities(params, key):
    """Zero is accepted, below is not."""
    assert f"{key} = -1e-09: must be at least 0 (" in rejection(params, f"{key}=-1e-9")
    assert flatten(params.with_overrides(f"{key}=0").to_dict())[key] == 0.0


@pytest.mark.parametrize(
    ("assignment", "reason"),
    [
        ("panel.E=60.0", r"must be at least 1e\+06 \(.*\[Pa\]\)"),
        ("panel.area=16.0", r"must be at most 1 \(.*\[m2\]\)"),
        ("panel.mounts.0.angle=90", r"must be at most 6\.28\d* \(.*\[rad\]\)"),
        ("arms.2.mount_angle=-180", r"must be at least -6\.28\d* \(.*\[rad\]\)"),
        ("control.period=2.0", r"must be at most 0\.1 \(.*\[s\]\)"),
        ("simulation.max_step=2.0", r"must be at most 0\.1 \(.*\[s\]\)"),
        ("limits.arm_singularity=1", r"must be less than 1 \("),
        ("panel.elements=0", r"must be at least 1 \("),
        ("panel.elements=65", r"must be at most 64 \("),
        ("panel.elements=2.0", r"must be a whole number \("),
        ("arms.0.links.1.com=1.01", r"must be at most the link's length 1 \[m\]"),
        ("path.heading=off", r"must be 'fixed' or 'tangent' \("),
        ("simulation.coupling=both", r"must be 'exact' or 'staggered' \("),
        ("simulation.integrator=euler", r"must be 'etdrk4' or 'rk4' \("),
        ("actuators.piezo.array=none", r"must be 'generalized', 'patches' or 'tip' \("),
        (f"{PATCHES}=[]", r"must have at least 1 entry \("),
        (f"{PATCHES}=[[0.2, 0.1]]", r"must be spans \[from, to\] with 0 <= from < to <= 1"),
        (f"{PATCHES}=[[0.0, 0.2], [0.1, 0.3]]", r"must be spans .*none beginning before the last one ends"),
        (f"{TIP}=[[0.9, 1.1]]", r"must be spans \[from, to\] with 0 <= from < to <= 1"),
        (f"{TIP}=[[-0.1, 0.1]]", r"must be spans \[from, to\] with 0 <= from < to <= 1"),
        ("suppression.coordinates=[]", r"must be auto, all, or a list"),
        ("suppression.coordinates=[q5, q5]", r"must be auto, all, or a list"),
        ("suppression.coordinates=[q5, q7]", r"must be auto, all, or a list"),
        ("suppression.coordinates=q5", r"must be auto, all, or a list"),
        ("suppression.B0=[1, 2]", r"must have 3 entries, has 2 \("),
        ("suppression.Gamma=[1, 2, 3, 4]", r"must have 3 entries, has 4 \("),
        ("arms.0.mount=[1]", r"must have 2 entries, has 1 \("),
        ("arms.0.links=[]", r"must have at least 1 entry \("),
        ("object.grasps=[]", r"must have at least 1 entry \("),
        ("panel=", r"must be a mapping of keys to values \("),
        ("arms={}", r"must be a list \("),
        ("arms.3.name=''", r"must not be empty \("),
        ("arms.3.name=arm2", r"must be unique"),
        ("panel.mounts.1.name=left", r"must be unique"),
        ("object.grasps.0.arm=arm9", r"must be the name of an arm \(arm1, arm2, antenna, camera\)"),
        ("object.grasps.0.arm=camera", r"must be an arm of at least 2 links"),
        ("object.grasps.1.arm=arm1", r"must be another arm"),
        ("initial.q=[0, 0, 0]", r"must have 9 entries, 3 of the base and 6 of the joints, has 3"),
        ("initial.qd=[0, 0, 0]", r"must have 9 entries, 3 of the base and 6 of the joints, has 3"),
        ("initial.qf=[0, 0]", r"must have 3 entries, has 2 \("),
        ("initial.qf=[[0, 0, 0]]", r"must have 3 numbers for all the panels or 2 lists of 3, one for each; has 1"),
        ("initial.qfd=[[0, 0, 0]]", r"must have 3 numbers for all the panels or 2 lists of 3, one for each; has 1"),
        ("initial.qfd=a", r"must be a list \("),
        ("initial.qd=a", r"must be a list \("),
        ('arms.3.name="a\\nb"', r"must consist of characters that can be printed"),
        (f"arms.3.name={'a' * 65}", r"must have at most 64 characters"),
        ("path.speed=20.1", r"must be at most limits\.velocity = 20 \[m/s\]"),
        ("path.radius=0.03", r"must be at least speed\^2 / limits\.velocity = 0\.0361 \[m\]"),
        ("simulation.baumgarte=1001", r"must be at most 1e\+03 \[1/s\] with steps of 0\.002 s"),
        ("control.period=7.0e-3", r"must be less than 0\.006667 \[s\] with Kp = 900 and"),
    ],
)
def test_rejected_values(params, assignment, reason):
    """The message names the override, the key, the value and what is allowed."""
    key = assignment.partition("=")[0]
    assert re.search(
        rf"^override '{re.escape(assignment)}': {re.escape(key)} = .+: {reason}", rejection(params, assignment)
    )


@pytest.mark.parametrize(
    "assignments",
    [
        ("suppression.coordinates=all",),
        ("suppression.coordinates=[q6, q5]",),
        ("initial.qf=[[0, 0.1, 0], [0, -0.1, 0]]",),
        ("panel.mounts=[]",),
        ("panel.mounts=[]", "initial.qf=[]"),
        ("object=null", "arms=[]", "initial.q=[0, 0, 0]", "initial.qd=[0, 0, 0]"),
        ("arms.0.mount_angle=-6.28", "control.period=6.6e-3", "panel.elements=64", "arms.0.links.0.com=1.0"),
        ("control.Kp=1.0e6", "control.period=0.5e-3"),
        ("initial.qd=",),
        ("arms.0.name=\u8155 <b>&'\"", "object.grasps.0.arm=\u8155 <b>&'\""),
    ],
)
def test_accepted_variants(params, assignments):
    """Variants that the checks must let through, and that survive a round trip."""
    variant = params.with_overrides(*assignments)
    assert variant != params
    assert Params.model_validate(variant.to_dict()) == variant


def sampled_loop_radius(Kp, Kd, period):
    """Spectral radius of a double integrator under ``u = -Kp e - Kd ed``, held over a period."""
    free = np.array([[1.0, period], [0.0, 1.0]])
    held = np.array([[period**2 / 2], [period]])
    return np.abs(np.linalg.eigvals(free - held @ [[Kp, Kd]])).max()


@pytest.mark.parametrize(("Kp", "Kd"), [(900.0, 300.0), (1.0e6, 300.0), (2.0e4, 100.0)])
def test_control_period_against_gains(params, Kp, Kd):
    """The longest period is the one at which the sampled error dynamics gets unstable."""
    longest = params.with_overrides(
        f"control.Kp={Kp}", f"control.Kd={Kd}", "control.period=1e-4"
    ).control.longest_period
    assert sampled_loop_radius(Kp, Kd, 0.999 * longest) < 1.0 < sampled_loop_radius(Kp, Kd, 1.001 * longest)


def test_control_period_that_is_too_long_is_rejected(params):
    """The message names the key to blame, the value and the limit."""
    message = rejection(params, "control.Kd=1100")
    assert message.startswith("override 'control.Kd=1100': control.period = 0.002: must be less than 0.001818 [s]")
