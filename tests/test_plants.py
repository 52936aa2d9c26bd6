"""Plants from what was drawn: each value moves its own keys, by the rule of mechanics that it stands for."""

import math

import numpy as np
import pytest
from plain_params import flatten

from sffr_gym import ConfigError
from sffr_gym.config.ranges import LARGEST_CUT
from sffr_gym.task.plants import draw_plant, drawn_plant, extreme_plants
from sffr_gym.task.scenario import load_scenario

CHANGES = {  # of factors of 2 or values: the keys that move and what they become, as a factor or a value
    "object_factor": {"object.mass": 2.0, "object.inertia": 2.0},
    "EI_factor": {"panel.EI": 2.0, "panel.bending_cut": math.sqrt(2.0)},
    "panel_mass_factor": {
        "panel.mass": 2.0, "panel.bending_cut": math.sqrt(0.5), "panel.axial_cut": math.sqrt(0.5),
    },
    "piezo_factor": {"actuators.piezo.force": 2.0, "actuators.piezo.moment": 2.0},
    "thruster_factor": {"actuators.thruster_force": 2.0, "actuators.thruster_torque": 2.0},
    "path_speed_m_s": {"path.speed": 2.0},
}  # fmt: skip
VALUES = {
    "minimum_on_time_s": "actuators.modulator.minimum_on_time", "piezo_lag_s": "actuators.lag.piezo",
    "thruster_lag_s": "actuators.lag.thruster", "joint_lag_s": "actuators.lag.joint",
    "piezo_step_V": "actuators.quantisation.piezo", "thruster_force_step_N": "actuators.quantisation.thruster_force",
    "thruster_torque_step_N_m": "actuators.quantisation.thruster_torque",
    "joint_step_N_m": "actuators.quantisation.joint",
}  # fmt: skip


def moved(params, plant):
    """Return the keys that differ, with the values before and after."""
    before, after = flatten(params.to_dict()), flatten(plant.to_dict())
    return {key: (before.get(key), after.get(key)) for key in before | after if before.get(key) != after.get(key)}


def test_nothing_drawn_changes_nothing(params):
    assert drawn_plant(params, {}) == params


@pytest.mark.parametrize("name", CHANGES)
def test_a_factor_moves_its_own_keys(params, name):
    """Cuts go with the frequencies of the modes that they divide: sqrt(EI / m) bending, sqrt(1 / m) axial."""
    value = 2.0 * params.path.speed if name == "path_speed_m_s" else 2.0
    found = {key: after / before for key, (before, after) in moved(params, drawn_plant(params, {name: value})).items()}
    assert found == pytest.approx(CHANGES[name])


@pytest.mark.parametrize("name", VALUES)
def test_a_value_moves_its_own_key(params, name):
    assert {key: after for key, (_, after) in moved(params, drawn_plant(params, {name: 0.03})).items()} == {
        VALUES[name]: 0.03
    }


@pytest.mark.parametrize("kind", ["continuous", "on-off"])
def test_thrusters_are_as_drawn_else_as_they_were(params, kind):
    plain = params.with_overrides(f"actuators.thrusters={kind}")
    for drawn, expected in (
        ({"thrusters_on_off": 1.0}, "on-off"),
        ({"thrusters_on_off": 0.0}, "continuous"),
        ({}, kind),
    ):
        assert drawn_plant(plain, drawn).actuators.thrusters == expected


