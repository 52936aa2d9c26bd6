"""Users' files: laid over the shipped one, rejected with their lines, found by name."""

import textwrap

import pytest
from plain_params import LEAVES, SHIPPED, flatten

from sffr_gym.config import strict_yaml
from sffr_gym.config.params import load_params
from sffr_gym.config.strict_yaml import ConfigError, config_dir


def write(folder, text):
    """Write a user's file and return its path."""
    path = folder / "mine.yaml"
    path.write_text(textwrap.dedent(text))
    return path


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
    mount = {"name": "only", "root.0": 0.0, "root.1": 0.0, "angle": 0.0, "mass": None, "length": None, "EI": None}
    expected |= {f"panel.mounts.0.{key}": leaf for key, leaf in mount.items()}
    assert flatten(load_params(path).to_dict()) == expected
    assert load_params(str(path)).n_panels == 1
    assert load_params(write(tmp_path, "{}")) == params


def test_errors_of_a_file_are_all_listed_with_their_lines(tmp_path):
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
        f"{path}:3: panel.EI = -3.0: must be at least 1e-09",
    ]


def test_error_at_a_shipped_key_names_the_file_that_made_it(tmp_path):
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
    """Each is rejected with the file's name and, where there is one, the line."""
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
    """A bare name finds the shipped file; with its ending unless the user has one; anything else is rejected."""
    monkeypatch.chdir(tmp_path)
    assert load_params("sffr") == load_params("sffr.yaml") == load_params(SHIPPED) == params
    with pytest.raises(ConfigError, match=r"^sfr: no such file; did you mean 'sffr'\? \(shipped: .*sffr"):
        load_params("sfr")
    with pytest.raises(ConfigError, match="Is a directory"):
        load_params(tmp_path)
    with pytest.raises(ConfigError, match=r"no such file"):
        load_params("elsewhere/sffr.yaml")
    for other in ("", "../configs/sffr.yaml"):
        with pytest.raises(ConfigError, match=r"no such file"):
            load_params(other)
    (tmp_path / "sffr.yaml").write_text("path: {speed: 2}")
    assert load_params("sffr.yaml").path.speed == 2.0


def test_folder_of_the_shipped_files(tmp_path, monkeypatch):
    """It is the one inside an installed package, or else the one beside the package."""
    (tmp_path / "sffr_gym" / "config").mkdir(parents=True)
    monkeypatch.setattr(strict_yaml, "__file__", str(tmp_path / "sffr_gym" / "config" / "strict_yaml.py"))
    assert config_dir() == tmp_path / "configs"
    (tmp_path / "sffr_gym" / "configs").mkdir()
    assert config_dir() == tmp_path / "sffr_gym" / "configs"
