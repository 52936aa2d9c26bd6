"""Loading, validation, overrides and identity of the parameters."""

import json
import math
import pickle
import re
import textwrap

import numpy as np
import pytest
import yaml
from pydantic import BaseModel, ValidationError

from sffr_gym import config
from sffr_gym.params import Base, ConfigError, Params, config_dir, load_params

SHIPPED = config_dir() / "sffr.yaml"
OTHER_WORDS = {"fixed": "tangent", "etdrk4": "rk4", "auto": "all", "exact": "staggered", "generalized": "tip"}
PATCHES, TIP = "actuators.piezo.patches", "actuators.piezo.tip"
# Keys that another one refers to change together with it.
TOGETHER = {
    "arms.0.name": {"arms.0.name": "first", "object.grasps.0.arm": "first"},
    "arms.1.name": {"arms.1.name": "second", "object.grasps.1.arm": "second"},
    "object.grasps.0.arm": {"object.grasps.0.arm": "arm2", "object.grasps.1.arm": "arm1"},
    "object.grasps.1.arm": {"object.grasps.0.arm": "arm2", "object.grasps.1.arm": "arm1"},
    **{
        f"{PATCHES}.{i}.1": {f"{PATCHES}.{i}.1": 0.1 * i + 0.105, f"{PATCHES}.{i + 1}.0": 0.1 * i + 0.105}
        for i in range(3)
    },
    f"{TIP}.0.1": {f"{TIP}.0.1": 0.99},
}


def flatten(tree, prefix=""):
    """Return {dotted key: leaf} of nested mappings and lists."""
    if not isinstance(tree, dict | list):
        return {prefix: tree}
    items = tree.items() if isinstance(tree, dict) else enumerate(tree)
    return {key: leaf for part, value in items for key, leaf in flatten(value, f"{prefix}.{part}".lstrip(".")).items()}


def sections(tree, prefix=""):
    """Return the dotted keys of all the mappings below the root, with their own keys."""
    found = {prefix: list(tree)} if isinstance(tree, dict) else {}
    items = tree.items() if isinstance(tree, dict) else enumerate(tree) if isinstance(tree, list) else ()
    for part, value in items:
        found |= sections(value, f"{prefix}.{part}".lstrip("."))
    return found


def shipped_tree():
    """Return the shipped file as PyYAML's own loader reads it."""
    return yaml.safe_load(SHIPPED.read_text())


def put(tree, key, value):
    """Set the leaf at a dotted key."""
    *parents, last = [int(part) if part.isdecimal() else part for part in key.split(".")]
    for part in parents:
        tree = tree[part]
    tree[last] = value


def other_value(leaf):
    """Return a valid value that differs from a shipped one."""
    if isinstance(leaf, str):
        return OTHER_WORDS.get(leaf, leaf + "2")
    return leaf + 1 if isinstance(leaf, int) else leaf * 1.01 if leaf else 0.01


def write(folder, text):
    """Write a user's file and return its path."""
    path = folder / "mine.yaml"
    path.write_text(textwrap.dedent(text))
    return path


LEAVES = flatten(shipped_tree())
KEYS = [(section, name) for section, names in sections(shipped_tree()).items() for name in names]


@pytest.fixture(scope="module")
def params():
    """Return the shipped case study."""
    return load_params()


def refusal(params, *assignments):
    """Return the message that refuses some overrides."""
    with pytest.raises(ConfigError) as caught:
        params.with_overrides(*assignments)
    return str(caught.value)


def message_or_nothing(params, assignment):
    """Return the message that refuses an override, or nothing."""
    try:
        params.with_overrides(assignment)
    except ConfigError as error:
        return str(error)
    return ""


def test_loaded_values_are_those_of_the_file(params):
    """Nothing is dropped, renamed, converted or added; a plain YAML reader sees the same numbers."""
    assert flatten(params.to_dict()) == LEAVES
    assert len(LEAVES) > 100


def test_no_field_has_a_default_and_every_number_has_a_unit():
    """The file alone holds the values, and messages can name the unit."""

    def check(model):
        for name, field in model.model_fields.items():
            assert field.is_required(), name
            inner = [each for each in models_in(field.annotation)]
            assert field.description if inner else re.search(r"\[.+\]$", field.description), name
            for each in inner:
                check(each)

    def models_in(annotation):
        if isinstance(annotation, type) and issubclass(annotation, BaseModel):
            return [annotation]
        return [found for arg in getattr(annotation, "__args__", ()) for found in models_in(arg)]

    check(Params)


