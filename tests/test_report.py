"""`sffr report`: what the page is told, and what is an error."""

import base64
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from importlib import resources

import numpy as np
import pytest
from command_line import sffr
from report_runs import SEED, made_up, made_up_run, run

from sffr_baselines import make_policy
from sffr_baselines.rollout import rollout
from sffr_gym.envs.single import SFFRFlexEnv
from sffr_gym.physics.kinematics import modal_tip_deflections
from sffr_gym.physics.model import mode_slice, pack
from sffr_gym.render.geometry import panel_line, place_in_panel
from sffr_gym.task.signals import ERROR, VIBRATION
from sffr_workbench.evaluation.recording import RECORDINGS, Recording
from sffr_workbench.figures.style import POLICY_COLOURS
from sffr_workbench.report.page import REPORT_FILE, SCRIPTS, STYLES, report_page, write_report
from sffr_workbench.report.replay import columns_of, episode_data, group_by_episode
from sffr_workbench.report.runs import read_run, score_table
from sffr_workbench.report.spectrum import GROUPS, SHARES, mode_frequencies, spectrum, use_of_limits

pytest.importorskip("jinja2")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A run of two laws and one policy that is no law, in two episodes."""
    folder = tmp_path_factory.mktemp("runs") / "three"
    run(folder, ["none", "ahsc", "random"])
    return folder


@pytest.fixture(scope="module")
def recording():
    env = SFFRFlexEnv("excited")
    return Recording.of(rollout(env, make_policy("ahsc", env), SEED))


@pytest.fixture(scope="module")
def text(folder):
    return report_page([read_run(folder)])


def embedded(text):
    """The episodes that a page holds."""
    found = re.search(r'<script type="application/json" id="episodes">(.*?)</script>', text, re.DOTALL)
    return json.loads(found[1])


def columns(policy, name):
    """A name's columns (rows, k) of a policy's embedded table."""
    values = np.frombuffer(base64.b64decode(policy["table"]), "<f4").reshape(policy["rows"], policy["width"])
    start, width = policy["layout"][name]
    return values[:, start : start + width]


def test_page_holds_what_was_recorded(text, folder):
    (episode,) = embedded(text)
    assert [policy["name"] for policy in episode["policies"]] == ["none", "ahsc", "random"]
    for policy, recording in zip(episode["policies"], read_run(folder).recordings, strict=True):
        np.testing.assert_allclose(columns(policy, "base"), recording.p[:, :3], rtol=1e-6)
        np.testing.assert_allclose(columns(policy, "energy")[:, 0], recording.signals[:, VIBRATION], rtol=1e-6)
        np.testing.assert_allclose(columns(policy, "error")[:, 0], recording.signals[:, ERROR], rtol=1e-6)
        assert policy["step"] == pytest.approx(0.05) and policy["failure"] == recording.failure
    assert [policy["rows"] for policy in episode["policies"]][:2] == [81, 81]
    assert episode["policies"][2]["failure"] and episode["policies"][2]["rows"] < 81
    assert not np.isfinite(columns(episode["policies"][2], "damping")).any()


def test_page_draws_panels_as_the_pictures_do(recording):
    """The robot's shape and the table give the line that the renderer draws."""
    data = episode_data({"ahsc": recording}, {"ahsc": "#000000"})
    row, factor, model = 300, 5.0, pack(recording.plant)
    modes = columns(data["policies"][0], "modes")[row].reshape(2, -1)
    for k, panel in enumerate(data["robot"]["panels"]):
        bent = factor * np.array(panel["shapes"]) @ modes[k]
        mine = place_in_panel(model, recording.p[row], k, np.column_stack([panel["x"], bent]))
        p = recording.p[row].copy()
        axial = np.zeros((2, model.omega2.shape[1]))
        axial[:, : model.n_axial] = p[mode_slice(model)].reshape(axial.shape)[:, : model.n_axial]
        p[mode_slice(model)] -= axial.ravel()  # the page leaves micrometres along the panel out
        np.testing.assert_allclose(mine, panel_line(model, recording.plant, p, k, factor, 32), atol=1e-6)


def test_page_asks_the_network_for_nothing(text):
    class Addresses(HTMLParser):
        found = ()

        def handle_starttag(self, tag, attrs):
            self.found += tuple(value for name, value in attrs if name in ("src", "href", "srcset", "action"))

    parser = Addresses()
    parser.feed(text)
    assert all(value.startswith("data:") for value in parser.found)
    assert "default-src 'none'" in text and "@import" not in text
    assert not re.search(r"\b(fetch|XMLHttpRequest|WebSocket|import)\s*\(", text)


