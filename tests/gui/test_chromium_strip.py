"""The strip of every page in a real browser: arms, alarms, control by name, the next step, Stop, and no connection."""

from __future__ import annotations

import pytest
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.keys import Keys

from tests.gui.chromium import SIZES, BrowserPage, chromium
from tests.gui.test_chromium import served
from tests.system.conftest import records as records
from tests.system.conftest import robot as robot
from tests.system.conftest import robots as robots
from tests.system.robot import Robot

pytestmark = [pytest.mark.slow, pytest.mark.peers, pytest.mark.simulated("paced")]
WORD = "document.querySelector('[data-arm-chip={}]').dataset.word"
PLACES = """return [...document.querySelectorAll('.armchip, #alarms, #control, #next, #stop, #power-off, main')]
    .map((part) => { const { x, y, width } = part.getBoundingClientRect(); return [x, y, width].map(Math.round); })"""
TARGETS = """return [...document.querySelectorAll('#stop, #power-off, .jog, .hold, #next :not([hidden])')]
    .filter((part) => part.getClientRects().length && part.getBoundingClientRect().height < 44)
    .map((part) => part.outerHTML)"""


def step(page: BrowserPage, which: str) -> None:
    """Wait until this is the next step, and take it."""
    page.until(f"document.querySelector('[data-step=\"{which}\"]').hidden === false", 120)
    page.take_control()  # a busy machine may have cost the page its control
    page.click(f"[data-step='{which}']")