@pytest.mark.parametrize("key", list(LEAVES))
def test_every_key_changes_the_loaded_object(params, key, tmp_path):
    """An override and a file change the value at the key, the same way, and nothing else."""
    changes = TOGETHER.get(key, {key: other_value(LEAVES[key])})
    tree = shipped_tree()
    for each, value in changes.items():
        put(tree, each, value)
    changed = params.with_overrides(*(f"{each}={value!r}" for each, value in changes.items()))
    assert flatten(changed.to_dict()) == LEAVES | changes
    assert changed != params
    assert changed.hash() != params.hash()
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(tree))
    assert load_params(path) == changed


@pytest.mark.parametrize(("section", "name"), KEYS)
def test_misspelled_key_raises_with_the_nearest_name(section, name, tmp_path):
    """Each key of each mapping, with one letter too many, is refused and the right one is suggested."""
    tree = shipped_tree()
    owner = tree
    for part in section.split(".") if section else ():
        owner = owner[int(part) if part.isdecimal() else part]
    wrong = name + name[-1]
    owner[wrong] = owner.pop(name)
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(tree))
    with pytest.raises(ConfigError) as caught:
        load_params(path)
    key = re.escape(f"{section}.{wrong}".lstrip("."))
    assert re.search(rf"mine\.yaml:\d+: {key}: unknown key; did you mean '{name}'\? \(known: ", str(caught.value))


@pytest.mark.parametrize("key", LEAVES)
def test_missing_or_wrongly_typed_value_raises(params, key):
    """No leaf accepts a mapping, a boolean or nothing, and no number accepts a text."""
    for value in ("{}", "true", "null", *(["'1.0'"] if not isinstance(LEAVES[key], str) else [])):
        message = refusal(params, f"{key}={value}")
        assert message.startswith(f"override '{key}={value}': {key} = {value}: must be ")


@pytest.mark.parametrize("key", [key for key, leaf in LEAVES.items() if isinstance(leaf, float)])
def test_numbers_accept_integers_and_refuse_nonfinite(params, key):
    """A float may be written as an integer; NaN and infinity are refused everywhere."""
    assert f"{key} = nan: must be finite" in refusal(params, f"{key}=.nan")
    assert f"{key} = inf: must be finite" in refusal(params, f"{key}=.inf")
    assert f"{key} = inf: must be finite" in refusal(params, f"{key}=1e400")
    assert "must be a number" not in message_or_nothing(params, f"{key}=1")


def test_integer_and_float_give_the_same_object(params):
    """25 and 25.0 are one value, with one hash."""
    whole, real = params.with_overrides("panel.EI=25"), params.with_overrides("panel.EI=25.0")
    assert whole == real
    assert whole.hash() == real.hash()
    assert isinstance(whole.panel.EI, float)


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
    """Zero and below are refused, just above is not."""
    assert f"{key} = 0: must be greater than 0 (" in refusal(params, f"{key}=0")
    assert f"{key} = -3.0: must be greater than 0 (" in refusal(params, f"{key}=-3.0")
    params.with_overrides(f"{key}=1e-3", "arms.0.links.1.com=0", "control.period=1e-6")


