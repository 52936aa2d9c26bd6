"""What each shipped scenario draws: plant and prior, path speed, sensors, faults, impulses."""

import math

import numpy as np
import pytest
import yaml

from sffr_gym import ConfigError, Simulator
from sffr_gym.config.strict_yaml import config_dir, merge
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.envs.vector import SFFRFlexVectorEnv
from sffr_gym.physics.model import pack
from sffr_gym.physics.monolithic import constraint_jacobian
from sffr_gym.task.episode import draw, nominal
from sffr_gym.task.observation import observation_fields
from sffr_gym.task.scenario import Scenario, load_scenario, scenario_names
from sffr_gym.task.signals import SIGNALS

SEEDS = range(60)
SHIPPED = (
    "degraded excited fast impulse mismatch noise nominal offset patches payload slew sprint thrust truth weak"
).split()
OTHER_PLANT = ("payload", "mismatch", "slew", "weak", "thrust", "truth", "sprint")
LINKS = [
    f"{arm}_link{k}" for arm, n in (("arm1", 2), ("arm2", 2), ("antenna", 1), ("camera", 1)) for k in range(1, n + 1)
]


def episodes(params, scenario, seeds=SEEDS):
    """Return episodes of a scenario, by name or as it is."""
    scenario = scenario if isinstance(scenario, Scenario) else load_scenario(scenario)
    known = nominal(params, scenario)
    return [draw(scenario, known, np.random.default_rng(seed)) for seed in seeds]


def spread(values, low, high):
    """Say whether values lie in a range and reach both of its ends to a tenth."""
    tenth = 0.1 * (high - low)
    return low <= min(values) < low + tenth and high - tenth < max(values) <= high


def user(**keys):
    """Return a scenario of a user."""
    return Scenario(name="mine", description="a test's", **keys)


def test_the_suite_is_complete():
    """The shipped scenarios are those of the task, each named as its file."""
    assert scenario_names() == SHIPPED
    assert [load_scenario(name).name for name in SHIPPED] == SHIPPED


@pytest.mark.parametrize("name", SHIPPED)
def test_drawn_values_are_named_alike_and_tell_the_episodes_apart(params, name):
    """Every draw of a scenario has the same names and plain floats; a seed gives the same draw again."""
    first, again = episodes(params, name), episodes(params, name)
    assert len({tuple(episode.drawn) for episode in first}) == 1
    assert {type(value) for episode in first for value in episode.drawn.values()} <= {float}
    assert [episode.drawn for episode in first] == [episode.drawn for episode in again]
    different = {tuple(episode.drawn.values()) for episode in first}
    assert len(different) == {"nominal": 1, "degraded": 4}.get(name, len(first))


@pytest.mark.parametrize("name", SHIPPED)
def test_start_keeps_the_grasps_of_the_drawn_plant(params, name):
    """Grippers and grasp points agree in place and velocity at the start of every episode."""
    for episode in episodes(params, name, range(5)):
        simulator = Simulator(episode.plant)
        state = simulator.unflatten(0.0, episode.p, episode.v)
        J, _ = constraint_jacobian(simulator.model, state.q, state.qd, state.obj)
        assert simulator.constraint_drift(state) < 1e-13
        assert np.abs(J @ np.concatenate([state.qd, state.objd])).max() < 1e-13


@pytest.mark.parametrize("name", SHIPPED)
def test_plant_and_prior_differ_where_the_scenario_says_so(params, name):
    """The controllers believe the case study; the plant is another one where a scenario says so."""
    for episode in episodes(params, name, range(3)):
        known = episode.prior.to_dict()
        assert known | {"path": 0} == params.to_dict() | {"path": 0}
        assert (episode.prior.path == params.path) == (name not in ("fast", "sprint"))
        assert (episode.plant != episode.prior) == (name in OTHER_PLANT)


def test_fast_flies_the_circle_at_the_drawn_speed(params):
    """Path, robot and object start at the drawn speed, which all know, and an episode is still once around."""
    found = episodes(params, "fast")
    for episode in found:
        speed = episode.drawn["path_speed_m_s"]
        assert episode.reference.rate == speed / 15.0 and episode.prior.path.speed == speed
        assert episode.ticks == math.ceil(2 * math.pi * 15.0 / speed / 2e-3)
        state = Simulator(episode.plant).unflatten(0.0, episode.p, episode.v)
        np.testing.assert_allclose(state.qd, [speed] + [0.0] * 8, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.objd, [speed, 0.0, 0.0], rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.qfd, [[0.0, -0.1, 0.0]] * 2, rtol=0, atol=1e-12)
    assert spread([episode.drawn["path_speed_m_s"] for episode in found], 0.6, 1.2)