def test_page_is_safe_from_names(folder, tmp_path):
    """A policy or command with markup in it stays text."""
    copy = tmp_path / "<b>run"
    shutil.copytree(folder, copy)
    manifest = json.loads((copy / "manifest.json").read_text())
    manifest["command"] = "</script><script>alert(1)</script>"
    (copy / "manifest.json").write_text(json.dumps(manifest))
    text = report_page([read_run(copy)])
    assert "<script>alert" not in text and "<b>run" not in text and "&lt;b&gt;run" in text


def test_every_script_and_style_is_in_the_page(text):
    shipped = {file.name for file in (resources.files("sffr_workbench.report") / "templates").iterdir()}
    assert shipped == {*SCRIPTS, *STYLES, "report.html"}
    for name in (*SCRIPTS, *STYLES):
        content = (resources.files("sffr_workbench.report") / "templates" / name).read_text(encoding="utf-8")
        assert content in text and "</script" not in content


def test_scores_are_means_in_the_heads_units():
    group = {"none": [made_up("none", 0.02), made_up("none", 0.04)], "ahsc": [made_up("ahsc", 0.001)] * 2}
    scores = score_table("made-up", group)
    heads = [head for head, _ in scores.heads]
    vibration, tracking = heads.index("vibration"), heads.index("tracking, rms")
    assert scores.heads[vibration][1] == "mJ" and scores.heads[tracking][1] == "µm"
    assert scores.title == "made-up: 2 episodes of each policy"
    rows = {policy: cells for policy, cells, _ in scores.rows}
    assert rows["none"][vibration].text == "30.0" and rows["ahsc"][vibration].text == "1.00"
    assert rows["ahsc"][0].text == "1.00" and rows["ahsc"][vibration].share == pytest.approx(1 / 30)
    assert (
        scores.verdict == "ahsc keeps the panels calmest: 1.00 mJ of vibration on average, 30.0 times less than none."
    )


def test_many_scenarios_have_an_overview():
    energies = {"one": {"none": 2e-3, "ahsc": 1e-3}, "two": {"none": 4e-3, "ahsc": 1e-3, "hsc": 2e-3}}
    results = [
        replace(made_up(policy, energy), scenario=name)
        for name, each in energies.items()
        for policy, energy in each.items()
    ]
    table = made_up_run("many", results).overview
    assert [head for head, _ in table.heads] == ["one", "two"]
    costs = {policy: [cell.text for cell in cells] for policy, cells, _ in table.rows}
    assert costs == {"none": ["1.60", "2.80"], "ahsc": ["1.00", "1.00"], "hsc": ["", "1.60"]}
    assert table.verdict == "" and made_up_run("one", results[:2]).overview is None
    assert made_up_run("no reference", [results[0], results[2]]).overview is None


def test_page_of_a_benchmark_shows_its_costs():
    text = report_page(
        [made_up_run("many", [replace(made_up("ahsc", 1e-3), scenario=name) for name in ("one", "two")])]
    )
    assert "cost in each scenario" in text and "one: 1 episode of each policy" in text


def test_verdict_leaves_out_what_failed():
    group = {"ahsc": [made_up("ahsc", 0.5)], "hsc": [made_up("hsc", 1.0)], "wild": [made_up("wild", 0.1, "lost grasp")]}
    assert score_table("made-up", group).verdict.startswith("ahsc keeps the panels calmest")
    assert score_table("made-up", {"ahsc": group["ahsc"]}).verdict == ""


def test_spectrum_finds_a_vibration(recording):
    """A sine of a known amplitude: its frequency, and its power as the integral."""
    t = recording.period * np.arange(len(recording.tips))
    tips = 0.1 * np.sin(2 * np.pi * 0.7 * t)[:, None] * [1.0, 0.5]
    found = spectrum(Recording(**vars(recording) | {"tips": tips}))
    f, psd = np.array(found["f"]), np.array(found["psd"])
    assert f[psd[0].argmax()] == pytest.approx(0.7, rel=0.03)
    np.testing.assert_allclose(psd[0] / psd[1], 4.0, rtol=1e-3)
    near = (f > 0.6) & (f < 0.8)
    assert np.trapezoid(psd[0][near], f[near]) == pytest.approx(0.1**2 / 2, rel=0.1)


