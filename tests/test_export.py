"""Files for other tools: linear models as matrices, histories of runs as tables, an evaluation for programs."""

import csv
import importlib.util
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import sffr
from scipy.io import loadmat

import sffr_workbench
from sffr_baselines import make_policy
from sffr_baselines.rollout import result_of, rollout
from sffr_gym import ConfigError, SFFRFlexEnv, Simulator, load_params
from sffr_gym.physics.kinematics import tip_deflections
from sffr_workbench.evaluation import read_episodes


def read_arrays(file):
    with np.load(file) as arrays:
        return dict(arrays)


def test_linearize_writes_the_model_for_numpy(tmp_path):
    file = tmp_path / "model.npz"
    result = sffr("linearize", "--out", file, "--set", "panel.EI=25")
    assert result.exit_code == 0, result.output
    assert "28 states, 15 inputs, 43 outputs" in result.output
    found, model = read_arrays(file), Simulator(load_params().with_overrides("panel.EI=25")).linearize()
    np.testing.assert_array_equal(found["A"], model.A)
    np.testing.assert_array_equal(found["Bd"], model.discrete().B)
    assert found["inputs_names"][6] == "thrust_x"
    assert found["states_units"].tolist() == [label.unit for label in model.states]
    assert found["Ts"] == 2e-3


def test_linearize_writes_the_model_for_matlab(tmp_path):
    file = tmp_path / "model.mat"
    assert sffr("linearize", "--at", "start", "--scenario", "patches", "--out", file).exit_code == 0
    found = loadmat(file, squeeze_me=True)
    assert found["B"].shape == (28, 25)
    assert found["inputs_names"][0] == "left_piezo1"
    assert found["outputs_units"][0] == "m"
    assert found["drift"][0] == pytest.approx(0.85)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--out", "model.csv"], ["model.csv", ".mat or .npz"]),
        (["--set", "initial.q.3=1.9"], ["initial.q"]),
        (["--scenario", "nowhere"], ["nowhere"]),
    ],
)
def test_linearize_says_what_is_wrong(tmp_path, monkeypatch, arguments, words):
    monkeypatch.chdir(tmp_path)
    result = sffr("linearize", *arguments)
    assert result.exit_code == 2
    assert all(word in result.output for word in words)
    assert list(tmp_path.iterdir()) == []


SHORT = "{name: short, description: short, duration: 0.6, panel_modes: [{mode: 1, amplitude: [0.05, 0.2]}]}"
PAGE = Path(__file__).parents[1] / "docs" / "control.md"
LAW = f"{Path(__file__).with_name('hsc_law.py')}:HSC"
SEED = 1_000_000


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Return the folder of an evaluation of a shipped law and a user's, the same one."""
    folder = tmp_path_factory.mktemp("export")
    (folder / "short.yaml").write_text(SHORT)
    where = "--scenario", folder / "short.yaml", "--out", folder / "run"
    assert sffr("evaluate", "hsc", LAW, "ahsc", "-n", 2, "--no-figures", *where).exit_code == 0
    return folder / "run"


def table(file):
    with file.open() as text:
        rows = list(csv.DictReader(text))
    return {name: np.array([float(row[name] or "nan") for row in rows]) for name in rows[0]}


