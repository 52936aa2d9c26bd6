"""Pages and figures of robots, episodes and names that nobody thought of when they were drawn."""

import dataclasses
import json
import re
import shutil

import numpy as np
import pytest
import yaml
from command_line import sffr

from sffr_gym.config.run_folder import RunFolder
from sffr_workbench.evaluation import Recording, evaluate, open_run, recording_files, write_run
from sffr_workbench.figures import draw_episode_figures
from sffr_workbench.report import report_page, write_report
from sffr_workbench.report.runs import read_run
from sffr_workbench.report.spectrum import mode_frequencies, spectrum

pytest.importorskip("jinja2")
pytest.importorskip("matplotlib")

FREE = ["object=null", "arms=[]", "initial.q=[0, 0, 0]", "initial.qd=[0.85, 0, 0]"]
LINK = "{mass: 3.0, length: 0.6, inertia: 0.1, com: 0.3}"
ARMS = ", ".join(f"{{name: a{k}, mount: [0.5, 0.{k}], mount_angle: 0.{k}, links: [{LINK}, {LINK}]}}" for k in range(3))
ROBOTS = {
    "no panels": ["panel.mounts=[]"],
    "no arms, no object": FREE,
    "base alone": [*FREE, "panel.mounts=[]"],
    "one panel": ["panel.mounts=[{name: one, root: [0.3, -0.7], angle: 2.1}]"],
    "three arms": [
        "object=null", f"arms=[{ARMS}]", "initial.q=[0, 0, 0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6]",
        "initial.qd=[0.85, 0, 0, 0, 0, 0, 0, 0, 0]",
    ],
    "failed at once": ["limits.position=1.0e-7"],
}  # fmt: skip
NAME = "x</script><img src=y onerror=alert(1)> $a$ 太阳 אבג " + "long" * 3
BROWSER = next((path for path in map(shutil.which, ("chromium", "chromium-browser", "google-chrome")) if path), None)


def write(folder, overrides=(), duration=0.5, name="odd", policies=("random", "none")):
    """Leave a run folder with its figures."""
    file = folder.parent / f"{folder.name}.yaml"
    file.write_text(yaml.safe_dump({"name": name, "description": name, "duration": duration}), encoding="utf-8")
    evaluation = evaluate(list(policies), str(file), 1, overrides=overrides)
    with RunFolder.claim(folder, "evaluation") as run:
        write_run(run, evaluation, ["sffr", "evaluate", name], draw_episode_figures(evaluation.first))


