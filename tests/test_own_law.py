"""Laws of one's own: a user's HSC is HSC, what is wrong is told with its line, who does not fit is skipped."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from command_line import sffr

from sffr_baselines import ControlLaw, UnfitError, make_policy
from sffr_baselines.own_law import OwnPolicy
from sffr_baselines.rollout import result_of, rollout, rollouts
from sffr_gym import ConfigError, SFFRFlexEnv
from sffr_gym.config.run_folder import RunFolder
from sffr_gym.task.scenario import load_scenario
from sffr_workbench.benchmark.episodes import Plan, run_episodes, unfit_policies
from sffr_workbench.evaluation import evaluate, read_episodes

HSC = f"{Path(__file__).with_name('hsc_law.py')}:HSC"
SEED = 1_000_000
HEAD = "from sffr_baselines import ControlLaw, UnfitError\nimport numpy as np\n\n"
ZEROS = "        return np.zeros(len(self.limit))\n"


@pytest.fixture
def law(tmp_path):
    """Return what writes a file with a law and returns its name."""

    def write(body, name="mine.py"):
        (tmp_path / name).write_text(HEAD + body, encoding="utf-8")
        return f"{tmp_path / name}:Law"

    return write


def simple(call=ZEROS, more=""):
    return f"class Law(ControlLaw):\n{more}    def __call__(self, obs):\n{call}"


@pytest.fixture(scope="module")
def short():
    """Return an environment with drawn panels and plants that are not the controllers'."""
    return SFFRFlexEnv(load_scenario("mismatch").with_changes(duration=0.6))


def test_hsc_of_a_user_scores_as_hsc_bit_for_bit(short):
    own, shipped = make_policy(HSC, short), make_policy("hsc", short)
    assert isinstance(own, OwnPolicy)
    for seed, side_by_side in zip(range(SEED, SEED + 9), rollouts(short, own, range(SEED, SEED + 9)), strict=True):
        expected = rollout(short, shipped, seed)
        for name in "signals", "tips", "t", "p", "v", "obs", "applied":
            np.testing.assert_array_equal(getattr(side_by_side, name), getattr(expected, name), err_msg=name)
        assert result_of(side_by_side).measures == result_of(expected).measures
        assert side_by_side.drawn == expected.drawn


def test_an_episode_ends_alone_where_it_fails(law):
    """Thrust at full makes each episode fail in its own time; alone it ends as it does beside others."""
    env = SFFRFlexEnv(load_scenario("excited").with_changes(duration=12.0))
    call = "        action = np.zeros(15)\n        action[0:6] = np.sign(obs[41:47])\n        return action\n"
    policy = make_policy(law(simple(call)), env)
    together = list(rollouts(env, policy, range(SEED, SEED + 5)))
    assert len({len(each.signals) for each in together}) > 1
    for seed, each in zip(range(SEED, SEED + 5), together, strict=True):
        alone = rollout(env, policy, seed)
        np.testing.assert_array_equal(each.signals, alone.signals)
        assert each.failure == alone.failure


def test_batch_form_controls_all_episodes_in_one_call(short, law):
    """The same law for rows and for one: the actions of a batch are those of single ones."""
    more = "    batch = True\n    def reset(self, params, simulator, seed):\n        self.n = len(seed)\n"
    rows = simple("        assert obs.shape == (self.n, 52)\n        return 0.001 * obs[:, :15]\n", more)
    one = simple("        assert obs.shape == (52,)\n        return 0.001 * obs[:15]\n")
    a = list(rollouts(short, make_policy(law(rows, "rows.py"), short), range(SEED, SEED + 3)))
    b = list(rollouts(short, make_policy(law(one, "one.py"), short), range(SEED, SEED + 3)))
    for batch, single in zip(a, b, strict=True):
        np.testing.assert_array_equal(batch.signals, single.signals)


def test_each_episode_has_a_law_of_its_own(short, law):
    more = "    def reset(self, params, simulator, seed):\n        self.seed, self.calls = seed, 0\n"
    call = "        self.calls += 1\n        assert self.calls <= 300\n" + ZEROS.replace(
        "np.zeros(len(self.limit))", "np.full(15, 1e-4 * (self.seed % 7))"
    )
    ended = list(rollouts(short, make_policy(law(simple(call, more)), short), [SEED, SEED + 1]))
    expected = [1e-4 * ((SEED + k) % 7) * 100.0 for k in range(2)]  # thrust of a unit action: 100 N
    assert [each.applied[3, 6] for each in ended] == pytest.approx(expected)