@pytest.mark.parametrize("key", NON_NEGATIVE)
def test_nonnegative_quantities(params, key):
    """Zero is accepted, below is not."""
    assert f"{key} = -1e-09: must be at least 0 (" in refusal(params, f"{key}=-1e-9")
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
        ("control.period=7.0e-3", r"must be less than 0\.006667 \[s\] with Kp = 900 and"),
    ],
)
def test_refused_values(params, assignment, reason):
    """The message names the override, the key, the value and what is allowed."""
    key = assignment.partition("=")[0]
    assert re.search(
        rf"^override '{re.escape(assignment)}': {re.escape(key)} = .+: {reason}", refusal(params, assignment)
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


def test_control_period_that_is_too_long_is_refused(params):
    """The message names the key to blame, the value and the limit."""
    message = refusal(params, "control.Kd=1100")
    assert message.startswith("override 'control.Kd=1100': control.period = 0.002: must be less than 0.001818 [s]")


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
    assert "there are no keys in 'object', which is null" in refusal(free, "object.mass=3")
    assert "object.grasps: missing" in refusal(free, "object={mass: 3, inertia: 1}")


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
    message = refusal(params, assignment)
    assert message.startswith(f"override '{assignment}': ")
    assert reason in message


def test_blame_falls_on_the_right_override(params):
    """Each fault names the override that made it, or all of them where none did alone."""
    lines = refusal(params, "panel.EI=-1", "path.speed=2", "path.radius=-2").splitlines()
    assert len(lines) == 2
    assert lines[0].startswith("override 'panel.EI=-1': panel.EI = -1")
    assert lines[1].startswith("override 'path.radius=-2': path.radius = -2")
    lines = refusal(params, "panel={EI: -1}", "arms=[{}]", "suppression.B0=[1]").splitlines()
    assert [line.partition(" (")[0] for line in lines] == [
        *(f"override 'arms=[{{}}]': arms.0.{key}: missing" for key in ("name", "mount", "mount_angle", "links")),
        "override 'panel={EI: -1}': panel.EI = -1: must be greater than 0",
        "override 'suppression.B0=[1]': suppression.B0 = [1]: must have 3 entries, has 1",
    ]
    assert refusal(params, "panel.EI=-1", "panel.EI=-2").startswith("override 'panel.EI=-2': panel.EI = -2")
    assert refusal(params, "path.speed=2", "control.Kd=1100").startswith(
        "override 'path.speed=2', override 'control.Kd=1100': control.period = 0.002"
    )


def test_partial_file_is_laid_over_the_shipped_one(params, tmp_path):
    """Mappings merge at every depth, lists replace whole, and a bare exponent is a number."""
    path = write(
        tmp_path,
        """
        panel: {EI: 3e-4, mounts: [{name: only, root: [0, 0], angle: 0}]}
        actuators:
          piezo: {voltage: 1e2}
        """,
    )
    expected = LEAVES | {"panel.EI": 3e-4, "actuators.piezo.voltage": 100.0}
    expected = {key: leaf for key, leaf in expected.items() if not key.startswith("panel.mounts")}
    mount = {"name": "only", "root.0": 0.0, "root.1": 0.0, "angle": 0.0}
    expected |= {f"panel.mounts.0.{key}": leaf for key, leaf in mount.items()}
    assert flatten(load_params(path).to_dict()) == expected
    assert load_params(str(path)).n_panels == 1
    assert load_params(write(tmp_path, "{}")) == params


def test_faults_of_a_file_are_all_listed_with_their_lines(tmp_path):
    """One line each, with file, line, dotted key, value and what is allowed."""
    path = write(
        tmp_path,
        """\
        panel:
          lenght: 4.0
          EI: -3.0
        arms:
          - name: one
            mount: [0, 0]
            mount_angle: 0
            links:
              - {mass: 1, length: 1, inertia: 1, com: 0}
              - {length: 1, inertia: 1, com: 0}
        """,
    )
    with pytest.raises(ConfigError) as caught:
        load_params(path)
    lines = str(caught.value).splitlines()
    assert sorted(line.partition(" (")[0] for line in lines) == [
        f"{path}:10: arms.0.links.1.mass: missing",
        f"{path}:2: panel.lenght: unknown key; did you mean 'length'?",
        f"{path}:3: panel.EI = -3.0: must be greater than 0",
    ]


def test_fault_at_a_shipped_key_names_the_file_that_made_it(tmp_path):
    """A file whose gains or arms do not fit the shipped rest is blamed, without a line that it does not have."""
    path = write(tmp_path, "control: {Kd: 1100}\narms: []\n")
    with pytest.raises(ConfigError) as caught:
        load_params(path)
    assert str(caught.value).startswith(f"{path}:1: control.period = 0.002: must be less than 0.001818 [s]")
    path = write(tmp_path, "\narms: []\n")
    with pytest.raises(ConfigError) as caught:
        load_params(path)
    assert str(caught.value).startswith(f"{path}: object.grasps.0.arm = 'arm1': must be the name of an arm (there is")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("panel:\n  EI: 3\n  mass: 2\n  EI: 4\n", ":4: cannot be read as YAML: key 'EI' is given twice"),
        ("panel: {}\npanel: {}\n", ":2: cannot be read as YAML: key 'panel' is given twice"),
        ("panel: [1\npath: 2\n", ":2: cannot be read as YAML: "),
        ("panel: &a {mounts: [*a]}\n", ": cannot be read: something in it refers to itself"),
        ("base: !!python/object/apply:os.getcwd []\n", ":1: cannot be read as YAML: "),
        ("base: !!bool maybe\n", ": cannot be read as YAML: "),
        ("base: !!timestamp maybe\n", ": cannot be read as YAML: "),
        ("a: \x00\n", ": cannot be read as YAML: "),
        ("- 1\n", ": must hold a mapping of keys to values, has [1]"),
        ("", ": must hold a mapping of keys to values, has null"),
        ("panel:\n  elements: 010\n", ":2: panel.elements = 10.0: must be a whole number"),
        ("path:\n  speed: 1:30\n", ":2: path.speed = '1:30': must be a number"),
        ("path:\n  heading: yes\n", ":2: path.heading = 'yes': must be 'fixed' or 'tangent'"),
    ],
)
def test_unreadable_files(tmp_path, text, reason):
    """Each is refused with the file's name and, where there is one, the line."""
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as caught:
        load_params(path)
    assert str(caught.value).startswith(f"{path}{reason}")


