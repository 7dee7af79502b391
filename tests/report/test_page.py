"""The page in a real browser with the network off: no request, no error, a 3-D view that moves, numbers that show."""

import io
import os
import re
import shutil
import time

import numpy as np
import pytest
from view.example_records import make_interaction, make_recording, make_rollout

from icjax.recording import Session
from icjax.report import write_report

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
SOFTWARE_WEBGL = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
PATIENCE = 150.0
"""s to wait for a picture: software rendering on a busy machine is slow. Nothing is asserted about time."""
MOVED = 0.005
"""Least share of pixels that must differ between two times; the finger covers more than a tenth of the view."""
LOCAL = ("file:", "data:", "blob:", "about:")

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    recording = make_recording()
    rollouts = (make_rollout("flat", bump=False), make_rollout("bump", failed=True))
    return write_report(
        tmp_path_factory.mktemp("report") / "report.html",
        session=Session(name="<example> & co", subject="nobody", recordings=(recording,)),
        interactions=(make_interaction(recording),),
        rollouts=rollouts,
        metrics={"transfer": {"normal force NRMSE": 0.1234}},
        seed=7,
    )


@pytest.fixture(scope="module")
def browser():
    if CHROMIUM is None:
        if os.environ.get("CI"):
            pytest.fail("no chromium on this machine, and CI must test the page in a browser")
        pytest.skip("no chromium on this machine: the page was not tested in a browser")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE_WEBGL)
        yield chromium
        chromium.close()


@pytest.fixture(scope="module")
def opened(browser, report):
    """The page, and everything the browser reported while it was opened."""
    context = browser.new_context(viewport={"width": 1000, "height": 640})
    context.set_offline(True)
    page = context.new_page()
    page.set_default_timeout(1e3 * PATIENCE)
    heard = {"errors": [], "requests": []}
    page.on("console", lambda message: heard["errors"].append(message.text) if message.type == "error" else None)
    page.on("pageerror", lambda error: heard["errors"].append(str(error)))
    page.on("request", lambda request: heard["requests"].append(request.url))
    page.goto(report.as_uri())
    pause(page)
    yield page, heard
    context.close()


def pause(page) -> None:
    """Wait for the 3-D view, then stop it."""
    frame = page.frame_locator("#scene")
    frame.locator("canvas").first.wait_for()
    frame.locator("input").first.wait_for()
    frame.locator("button").first.wait_for()
    frame.locator("input").first.focus()
    go_to(page, "0.01")


def go_to(page, seconds: str) -> None:
    field = page.frame_locator("#scene").locator("input").first
    field.fill(seconds)
    field.press("Enter")
    page.wait_for_timeout(1000)


def canvas(page) -> np.ndarray:
    """Pixels of the 3-D view without the viewer's own message box in its upper part."""
    from matplotlib.image import imread

    image = imread(io.BytesIO(page.frame_locator("#scene").locator("canvas").first.screenshot()))
    return image[image.shape[0] // 3 :, :, :3]


def changed(page, before: np.ndarray) -> float:
    """Share of pixels that differ from an earlier picture, waiting until some do."""
    end = time.monotonic() + PATIENCE
    share = 0.0
    while share < MOVED and time.monotonic() < end:
        share = difference(canvas(page), before)
    return share


def difference(a: np.ndarray, b: np.ndarray) -> float:
    """Share of pixels that differ visibly."""
    return float(np.mean(np.abs(a - b).max(axis=-1) > 0.05))


def test_it_is_one_page_of_reasonable_size(report):
    # One viewer of 0.82 MB for all scenes, about 0.1 MB a scene, about 0.1 MB a figure.
    assert report.stat().st_size < 2.5e6
    assert len(list(report.parent.iterdir())) == 1


def test_nothing_is_fetched_and_nothing_fails(opened):
    _, heard = opened
    assert heard["requests"], "the listener heard nothing at all"
    assert [url for url in heard["requests"] if not url.startswith(LOCAL)] == []
    assert heard["errors"] == []


def test_the_numbers_are_visible(opened):
    page, _ = opened
    table = page.locator("#compliance table")
    assert table.is_visible()
    words = table.inner_text()
    for expected in ("0.200", "0.160 to 0.250", "0.900", "0.720 to 1.12", "not estimated", "below 1.00"):
        assert expected in words
    for expected in ("stable", "not excited"):
        assert expected in words
    section = page.locator("#compliance")
    assert "Does it depend on the windows?" in section.inner_text()
    assert section.locator("details").count() == 1
    assert "0.1234" in page.locator("#provenance").inner_text()
    assert "max pivots" in page.locator("#rollouts").inner_text()
    assert "<example> & co" in page.locator("h1").inner_text()


def test_every_figure_is_drawn_with_text(opened):
    page, _ = opened
    drawings = page.locator("figure svg")
    assert drawings.count() == 8
    for index in range(drawings.count()):
        box = drawings.nth(index).bounding_box()
        assert box["width"] > 400
        assert box["height"] > 100
    assert page.get_by_text("MP torque (mNm)").first.is_visible()


def test_ids_are_unique(opened):
    page, _ = opened
    ids = page.evaluate("[...document.querySelectorAll('[id]')].map(item => item.id)")
    assert len(ids) == len(set(ids))


def test_references_inside_drawings_exist(report):
    text = re.sub(r"<script>.*?</script>", "", report.read_text(encoding="utf-8"), flags=re.DOTALL)
    known = set(re.findall(r'\bid="([^"]+)"', text))
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', text))
    assert used
    assert used <= known


def test_the_3d_view_shows_something_and_the_scrubber_moves_it(opened):
    page, heard = opened
    canvas(page)  # the view draws the chosen time with the first picture that is asked of it
    first = canvas(page)
    assert first.std() > 0.02, "the canvas is uniform"
    assert difference(canvas(page), first) < MOVED, "the view moves although it is paused"
    go_to(page, "1.4")
    assert changed(page, first) >= MOVED
    assert heard["errors"] == []


def test_another_tab_shows_another_scene(opened):
    page, heard = opened
    before = canvas(page)
    page.locator("#scene-tabs button", has_text="bump").click()
    page.wait_for_timeout(2000)
    pause(page)
    assert changed(page, before) >= MOVED
    assert page.locator("#scene-tabs button[aria-selected=true]").inner_text() == "bump"
    assert heard["errors"] == []
    assert [url for url in heard["requests"] if not url.startswith(LOCAL)] == []