def test_a_turning_robot_matches_the_speed_of_a_faster_path(params):
    """With the heading along the path, base and object turn about the object at the drawn rate."""
    turning = params.with_overrides("path.heading=tangent", "path.speed=0.5", "initial.qd=[0,0,0,0,0,0,0,0,0]")
    (episode,) = episodes(turning, user(speed=(1.1, 1.1)), [0])
    rate, reference = 0.6 / 15.0, episode.reference  # of what it is faster than the start that the file gives
    np.testing.assert_allclose(
        episode.v[:3], [0.6 - rate * reference.base_y, rate * reference.base_x, rate], rtol=0, atol=1e-14
    )
    np.testing.assert_allclose(episode.v[-3:], [0.6, 0.0, rate], rtol=0, atol=1e-12)


def test_random_phase_starts_on_the_path_with_the_panels_bent_by_it(params):
    """Robot and object fly along the circle where they start; the panels have the shape of the path's acceleration."""
    still = params.with_overrides("initial.qfd=[0, 0, 0]")
    phases = []
    for episode in episodes(still, user(random_phase=True)):
        phase, model = episode.drawn["path_phase_rad"], pack(still)
        phases.append(phase)
        assert episode.reference.phase == phase
        state = Simulator(still).unflatten(0.0, episode.p, episode.v)
        along = 0.85 * np.array([math.cos(phase), math.sin(phase)])
        np.testing.assert_allclose(state.qd[:2], along, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.objd, [*along, 0.0], rtol=0, atol=1e-12)
        push = (
            -(0.85**2) / 15.0 * math.sin(phase)
        )  # along x, which is across both panels, against the left one's y axis
        compliance = model.translation[0] / model.omega2[0]
        compliance[: model.n_axial] = 0.0
        shape = model.shapes[0] @ compliance
        np.testing.assert_allclose(state.qf, [push * shape, -push * shape], rtol=0, atol=1e-12)
    assert spread(phases, 0.0, 2.0 * math.pi)


def test_payload_scales_mass_and_inertia_of_the_object_together(params):
    """The object is up to twenty times as heavy; nothing else of the plant changes."""
    found = episodes(params, "payload")
    for episode in found:
        factor = episode.drawn["object_factor"]
        assert episode.plant.object.mass == factor * 3.0
        assert episode.plant.object.inertia == factor * 0.5
        assert episode.plant.to_dict() | {"object": 0} == params.to_dict() | {"object": 0}
    assert spread([episode.drawn["object_factor"] for episode in found], 1.0, 20.0)


def test_mismatch_scales_panels_and_links(params):
    """Stiffness and mass of the panels and the mass of every link are drawn apart; a link's inertia goes with it."""
    found = episodes(params, "mismatch")
    links = [link for arm in params.arms for link in arm.links]
    for episode in found:
        drawn, panel = episode.drawn, episode.plant.panel
        assert panel.EI == drawn["EI_factor"] * 20.0
        assert panel.mass == drawn["panel_mass_factor"] * 9.0
        for name, link, plain in zip(LINKS, (k for arm in episode.plant.arms for k in arm.links), links, strict=True):
            factor = drawn[f"{name}_mass_factor"]
            assert (link.mass, link.inertia) == (factor * plain.mass, factor * plain.inertia)
            assert (link.length, link.com) == (plain.length, plain.com)
        model, nominal = pack(episode.plant), pack(params)
        ratio = drawn["EI_factor"] / drawn["panel_mass_factor"]
        np.testing.assert_allclose(model.omega2[:, 1:], ratio * nominal.omega2[:, 1:], rtol=1e-12)
        assert episode.plant.object == params.object
    assert spread([episode.drawn["EI_factor"] for episode in found], 0.7, 1.3)
    assert spread([episode.drawn["panel_mass_factor"] for episode in found], 0.8, 1.2)
    assert spread([episode.drawn[f"{name}_mass_factor"] for episode in found for name in LINKS], 0.9, 1.1)
    assert len({episode.drawn[f"{name}_mass_factor"] for episode in found for name in LINKS}) == len(LINKS) * len(found)