def test_anchors_and_merge_keys_work(params, tmp_path):
    """A merged key that is given again is no duplicate."""
    path = write(tmp_path, "reward:\n  tracking: &t {weight: 2, scale: 3}\n  effort: {<<: *t, scale: 4}\n")
    reward = load_params(path).reward
    assert (reward.effort.weight, reward.effort.scale, reward.tracking.scale) == (2.0, 4.0, 3.0)
    assert reward.vibration == params.reward.vibration


def test_names_of_shipped_and_missing_files(params, tmp_path, monkeypatch):
    """A bare name finds the shipped file, unless the user has one of that name; anything else is refused."""
    monkeypatch.chdir(tmp_path)
    assert load_params("sffr") == load_params("sffr.yaml") == load_params(SHIPPED) == params
    with pytest.raises(ConfigError, match=r"^sfr: no such file; did you mean 'sffr'\? \(shipped: .*sffr"):
        load_params("sfr")
    with pytest.raises(ConfigError, match=r"no such file"):
        load_params(tmp_path)
    with pytest.raises(ConfigError, match=r"no such file"):
        load_params("elsewhere/sffr.yaml")
    (tmp_path / "sffr.yaml").write_text("path: {speed: 2}")
    assert load_params("sffr.yaml").path.speed == 2.0


def test_folder_of_the_shipped_files(tmp_path, monkeypatch):
    """It is the one inside an installed package, or else the one beside the package."""
    (tmp_path / "sffr_gym").mkdir()
    monkeypatch.setattr(config, "__file__", str(tmp_path / "sffr_gym" / "config.py"))
    assert config_dir() == tmp_path / "configs"
    (tmp_path / "sffr_gym" / "configs").mkdir()
    assert config_dir() == tmp_path / "sffr_gym" / "configs"


def test_objects_are_immutable_hashable_and_pickle(params):
    """No attribute can be set, sequences are tuples, equal objects hash alike."""
    with pytest.raises(ValidationError, match="frozen"):
        params.panel.EI = 3.0
    with pytest.raises(ValidationError, match="frozen"):
        params.object = None
    with pytest.raises(ValidationError, match="extra_forbidden"):
        Base(mass=1.0, inertia=1.0, side=1.0, colour=1.0)
    again = load_params()
    assert again is not params
    assert hash(again) == hash(params) != hash(params.with_overrides("panel.EI=21"))
    assert pickle.loads(pickle.dumps(params)) == params
    assert isinstance(params.arms, tuple)
    assert isinstance(params.initial.q, tuple)


def test_manifest_round_trip(params):
    """The plain form survives JSON, and the short hash depends on the values alone."""
    tree = json.loads(json.dumps(params.to_dict()))
    again = Params.model_validate(dict(reversed(tree.items())))
    assert again == params
    assert again.hash() == params.hash()
    assert re.fullmatch(r"[0-9a-f]{16}", params.hash())


def test_derived_values(params):
    """Counts and the period of the circle follow the stored values."""
    assert (params.n_links, params.n_panels) == (6, 2)
    assert params.path.period == pytest.approx(2 * math.pi * 15.0 / 0.85, rel=1e-15)
    assert "period" not in params.to_dict()["path"]
