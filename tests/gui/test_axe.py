"""All pages by axe-core: WCAG 2.2 AA and its best practices, in both themes. `tools/peers` installs it."""

from __future__ import annotations

import pytest

from tests.gui.chromium import BrowserPage, chromium
from tests.gui.test_chromium import served
from tests.system.conftest import records as records
from tests.system.conftest import robot as robot
from tests.system.conftest import robots as robots
from tests.system.robot import ROOT, Robot

pytestmark = [pytest.mark.slow, pytest.mark.peers, pytest.mark.simulated("paced")]
AXE = ROOT / ".venv-axe" / "axe_playwright_python" / "axe.min.js"
FULL = ROOT / "configs" / "systems" / "kinematic-full.yaml"
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]
RUN = """const [rules, done] = arguments;
axe.run(document, { preload: false, resultTypes: ['violations'], runOnly: rules }).then(({ violations }) =>
  done(violations.flatMap(({ id, nodes }) => nodes.map((node) => `${id}: ${node.html.slice(0, 160)}`))))"""


def violations(page: BrowserPage) -> list[str]:
    page.js(AXE.read_text(encoding="utf-8"))
    return list(page.driver.execute_async_script(RUN, RULES))


def test_no_page_violates_wcag(robot: Robot) -> None:
    if not AXE.exists():
        pytest.skip("axe-core is not here: tools/peers")
    # so high that the timeline at the bottom covers no button
    with served(robot, FULL) as address, chromium(address, 1280, 4000) as page:
        page.driver.set_script_timeout(120)
        page.open()
        paths = page.js("return [...document.querySelectorAll('nav a')].map((a) => a.getAttribute('href'))")
        found: dict[str, list[str]] = {}
        for theme in ("light", "dark"):
            page.js("localStorage.setItem('theme', arguments[0])", theme)
            for path in [*paths, "/nothing-here"]:
                page.open(path)
                page.until("document.querySelector('[data-arm-chip=PSM1]').dataset.word === 'off'")
                found[f"{path} {theme}"] = violations(page)
            for opens in ("#alarms", "[data-opens=help]", "#control"):  # with what is hidden before
                page.open()
                page.js("localStorage.removeItem('person'); document.querySelector(arguments[0]).click()", opens)
                found[f"{opens} {theme}"] = violations(page)
        assert not {where: wrong for where, wrong in found.items() if wrong}


def test_at_twice_the_size_nothing_is_lost_and_motion_is_reduced(robot: Robot) -> None:
    with served(robot, FULL) as address, chromium(address, 640, 400) as page:  # 1280x800 at 200 %
        page.open()
        assert page.too_wide() == []
        page.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [
            {"name": "prefers-reduced-motion", "value": "reduce"}]})
        assert page.js("return matchMedia('(prefers-reduced-motion: reduce)').matches")
        page.open("/")
        assert page.js("return document.getAnimations().length") == 0
        assert page.js("const main = document.querySelector('main').getBoundingClientRect().top;"
                       "return document.querySelector('.strip').getBoundingClientRect().height") < 200