def test_export_has_every_control_period_with_what_the_simulator_says(run, tmp_path):
    assert sffr("export-run", run, "--rate", 500, "--seed", SEED + 1, "-o", tmp_path / "out").exit_code == 0
    found = table(tmp_path / "out" / f"hsc-{SEED + 1}.csv")
    np.testing.assert_allclose(found["time"], 2e-3 * np.arange(300), rtol=0, atol=1e-12)
    env = SFFRFlexEnv(run.parent / "short.yaml")
    expected = rollout(env, make_policy("hsc", env), SEED + 1, stride=1)
    plant = Simulator(expected.episode.plant)
    for row in 0, 17, 299:
        state = plant.unflatten(expected.t[row], expected.p[row], expected.v[row])
        volts, base, joints = plant.split(expected.applied[row])
        command = {"base": base, "joints": joints, "piezo_volts": volts}
        assert found["base_yaw"][row] == state.q[2]
        assert found["arm2_joint1_rate"][row] == state.qd[5]
        assert found["object_y"][row] == state.obj[1]
        assert found["right_tip_slope_rate"][row] == pytest.approx(state.qfd[1, 2], abs=1e-15)
        assert found["left_piezo2"][row] == volts[0, 1]
        assert found["thrust_yaw"][row] == base[2]
        assert found["camera_torque1"][row] == joints[5]
        forces, q_flex = plant.grasp_forces(state, **command), plant.q_flex(state, **command)
        assert found["arm2_grasp_y"][row] == pytest.approx(forces[1, 1], abs=1e-9)
        assert found["panels_moment"][row] == pytest.approx(q_flex[2], abs=1e-9)
    error = np.hypot(found["object_x"] - found["object_x_desired"], found["object_y"] - found["object_y_desired"])
    np.testing.assert_allclose(error[1:], found["object_error"][1:], rtol=0, atol=1e-12)


def test_a_stepped_law_leaves_the_same_history_as_the_compiled_one(run, tmp_path):
    assert sffr("export-run", run, "--all", "-o", tmp_path / "out").exit_code == 0
    for seed in SEED, SEED + 1:
        own, shipped = (table(tmp_path / "out" / f"{name}-{seed}.csv") for name in ("HSC", "hsc"))
        assert own.keys() == shipped.keys()
        for name, values in shipped.items():
            if "damping" not in name:
                np.testing.assert_allclose(own[name], values, rtol=0, atol=1e-9, err_msg=name)
        assert np.isnan(own["left_damping_slope"]).all()


def test_schema_tells_unit_and_frame_of_every_column(run, tmp_path):
    assert sffr("export-run", run, "--policy", "ahsc", "-o", tmp_path / "out").exit_code == 0
    columns = json.loads((tmp_path / "out" / "schema.json").read_text())["columns"]
    names = [each["name"] for each in columns]
    assert names == list(table(tmp_path / "out" / f"ahsc-{SEED}.csv"))
    about = {each["name"]: (each["unit"], each["frame"]) for each in columns}
    assert about["base_x_rate"] == ("m/s", "inertial")
    assert about["left_tip_slope"] == ("rad", "panel")
    assert about["thrust_x"] == ("N", "base")
    assert about["vibration"] == ("J", "-")
    assert {frame for _, frame in about.values()} == {"-", "inertial", "base", "panel", "joint"}
    page = PAGE.read_text(encoding="utf-8")
    for name in "time", "object_phi_desired", "panels_moment", "thrust_yaw":
        assert f"`{name}`" in page


def test_forms_hold_the_same_numbers(run, tmp_path):
    for form in "csv", "mat", "parquet":
        if form == "parquet":
            pytest.importorskip("pyarrow")
        assert sffr("export-run", run, f"--{form}", "--policy", "ahsc", "-o", tmp_path / form).exit_code == 0
    expected = table(tmp_path / "csv" / f"ahsc-{SEED}.csv")
    mat = loadmat(tmp_path / "mat" / f"ahsc-{SEED}.mat", squeeze_me=True)
    assert mat["names"].tolist() == list(expected)
    assert mat["units"][1] == "m" and mat["frames"][1] == "inertial"
    for name, values in expected.items():
        np.testing.assert_array_equal(mat[name], values)
    from pyarrow import parquet

    read = parquet.read_table(tmp_path / "parquet" / f"ahsc-{SEED}.parquet")
    np.testing.assert_array_equal(read["base_y"].to_numpy(), expected["base_y"])
    assert read.schema.field("thrust_x").metadata == {b"unit": b"N", b"frame": b"base"}


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--rate", 300], ["rate = 300", "such as 250"]),
        (["--rate", 0], ["0.0 must be at least 1e-06"]),
        (["--policy", "ahcs"], ["'ahcs'", "did you mean 'ahsc'?"]),
        (["--seed", 7], ["no episode", "7"]),
        (["--csv", "--mat"], ["give one of"]),
    ],
)
def test_export_says_what_is_wrong(run, tmp_path, arguments, words):
    result = sffr("export-run", run, *arguments, "-o", tmp_path / "out")
    assert result.exit_code == 2
    assert all(word in result.output for word in words)