@pytest.mark.parametrize("factor", [0.5, 2.0])
@pytest.mark.parametrize("key", ["EI", "panel_mass"])
def test_a_plant_keeps_the_modes_of_the_prior(params, key, factor):
    """A mode just within the cuts stays there in a stiffer or lighter panel, so that the state keeps its length."""
    many = params.with_overrides("panel.elements=6")
    omega = np.sqrt(pack(many.with_overrides("panel.bending_cut=1.0e+6")).omega2[0])
    n_axial = pack(many).n_axial
    for cut in omega[n_axial + 2] * np.array([0.99, 1.01]):
        known = many.with_overrides(f"panel.bending_cut={cut}")
        (episode,) = episodes(known, user(plant={key: (factor, factor)}), [0])
        assert pack(episode.plant).omega2.shape == pack(known).omega2.shape
        assert pack(episode.plant).n_axial == pack(known).n_axial


def test_noise_levels_follow_the_units(params):
    """Each measured number has the noise of its unit; the reference, which is known, has none; half are late."""
    found = episodes(params, "noise")
    levels = {"m": 1e-4, "rad": 1e-4, "m/s": 5e-4, "rad/s": 5e-4}
    fields = observation_fields(pack(params), params)
    for name, field in fields.items():
        units = [unit.strip() for unit in field.unit.split(",")]
        for k in range(field.size):
            expected = 0.0 if name.startswith("reference") else levels[units[k % len(units)]]
            assert found[0].sensing.level[field.start + k] == expected
    late = [episode.sensing.delay for episode in found]
    assert set(late) == {0, 1} and 0.3 < np.mean(late) < 0.7
    assert [episode.drawn["delay_periods"] for episode in found] == late
    assert len({episode.sensing.key for episode in found}) == len(found)
    assert {(episode.sensing.delay, episode.sensing.key) for episode in episodes(params, "excited")} == {(0, 0)}


def test_each_degraded_episode_has_one_fault(params):
    """Either panel's piezos are dead, or thrusters or joints have a twenty-fifth of their limit; each comes up."""
    faults = {
        (*episode.health.piezo, episode.health.thruster, episode.health.joint)
        for episode in episodes(params, "degraded")
    }
    assert faults == {(0, 1, 1, 1), (1, 0, 1, 1), (1, 1, 0.043, 1), (1, 1, 1, 0.039)}


def test_impulses_act_at_any_time_in_any_direction(params):
    """Three impulses of up to 20 N s and 5 N m s, anywhere in the episode; the drawn values say which."""
    found = episodes(params, "impulse")
    ticks, impulses = np.concatenate([episode.impulses.tick for episode in found]), []
    for episode in found:
        assert episode.impulses.tick.shape == (3,)
        for k, impulse in enumerate(episode.impulses.impulse):
            names = [f"impulse{k}_{name}" for name in ("x_N_s", "y_N_s", "moment_N_m_s")]
            np.testing.assert_array_equal([episode.drawn[name] for name in names], impulse)
            assert episode.drawn[f"impulse{k}_time_s"] == pytest.approx(episode.impulses.tick[k] * 2e-3, rel=1e-12)
            impulses.append(impulse)
    x, y, moment = np.transpose(impulses)
    assert spread(ticks, 0, found[0].ticks - 1)
    assert spread(np.hypot(x, y), 0.0, 20.0)
    assert spread(moment, -5.0, 5.0)
    assert set(np.floor(np.arctan2(y, x) / (np.pi / 2))) == {-2, -1, 0, 1}


@pytest.mark.parametrize(
    ("keys", "override", "message"),
    [
        ({"plant": {"object": (1.0, 2.0)}}, "object=null", "plant.object: the robot carries no object"),
        ({"faults": ({"actuators": "piezo", "remaining": 0.0},)}, "panel.mounts=[]", "no panel whose piezos"),
    ],
)
def test_draws_that_the_robot_cannot_have_are_rejected(params, keys, override, message):
    """A payload without an object and piezos without panels are errors of the scenario."""
    with pytest.raises(ConfigError, match=f"mine: .*{message}"):
        episodes(params.with_overrides(override), user(**keys), [0])


def test_everything_can_be_drawn_at_once(params):
    """A scenario of all draws takes them from one generator, all different."""
    everything: dict = {}
    for name in SHIPPED:
        content = yaml.safe_load((config_dir() / "scenarios" / f"{name}.yaml").read_text(encoding="utf-8"))
        everything = merge(everything, content)
    scenario = Scenario.model_validate(everything)
    (episode,) = episodes(params, scenario, [3])
    names = {name for shipped in SHIPPED for name in episodes(params, shipped, [0])[0].drawn}
    assert set(episode.drawn) == names
    random = [value for value in episode.drawn.values() if value not in (0.0, 0.5, 1.0)]
    assert len(set(random)) == len(random)