def test_what_a_law_is_given_and_what_its_helpers_make(short, law):
    policy = make_policy(law(simple()), short)
    own = policy._law
    assert own.params is short.params
    assert own.period == 2e-3
    obs = np.arange(52.0)
    np.testing.assert_array_equal(own.see(obs, "elastic"), [35, 36, 37, 38, 39, 40])
    assert own.see(np.stack([obs, obs]), "yaw_rate").shape == (2, 1)
    volts, base, joints = np.full((2, 3), 100.0), [1.0, 2.0, 3.0], np.full(6, 0.7)
    np.testing.assert_allclose(own.action(volts, base, joints), [*[0.5] * 6, 0.01, 0.02, 0.03, *[0.1] * 6])
    np.testing.assert_allclose(own.action(joints=joints), [*[0.0] * 9, *[0.1] * 6])
    assert own.action().shape == (15,)
    rows = own.action(volts=np.zeros((4, 2, 3)), base=np.ones((4, 3)))
    np.testing.assert_allclose(rows[:, 6:9], 0.01)


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (simple("        return [1.0, 2.0]\n"), ["mine.py:5", "Law.__call__", "shape (2,); it must be (15,)"]),
        (simple("        return np.full(15, np.nan)\n"), ["mine.py:5", "NaN for left_piezo1"]),
        (simple("        return None\n"), ["mine.py:5", "Law.__call__"]),
        (simple("        return 'left'\n"), ["mine.py:5", "no array of real numbers"]),
        (simple("        return ['0'] * 15\n"), ["mine.py:5", "no array of real numbers"]),
        (simple("        return np.zeros(15) + 1j\n"), ["mine.py:5", "no array of real numbers"]),
        (simple("        return np.ma.masked_all(15)\n"), ["mine.py:5", "no array of real numbers"]),
        (simple("        return [[1.0, 2.0], 3.0]\n"), ["mine.py:5", "no array of real numbers: setting an array"]),
        (simple("        raise SystemExit(0)\n"), ["mine.py:6: Law.__call__: SystemExit: 0"]),
        (simple(more="    def __init__(self):\n        raise SystemExit\n"), ["mine.py:6: Law.__init__: SystemExit"]),
        (simple() + "raise SystemExit\n", ["mine.py:7: import: SystemExit"]),
        (simple(more="    def design(self):\n        pass\n"), ["mine.py:5: Law.design: TypeError"]),
        (simple("        x = 1\n        return obs[99] + x\n"), ["mine.py:7: Law.__call__: IndexError"]),
        (simple(more="    def design(self, params, simulator):\n        1 / 0\n"), ["mine.py:6: Law.design: ZeroDiv"]),
        (simple(more="    def __init__(self):\n        self.x = {}['gain']\n"), ["mine.py:6: Law.__init__: KeyError"]),
        ("class Law(ControlLaw):\n    pass\n", ["define __call__"]),
        ("class Other(ControlLaw):\n    pass\n", ["has no Law", "laws in it: Other"]),
        ("class Law:\n    pass\n", ["Law is no law", "sffr_baselines.ControlLaw"]),
        ("def law(:\n", ["mine.py:4: invalid syntax"]),
        ("x = '\0'\n", ["mine.py: source code string cannot contain null bytes"]),
        ("import nothing_of_that_name\n", ["mine.py:4", "ModuleNotFoundError"]),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_file_and_line(law, body, words):
    result = sffr("evaluate", law(body), "--no-figures")
    assert result.exit_code == 2
    assert all(word in result.output for word in words), result.output


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (",gian=2", ["gian", "it has gain"]),
        (",gain", ["'gain' is no setting", "key=value"]),
        (",gain=[1", ["no YAML value"]),
        (",gain=1,gain=2", ["gain is given twice"]),
        (",gain=2e-3", None),
        ("", None),
        (",gain=[1, 2]", None),
    ],
)
def test_settings_are_those_of_the_constructor(law, short, settings, words):
    name = law(simple(more="    def __init__(self, gain=1.0):\n        self.gain = gain\n")) + settings
    if words is None:
        policy = make_policy(name, short)
        expected = {"": 1.0, ",gain=[1, 2]": [1, 2], ",gain=2e-3": 0.002}  # as in every file of the project
        assert (policy.name, policy._law.gain) == (f"Law{settings}", expected[settings])
        return
    with pytest.raises(ConfigError) as error:
        make_policy(name, short)
    assert all(word in str(error.value) for word in words)


def test_a_missing_file_and_a_module(tmp_path, monkeypatch, law, short):
    law(simple(), "there.py")
    with pytest.raises(ConfigError, match=r"no such file; did you mean 'there\.py'"):
        make_policy(f"{tmp_path}/ther.py:Law", short)
    (tmp_path / "folder.py").mkdir()
    with pytest.raises(ConfigError, match=r"folder\.py: is no file"):
        make_policy(f"{tmp_path}/folder.py:Law", short)
    with pytest.raises(ConfigError, match="no such module"):
        make_policy("nothing.of.that:Law", short)
    (tmp_path / "mypackage").mkdir()
    law(simple(), "mypackage/laws.py")
    monkeypatch.chdir(tmp_path)
    policy = make_policy("mypackage.laws:Law", short)
    assert policy.file == tmp_path / "mypackage" / "laws.py"


