"""The operator's page in headless Chromium."""

import re
import shutil
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bringup.view_results import serving, write_result
from roller_bringup.view import health
from roller_bringup.view.grid import CONTINUED
from roller_bringup.view.result import read_result
from roller_bringup.view.scene import Scene
from waiting import wait_until

playwright = pytest.importorskip(
    "playwright.sync_api", reason="pip install -r requirements-browser.txt"
)
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser"))), None)
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no chromium on this machine"),
    pytest.mark.scan,
]

#: Colours of a canvas; one of a picture has hundreds.
_COLOURS = """(id) => {
  const canvas = document.querySelector(id);
  const image = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  return new Set(new Uint32Array(image.data.buffer)).size;
}"""


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as driver:
        chromium = driver.chromium.launch(
            executable_path=CHROMIUM, args=["--no-sandbox", "--disable-gpu"]
        )
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser: Any) -> Iterator[Any]:
    """Opens pages; what goes wrong in one fails the test."""
    faults: list[str] = []
    contexts = []

    def open_at(url: str, **options: Any) -> Any:
        contexts.append(browser.new_context(viewport={"width": 1400, "height": 900}, **options))
        page = contexts[-1].new_page()
        page.set_default_timeout(60_000)
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("dialog", lambda dialog: faults.append(dialog.message))
        page.goto(url)
        return page

    yield open_at
    for context in contexts:
        context.close()
    assert not faults


def until(page: Any, holds: str) -> None:
    """Wait for something of a page; `wait_for_function` needs an eval, which the page forbids."""
    wait_until(lambda: page.evaluate(holds), lambda: holds)


def says(page: Any, where: str, text: str) -> None:
    """Wait for words on a page: what it shows comes piece by piece."""
    wait_until(lambda: text in page.inner_text(where), lambda: text)


def painted(page: Any) -> int:
    return page.evaluate("window.rollerPainted()[0]")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_worst_finding_of_a_result_is_seen_first(tmp_path, open_page, scheme):
    with serving(read_result(write_result(tmp_path / "result"))) as server:
        page = open_page(server.url, color_scheme=scheme)
        until(page, "document.querySelector('#word').textContent === 'NONCONFORM'")
        page.wait_for_selector("#worst:not([hidden])")
        assert page.inner_text("#worst b") == "dent, 220 µm deep ± 20 µm, 3 mm × 2 mm"
        assert (
            float(page.eval_on_selector("#word", "e => parseFloat(getComputedStyle(e).fontSize)"))
            > 70
        )
        until(page, f"({_COLOURS})('#map') > 8")
        first = page.locator("#findings li").first
        wait_until(lambda: first.get_attribute("aria-selected") == "true")
        # What a file says is text, never a part of the page.
        says(page, "#facts", "<img")
        assert page.locator("#facts img").count() == 0
        dark = page.evaluate("getComputedStyle(document.body).backgroundColor") == "rgb(16, 19, 24)"
        assert dark == (scheme == "dark")
        page.keyboard.press("l")
        assert (page.evaluate("document.documentElement.dataset.theme") == "dark") != dark


