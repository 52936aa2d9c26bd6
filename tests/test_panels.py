"""Panels that differ: what a mount has of its own reaches plant, laws, limits, draws and pictures."""

import numpy as np
import pytest
from oracle import Oracle

from sffr_baselines import make_policy
from sffr_baselines.laws import make_law
from sffr_baselines.rollout import rollout
from sffr_baselines.stability import sampled_growth
from sffr_baselines.suppression import damped_coordinates
from sffr_gym import ConfigError, SFFRFlexEnv, SFFRFlexVectorEnv, load_params
from sffr_gym.physics.actuators import pack_actuators
from sffr_gym.physics.model import joint_slice, modal, mode_slice, pack
from sffr_gym.physics.piezo import thickness
from sffr_gym.physics.simulator import Simulator
from sffr_gym.render.geometry import panel_line

LEFT, RIGHT = "panel.mounts.0.", "panel.mounts.1."
UNLIKE = [LEFT + "mass=6", LEFT + "EI=30", RIGHT + "length=3", RIGHT + "mass=11"]
ALIKE = ["panel.mass=6", "panel.EI=30", "panel.length=3"]
EACH = {"mass": [0.8, 1.2], "length": [0.9, 1.1], "EI": [0.7, 1.3]}


def robot(*overrides):
    return load_params().with_overrides(*overrides)


def test_a_mount_has_what_the_section_has_unless_it_says_otherwise():
    """Mass, length and EI by themselves; panels that are alike are one object, computed once."""
    params = robot(*UNLIKE)
    left, right = params.panel.each
    assert (left.mass, left.length, left.EI) == (6.0, 4.0, 30.0)
    assert (right.mass, right.length, right.EI) == (11.0, 3.0, 20.0)
    assert (
        all(panel is load_params().panel for panel in load_params().panel.each)
        or len({id(panel) for panel in load_params().panel.each}) == 1
    )
    same = robot(LEFT + "mass=9", RIGHT + "EI=20").panel
    assert same.each[0] is same.each[1] is same


def test_all_panels_changed_one_by_one_are_the_panel_changed_for_all():
    """To the last bit, in the arrays of the plant and of every law."""
    one_by_one = robot(*(f"{mount}{key.removeprefix('panel.')}" for mount in (LEFT, RIGHT) for key in ALIKE))
    together = robot(*ALIKE)

    def leaves(value):
        return [leaf for part in value for leaf in leaves(part)] if isinstance(value, tuple) else [value]

    for name in ("ahsc", "lqr-ff", "mpc", "ppf"):
        for left, right in zip(leaves(make_law(name, one_by_one)), leaves(make_law(name, together)), strict=True):
            np.testing.assert_array_equal(left, right)


@pytest.mark.parametrize("name", ["lqr", "mpc"])
def test_a_panel_is_fed_back_as_if_all_were_like_it(name):
    """Even beside one so stiff that of a robot with both the law would leave more coordinates undamped."""
    stiff, soft = robot(RIGHT + "EI=1.0e+6"), robot()
    assert len(damped_coordinates(stiff)) < len(damped_coordinates(soft))
    gains = [make_law(name, params).regulator.gain for params in (stiff, soft)]
    np.testing.assert_array_equal(gains[0][0], gains[1][0])
    assert not np.allclose(gains[0][1], gains[1][1])


@pytest.mark.parametrize("elements", [1, 2])
def test_accelerations_are_those_of_the_lagrangian(elements):
    """Of an independent model, whose elements have each panel's own length, mass and stiffness."""
    params = robot(*UNLIKE, f"panel.elements={elements}", "panel.axial_cut=1e9", "panel.bending_cut=1e9", "object=null")
    oracle, sim = Oracle(params.to_dict()), Simulator(params)
    rng = np.random.default_rng(elements)
    n, n_f = joint_slice(sim.model).stop, 3 * elements
    q, qd = rng.uniform(-1, 1, n), rng.uniform(-1, 1, n)
    qf, qfd = 0.05 * rng.uniform(-1, 1, (2, n_f)), 0.1 * rng.uniform(-1, 1, (2, n_f))
    z, zd = np.concatenate([q, qf.ravel()]), np.concatenate([qd, qfd.ravel()])
    expected = np.linalg.solve(oracle.mass_matrix(z), -oracle.bias(z, zd))
    p, v = (np.concatenate([rigid, modal(sim.model, elastic)]) for rigid, elastic in ((q, qf), (qd, qfd)))
    qdd, qfdd, _ = sim.acceleration(sim.unflatten(0.0, p, v))
    found = np.concatenate([qdd, qfdd.ravel()])
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_clamped_frequencies_are_those_of_each_beam():
    """Of a cantilever: 3.516 sqrt(EI / (m L^3)); as many modes are kept of each."""
    params = robot(*UNLIKE, "panel.elements=4")
    omega = np.sqrt(pack(params).omega2)
    n_axial = pack(params).n_axial
    for i, panel in enumerate(params.panel.each):
        assert omega[i, n_axial] == pytest.approx(3.5160 * np.sqrt(panel.EI / (panel.mass * panel.length**3)), rel=1e-4)
    assert omega.shape == np.sqrt(pack(robot("panel.elements=4")).omega2).shape


def test_energy_and_momentum_are_conserved():
    """Undamped, free, both forms of panels."""
    for more in ([], ["panel.foreshortening=true", "panel.elements=2"]):
        free = ["object=null", "panel.strain_rate_damping=0", "initial.qfd=[0, 0.2, 0]", "initial.qf=[0, 0.1, 0]"]
        sim = Simulator(robot(*UNLIKE, *free, *more))
        state = sim.initial_state()
        energy, momentum = sim.energy(state), sim.momentum(state)
        for _ in range(500):
            state = sim.step(state)
        assert sim.energy(state) == pytest.approx(energy, rel=1e-8)
        np.testing.assert_allclose(sim.momentum(state), momentum, rtol=1e-8, atol=1e-8)