def test_spectrum_of_free_panels_peaks_at_the_first_mode():
    env = SFFRFlexEnv("excited")
    recording = Recording.of(rollout(env, make_policy("none", env), SEED))
    found, first = spectrum(recording), mode_frequencies(recording)[0]
    f = np.array(found["f"])
    for psd in np.array(found["psd"]):
        swinging = f > 0.05
        assert f[swinging][psd[swinging].argmax()] == pytest.approx(first, rel=0.2)


def test_short_episode_has_no_spectrum(recording):
    found = spectrum(Recording(**vars(recording) | {"tips": recording.tips[:50]}))
    assert found == {"f": [], "psd": [[], []]}
    for rows, there in (300, False), (500, True):  # four periods of 20 Hz take 400 rows at a period of 0.5 ms
        found = spectrum(Recording(**vars(recording) | {"tips": recording.tips[:rows], "period": 5.0e-4}))
        assert bool(found["f"]) == there


def test_use_counts_every_command_once(recording):
    use = use_of_limits(recording)
    assert use.keys() == set(GROUPS)
    for shares in use.values():
        assert len(shares) == len(SHARES) + 1 and sum(shares) == pytest.approx(1.0, abs=1e-3)
        assert shares[-1] == 0.0
    busy = Recording(**vars(recording) | {"applied": np.tile(recording.limit, (len(recording.t), 1))})
    assert all(shares[-1] == 1.0 for shares in use_of_limits(busy).values())
    half = Recording(**vars(recording) | {"applied": np.tile(0.5 * recording.limit, (len(recording.t), 1))})
    assert all(shares[-2] == 1.0 for shares in use_of_limits(half).values())


def test_dead_actuators_are_left_out(recording):
    limit = recording.limit.copy()
    limit[:3] = 0.0
    applied = np.tile(limit, (len(recording.t), 1))
    assert use_of_limits(Recording(**vars(recording) | {"applied": applied, "limit": limit}))["piezo"][-1] == 1.0


def test_same_policy_of_two_runs_keeps_apart(recording):
    other = Recording(**vars(recording) | {"policy": "none"})
    away = Recording(**vars(recording) | {"seed": 7})
    groups = group_by_episode([("one", recording), ("one", other), ("two", recording), ("two", away)])
    assert [list(members) for members in groups] == [["ahsc (one)", "none", "ahsc (two)"], ["ahsc"]]


@pytest.mark.parametrize("change", ["plant", "limit", "start"])
def test_episodes_of_other_robots_are_not_put_together(recording, change):
    """Scenarios of the same name may differ in the plant, in what its actuators can give, and in the start."""
    start = recording.p.copy()
    start[0, 0] += 0.1
    other = {
        "plant": {"plant": recording.plant.with_overrides("panel.EI=25")}, "limit": {"limit": 0.5 * recording.limit},
        "start": {"p": start},
    }[change]  # fmt: skip
    changed = Recording(**vars(recording) | {"policy": "none"} | other)
    assert [list(members) for members in group_by_episode([("one", recording), ("two", changed)])] == [
        ["ahsc"],
        ["none"],
    ]


def test_page_shows_the_robot_of_the_episode(tmp_path):
    """Frequencies and limits are those of the drawn plant and its fault, not of the parameters."""
    file = tmp_path / "weak.yaml"
    file.write_text(
        "{name: weak, description: A test's., duration: 0.5, plant: {EI: [0.5, 0.5]}, "
        "faults: [{actuators: thruster, remaining: 0.25}]}"
    )
    env = SFFRFlexEnv(str(file))
    recording = Recording.of(rollout(env, make_policy("none", env), SEED))
    nominal = Recording(**vars(recording) | {"plant": env.params})
    first, usual = (mode_frequencies(each)[0] for each in (recording, nominal))
    assert recording.plant.panel.EI == 0.5 * env.params.panel.EI and first == pytest.approx(usual * 0.5**0.5, rel=0.01)
    assert episode_data({"none": recording}, {"none": "#000000"})["robot"]["frequencies"][0] == first
    np.testing.assert_array_equal(recording.limit[6:9], [25.0, 25.0, 25.0])


def test_recordings_of_another_plant_path_or_scenario_keep_apart(recording):
    heavier = recording.plant.with_overrides("panel.mass=10")
    others = [
        {"plant": heavier}, {"scenario": "other"}, {"reference": recording.reference._replace(phase=1.0)},
        {"reference": recording.reference._replace(rate=0.1)}, {"reference": recording.reference._replace(radius=9.0)},
        {"reference": recording.reference._replace(turning=1.0)},
    ]  # fmt: skip
    all_of_them = [recording, *(Recording(**vars(recording) | changes) for changes in others)]
    groups = group_by_episode([("run", each) for each in all_of_them])
    assert [list(members.values()) for members in groups] == [[each] for each in all_of_them]


