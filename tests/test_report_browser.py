"""The report's page in a real browser: it opens without a word on the console, plays, scrubs, overlays policies.

Needs playwright and Chromium; without, the tests are skipped, unless SFFR_BROWSER is set to "required". Screenshots go
to the folder that SFFR_ARTEFACTS names.
"""

import base64
import importlib
import io
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from report_runs import run

from sffr_workbench.report import write_report

NAMES = ("chromium", "chromium-browser", "google-chrome")
CHROMIUM = next((path for path in map(shutil.which, NAMES) if path), None)
REQUIRED = os.environ.get("SFFR_BROWSER") == "required"
if CHROMIUM is None and not REQUIRED:
    pytest.skip(f"no browser: none of {', '.join(NAMES)} is on the PATH", allow_module_level=True)
load = importlib.import_module if REQUIRED else pytest.importorskip
Image, playwright, _ = (load(name) for name in ("PIL.Image", "playwright.sync_api", "jinja2"))
expect = playwright.expect

POLICIES = ["none", "hsc", "ahsc"]
BETWEEN_TIPS = slice(100, -100)  # rows of the stage's pixels
TIME, PLAY, CLOCK = "[data-part=time]", "[data-part=play]", "[data-part=clock]"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """The page of a run of 4 s and another of another episode."""
    folder = tmp_path_factory.mktemp("runs")
    run(folder / "first", POLICIES)
    run(folder / "second", ["ahsc"], name="other")
    return write_report([folder / "first", folder / "second"], folder / "report.html")


@pytest.fixture(scope="module")
def browser():
    assert CHROMIUM is not None, f"a browser is required, and none of {', '.join(NAMES)} is on the PATH"
    with playwright.sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=CHROMIUM)
        yield browser
        browser.close()


@pytest.fixture
def open_page(browser, file):
    """Open the page with settings of the browser; afterwards nothing must have been said or asked of the network."""
    words, asked, contexts = [], [], []

    def open_(**settings):
        context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}} | settings)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: words.append(message.text))
        page.on("pageerror", lambda error: words.append(str(error)))
        page.on("request", lambda request: asked.append(request.url))
        page.goto(file.as_uri())
        expect(page.locator(CLOCK)).to_contain_text("/ 4.0 s")
        return page

    yield open_
    for context in contexts:
        context.close()
    assert words == []
    assert {url for url in asked if not url.startswith("data:")} == {file.as_uri()}


@pytest.fixture
def page(open_page):
    return open_page()


def keep(page, name):
    """Keep a screenshot if a folder is named."""
    if folder := os.environ.get("SFFR_ARTEFACTS"):
        Path(folder).mkdir(parents=True, exist_ok=True)
        height = page.evaluate("document.documentElement.scrollHeight")
        page.set_viewport_size(page.viewport_size | {"height": height})
        page.screenshot(path=Path(folder) / f"{name}.png")


def picture(page):
    """The stage's pixels (height, width, 3), once what was asked for is drawn."""
    page.wait_for_timeout(60)
    return pixels(page.locator("[data-part=stage]"))


def pixels(canvas):
    """A canvas's pixels (height, width, 3), on white where it is empty."""
    drawn = base64.b64decode(canvas.evaluate("(canvas) => canvas.toDataURL()").partition(",")[2])
    image = Image.open(io.BytesIO(drawn)).convert("RGBA")
    ground = Image.new("RGBA", image.size, "white")
    return np.asarray(Image.alpha_composite(ground, image).convert("RGB")).astype(int)


def same(one, other):
    return one.shape == other.shape and (one == other).all()


def places(page):
    """Rows and columns of the stage's pixels that have each policy's colour, without the bars beyond the tips."""
    shown, found = picture(page)[BETWEEN_TIPS], {}
    for row in page.locator("[data-part=policies] tr").all():
        colour = row.evaluate("(row) => row.style.getPropertyValue('--colour')")
        want = [int(colour[at : at + 2], 16) for at in (1, 3, 5)]
        found[row.locator(".name").inner_text()] = np.nonzero(np.abs(shown - want).max(axis=-1) < 12)
    return found


def colours(page):
    """How many of the stage's pixels have each policy's colour."""
    return {name: len(rows) for name, (rows, _) in places(page).items()}


def wait_for_time(page, least):
    """Wait until the replay has come to a time [s]."""
    for _ in range(200):
        if time_of(page) > least:
            return
        page.wait_for_timeout(25)
    pytest.fail(f"the replay did not come to {least} s")


