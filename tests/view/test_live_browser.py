"""The live page in a real browser: it shows something, plays, and a slider that is moved changes the simulation."""

import io
import os
import shutil
import time

import numpy as np
import pytest
from view.example_live import MASS, make_pressing, make_scene

from icjax import view

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SOFTWARE_WEBGL = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 150.0
"""s to wait for a picture: software rendering on a busy machine is slow. Nothing is asserted about time."""

pytestmark = pytest.mark.slow


@pytest.fixture
def browser():
    if CHROMIUM is None:
        if os.environ.get("CI"):
            pytest.fail("no chromium on this machine, and CI must test the page in a browser")
        pytest.skip("no chromium on this machine: the live page was not tested in a browser")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_WEBGL)
        yield chromium
        chromium.close()


def until(condition) -> bool:
    end = time.monotonic() + PATIENCE
    while not condition() and time.monotonic() < end:
        time.sleep(0.2)
    return condition()


def canvas(window) -> np.ndarray:
    from matplotlib.image import imread

    image = imread(io.BytesIO(window.locator("canvas").first.screenshot()))
    return image[image.shape[0] // 3 :, : image.shape[1] // 2, :3]


def test_a_person_plays_scrubs_and_changes_the_mass(browser):
    page = view.explore(make_pressing(), make_scene(), port=0, browser=False)
    try:
        assert page.explorer.wait(PATIENCE)
        window = browser.new_page(viewport={"width": 1000, "height": 640})
        window.set_default_timeout(1e3 * PATIENCE)
        errors = []
        window.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        window.on("pageerror", lambda error: errors.append(str(error)))
        window.goto(page.url)
        window.locator("canvas").first.wait_for()
        window.get_by_role("button", name="Pause").click()
        window.get_by_role("button", name="Play").wait_for()
        assert until(lambda: not page.playback.playing)
        assert until(lambda: canvas(window).std() > 0.02), "the canvas is uniform"
        moment = window.get_by_role("textbox").first
        moment.fill("0.15")
        moment.press("Enter")
        assert until(lambda: page.playback.at == pytest.approx(0.15, abs=1e-3))
        assert until(lambda: "pad on ball" in window.content())
        before = page.explorer.rollout
        mass = window.get_by_role("textbox").nth(4)  # moment, compliance, friction of the plate, of the ball
        assert float(mass.input_value()) == pytest.approx(1e3 * MASS)
        mass.fill("200")
        mass.press("Enter")
        assert until(lambda: page.explorer.rollout is not before)
        assert '"mass": 0.2' in page.explorer.rollout.scene
        assert until(lambda: page.record is page.explorer.rollout)
        assert page.playback.at == pytest.approx(0.15, abs=1e-3)
        assert errors == []
    finally:
        page.close()
