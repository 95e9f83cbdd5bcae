"""The web console in real browsers: what people see and press. With Chromium and its driver."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Callable, Iterator

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from tests.gui.chromium import BrowserPage, chromium
from tests.system.conftest import records as records
from tests.system.conftest import robot as robot
from tests.system.conftest import robots as robots
from tests.system.robot import ROOT, Robot
from tests.system.test_socket_bridge import free
from trocar.procs.machine.paths import token_file
from trocar.shm.ring.ring import RingReader

pytestmark = [pytest.mark.slow, pytest.mark.peers, pytest.mark.simulated("paced")]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic-teleop.yaml"
DEMO = ROOT / "configs" / "systems" / "demo-teleop.yaml"
Records = Callable[[Robot, str, str], RingReader]
HANDLE = """const stage = document.querySelector('.stage').stage; stage.draw();
const at = stage.models.MTMR.handle.getWorldPosition(stage.camera.position.clone()).project(stage.camera);
return [Math.round(at.x * stage.element.clientWidth / 2), Math.round(-at.y * stage.element.clientHeight / 2)]"""
COLOURS = """const stage = document.querySelector('.stage').stage; stage.draw();
const gl = stage.renderer.getContext(), w = gl.drawingBufferWidth, h = gl.drawingBufferHeight;
const pixels = new Uint8Array(4 * w * h); gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, pixels);
const found = new Set(); for (let i = 0; i < pixels.length; i += 4)
  found.add((pixels[i] >> 3) << 10 | (pixels[i + 1] >> 3) << 5 | pixels[i + 2] >> 3); return found.size"""


@contextlib.contextmanager
def served(robot: Robot, file: object = KINEMATIC, *options: str) -> Iterator[str]:
    """A system with a console; its address."""
    port = free()
    robot.up(file, "--set", f"gui.listen=127.0.0.1:{port}", *options)  # type: ignore[arg-type]
    try:
        yield f"http://127.0.0.1:{port}"
    finally:
        robot.pids.add(robot.pid("gui"))


def homed(page: BrowserPage) -> None:
    """All arms, by the buttons of the page."""
    page.click("main [data-asks=power-on]")
    page.until("trocar.value('PSM1/state.state') === 'ENABLED'", 90)
    page.click("main [data-asks=home]")
    page.until("trocar.value('PSM1/state.is_homed') && trocar.value('MTMR/state.is_homed')", 120)


def test_the_demo_is_powered_homed_and_seen_in_a_browser(robot: Robot) -> None:
    with served(robot, DEMO) as address, chromium(address) as page:
        page.open()
        page.click("#power-on")
        assert "Take control first" in page.note()
        page.until("trocar.value('PSM1/state.state') === 'DISABLED'")
        page.take_control()
        page.click("#power-on", yes=False)
        homed(page)
        assert page.find("#arm-PSM1 .chip").text == "ENABLED"
        page.open("/3d")
        page.until("document.querySelector('.stage')?.stage?.isPlaced")
        assert page.js(COLOURS) > 60, "an empty picture"
        assert page.js("return Object.values(document.querySelector('.stage').stage.models)"
                       ".every((model) => model.size > 6 && model.group.visible)")
        walls = "Object.values(document.querySelector('.stage').stage.models.PSM1.walls.drawn)"
        robot.trocar("send", "PSM1", "add_wall", "0", "0", "-0.3", "0", "0", "0", "1", "table plane")
        page.until(f"{walls}.length === 1 && {walls}[0].name === 'table' && {walls}[0].position.z === -0.3")
        robot.trocar("send", "PSM1", "remove_wall", "table")
        page.until(f"{walls}.length === 0")
        page.find("body").send_keys(Keys.CONTROL, "o")  # from any page, and this one has no control any more
        page.until("document.querySelector('#power-off').dataset.outcome === 'done'")
        page.open()
        page.until("trocar.value('PSM1/state.state') === 'DISABLED'", 60)
        page.open("/processes")
        page.until("document.querySelectorAll('#processes tr').length > 5")
        assert page.wrongs() == []
        ours = (address, address.replace("http", "ws"), "data:", "blob:", "chrome", "about:")
        assert [url for url in page.addresses() if not url.startswith(ours)] == []


def test_the_console_is_killed_and_the_page_comes_back(robot: Robot, records: Records) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open()
        page.take_control()
        homed(page)
        state = records(robot, "PSM1", "state")
        cell = state.field("is_homed")
        page.open("/3d")
        stage = "document.querySelector('.stage')"
        page.until(f"{stage}?.stage?.isPlaced && getComputedStyle({stage}).filter === 'none'")
        robot.pids.add(robot.kill("gui"))
        page.until("document.body.dataset.connection === 'lost'", 20)
        page.until(f"getComputedStyle({stage}).filter.includes('grayscale')")
        page.until("document.body.dataset.connection === 'live' && document.body.dataset.control === 'none'", 60)
        assert "Control lost: " in page.find("#control-lost").text
        page.open("/plots#PSM1/state.position[0]")
        kept = "document.querySelector('.plots').plots.signals()[0].t"
        page.until(f"{kept}.length > 50")
        page.click("[data-plot=pause]")
        times = page.js(f"window.isKept = true; return {kept}")
        for other in ("", "const { parse } = JSON; JSON.parse = (text) => ({...parse(text), run: 'other'});"):
            page.js(other)
            robot.pids.add(robot.kill("gui"))
            page.until("document.body.dataset.connection === 'lost'", 20)
            page.until("document.body.dataset.connection === 'live'", 60)
            assert page.js(f"return window.isKept && {kept}") == times, "a person decides when a paused plot is dropped"
            assert page.find("#reload").is_displayed() == bool(other)
        page.find("#reload").click()
        page.until("document.getElementById('confirm').open")
        assert "the paused plot" in page.find("#confirm-text").text
        page.answer_yes()
        page.until("!window.isKept && document.body.dataset.connection === 'live'")
        page.open()
        page.until("trocar.value('PSM1/state.is_homed')")
        assert state.newest() and bool(cell)


def test_a_page_too_many_says_so_and_comes_in_when_another_one_leaves(robot: Robot) -> None:
    with served(robot, KINEMATIC, "--set", "gui.max_clients=1") as address, chromium(address) as page:
        page.open()
        first = page.driver.current_window_handle
        page.driver.switch_to.new_window("tab")
        page.driver.get(address)
        lost = "document.querySelector('.bar .lost').textContent"
        page.until(f"document.body.dataset.connection === 'lost' && {lost}.startsWith('1 pages are open already')")
        assert "not even Power off" in page.js(f"return {lost}")
        second = page.driver.current_window_handle
        page.driver.switch_to.window(first)
        page.driver.close()
        page.driver.switch_to.window(second)
        page.until("document.body.dataset.connection === 'live'")


def test_what_is_old_turns_grey(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open()
        page.until("!document.querySelector('#arm-PSM1').classList.contains('stale')")
        page.open("/plots#PSM1/state.trajectory_ratio,PSM1/state.position[0]")
        page.until("document.querySelector('#plot-legend .chip:not(.stale) b')?.textContent.startsWith('1.')")
        page.until("document.querySelectorAll('#plot-legend .chip b')[1]?.textContent === '–'")  # it has no power
        robot.trocar("stop", "PSM1", "--yes")
        page.until("/s old/.test(document.querySelector('#plot-legend .chip.stale .age')?.textContent)")
        page.open()
        page.until("document.querySelector('#arm-PSM1').classList.contains('stale')")
        page.until("/s old/.test(document.querySelector('#arm-PSM1 .age').textContent)")
        page.open("/3d")
        page.until("/PSM1: \\d+ s old/.test(document.querySelector('.stage .names')?.textContent)")


def test_keys_work_on_every_page_and_names_in_messages_are_whole(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open("/plots")
        for key in "ph":
            page.js("document.querySelector('.note')?.remove()")
            page.find("body").send_keys(Keys.CONTROL, key)
            assert "Take control first" in page.note()
        page.find("body").send_keys(Keys.NULL, "?")
        page.until("document.getElementById('help').open")
        page.js("sessionStorage.setItem('control', String(Date.now() + 3600000))")  # left; then the clock was set back
        page.open()
        page.until("document.querySelector('.message')")
        page.js("""const row = document.querySelector('.message').cloneNode(true), [, name, text] = row.children;
            name.textContent = 'MTML_MTMR_ECM'; text.textContent = 'waits for somebody '.repeat(20);
            row.append(document.createElement('em')); document.getElementById('messages').append(row)""")
        assert page.js("""const [, name, text] = document.querySelector('.message:last-child').children;
            return name.scrollWidth <= Math.ceil(name.getBoundingClientRect().width)
              && name.getBoundingClientRect().right <= text.getBoundingClientRect().left""")
        page.resize(390, 844)
        assert page.js("return Math.min(...[...document.querySelector('.message:last-child').children].slice(1)"
                       ".map((part) => part.getBoundingClientRect().width))") > 80, "letters one below the other"
        assert page.wrongs() == [] and page.js("return document.body.dataset.control") == "none"
        page.open("/focus")
        assert "There is no such page" in page.find("main").text and page.find("#power-off").is_displayed()


def test_power_off_stays_in_reach_while_a_dialog_is_open(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open()
        for dialog in ("help", "confirm"):
            if dialog == "help":
                page.find("body").send_keys("?")
            else:
                page.take_control()
                page.click("#power-on", yes=True)
                page.until("trocar.value('PSM1/state.state') === 'ENABLED'", 90)
                page.press("main [data-asks=home]")
            page.until(f"document.getElementById('{dialog}').open && document.querySelector('main.content').inert")
            for _ in range(4):
                page.find("body").send_keys(Keys.TAB)
                assert page.js("return document.activeElement.closest('dialog, .ends') !== null")
            page.find("#power-off").click()  # a real one, at its place on the screen
            page.until("document.querySelector('#power-off').dataset.outcome === 'done'")
            page.until("trocar.value('PSM1/state.state') === 'DISABLED'", 60)
            page.js("delete document.querySelector('#power-off').dataset.outcome")
            page.find("body").send_keys(Keys.ESCAPE)
            page.until("!document.querySelector('dialog[open]') && !document.querySelector('main.content').inert")
            assert page.js("return document.activeElement.dataset.asks") == ("home" if dialog == "confirm" else None)
        page.find("#power-off").click()
        page.until("document.querySelector('#power-off').dataset.outcome === 'done'")
        page.js("document.querySelector('[data-opens=help]').click()")
        assert page.js("return document.querySelector('.note')") is None, "a refusal beside another question"
        assert page.value("PSM1/state.state") == "DISABLED", "Escape is no yes"
        assert page.wrongs() == []


def test_the_slave_that_follows_is_seen_following(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open()
        page.take_control()
        homed(page)
        page.open("/console")
        page.take_control()
        teleop, stage = "MTMR_PSM1/state", "document.querySelector('.stage')?.stage"
        page.click("#start-console")
        page.until("trocar.value('console/state.teleop_enabled')")
        assert page.until(f"trocar.value('{teleop}.reason')"), "it says what it waits for"
        page.click("#console-operator-press")
        page.until(f"trocar.value('{teleop}.following')", 90)
        page.driver.switch_to.new_window("tab")  # the page Console stays open: with it the operator would go
        page.open("/3d")
        page.until(f"{stage}?.isPlaced")
        where = f"{stage}.models.PSM1.tip.position.toArray()"
        before = page.js(f"return {where}")
        robot.trocar("send", "MTMR", "move_cr", "0.04", "0", "0", "0", "0", "0", "1", code=None)
        page.until(f"Math.hypot(...{where}.map((v, i) => v - {before}[i])) > 0.003", 60)


def test_a_board_that_is_gone_is_a_fault_with_its_remedy(robot: Robot) -> None:
    with served(robot, DEMO) as address, chromium(address) as page:
        gain = "[data-gain=p_gain][data-axis='1']"
        page.open("/pid/IO1/PSM1")
        page.until(f"document.querySelector(\"{gain}\").value")
        page.typed(gain, "123")
        page.open()
        page.take_control()
        page.click("main [data-asks=power-on]")
        page.until("trocar.value('PSM1/state.state') === 'ENABLED'", 90)
        robot.trocar("send", "boards", "amp_fault", "2", "1", "PSM1")
        page.until("trocar.value('PSM1/state.state') === 'FAULT'", 60)
        page.open("/pid/IO1/PSM1")
        page.until("document.getElementById('edited').textContent.startsWith('1 changed')")
        assert page.find(gain).get_attribute("value") == "123"
        page.open("/io/IO1/PSM1")
        page.until("/axis 2/.test(document.querySelector('.fault').innerText)")
        page.until("document.querySelector('.fault .remedy').textContent")
        assert page.js("return [...document.querySelectorAll('.actuators tr.on')].map((row) => row.rowIndex)") == [3]
        robot.trocar("send", "boards", "amp_fault", "2", "0", "PSM1")
        page.open()
        page.take_control()
        page.click("main [data-asks=power-on]")
        page.until("trocar.value('PSM1/state.state') === 'ENABLED'", 90)
        robot.trocar("send", "boards", "unplug_board", "6")
        page.until("trocar.value('PSM1/state.state') === 'FAULT' || trocar.value('MTMR/state.state') === 'FAULT'", 60)
        page.until("[...document.querySelectorAll('.fault:not([hidden])')].some((fault) => fault.innerText.length > 20"
                   " && fault.querySelector('.remedy').textContent)")
        assert page.js("return [...document.querySelectorAll('.message.error')].length") > 0


def test_from_elsewhere_a_token_opens_the_console_and_nothing_else_does(robot: Robot) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # sends nothing; says which address we have to others
        except OSError:
            pytest.skip("this machine has no address but loopback")
        host = probe.getsockname()[0]
    port = free()
    robot.up(KINEMATIC, "--set", f"gui.listen={host}:{port}")
    token = token_file(robot.environment, robot.name).read_text().strip()
    assert token not in robot.output(), "that may be somebody else's to read"
    with chromium(f"http://{host}:{port}") as page:
        page.driver.get(page.address)
        robot.pids.add(robot.pid("gui"))
        page.until("document.querySelector('form')")
        page.find("input").send_keys("a wrong one, surely", Keys.ENTER)
        page.until("document.body.innerText.includes('This token is wrong')")
        assert "PSM1" not in page.driver.page_source
        page.find("input").send_keys(token, Keys.ENTER)
        page.until("document.body.dataset.connection === 'live'")
        page.take_control()
        page.open("/processes")
        assert token not in page.driver.page_source + page.driver.current_url
        page.driver.delete_all_cookies()  # as after a start with another token
        robot.pids.add(robot.kill("gui"))
        page.until("document.querySelector('form')?.innerText.includes('Token of this system')")


def test_a_tip_of_an_emulated_master_is_pulled_in_3d_and_let_go_with_its_view(robot: Robot) -> None:
    with served(robot, DEMO) as address, chromium(address) as page:
        page.open()
        page.take_control()
        homed(page)
        robot.trocar("send", "MTMR", "free")
        page.open("/3d")
        page.until("document.querySelector('.stage')?.stage?.isPlaced")
        page.click("[data-view=masters]")
        page.take_control()
        where = page.js(HANDLE)
        tip = "document.querySelector('.stage').stage.models.MTMR.tip.position.toArray()"
        before = page.js(f"return {tip}")
        canvas = page.find(".stage canvas")
        page.js("const { send } = WebSocket.prototype; window.said = [];"
                "WebSocket.prototype.send = function (text) { window.said.push(JSON.parse(text).command);"
                " send.call(this, text); }")
        drag = ActionChains(page.driver).move_to_element_with_offset(canvas, *where).click_and_hold()
        drag.move_by_offset(60, -60).perform()
        page.until(f"Math.hypot(...{tip}.map((v, i) => v - {before}[i])) > 0.01", 60)
        page.js("window.dispatchEvent(new Event('pagehide'))")
        assert page.js("return window.said.filter(Boolean).at(-1)") == "release_tip"
        ActionChains(page.driver).release().perform()
        assert page.wrongs() == []