def time_of(page):
    return float(page.locator(TIME).input_value())


def test_page_opens_with_everything_drawn(page):
    """And says nothing on the console, as after every test here."""
    canvases = page.locator("canvas")
    for k in range(canvases.count()):
        assert len(np.unique(pixels(canvases.nth(k)).reshape(-1, 3), axis=0)) > 20
    assert page.locator("[data-part=charts] canvas, [data-part=tips] canvas").count() == 6
    assert page.locator("[data-part=spectra] canvas").count() == 2
    assert page.locator("[data-part=uses] canvas").count() == 3
    expect(page.locator("body")).to_contain_text("hsc keeps the panels calmest")


def test_replay_moves_and_pauses(page):
    before = picture(page)
    page.locator(PLAY).click()
    expect(page.locator(PLAY)).to_have_text("Pause")
    wait_for_time(page, 0.3)
    page.locator(PLAY).click()
    expect(page.locator(PLAY)).to_have_text("Play")
    moved, held = picture(page), time_of(page)
    assert 0.3 < held < 3.95 and not same(moved, before)
    page.wait_for_timeout(150)
    assert time_of(page) == held and same(picture(page), moved)


def test_replay_stops_at_the_end_and_starts_again(page):
    page.locator(TIME).fill("3.8")
    page.locator(PLAY).click()
    expect(page.locator(PLAY)).to_have_text("Play")
    expect(page.locator(CLOCK)).to_have_text("4.0 / 4.0 s")
    page.locator(PLAY).click()
    expect(page.locator(PLAY)).to_have_text("Pause")
    assert time_of(page) < 3.0


def test_scrubbing_sets_the_time(page):
    """The slider, and dragging over a chart; the same time gives the same picture."""
    page.locator(TIME).fill("2")
    expect(page.locator(CLOCK)).to_have_text("2.0 / 4.0 s")
    there, energy = picture(page), page.locator(".energy").all_inner_texts()
    chart = page.locator("[data-part=charts] canvas").first
    chart.scroll_into_view_if_needed()
    box = chart.bounding_box()
    page.mouse.move(box["x"] + 63, box["y"] + 40)
    page.mouse.down()
    expect(page.locator(CLOCK)).to_contain_text("0.0 /")
    assert not same(picture(page), there) and page.locator(".energy").all_inner_texts() != energy
    page.mouse.move(box["x"] + box["width"] - 12, box["y"] + 40)
    page.mouse.up()
    expect(page.locator(CLOCK)).to_contain_text("4.0 /")
    page.locator(TIME).fill("2")
    expect(page.locator(CLOCK)).to_have_text("2.0 / 4.0 s")
    assert same(picture(page), there) and page.locator(".energy").all_inner_texts() == energy


def test_two_policies_overlay(page):
    """Each policy's colour is on its panels while it is chosen, and no longer; hsc hides ahsc, which it is close to."""
    page.locator(TIME).fill("3")
    boxes, all_three = page.get_by_role("checkbox"), colours(page)
    boxes.nth(1).uncheck()
    two = colours(page)
    boxes.nth(0).uncheck()
    one = colours(page)
    assert all_three["none"] > 100 and all_three["hsc"] > 100
    assert two["none"] > 100 and two["ahsc"] > 100 and two["hsc"] < 0.2 * all_three["hsc"]
    assert one["none"] < 0.2 * two["none"] and one["ahsc"] > 100
    boxes.nth(0).check()
    keep(page, "two-policies")


def test_calmest_policy_is_in_front_until_another_comes_back(page):
    front = page.locator("[data-part=policies] tr.front .name")
    expect(front).to_have_text("hsc")  # by a few per cent in this short episode
    page.get_by_role("checkbox").nth(0).uncheck()
    page.get_by_role("checkbox").nth(0).check()
    expect(front).to_have_text("none")


def test_nothing_chosen_is_no_fault(page):
    for k in range(3):
        page.get_by_role("checkbox").nth(k).uncheck()
    page.locator(TIME).fill("1")
    page.keyboard.press("z")
    expect(page.locator(CLOCK)).to_contain_text("1.0 /")