def test_the_strip_leads_from_no_name_to_teleoperation_and_stops_it_and_nothing_moves_in_it(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page, chromium(address) as other:
        other.open("/nothing-here")
        page.open()
        page.js("localStorage.removeItem('person')")
        page.until(f"{WORD.format('PSM1')} === 'off'")
        before = page.js(PLACES)
        assert page.find("#power-on").get_attribute("aria-disabled") == "true", "without control, actions are disabled"
        assert page.find("#stop").is_enabled() and page.find("#power-off").is_enabled()
        page.find("#control").click()
        page.until("document.getElementById('person').open && document.activeElement.id === 'person-name'")
        page.find("#person-name").send_keys("Ada", Keys.ENTER)
        page.until("document.getElementById('holder').textContent === 'Control: you, Ada'")
        assert page.find("#power-on").get_attribute("aria-disabled") is None
        page.take_control()
        other.until("document.getElementById('holder').textContent === 'Control: Ada'")
        other.find("#control").click()
        other.until("document.getElementById('confirm').open")
        assert other.find("#confirm-text").text == "Ada has control. Take it over?"
        other.driver.get("about:blank")
        page.take_control()
        page.find("#power-on").click()
        page.until("document.getElementById('confirm').open")
        asked = page.find("#confirm-text").text
        assert "MTMR" in asked and "PSM1" in asked and "2 of 2" in asked
        page.answer_yes()
        step(page, "home")
        page.until(f"{WORD.format('PSM1')} === 'ready' && {WORD.format('MTMR')} === 'ready'", 120)
        assert page.js(PLACES) == before, "nothing moves when a state changes"
        step(page, "teleop")
        page.until("trocar.value('strip.consoles.console')")
        page.take_control()
        page.js("trocar.call('PSM1', 'move_jp', [0.5, 0, 0.1, 0, 0, 0], '')")
        page.until(f"['moving', 'follows'].includes({WORD.format('PSM1')})", 60)
        page.find("body").send_keys(Keys.CONTROL, "s")
        page.until("document.getElementById('stop').dataset.outcome === 'done'")
        page.until(f"!trocar.value('strip.consoles.console') && {WORD.format('PSM1')} === 'ready'", 60)
        assert page.value("PSM1/state.position")[0] < 0.45
        page.find("body").send_keys(Keys.ALT, "t")
        page.until("document.getElementById('confirm').open")
        assert "Start teleoperation?" in page.find("#confirm-text").text
        assert page.wrongs() == []


def test_the_strip_shows_and_stops_the_present_while_the_page_shows_the_past(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open("/operate")
        page.until(f"{WORD.format('PSM1')} === 'off'")
        steps = page.js("return JSON.parse(document.getElementById('stop').dataset.steps)[0]")
        assert [" ".join(step[:2]) for step in steps] == [
            "system hold", "console teleop_enable", "MTMR hold", "PSM1 hold"]
        page.take_control()
        page.find("#power-on").click()
        page.until("document.getElementById('confirm').open")
        assert "2 of 2" in page.find("#confirm-text").text
        robot.trocar("send", "MTMR", "state_command", "enable")
        page.until(f"{WORD.format('MTMR')} === 'powered'")
        page.find("#confirm button.primary").click()
        page.until("document.getElementById('confirm').open"
                   " && document.getElementById('confirm-text').textContent.includes('1 of 2')")
        page.find("#confirm button.quiet").click()
        assert page.value("strip.arms.PSM1.word") == "off", "a yes is to the question that was shown"
        page.js("trocar.onTick(() => { throw new Error('one view'); });"
                "trocar.rewind({ strip: { arms: { PSM1: { word: 'ready' }, MTMR: { word: 'fault' } }, links: [] } })")
        page.until("document.getElementById('limits').textContent.includes('Not recorded')")
        robot.trocar("send", "PSM1", "state_command", "enable")
        page.until(f"{WORD.format('PSM1')} === 'powered' && {WORD.format('MTMR')} === 'powered'")
        page.find("#power-on" if page.js("return !document.getElementById('power-on').hidden") else "#home").click()
        assert "the past" in page.note()
        page.find("#stop").click()
        page.until("document.getElementById('stop').dataset.outcome === 'done'")
        page.until(f"{WORD.format('PSM1')} === 'paused' && {WORD.format('MTMR')} === 'paused'")
        page.js("trocar.rewind(null)")
        step(page, "resume")
        page.until(f"{WORD.format('PSM1')} === 'powered' && {WORD.format('MTMR')} === 'powered'")


def test_alarms_are_counted_listed_acknowledged_and_sounded(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        count = "document.getElementById('alarms').textContent"
        page.open("/nothing-here")
        page.until(f"{count} === '✓ 0 alarms'")
        page.click("#alarms")
        page.click("#sound")
        comes = """trocar.data('alarms').rows = [...trocar.data('alarms').rows, ...arguments[0].map((text, i) => (
            { from: 'PSM1', severity: 'error', code: text, text, hint: 'Look at it.', at_ms: 1e12 + i, order: i }))]"""
        page.js(comes, ["it trips", "it trips again"])
        page.until(f"{count} === '▲ 2 alarms'")
        page.until("Number(document.getElementById('sound').dataset.played) === 2")  # one to hear what it is
        assert page.js("return document.getElementById('alarmed').textContent") == "PSM1: it trips again"
        assert "Look at it." in page.find("#alarm-rows .message").text
        page.click("#alarm-rows .message button")
        page.until(f"{count} === '▲ 1 alarm'")
        page.click("[data-acknowledge]")
        page.until(f"{count} === '✓ 0 alarms'")
        page.find("body").send_keys(Keys.ESCAPE)
        page.until("document.getElementById('alarm-list').hidden && document.activeElement.id === 'alarms'")
        page.open("/plots")
        page.until(f"{count} === '✓ 0 alarms'")
        page.js(comes, ["it trips", "it trips again"])
        page.js(comes, ["an older one", "another"])
        page.until(f"{count} === '▲ 2 alarms'")  # those that are acknowledged stay so


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_without_connection_a_bar_says_so_and_stop_and_power_off_keep_their_places(
        robot: Robot, width: int, height: int) -> None:
    with served(robot) as address, chromium(address, width, height) as page:
        places = set()
        for path in ("/", "/3d", "/nothing-here"):
            page.open(path)
            page.until(f"{WORD.format('PSM1')} === 'off'")
            page.js("scrollTo(0, document.body.scrollHeight)")
            places.add(str(page.js("""return ['stop', 'power-off'].map((id) => {
                const { x, y, right, bottom } = document.getElementById(id).getBoundingClientRect();
                return [x, y, right, bottom, y >= 0 && bottom <= innerHeight && right <= innerWidth]; })""")))
            assert page.js(TARGETS) == []
        assert len(places) == 1 and "False" not in places.pop()
        page.js("window.Kept = WebSocket; window.WebSocket = class {"  # a network that is cut
                " constructor() { setTimeout(() => this.onclose({ reason: '' }), 50); } }")
        robot.pids.add(robot.kill("gui"))
        page.until("/^No connection for \\d+ s. Power off cannot be sent: use the emergency stop.$/"
                   ".test(document.querySelector('#offline .since').textContent)"
                   " && !document.getElementById('offline').hidden", 20)
        assert page.js("const { width } = document.getElementById('offline').getBoundingClientRect();"
                       "return width === document.documentElement.clientWidth")
        assert page.js(f"return {WORD.format('PSM1')}") == "no data"
        page.until("document.getElementById('time-shown')?.textContent !== 'live'"
                   " && !document.getElementById('live')?.classList.contains('on')")
        page.js("window.WebSocket = window.Kept")
        page.until("document.getElementById('offline').hidden", 60)


def test_a_jog_by_key_lasts_while_the_key_is_held(robot: Robot) -> None:
    with served(robot) as address, chromium(address) as page:
        page.open()
        page.take_control()
        page.click("main [data-asks=home]")
        page.until("trocar.value('PSM1/state.is_homed')", 120)
        page.open("/arm/PSM1")
        page.take_control()
        page.until("trocar.value('PSM1/state.valid')")
        assert page.js(TARGETS) == []
        jog = ".jog[data-joint='0'][data-sign='1']"
        before = page.value("PSM1/state.position")[0]
        for _ in range(12):  # a busy machine may cost the page its control, or the jog
            page.take_control()
            page.js("document.querySelector(arguments[0]).focus()", jog)
            ActionChains(page.driver).key_down(Keys.SPACE).perform()
            page.until(f"trocar.value('PSM1/state.position')[0] > {before} + 0.02"
                       " || !document.querySelector('.jog.on')")
            ActionChains(page.driver).key_up(Keys.SPACE).perform()
            if page.js(f"return trocar.value('PSM1/state.position')[0] > {before} + 0.02"):
                break
        page.until("!document.querySelector('.jog.on') && Math.abs(trocar.value('PSM1/state.velocity')[0]) < 1e-4")
        assert page.value("PSM1/state.position")[0] > before + 0.02
        page.take_control()
        page.js("document.querySelector(arguments[0]).focus()", jog)
        ActionChains(page.driver).key_down(Keys.SPACE).perform()
        page.js("document.activeElement.blur()")
        assert page.js("return document.querySelector('.jog.on')") is None, "the key counts at its button only"
        ActionChains(page.driver).key_up(Keys.SPACE).perform()
        page.take_control()
        on = page.js("""
            document.querySelector(arguments[0]).focus();
            const isOnAfter = (key, repeat) => {
              const event = new KeyboardEvent('keydown', { key, repeat, bubbles: true, cancelable: true });
              document.activeElement.dispatchEvent(event);
              return document.querySelector('.jog.on') !== null;
            };
            return [[' ', false], ['a', false], [' ', true], [' ', false], [' ', true]].map((one) => isOnAfter(...one))
            """, jog)
        assert on == [True, False, False, True, True], "another key ends it, and a repetition begins nothing"
        page.until("!document.querySelector('.jog.on')", 5)  # its repetitions have ended
        assert page.wrongs() == []
