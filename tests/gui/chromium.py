"""Real browsers for tests of the web console: Chromium without a window."""

from __future__ import annotations

import contextlib
import json
import shutil
import tempfile
import time
from collections.abc import Iterator
from typing import Any

import pytest
from selenium import webdriver
from selenium.common.exceptions import TimeoutException
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement
from selenium.webdriver.support.ui import WebDriverWait

OPTIONS = ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
           "--enable-unsafe-swiftshader", "--hide-scrollbars", "--disable-background-networking",
           "--disable-component-update", "--no-first-run")
DUE_S = 40.0
SIZES = ((1280, 720), (820, 1180), (390, 844))
"""Of a small screen, a tablet and a phone."""


class BrowserPage:
    """A browser with the console open."""

    def __init__(self, driver: webdriver.Chrome, address: str) -> None:
        self.driver, self.address, self.system = driver, address, ""

    def open(self, path: str = "/") -> None:
        """Load a page, and wait for its first data."""
        self.driver.get(self.address + path)
        self.until("document.body.dataset.connection === 'live' && document.querySelector('main')")
        self.js("localStorage.setItem('person', 'Tester')")  # else the page asks for it

    def js(self, code: str, *arguments: Any) -> Any:
        """Run a piece of JavaScript in the page."""
        return self.driver.execute_script(code, *arguments)  # type: ignore[no-untyped-call]

    def until(self, condition: str, seconds: float = DUE_S) -> Any:
        """Until an expression is true in the page."""
        def holds(driver: webdriver.Chrome) -> Any:
            with contextlib.suppress(Exception):
                return self.js(f"return {condition}")
            return False

        try:
            return WebDriverWait(self.driver, seconds, 0.05).until(holds)
        except Exception:
            shown = self.js("return document.body.innerText")[:1500]
            pytest.fail(f"did not happen within {seconds} s: {condition}\n{shown}\n{self.wrongs()}")

    def value(self, path: str) -> Any:
        """What the page knows of a source."""
        return self.js("return window.trocar.value(arguments[0])", path)

    def find(self, css: str) -> WebElement:
        """One element."""
        return self.driver.find_element(By.CSS_SELECTOR, css)

    def press(self, css: str) -> None:
        """Press an element, between the strip and the timeline."""
        button = self.find(css)
        self.js("arguments[0].scrollIntoView({block: 'center'})", button)
        button.click()

    def click(self, css: str, *, yes: bool = True) -> None:
        """Press a button, and answer what it asks."""
        self.press(css)
        if self.js("return document.getElementById('confirm').open"):
            self.find("#confirm button.primary" if yes else "#confirm button.quiet").click()

    def answer_yes(self) -> None:
        """To a question that comes after a while."""
        self.until("document.getElementById('confirm').open")
        self.find("#confirm button.primary").click()

    def typed(self, css: str, text: str) -> None:
        """Into an input, as a person does."""
        self.js("const input = document.querySelector(arguments[0]); input.value = arguments[1];"
                "input.dispatchEvent(new Event('input', {bubbles: true}))", css, text)

    def resize(self, width: int, height: int) -> None:
        """Another size of the window."""
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", {
            "width": width, "height": height, "deviceScaleFactor": 1, "mobile": False})

    def take_control(self) -> None:
        """Press Take control; once more where a busy machine has disconnected the page meanwhile."""
        end = time.monotonic() + DUE_S
        self.js("localStorage.setItem('person', localStorage.getItem('person') || 'Tester')")
        while self.js("return document.body.dataset.control") != "you":
            self.until("document.body.dataset.connection === 'live'")
            # In one step: who goes from page to page gets control back by himself, and would now press to give it back.
            self.js("if (document.body.dataset.control !== 'you') document.getElementById('control').click()")
            if self.js("return document.getElementById('confirm').open"):
                self.find("#confirm button.primary").click()
            with contextlib.suppress(TimeoutException):
                WebDriverWait(self.driver, 3.0, 0.05).until(
                    lambda driver: self.js("return document.body.dataset.control") == "you")
            if time.monotonic() > end:
                pytest.fail("this page does not get control")

    def held(self, css: str, condition: str) -> None:
        """Hold a button until something is so; again where a busy machine has cost the page its control, or the jog."""
        for _ in range(12):
            self.take_control()
            button = self.find(css)
            self.js("arguments[0].scrollIntoView({block: 'center'})", button)
            ActionChains(self.driver).move_to_element(button).click_and_hold().perform()
            try:
                self.until(f"({condition}) || document.body.dataset.control !== 'you'"
                           " || !document.querySelector('.jog.on')")
            finally:
                ActionChains(self.driver).release().perform()
            if self.js(f"return {condition}"):
                return
        pytest.fail(f"held in vain: {css}")

    def note(self) -> str:
        """What is said beside the button that was pressed."""
        return str(self.until("document.querySelector('.note')?.textContent"))

    def too_wide(self) -> list[str]:
        """Pages of the bar that can be shifted sideways, or have parts beyond the edge that nothing scrolls to."""
        found = []
        for path in self.js("return [...document.querySelectorAll('.bar nav a')].map((a) => a.getAttribute('href'))"):
            self.open(path)
            self.until("document.querySelector('main').querySelector('.card')")
            beyond = self.js("""if (document.documentElement.scrollWidth > innerWidth) return 'the page';
                for (const part of document.querySelectorAll('.bar *, main *'))
                  if (part.getClientRects().length && part.getBoundingClientRect().right > innerWidth + 1
                      && !part.closest('.scroll, .stage')) return part.outerHTML.slice(0, 90);
                return ''""")
            found += [f"{path}: {beyond}"] if beyond else []
        return found

    def wrongs(self) -> list[str]:
        """What the browser complains of: scripts, files that are not there, addresses that it may not ask."""
        return [row["message"] for row in self.driver.get_log("browser") if row["level"] == "SEVERE"]

    def addresses(self) -> list[str]:
        """All that it has asked the network for."""
        found = []
        for row in self.driver.get_log("performance"):
            message = json.loads(row["message"])["message"]
            if message["method"] == "Network.requestWillBeSent":
                found.append(message["params"]["request"]["url"])
        return found


@contextlib.contextmanager
def chromium(address: str, width: int = 1280, height: int = 720) -> Iterator[BrowserPage]:
    """A browser of its own; it ends with the test."""
    binary, service = shutil.which("chromium"), shutil.which("chromedriver")
    if binary is None or service is None:
        pytest.skip("chromium and chromedriver are not here: apt-get install chromium chromium-driver")
    options = webdriver.ChromeOptions()
    options.binary_location = binary
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as home:
        for option in (*OPTIONS, f"--window-size={width},{height}", f"--user-data-dir={home}"):
            options.add_argument(option)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(service))
        try:
            driver.set_window_rect(0, 0, width, height)
            page = BrowserPage(driver, address)
            page.resize(width, height)
            yield page
        finally:
            driver.quit()