def test_patches_lie_on_the_faces_of_their_own_panel():
    """The stiffer panel of one section is thicker: its pairs bend it more."""
    params = robot(*UNLIKE, "actuators.piezo.array=patches")
    left, right = params.panel.each
    K_PZ = pack_actuators(params, pack(params)).K_PZ
    assert thickness(left) > thickness(right)
    slope = np.abs(K_PZ[:, 2]).max(axis=1)
    assert slope[0] != pytest.approx(slope[1], rel=0.05)


def test_feedforward_tracks_with_the_right_panels_and_not_with_the_mean_ones():
    """Nanometres where the law believes in the panels as they are: in each of them, not in two of a kind."""
    scenario = {"name": "short", "description": "", "duration": 3.0}
    env = SFFRFlexEnv(scenario, overrides=UNLIKE)
    right = rollout(env, make_policy("ahsc-ff", env), seed=0).signals[:, 0]
    wrong = rollout(env, make_policy("ahsc-ff", load_params()), seed=0).signals[:, 0]
    assert np.sqrt(np.mean(right**2)) < 2e-8 < 50.0 * np.sqrt(np.mean(right**2)) < np.sqrt(np.mean(wrong**2))


def test_the_regulator_has_a_gain_for_each_panel():
    """That of a robot all of whose panels are like it; the shape at rest likewise."""
    law = make_law("lqr", robot(*UNLIKE))
    for i, keys in enumerate((["panel.mass=6", "panel.EI=30"], ["panel.length=3", "panel.mass=11"])):
        alone = make_law("lqr", robot(*keys))
        np.testing.assert_array_equal(law.regulator.gain[i], alone.regulator.gain[0])
        np.testing.assert_array_equal(law.regulator.shape[i], alone.regulator.shape[0])
        np.testing.assert_array_equal(law.schedule.omega[i], alone.schedule.omega[0])
        np.testing.assert_array_equal(law.suppression.M_inv[i], alone.suppression.M_inv[0])


def test_the_fastest_growth_of_any_panel_counts():
    """A light panel bears less of a sampled damping than a heavy one."""
    damped, B = np.ones(3), np.array([0.0, 2000.0, 5.0])
    light, heavy = (
        float(sampled_growth(pack(robot(key)), B, damped, 2e-3)) for key in ("panel.mass=3", "panel.mass=9")
    )
    both = float(sampled_growth(pack(robot(RIGHT + "mass=3")), B, damped, 2e-3))
    assert both == light > heavy


def test_an_episode_ends_at_a_part_of_the_panels_own_length():
    """A panel of 3 m may bend by 0.75 m, one of 4 m by 1 m."""
    for side, (mount, limit) in enumerate(((LEFT, 1.0), (RIGHT, 0.75))):
        for share, fails in ((0.99, False), (1.01, True)):
            tips = [[0.0, 0.0, 0.0], [0.0, 0.0, 0.0]]
            tips[side] = [0.0, share * limit, 1.5 * share * limit / (4.0 if mount == LEFT else 3.0)]
            env = SFFRFlexEnv(overrides=[RIGHT + "length=3", f"initial.qf={tips}", "initial.qfd=[0, 0, 0]"])
            env.reset(seed=0)
            assert bool(env.step(np.zeros(15))[-1]["failure"]) is fails, (side, share)


def test_panels_are_drawn_one_by_one(user_scenario):
    """Each has its own factors, in a batch as alone, and the plant is made again of what was drawn."""
    scenario = user_scenario(duration=1.0, plant={"each_panel": EACH, "EI": [0.9, 1.1]})
    env = SFFRFlexEnv(scenario)
    env.reset(seed=4)
    drawn = env.episode.drawn
    names = [f"{side}_panel_{key}_factor" for side in ("left", "right") for key in EACH]
    assert set(names) < set(drawn) and len({drawn[name] for name in names}) == 6
    left, right = env.plant.panel.each
    assert left.length == pytest.approx(4.0 * drawn["left_panel_length_factor"])
    assert right.EI == pytest.approx(20.0 * drawn["right_panel_EI_factor"] * drawn["EI_factor"])
    many = SFFRFlexVectorEnv(9, scenario=scenario)
    many.reset(seed=0)
    action = np.full((9, 15), 0.1)
    for _ in range(5):
        obs = many.step(action)[0]
    env.reset(seed=4)
    for _ in range(5):
        alone = env.step(action[0])[0]
    np.testing.assert_array_equal(obs[4], alone)
    other = SFFRFlexEnv(scenario)
    other.set_state(env.get_state())
    np.testing.assert_array_equal(other.step(action[0])[0], env.step(action[0])[0])


def test_pictures_show_each_panel_at_its_length():
    """Straight from root to tip."""
    params = robot(*UNLIKE)
    model = pack(params)
    p = np.zeros(model.at.end)
    for i, length in enumerate((4.0, 3.0)):
        line = panel_line(model, params, p, i)
        assert np.hypot(*(line[-1] - line[0])) == pytest.approx(length)
    assert mode_slice(model).stop == model.at.object


def test_a_mount_says_what_is_wrong_with_it():
    with pytest.raises(ConfigError, match=r"panel\.mounts\.1\.mass = -1.*mass of this panel, null: panel\.mass \[kg\]"):
        robot(RIGHT + "mass=-1")