def test_each_policy_has_its_own_colour(recording):
    colours = {"none": "#111111", "ahsc": "#222222", "hsc": "#333333"}
    data = episode_data({"ahsc": recording, "none": Recording(**vars(recording) | {"policy": "none"})}, colours)
    assert {policy["name"]: policy["colour"] for policy in data["policies"]} == {"ahsc": "#222222", "none": "#111111"}


def test_grasp_forces_carry_the_object(recording):
    """Arrows point as the grippers push: the object's momentum changes by the sum of their forces over time."""
    found = columns_of(recording, pack(recording.plant))
    forces, place = found["grasp"].reshape(len(recording.t), -1, 2).sum(axis=1), found["object"][:, :2]
    step = recording.t[1]
    velocity = np.diff(place, axis=0) / step
    change = recording.plant.object.mass * (velocity[-1] - velocity[0])
    np.testing.assert_allclose(forces[1:-1].sum(axis=0) * step, change, atol=0.05 * np.abs(change).max())


def test_quasi_static_shape_is_near_a_calmed_panel(recording):
    """Dashed: what AHSC's panels settle to."""
    found = columns_of(recording, pack(recording.plant))
    late = recording.t > 40.0
    modes, rest = (found[name][late].reshape(-1, 2, 3)[:, :, 1] for name in ("modes", "rest"))
    away = modes - rest
    still = modal_tip_deflections(pack(recording.plant), found["rest"].reshape(-1, 2, 3))
    np.testing.assert_allclose(found["tips"] - found["swing"], still, atol=1e-12)  # m
    assert np.sqrt(np.mean(away**2)) < 0.2 * np.sqrt(np.mean(rest**2))


def test_command_writes_one_file(folder):
    result = sffr("report", folder)
    assert result.exit_code == 0, result.output
    assert f"{REPORT_FILE}: " in result.stdout and "MB" in result.stdout
    assert sffr("report", folder).exit_code == 2 and "--overwrite" in sffr("report", folder).output
    assert sffr("report", folder, "--overwrite", "--quiet").stdout == ""
    assert (folder / REPORT_FILE).read_text(encoding="utf-8") == report_page([read_run(folder)])


def test_several_runs_make_one_page(folder, tmp_path):
    run(tmp_path / "other", ["hsc", "ahsc"], episodes=1)
    run(tmp_path / "again", ["hsc"], episodes=1, name="long", seed=SEED + 1)
    file = write_report([folder, tmp_path / "other", tmp_path / "again"], tmp_path / "new" / "page.html")
    first, second = embedded(file.read_text(encoding="utf-8"))
    assert [policy["name"] for policy in first["policies"]] == ["none", "ahsc (three)", "random", "hsc", "ahsc (other)"]
    assert len({policy["colour"] for policy in first["policies"]}) == 5
    assert [policy["name"] for policy in second["policies"]] == ["hsc"]
    colours = {policy["name"]: policy["colour"] for policy in first["policies"]}
    assert second["policies"][0]["colour"] == colours["hsc"]
    assert {name: colours[name] for name in ("none", "hsc")} == {name: POLICY_COLOURS[name] for name in ("none", "hsc")}


def test_run_without_recordings_has_a_page_without_replay(folder, tmp_path):
    copy = tmp_path / "bare"
    shutil.copytree(folder, copy)
    shutil.rmtree(copy / RECORDINGS)
    text = report_page([read_run(copy)])
    assert "No replay" in text and 'data-part="stage"' not in text and embedded(text) == []


@pytest.mark.parametrize(
    "names,message",
    [
        (["nothing"], "holds no run of sffr evaluate or sffr benchmark"),
        (["three", "three"], "is given twice"),
        (["bare"], "manifest.json: cannot be read: No such file"),
    ],
)
def test_errors_say_what_is_wrong(folder, names, message):
    bare = folder.parent / "bare"
    shutil.copytree(folder, bare, dirs_exist_ok=True)
    (bare / "manifest.json").unlink()
    result = sffr("report", *(folder.parent / name for name in names), "--out", folder.parent / "none.html")
    assert result.exit_code == 2 and message in result.output, result.output
    assert not (folder.parent / "none.html").exists()


def test_missing_extra_says_what_to_install(monkeypatch, folder):
    monkeypatch.setattr("sffr_workbench.common.extras.find_spec", lambda name: None)
    result = sffr("report", folder, "--overwrite")
    assert result.exit_code == 2 and "pip install 'sffr-gym[report]'" in result.output