def test_an_episode_that_comes_out_otherwise_is_refused(run, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    file = copy / "episodes.csv"
    file.write_text(file.read_text().replace(f"short,ahsc,{SEED},", f"short,ahsc,{SEED},1"))
    result = sffr("export-run", copy, "--policy", "ahsc", "-o", tmp_path / "out")
    assert result.exit_code == 2 and "comes out otherwise" in result.output
    (tmp_path / "hsc_law.py").write_text(Path(LAW[:-4]).read_text() + "\n# another\n")
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["policy_names"][1] = f"{tmp_path / 'hsc_law.py'}:HSC"
    (copy / "manifest.json").write_text(json.dumps(manifest))
    result = sffr("export-run", copy, "--policy", "HSC", "-o", tmp_path / "out")
    assert result.exit_code == 2 and "not the file" in result.output


def examples():
    return re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)


@pytest.mark.parametrize("code", [code for code in examples() if "matplotlib" not in code])
def test_examples_of_the_page_run(code):
    done = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "nan" not in done.stdout


def test_ten_lines_draw_a_figure_of_the_paper_from_an_exported_file(run, tmp_path, monkeypatch):
    plt = pytest.importorskip("matplotlib.pyplot")
    (code,) = [code for code in examples() if "fig12" in code]
    assert len(code.split("plt\n")[1].strip().splitlines()) <= 10
    monkeypatch.chdir(tmp_path)
    assert sffr("export-run", run, "--policy", "ahsc", "--out", "runs/fig12-export").exit_code == 0
    with plt.rc_context({"backend": "agg"}):
        plt.figure()
        exec(code, {})
        lines = plt.gca().get_lines()
        env = SFFRFlexEnv(run.parent / "short.yaml")
        expected = rollout(env, make_policy("ahsc", env), SEED)
        tips = tip_deflections(env.plant_task.model, expected.p)
        for line, panel in zip(lines, (0, 1), strict=True):
            np.testing.assert_allclose(line.get_xdata(), expected.t, rtol=0, atol=1e-12)
            np.testing.assert_allclose(line.get_ydata(), tips[:, panel], rtol=0, atol=1e-12)
        plt.close()
    assert (tmp_path / "fig12.png").stat().st_size > 5000


def test_evaluation_is_an_object_for_programs_and_notebooks(run):
    found = sffr_workbench.evaluate(["hsc", "ahsc"], run.parent / "short.yaml", 2)
    own = read_episodes(run)
    assert [row["vibration"] for row in found.rows] == [r.measures["vibration"] for r in own if r.policy != "HSC"]
    assert found.table["ahsc"]["cost"] == pytest.approx(1.0)
    frame = found.frame()
    assert len(frame) == 4
    if importlib.util.find_spec("pandas"):
        assert frame["policy"].tolist() == ["hsc", "hsc", "ahsc", "ahsc"]
    text = found._repr_html_()
    assert text.startswith("<table>") and "<th>hsc</th>" in text and "2 episodes" in text
    second = found.trajectory("hsc", SEED + 1, stride=1)
    assert (second.seed, len(second.t)) == (SEED + 1, 300)
    assert result_of(second).measures == found.results["hsc"][1].measures
    assert found.trajectory("hsc") is found.first["hsc"]
    with pytest.raises(ConfigError, match="did you mean 'hsc'"):
        found.trajectory("hcs")
