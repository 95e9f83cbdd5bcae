"""The console's pages of robots, buttons, setup joints and focus in a real browser, on emulated boards."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from selenium.webdriver.common.action_chains import ActionChains

from tests.gui.chromium import SIZES, BrowserPage, chromium
from tests.system.conftest import systems
from tests.system.robot import Robot
from tests.system.robot_pages import OPTIONS, system_file
from tests.system.test_socket_bridge import free

pytestmark = [pytest.mark.peers, pytest.mark.slow, pytest.mark.simulated("paced")]


@pytest.fixture(scope="module")
def console(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Robot, BrowserPage]]:
    """A robot that is on, and a browser that has control of it."""
    place = tmp_path_factory.mktemp("pages")
    with systems(place, "paced") as make:
        robot, port = make(), free()
        robot.up(system_file(place), *OPTIONS, "--set", f"gui.listen=127.0.0.1:{port}")
        with chromium(f"http://127.0.0.1:{port}") as page:
            yield robot, page


def opened(console: tuple[Robot, BrowserPage], path: str) -> BrowserPage:
    """A page, with control."""
    page = console[1]
    page.open(path)
    page.take_control()
    return page


def shown(path: str) -> str:
    """What a value is in the page, as JavaScript."""
    return f"window.trocar.value('{path}')"


def test_a_page_shows_power_and_brakes_change(console: tuple[Robot, BrowserPage]) -> None:
    page = console[1]
    page.open("/io")
    page.until("document.querySelectorAll('.actuators tbody tr').length === 7")
    page.click("#io-power-on")
    assert "Take control" in page.note()
    page.take_control()
    page.click("#io-power-on", yes=False)
    page.click("#brakes-release")
    page.until("document.querySelector('.note.bad')?.textContent.includes('amplifiers are not on')")
    console[0].trocar("home", "ECM")
    page.until(shown("IO1/robot0.brakes_released"))
    page.until("[...document.querySelectorAll('.actuators .light.on')].length >= 11")
    assert "°" in page.find(".actuators").text
    page.take_control()  # a busy machine may have held the console up meanwhile
    page.click("#brakes-engage")
    page.until(f"!{shown('IO1/robot0.brakes_released')}")
    page.js("document.getElementById('control').click()")
    page.until("document.body.dataset.control === 'none'")
    page.click("#io-power-off")
    page.until(f"!{shown('IO1/robot0.amps_on')}")
    stale = "document.getElementById('robot').classList.contains('stale')"
    assert not page.js(f"return {stale}")
    console[0].trocar("send", "boards", "unplug_board", "4")
    page.until(f"{stale} && document.querySelector('#robot .age').textContent.includes('s old')")
    console[0].trocar("send", "boards", "plug_board", "4")
    page.until(f"!{stale}")
    page.open("/io/io/PSM1")
    page.until(f"document.getElementById('robot')?.innerText.includes('KINEMATIC') && !{stale}")
    assert page.wrongs() == []


def test_a_gain_is_edited_applied_and_saved_and_a_step_is_seen(console: tuple[Robot, BrowserPage]) -> None:
    console[0].home("ECM")
    page = opened(console, "/pid")
    page.until("document.querySelector('[aria-label=\"p_gain pitch\"]')?.value === '1000'")

    def edit(text: str) -> None:
        page.js("const i = document.querySelector('[aria-label=\"p_gain pitch\"]'); i.focus(); i.value = arguments[0];"
                "i.dispatchEvent(new Event('input', {bubbles: true}))", text)

    edit("-3")
    page.click("#apply")
    page.until("document.querySelector('.note.bad')?.textContent.includes('from 0 up to')")
    edit("1010,5")
    page.click("#apply")
    page.until(f"{shown('IO1/gains0.p_gain.1')} === 1010.5")
    page.until("document.getElementById('edited').textContent === 'nothing changed'")
    edit("99000")
    page.click("#apply")
    page.until("document.querySelector('.note.bad')?.textContent.includes('more than 10 times')")
    page.click("#discard")
    saved = page.js("return fetch(document.getElementById('save').href).then((answer) => answer.json())")
    assert [axis["p_gain"] for axis in saved["pid"]][:2] == [400, 1010.5]
    before = page.value("IO1/robot0.setpoint_position.0")
    page.until("document.getElementById('trace').getContext('2d').getImageData(60, 20, 200, 300).data.some((v) => v)")
    page.until("""['--s0', '--s1'].every((name) => {
        const { width, height } = document.getElementById('trace');
        const all = document.getElementById('trace').getContext('2d').getImageData(0, 0, width, height / 2).data;
        const of = getComputedStyle(document.documentElement).getPropertyValue(name).trim().match(/[0-9a-f]{2}/g);
        const [r, g, b] = of.map((part) => parseInt(part, 16));
        for (let i = 0; i < all.length; i += 4)
          if (Math.abs(all[i] - r) + Math.abs(all[i + 1] - g) + Math.abs(all[i + 2] - b) < 24) return true;
        return false })""")  # measured on setpoint: both colours are seen
    page.js("document.getElementById('step-time').value = '4'")
    page.click("#step")
    page.until(f"{shown('IO1/robot0.setpoint_position.0')} > {before + 0.017}")
    page.until(f"Math.abs({shown('IO1/robot0.setpoint_position.0')} - {before}) < 1e-4")
    page.until("document.getElementById('pause').textContent === 'Resume'")
    page.take_control()
    page.click("#switch-pid", yes=False)
    assert page.value("IO1/robot0.pid_enabled")
    page.click("#switch-pid")
    page.until(f"!{shown('IO1/robot0.pid_enabled')}")
    assert page.wrongs() == []


@pytest.mark.parametrize("way", ["hold from elsewhere", "Power off"])
def test_a_step_does_not_go_back_after_the_arm_was_stopped(console: tuple[Robot, BrowserPage], way: str) -> None:
    robot = console[0]
    robot.home("ECM")
    page = opened(console, "/pid")
    setpoint = shown("IO1/robot0.setpoint_position.0")
    page.until(f"{shown('ECM/state.state')} === 'ENABLED' && {setpoint} !== null && {shown('ECM/audit')}")
    before = page.value("IO1/robot0.setpoint_position.0")
    page.js("document.getElementById('step-time').value = '5'")
    page.click("#step")
    page.until(f"{setpoint} > {before + 0.017}")
    if way == "Power off":
        page.find("#power-off").click()
    else:
        robot.trocar("send", "ECM", "hold")
    page.until("/does not step back/.test(document.querySelector('.note.bad')?.textContent)")
    assert ("it was stopped" if way == "Power off" else "received hold") in page.note()
    stands = page.value("IO1/robot0.setpoint_position.0")
    assert way == "Power off" or stands == pytest.approx(before + 0.01745, abs=1e-3)
    assert page.wrongs() == []


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_no_page_is_wider_than_the_screen(console: tuple[Robot, BrowserPage], width: int, height: int) -> None:
    with chromium(console[1].address, width, height) as page:
        page.open()
        assert page.too_wide() == []


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_every_view_has_in_the_picture_what_it_is_of(console: tuple[Robot, BrowserPage], width: int, height: int
                                                     ) -> None:
    with chromium(console[1].address, width, height) as page:
        page.open("/3d")
        page.until("document.querySelector('.stage')?.stage?.isPlaced")
        for view in page.js("return [...document.querySelectorAll('[data-view]')].map(({ dataset }) => dataset.view)"):
            if view == "operator":  # of the tips, from where the endoscope is
                continue
            farthest = page.js("""const [view] = arguments, { stage } = document.querySelector('.stage');
                stage.look(view);
                stage.camera.updateMatrixWorld();
                const are = (model) => view === 'all' || (model.type === 'MTM') === (view === 'masters');
                const places = stage.points(are, view === 'all').map((at) => at.clone().project(stage.camera));
                return Math.max(...places.map(({ x, y }) => Math.max(Math.abs(x), Math.abs(y))))""", view)
            assert 0.7 < farthest < 1.0, view


def test_a_pedal_that_is_pressed_is_seen(console: tuple[Robot, BrowserPage]) -> None:
    page = opened(console, "/buttons")
    row = "document.querySelector('[data-input=coag]').closest('tr')"
    page.until(f"{row}.innerText.includes('operator is present')")
    page.click("[data-input=coag]")
    page.until(f"{row}.querySelector('.light.on') && {row}.innerText.includes('pressed')")
    page.until(shown("console/state.operator_present"))
    page.click("[data-input=coag]")
    page.until(f"!{row}.querySelector('.light.on') && {row}.innerText.includes('released')")
    assert page.wrongs() == []


def test_kinematic_setup_arms_are_put_where_one_says(console: tuple[Robot, BrowserPage]) -> None:
    page = opened(console, "/suj")
    page.until(shown("SUJ/state.setup_valid.2"))
    card = "#setup-PSM2"
    page.click(f"{card} [data-submit]")
    page.until("document.querySelector('.note.bad')?.textContent.includes('a number is needed')")
    page.click(f"{card} [data-reads]")
    page.js("document.querySelector('#setup-PSM2 [data-arg]').value = '123,5'")
    before = page.value("SUJ/state.position.2.1")
    page.click(f"{card} [data-submit]")
    page.until(f"Math.abs({shown('SUJ/state.position.2.0')} - 0.1235) < 1e-9")
    assert abs(page.value("SUJ/state.position.2.1") - before) < 1e-3
    assert page.wrongs() == []


def test_the_lens_moves_while_a_button_is_held(console: tuple[Robot, BrowserPage]) -> None:
    page = opened(console, "/focus")
    button, hand = page.find("#lens-focus_in"), ActionChains(page.driver)
    hand.click_and_hold(button).perform()
    page.until(shown("lens/state.focusing.0"))
    hand.reset_actions()
    hand.release().perform()
    page.until(f"!{shown('lens/state.focusing.0')}")
    for number in (1, 2):  # not the buttons of a mouse that do other things: a menu would swallow the end
        assert page.js("""const [button, number] = arguments; let isOn = false;
            button.dispatchEvent(new PointerEvent('pointerdown', { bubbles: true, button: number }));
            isOn = button.classList.contains('on'); window.dispatchEvent(new PointerEvent('pointerup'));
            const menu = new MouseEvent('contextmenu', { bubbles: true, cancelable: true });
            return !isOn && !button.dispatchEvent(menu)""", button, number)
    page.click("#lens-lock")
    page.until(shown("lens/state.locked"))
    ActionChains(page.driver).click(button).perform()
    page.until("document.querySelector('.note.bad')?.textContent.includes('lock')")
    assert page.wrongs() == []


def test_a_setup_arm_is_clutched_and_lifted_while_a_button_is_held(
        tmp_path: Path, data: Callable[[str], Path]) -> None:
    with systems(tmp_path, "paced") as make:
        robot, port = make(), free()
        robot.up(data("dvrk-site/jhu-daVinci/system-SUJ.json"), "--path", str(data("dvrk-share")),
                 *OPTIONS, "--set", f"gui.listen=127.0.0.1:{port}")
        with chromium(f"http://127.0.0.1:{port}") as page:
            page.open("/suj")
            robot.pids.add(robot.pid("gui"))
            page.until("document.querySelector('#setup-PSM1 .switch')")
            page.click("#setup-PSM1 .switch")
            assert "Take control" in page.note()
            robot.trocar("home")
            page.until(f"{shown('SUJ/state.setup_valid')}.every((known) => known)", 120)
            page.take_control()
            page.click("#setup-PSM1 .switch", yes=False)
            assert not page.value("SUJ/state.clutched.1")
            page.click("#setup-PSM1 .switch")
            page.until(shown("SUJ/state.clutched.1"))
            page.until(f"!{shown('SUJ/state.setup_valid.1')} && {shown('SUJ/state.brake_current.1')} > 0")
            page.take_control()
            page.click("#setup-PSM1 .switch")
            page.until(f"!{shown('SUJ/state.clutched.1')}")
            page.until(shown("SUJ/state.setup_valid.1"), 120)
            page.take_control()
            hand = ActionChains(page.driver)
            page.js("arguments[0].scrollIntoView({block: 'center'})", page.find(".hold"))
            hand.click_and_hold(page.find(".hold")).perform()
            page.until(f"{shown('SUJ/state.lift')} === 1")
            hand.reset_actions()
            hand.release().perform()
            page.until(f"!{shown('SUJ/state.lift')}")
            assert page.wrongs() == []