def test_nan_within_an_episode_ends_the_command_with_the_line(law, tmp_path):
    more = "    def reset(self, params, simulator, seed):\n        self.k = 0\n"
    call = "        self.k += 1\n        return np.full(15, np.nan if self.k > 30 else 0.0)\n"
    scenario = tmp_path / "short.yaml"
    scenario.write_text("{name: short, description: short, duration: 0.2}", encoding="utf-8")
    result = sffr("evaluate", law(simple(call, more)), "--no-figures", "-s", scenario, "-o", tmp_path / "run")
    assert result.exit_code == 2
    assert "mine.py:7: Law.__call__ returned NaN" in result.output


def test_a_slow_law_is_told_before_it_runs(law, tmp_path):
    scenario = tmp_path / "short.yaml"
    scenario.write_text("{name: short, description: short, duration: 0.02}", encoding="utf-8")
    call = "        import time\n        time.sleep(2e-3)\n" + ZEROS
    result = sffr("evaluate", law(simple(call)), "--no-figures", "-s", scenario, "-o", tmp_path / "run")
    assert result.exit_code == 0, result.output
    assert "note: Law takes 2" in result.output and "ms a call" in result.output


def test_who_does_not_fit_is_skipped_with_the_reason_and_the_hash_is_kept(law, tmp_path):
    scenario = tmp_path / "short.yaml"
    scenario.write_text("{name: short, description: short, duration: 0.2}", encoding="utf-8")
    wheels = simple(more="    def design(self, params, simulator):\n        raise UnfitError('wants wheels')\n")
    fits, unfit = law(simple(), "fits.py"), law(wheels.replace("class Law", "class Wheels")).replace(":Law", ":Wheels")
    folder = tmp_path / "run"
    result = sffr("evaluate", unfit, fits, "none", "-s", scenario, "-o", folder, "--no-figures")
    assert result.exit_code == 0, result.output
    assert "skipped: Wheels: wants wheels" in result.output
    results = read_episodes(folder)
    assert [each.policy for each in results] == ["Law", "none"]
    manifest = json.loads((folder / "manifest.json").read_text())
    assert results[0].file == manifest["policy_files"]["Law"] and len(results[0].file) == 16
    assert results[1].file == ""
    assert manifest["skipped"] == {"Wheels": "Wheels: wants wheels"}
    with (folder / "episodes.csv").open() as file:
        assert next(csv.DictReader(file))["policy_file"] == results[0].file
    assert sffr("evaluate", unfit, "-s", scenario, "--no-figures").exit_code == 2


def test_benchmark_runs_laws_of_ones_own_in_any_number_of_processes(law, tmp_path):
    file = tmp_path / "short.yaml"
    file.write_text(
        "{name: short, description: short, duration: 0.2, panel_modes: [{mode: 1, amplitude: [0.05, 0.2]}]}"
    )
    params, runs = SFFRFlexEnv().params, []
    plan = Plan((HSC, "hsc", "ahsc"), (str(file),), 5, SEED, params)
    for jobs in 1, 2:
        with RunFolder.claim(tmp_path / f"jobs{jobs}", "benchmark", resume=True) as run:
            runs.append(run_episodes(plan, run, jobs))
    assert runs[0] == runs[1]
    own, shipped = runs[0][:5], runs[0][5:10]
    assert [each.measures for each in own] == [each.measures for each in shipped]
    assert {each.file for each in own} == {plan.identity().policies["HSC"]}
    assert own == evaluate([HSC], file, 5, SEED).results["HSC"]
    robot = params.with_overrides("object=null")
    assert "HSC: needs an object" in unfit_policies(plan.policies, [str(file)], robot)[HSC]


def test_a_new_law_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.yaml").write_text("{name: short, description: short, duration: 0.4}")
    assert sffr("new", "law", "mine.py").exit_code == 0
    result = sffr("evaluate", "mine.py:MyLaw", "mine.py:MyLaw,damping=3.0", "-s", "short.yaml", "--no-figures")
    assert result.exit_code == 0, result.output
    assert "MyLaw,damping=3.0" in result.output
    again = sffr("new", "law", "mine.py")
    assert again.exit_code == 2 and "there already" in again.output
    assert sffr("new", "law", "mine.txt").exit_code == 2


def test_base_class_stands_alone():
    """It has no abstract machinery: a law is made by its constructor, and says what to define."""
    with pytest.raises(NotImplementedError, match="define __call__"):
        ControlLaw()(np.zeros(3))
    assert issubclass(UnfitError, ConfigError)