def test_findings_are_filtered_and_profiles_drawn(tmp_path, open_page):
    with serving(read_result(write_result(tmp_path / "result"))) as server:
        page = open_page(server.url)
        wait_until(lambda: page.locator("#findings li").count() == 3)
        # Who goes through the list by keyboard stays in it.
        page.focus("#findings li:nth-child(2)")
        page.keyboard.press("Enter")
        page.keyboard.press("Tab")
        page.keyboard.press("Enter")
        assert "scratch" in page.inner_text("#findings li[aria-selected='true']")
        page.select_option("#by-verdict", "nonconform")
        assert page.locator("#findings li").count() == 2
        page.select_option("#by-kind", "raised")
        assert page.locator("#findings li").count() == 1
        page.select_option("#by-verdict", "")
        page.select_option("#by-kind", "")
        page.keyboard.press("0")
        until(page, "document.querySelector('#fit').getAttribute('aria-pressed') === 'true'")
        box = page.locator("#map").bounding_box()
        x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
        page.mouse.move(x, y)
        until(page, "document.querySelector('#readout').textContent.includes('base x')")
        page.keyboard.press("p")
        page.mouse.move(box["x"] + 2, y)
        page.mouse.down()
        page.mouse.move(box["x"] + box["width"] - 2, y, steps=5)
        page.mouse.up()
        page.wait_for_selector("#profile:not([hidden])")
        # The gap of 3 of 30 mm isn't bridged, and the dent lies across the middle row.
        says(page, "#profile-text", "from -220 µm to 10 µm")
        text = page.inner_text("#profile-text")
        assert text.startswith("height over")
        measured, continued = (int(share) for share in re.findall(r"(\d+) %", text))
        # Of 30 mm, 24 and 3.
        assert continued == pytest.approx(measured / 8, abs=1)
        chart, told = page.locator("#profile-chart").bounding_box(), set()
        for share in np.linspace(0.1, 0.98, 45):
            page.mouse.move(chart["x"] + share * chart["width"], chart["y"] + 50)
            told.add(page.inner_text("#profile-text").partition(": ")[2])
        assert {"10 µm", "10 µm, continued from neighbours", "not measured"} <= told
        page.keyboard.press("Escape")
        page.wait_for_selector("#profile", state="hidden")
        link = page.locator("#files a", has_text="findings.csv")
        assert link.get_attribute("href") == "/files/findings.csv"


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_only_what_was_not_measured_is_hatched(tmp_path, open_page, scheme):
    scene = Scene("continued", tmp_path)
    state = np.full((64, 64), CONTINUED, np.uint8)
    scene.grid.put(0, 0, {"height": np.zeros((64, 64), np.float32)}, state)
    with serving(scene) as server:
        page = open_page(server.url, color_scheme=scheme)
        until(page, f"({_COLOURS})('#map') > 1")
        page.keyboard.press("-")  # nothing is at an edge of the picture
        middle = """() => {
          const canvas = document.querySelector("#map"), {width, height} = canvas;
          const context = canvas.getContext("2d");
          const image = context.getImageData(width / 2 - 40, height / 2 - 40, 80, 80);
          return new Set(new Uint32Array(image.data.buffer)).size;
        }"""
        until(page, f"({middle})() === 1")