def test_keys_do_what_the_page_says(page):
    page.keyboard.press("ArrowRight")
    expect(page.locator(CLOCK)).to_contain_text("0.5 /")
    page.keyboard.press("Shift+ArrowRight")
    expect(page.locator(CLOCK)).to_contain_text("4.0 /")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowLeft")
    expect(page.locator(CLOCK)).to_contain_text("3.0 /")
    page.keyboard.press("Home")
    expect(page.locator(CLOCK)).to_contain_text("0.0 /")
    page.keyboard.press("-")
    page.keyboard.press("-")
    expect(page.locator("[data-part=speed]")).to_have_value("1")
    page.keyboard.press("+")
    expect(page.locator("[data-part=speed]")).to_have_value("2")
    page.keyboard.press("2")
    expect(page.get_by_role("checkbox").nth(1)).not_to_be_checked()
    page.keyboard.press("2")
    expect(page.get_by_role("checkbox").nth(1)).to_be_checked()
    page.keyboard.press("e")
    expect(page.locator("[data-part=factorText]")).to_have_text("6\u00d7")
    page.keyboard.press("Shift+E")
    expect(page.locator("[data-part=factorText]")).to_have_text("5\u00d7")
    page.keyboard.press("Space")
    expect(page.locator(PLAY)).to_have_text("Pause")
    page.keyboard.press("Space")
    expect(page.locator(PLAY)).to_have_text("Play")


def test_keyboard_reaches_every_control(page):
    """With the tab key, in the order of the page."""
    reached = []
    for _ in range(12):
        page.keyboard.press("Tab")
        reached.append(page.evaluate("document.activeElement.dataset.part ?? document.activeElement.type ?? ''"))
    assert [part for part in reached if part] [:9] == [
        "play", "time", "speed", "view", "factor", "episode", "checkbox", "checkbox", "checkbox",
    ]  # fmt: skip
    outline = "getComputedStyle(document.querySelector('[data-part=play]:focus-visible')).outlineStyle"
    page.locator(TIME).focus()
    page.keyboard.press("Shift+Tab")
    assert page.evaluate(outline) == "solid"


def test_views_change_the_picture(page):
    """Into each panel, the whole path, and back."""
    page.locator(TIME).fill("2")
    seen, names = [], []
    for _ in range(4):
        seen.append(picture(page))
        names.append(page.locator("[data-part=view] option:checked").inner_text())
        if names[-1] == "panel left":
            keep(page, "panel")
        page.keyboard.press("z")
    assert names == ["whole robot", "panel left", "panel right", "whole path"]
    assert not any(same(one, other) for k, one in enumerate(seen) for other in seen[:k])


@pytest.mark.parametrize("view,across", [("robot", 1), ("panel 0", 0)])
def test_exaggeration_bends_the_panels_more(page, view, across):
    """To the side where the whole robot is shown, up or down in the view of one panel."""
    page.locator(TIME).fill("0.5")
    page.locator("[data-part=view]").select_option(view)
    reach = []
    for factor in "2", "6":
        page.locator("[data-part=factor]").fill(factor)
        expect(page.locator("[data-part=factorText]")).to_have_text(f"{factor}\u00d7")
        reach.append(np.ptp(places(page)["hsc"][across]))
    assert reach[1] > 1.5 * reach[0]


def test_other_episode_can_be_chosen(page):
    expect(page.locator("[data-part=policies] tr")).to_have_count(3)
    page.locator("[data-part=episode]").select_option(label="other, seed 1000003")
    expect(page.locator("[data-part=policies] tr")).to_have_count(1)
    assert page.locator("[data-part=charts] canvas, [data-part=tips] canvas").count() == 6


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_follows_light_and_dark(open_page, scheme):
    page = open_page(color_scheme=scheme)
    page.locator(TIME).fill("2")
    ground = page.evaluate("getComputedStyle(document.body).backgroundColor.match(/\\d+/g).map(Number)")[:3]
    for shade in ground, picture(page)[200, 3]:
        assert min(shade) > 200 if scheme == "light" else max(shade) < 60
    keep(page, scheme)


def test_page_turns_dark_while_open(page):
    before = picture(page)
    page.emulate_media(color_scheme="dark")
    assert not same(picture(page), before)


def test_page_fits_a_phone(open_page):
    """Nothing but wide tables has to be moved sideways, and what is touched is large enough for a finger."""
    page = open_page(viewport={"width": 390, "height": 844}, device_scale_factor=2, is_mobile=True, has_touch=True)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    for part in ("play", "speed", "view"):
        assert page.locator(f"[data-part={part}]").bounding_box()["height"] >= 36
    clock = page.locator(CLOCK).bounding_box()
    assert clock["x"] + clock["width"] <= 390
    page.locator(PLAY).tap()
    wait_for_time(page, 0.2)
    page.locator(PLAY).tap()
    keep(page, "phone")