def test_links_and_panels_of_their_own(params):
    """A link's inertia goes with its mass; a panel's factor acts on what it has beside those of all panels."""
    arm, mount = params.arms[1].name, params.panel.mounts[0].name
    found = moved(params, drawn_plant(params, {f"{arm}_link2_mass_factor": 2.0}))
    assert {key: after / before for key, (before, after) in found.items()} == {
        "arms.1.links.1.mass": 2.0, "arms.1.links.1.inertia": 2.0,
    }  # fmt: skip
    drawn = {f"{mount}_panel_length_factor": 0.5, f"{mount}_panel_EI_factor": 3.0, "EI_factor": 2.0}
    plant = drawn_plant(params, drawn)
    first, second = plant.panel.mounts
    assert (first.own["length"], first.own["EI"]) == (0.5 * params.panel.length, 6.0 * params.panel.EI)
    assert not second.own and plant.panel.EI == 2.0 * params.panel.EI
    again = drawn_plant(plant, {"EI_factor": 2.0, f"{mount}_panel_EI_factor": 1.0})
    assert again.panel.mounts[0].own["EI"] == 12.0 * params.panel.EI


def test_cuts_stay_in_their_range(params):
    """A cut at its upper end divides no modes, whatever the panel."""
    open_ended = params.with_overrides(f"panel.bending_cut={LARGEST_CUT}", f"panel.axial_cut={LARGEST_CUT}")
    panel = drawn_plant(open_ended, {"panel_mass_factor": 0.25}).panel
    assert (panel.bending_cut, panel.axial_cut) == (LARGEST_CUT, LARGEST_CUT)
    panel = drawn_plant(open_ended, {"panel_mass_factor": 4.0}).panel
    assert (panel.bending_cut, panel.axial_cut) == (0.5 * LARGEST_CUT, 0.5 * LARGEST_CUT)


@pytest.mark.parametrize("value", [1e-3, 1e3])
@pytest.mark.parametrize("name", ["EI_factor", "path_speed_m_s"])
def test_what_no_scenario_draws_is_refused(params, name, value):
    with pytest.raises(ValueError, match=f"drawn: {name} = {value}: no scenario draws that"):
        drawn_plant(params, {name: value})
    assert drawn_plant(params, {name: 1.001e-3 if value < 1.0 else 0.999e3})


@pytest.mark.parametrize(("part", "kinds"), [(0.0, (0.0, 0.0)), (0.5, (1.0, 0.0)), (1.0, (1.0, 0.0))])
def test_extreme_plants_lie_at_the_ends(params, part, kinds):
    """Every drawn value at its lower end, then at its upper one; thrusters are on-off below their probability."""
    scenario = load_scenario("nominal").with_changes(
        plant={"EI": (0.5, 2.0), "object": (3.0, 4.0), "lag": {"joint": (0.01, 0.02)}, "on_off": part}
    )
    for k, plant in enumerate(extreme_plants(scenario, params)):
        ends = {"EI_factor": (0.5, 2.0)[k], "object_factor": (3.0, 4.0)[k], "joint_lag_s": (0.01, 0.02)[k]}
        assert plant == drawn_plant(params, ends | {"thrusters_on_off": kinds[k]})


def test_only_what_a_scenario_names_is_drawn(params):
    """In the order of its docstring; without anything, no number is used."""
    rng = np.random.default_rng(0)
    before, drawn = rng.bit_generator.state, {}
    assert draw_plant(load_scenario("nominal"), params, rng, drawn) == params
    assert drawn == {} and rng.bit_generator.state == before
    keys = ("object", "EI", "panel_mass", "link_mass", "piezo", "thruster", "minimum_on_time")
    names = (
        "object_factor",
        "EI_factor",
        "panel_mass_factor",
        "",
        "piezo_factor",
        "thruster_factor",
        "minimum_on_time_s",
    )
    for key, name in zip(keys, names, strict=True):
        drawn = {}
        draw_plant(load_scenario("nominal").with_changes(plant={key: (0.9, 1.1)}), params, rng, drawn)
        links = [f"{arm.name}_link{k + 1}_mass_factor" for arm in params.arms for k in range(len(arm.links))]
        assert list(drawn) == ([name] if name else links) and all(0.9 <= value <= 1.1 for value in drawn.values())
    with pytest.raises(ConfigError, match="carries no object"):
        draw_plant(load_scenario("payload"), params.with_overrides("object=null"), rng, {})