def data(page):
    """The page's data, read as strictly as JavaScript does."""
    (text,) = re.findall(r'<script type="application/json" id="episodes">(.*?)</script>', page, re.DOTALL)

    def refuse(word):
        raise ValueError(f"{word} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """Folders of all of them by name."""
    root = tmp_path_factory.mktemp("odd")
    cases = {robot: {"overrides": overrides} for robot, overrides in ROBOTS.items()}
    cases |= {"one period": {"duration": 0.002}, "names": {"name": NAME}}
    for case, arguments in cases.items():
        write(root / case, **arguments)
    return {case: root / case for case in cases}


@pytest.fixture(scope="module")
def pages(runs):
    return {case: write_report([folder], folder / "report.html") for case, folder in runs.items()}


CASES = [*ROBOTS, "one period", "names"]


@pytest.mark.parametrize("case", CASES)
def test_everything_has_a_page_and_figures(case, runs, pages):
    (episode,) = data(pages[case].read_text(encoding="utf-8"))
    assert [policy["name"] for policy in episode["policies"]] == ["random", "none"]
    figures = {file.name for file in runs[case].glob("*.png")}
    assert figures >= {"path.png", "tracking.png", "forces.png"}
    assert ("panels.png" in figures) == bool(episode["robot"]["panels"])


@pytest.mark.parametrize("case", ["no panels", "base alone"])
def test_robot_without_panels_has_neither_spectra_nor_a_verdict_on_them(case, runs, pages):
    (episode,) = data(pages[case].read_text(encoding="utf-8"))
    assert all(policy["spectra"] == {"f": [], "psd": []} for policy in episode["policies"])
    assert not any(table.verdict for table in read_run(runs[case]).tables)


def test_names_stay_texts(pages):
    """In the page and in its data; none ends the script or becomes markup."""
    page = pages["names"].read_text(encoding="utf-8")
    assert "<img src=y" not in page and page.count("</script>") == 2
    assert data(page)[0]["name"].startswith(NAME)
    assert not re.search(r'<(script|img|link|iframe)[^>]+(src|href)="?https?://', page)


def test_what_is_no_text_is_a_question_mark(runs):
    run = dataclasses.replace(read_run(runs["one panel"]), name="p\udcff")
    page = report_page([run])
    assert page.encode() and "p?" in page


def test_numbers_that_are_not_finite_are_null_or_left_out(runs):
    run = read_run(runs["one panel"])
    recording = run.recordings[0]
    p, applied, tips = recording.p.copy(), recording.applied.copy(), recording.tips.copy()
    p[0], applied[:, 0], tips[5:] = np.nan, np.inf, np.nan
    damaged = dataclasses.replace(recording, p=p, applied=applied, tips=tips)
    assert mode_frequencies(damaged) == []
    results = [dataclasses.replace(each, measures=dict.fromkeys(each.measures, np.nan)) for each in run.results]
    with np.errstate(all="ignore"):
        page = report_page([dataclasses.replace(run, recordings=[damaged], results=results)])
    assert len(data(page)) == 1


@pytest.mark.parametrize(
    "seconds,period,there", [(0.5, 0.002, True), (0.318, 0.002, False), (0.05, 1e-4, False), (0.25, 1e-4, True)]
)
def test_spectrum_needs_periods_of_the_highest_frequency(runs, seconds, period, there):
    (file, *_) = recording_files(open_run(runs["one panel"]))
    t = np.arange(0.0, seconds, period)
    recording = dataclasses.replace(Recording.read(file), period=period, tips=np.sin(60.0 * t)[:, None])
    found = spectrum(recording)
    assert bool(found["f"]) == there and len(found["psd"]) == 1
    assert all(np.diff(found["f"]) > 0.0) and np.isfinite(found["psd"]).all()


@pytest.mark.skipif(BROWSER is None, reason="no browser is on the PATH")
def test_pages_open_without_a_word(pages):
    """At both ends, in every view; sections without content are hidden."""
    playwright = pytest.importorskip("playwright.sync_api")
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=BROWSER)
        for case, file in pages.items():
            words, page = [], browser.new_page(viewport={"width": 1280, "height": 900})
            page.on("console", lambda message, words=words: words.append(message.text))
            page.on("pageerror", lambda error, words=words: words.append(str(error)))
            page.goto(file.as_uri())
            for key in ("z", "End", "z", "z", " ", "1", "Home"):
                page.keyboard.press(key)
                page.wait_for_timeout(30)
            assert words == [], case
            flexible = case not in ("no panels", "base alone")
            assert page.locator("th.volts").is_visible() == flexible, case
            assert page.locator("#spectra").is_visible() == (flexible and case not in ("one period", "failed at once"))
            assert page.evaluate("document.documentElement.scrollWidth") <= 1280, case
            page.close()
        browser.close()


@pytest.mark.parametrize(
    "policy", ["mine.py:MyLaw", "mine.py:MyLaw,gain=2", "package.module:MyLaw", "ahsc", "best.npz"]
)
def test_a_policy_in_place_of_a_run_is_told_what_to_do(policy):
    """A report has no scenario, seeds or robot of its own: they are those of a run."""
    result = sffr("report", policy)
    assert result.exit_code == 2
    assert f"{policy}: is a policy" in result.output
    assert f"sffr evaluate {policy} --out runs/mine, then sffr report runs/mine" in " ".join(result.output.split())