def test_the_plant_is_simulated_as_a_robot_of_its_parameters(user_scenario):
    """States, observation, reward and measures are those of an environment whose parameters are the plant's."""
    double = [2.0, 2.0]
    env = SFFRFlexEnv(user_scenario(plant={"EI": double, "panel_mass": double, "link_mass": double, "object": double}))
    masses = [f"{{mass: {2 * mass}, inertia: 1.0, length: 1.0, com: 0.5}}" for mass in (4, 3)]
    changes = ["panel.EI=40", "panel.mass=18", "object.mass=6", "object.inertia=1.0"]
    changes += [f"arms.{arm}.links=[{', '.join(masses)}]" for arm in (0, 1)]
    changes += ["arms.2.links.0.mass=6", "arms.2.links.0.inertia=0.2", "arms.3.links.0.mass=4"]
    changes += ["arms.3.links.0.inertia=0.1", f"panel.axial_cut={1e4 * math.sqrt(0.5)!r}"]
    same, other = SFFRFlexEnv(overrides=changes), SFFRFlexEnv()
    env.reset(seed=0)
    assert env.episode.drawn and env.plant == same.params
    outputs = [[each.reset(seed=0)[0] for each in (env, same, other)]]
    for action in np.random.default_rng(1).uniform(-0.1, 0.1, (30, 15)):
        steps = [each.step(action) for each in (env, same, other)]
        assert steps[0][1] == steps[1][1] != steps[2][1]
        for name in (*SIGNALS, "failure", "cost"):
            assert steps[0][4][name] == steps[1][4][name]
        outputs.append([step[0] for step in steps])
    ours, theirs, nominal = np.swapaxes(outputs, 0, 1)
    np.testing.assert_array_equal(ours, theirs)
    assert (ours != nominal).any()


@pytest.mark.parametrize(
    ("fault", "lost"),
    [("piezo", [slice(0, 3), slice(3, 6)]), ("thruster", [slice(6, 9)]), ("joint", [slice(9, 15)])],
)
@pytest.mark.parametrize("remaining", [0.0, 0.5])
def test_a_fault_cuts_off_what_is_lost_of_the_limit(user_scenario, fault, lost, remaining):
    """An action asks for the same force as ever; what the fault leaves of the limit bounds it, and a dead one is 0."""
    env = SFFRFlexEnv(user_scenario(faults=[{"actuators": fault, "remaining": remaining}]))
    limit = SFFRFlexEnv().prior_task.actuators.limit
    affected = set()
    for seed in range(8):
        env.reset(seed=seed)
        *_, info = env.step(np.full(15, 0.4))
        applied = info["applied"] / limit
        weak = [k for k, places in enumerate(lost) if (applied[places] != 0.4).any()]
        affected |= set(weak)
        env.reset(seed=seed)
        *_, full = env.step(np.ones(15))
        expected = np.ones(15)
        expected[lost[weak[0] if weak else 0]] = remaining
        if remaining == 0.0 or len(lost) == 1:
            np.testing.assert_array_equal(full["applied"] / limit, expected)
        groups = {"piezo": slice(0, 6), "thruster": slice(6, 9), "joint": slice(9, 15)}
        for name, places in groups.items():  # what is dead does not saturate
            assert full[f"{name}_saturated"] == pytest.approx((full["applied"][places] != 0.0).mean())
    assert affected == (set(range(len(lost))) if remaining == 0.0 else set())


def test_a_plant_may_need_other_steps():
    """A lighter panel needs shorter steps of the classical integrator; one alone and those of a batch get them."""
    overrides = ["simulation.integrator=rk4"]
    env = SFFRFlexEnv("mismatch", overrides=overrides)
    batch = SFFRFlexVectorEnv(20, scenario="mismatch", overrides=overrides)
    batch.reset(seed=0)
    together, steps = batch.step(np.zeros((20, 15)))[0], set()
    for seed in range(20):
        env.reset(seed=seed)
        np.testing.assert_array_equal(env.step(np.zeros(15))[0], together[seed])
        steps.add(env.plant_task.steps)
    assert len(steps) > 1
