"""Overrides: dotted keys, their order, and who is to blame."""

import json

import pytest
from plain_params import rejection

from sffr_gym.config.params import load_params


def test_overrides_are_made_in_turn_and_validated_together(params):
    """Later ones win, partners are checked only at the end, and mappings merge while lists replace."""
    assert params.with_overrides("panel.EI=1", "panel.EI=2").panel.EI == 2.0
    assert params.with_overrides("panel={EI: 3, mass: 2}").panel == params.panel.model_copy(
        update={"EI": 3.0, "mass": 2.0}
    )
    moved = params.with_overrides("arms.1.mount=[1, 2]", " arms.0.links.1.mass = 3.3")
    assert moved.arms[1].mount == (1.0, 2.0)
    assert [link.mass for link in moved.arms[0].links] == [4.0, 3.3]
    assert params == load_params()
    assert params.with_overrides() == params


def test_object_can_be_left_out_and_put_back(params):
    """Null removes the object; a whole one can replace null, a part of it cannot."""
    free = params.with_overrides("object=null")
    assert free.object is None
    whole = f"object={json.dumps(params.to_dict()['object'])}"
    assert free.with_overrides(whole) == params
    assert "there are no keys in 'object', which is null" in rejection(free, "object.mass=3")
    assert "object.grasps: missing" in rejection(free, "object={mass: 3, inertia: 1}")


@pytest.mark.parametrize(
    ("assignment", "reason"),
    [
        ("panel.EI", "must be key=value"),
        ("=3", "must be key=value"),
        ("panel..EI=3", "must be key=value"),
        ("panel.EI=[1,", "cannot be read as YAML"),
        ("panel={EI: 1, EI: 2}", "key 'EI' is given twice"),
        ("suppression.B0=&a [*a]", "refers to itself"),
        ("arms.4.name=a", "arms.4: no such entry; 'arms' has 4, counted from 0"),
        ("arms.\u0661.name=a", "no such entry"),  # a digit of another script
        ("arms.-1.name=a", "arms.-1: no such entry"),
        ("panel.EI.x=3", "panel.EI.x: there are no keys in 'panel.EI', which is 20.0"),
        ("pannel.EI=3", "pannel: unknown key; did you mean 'panel'?"),
        ("control.kp=3", "control.kp: unknown key; did you mean 'Kp'?"),
        ("EI=3", "EI: unknown key; did you mean 'panel.EI'?"),
        ("mass=3", "mass: unknown key (known: base, arms,"),
        ("~=3", "~: unknown key (known: base, arms,"),
        ("panel={1: 2}", "panel.1: keys must be texts"),
        ("arms.0.links.0={masss: 3}", "arms.0.links.0.masss: unknown key; did you mean 'mass'?"),
    ],
)
def test_malformed_overrides(params, assignment, reason):
    """The message names the override and what is wrong with it."""
    message = rejection(params, assignment)
    assert message.startswith(f"override '{assignment}': ")
    assert reason in message


def test_blame_falls_on_the_right_override(params):
    """Each error names the override that made it, or all of them where none did by itself."""
    lines = rejection(params, "panel.EI=-1", "path.speed=2", "path.radius=-2").splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("override 'panel.EI=-1': panel.EI = -1")
    assert lines[1].startswith("override 'path.radius=-2': path.radius = -2")
    lines = rejection(params, "panel={EI: -1}", "arms=[{}]", "suppression.B0=[1]").splitlines()
    assert [line.partition(" (")[0] for line in lines] == [
        *(f"override 'arms=[{{}}]': arms.0.{key}: missing" for key in ("name", "mount", "mount_angle", "links")),
        "override 'panel={EI: -1}': panel.EI = -1: must be at least 1e-09",
        "override 'suppression.B0=[1]': suppression.B0 = [1]: must have 3 entries, has 1",
    ]
    assert rejection(params, "panel.EI=-1", "panel.EI=-2").startswith("override 'panel.EI=-2': panel.EI = -2")
    assert rejection(params, "path.speed=2", "control.Kd=1100").startswith(
        "override 'path.speed=2', override 'control.Kd=1100': control.period = 0.002"
    )


def test_an_invalid_entry_is_told_once(params):
    """And not that a list of one invalid entry has none."""
    message = rejection(params, "object={grasps: [3]}")
    assert "object.grasps.0 = 3: must be a mapping of keys to values" in message and len(message.splitlines()) == 1