def test_five_million_points_two_browsers_a_dead_node_and_a_new_server(open_page):
    scene, rng = Scene("live"), np.random.default_rng(4)
    scene.nodes["emvs: depth"] = health.Node("emvs: depth", 0, "running", seen_s=time.monotonic())

    def roll(begin_m: float, points: int) -> None:
        with scene.lock:
            for node in scene.nodes.values():
                if node.name.startswith("emvs"):
                    node.seen_s = time.monotonic()
            x, y = rng.uniform(begin_m, begin_m + 0.1, points), rng.uniform(0, 0.015, points)
            scene.grid.add(x, y, {"height": np.sin(50 * x).astype(np.float32) * 1e-4})
            scene.head, scene.speed_m_s = (begin_m + 0.1, 0.0075), 0.3

    for k in range(98):
        roll(k * 0.1, 51_000)
    with serving(scene) as server:
        pages = [open_page(server.url), open_page(server.url)]
        for page in pages:
            until(page, "document.querySelector('#word').textContent !== '…'")
            until(page, f"({_COLOURS})('#overview') > 60")
        wait_until(lambda: len(server.viewers) == 2)
        scene.take_depth(lambda: np.full((4, 4), 0.03, np.float32))
        scene.take_text("plate")
        for page in pages:
            page.wait_for_selector("#depth")
            page.wait_for_selector("#text")
            assert page.is_visible("#legend")
        before = [painted(page) for page in pages]
        for k in range(98, 100):
            roll(k * 0.1, 1_000)
            for page in pages:
                until(page, "document.querySelector('#word').textContent === 'ROLLING'")
        for page, count in zip(pages, before, strict=True):
            until(page, f"window.rollerPainted()[0] > {count}")
            says(page, "#foot", "5,000,000 points")
        # Another node speaks, and then none of the first.
        scene.nodes["emvs: depth"].seen_s -= 2 * health.SILENT_S
        scene.nodes["ur10: robot"] = health.Node("ur10: robot", 0, "receiving", seen_s=1e12)
        until(pages[0], "document.querySelector('#word').textContent === 'NODE LOST'")
        says(pages[0], "#nodes li[data-level='gone']", "start it again")
        # Its figures, by keyboard, while frames come.
        pages[0].focus("#nodes li")
        count = painted(pages[0])
        scene.take_text("plate eight")
        until(pages[0], f"window.rollerPainted()[0] > {count}")
        scene.nodes["emvs: depth"].values = {"windows": "7"}
        pages[0].keyboard.press("Enter")
        says(pages[0], "#nodes li table", "windows")
        port = server.port
    until(pages[0], "document.querySelector('#word').textContent === 'NO SERVER'")
    again = Scene("again")
    again.grid.add(
        rng.uniform(0, 0.01, 99), rng.uniform(0, 0.01, 99), {"height": np.ones(99, "f4")}
    )
    with serving(again, port=port):
        for page in pages:
            until(page, "document.querySelector('#title').textContent === 'again'")
            until(page, "document.querySelector('#foot').textContent.includes('99 points')")
            # What the first server had isn't taken for this one's.
            page.wait_for_selector("#depth", state="hidden")
            page.wait_for_selector("#text", state="hidden")
        again.restart()
        for page in pages:
            page.wait_for_selector("#legend", state="hidden")


def test_a_phone_shows_the_verdict_first(tmp_path, open_page):
    with serving(read_result(write_result(tmp_path / "result"))) as server:
        page = open_page(server.url)
        page.set_viewport_size({"width": 390, "height": 600})
        page.reload()
        first = page.locator("#findings li").first
        wait_until(lambda: first.get_attribute("aria-selected") == "true")
        assert page.evaluate("window.scrollY") == 0
        assert page.evaluate("document.documentElement.scrollWidth") == 390


@pytest.mark.parametrize("width", [1280, 1400, 1920])
def test_state_and_figures_stand_side_by_side(open_page, width):
    scene = Scene("live")
    scene.nodes["inspect: findings"] = node = health.Node("inspect: findings", 0, "running")
    scene.nodes["emvs: depth"] = lost = health.Node("emvs: depth", 0, "running")
    node.values, lost.seen_s = {"event_rate_per_s": "30.44e6"}, -1e9
    scene.speed_m_s, scene.force_n, scene.lag_s = 0.3, -19.0, 0.03
    scene.coverage = {"measured": 0.42, "continued": 0.58, "unmeasured": 0.1}
    with serving(scene) as server:
        page = open_page(server.url)
        page.set_viewport_size({"width": width, "height": 900})
        node.seen_s = time.monotonic()
        until(page, "document.querySelector('#word').textContent === 'NODE LOST'")
        wait_until(lambda: page.locator("#figures dd").count() == 7)
        big, figures = (page.locator(name).bounding_box() for name in ("#big", "#figures"))
        word = page.evaluate("document.querySelector('#word').scrollWidth")
        assert figures["x"] > big["x"] + word + 8
        assert figures["y"] < big["y"] + big["height"]
        assert figures["height"] < 100  # one row


def test_nothing_is_fetched_from_elsewhere() -> None:
    folder = Path(health.__file__).parent / "page"
    for path in folder.iterdir():
        assert "://" not in path.read_text(), path.name
        assert "innerHTML" not in path.read_text(), path.name
