"""The timeline in a real browser: a fault, the state before it, and back. With Chromium and its driver."""

from __future__ import annotations

import pytest
from selenium.webdriver.common.keys import Keys

from tests.gui.chromium import BrowserPage, chromium
from tests.gui.test_chromium import DEMO, KINEMATIC, homed, served
from tests.system.conftest import records as records
from tests.system.conftest import robot as robot
from tests.system.conftest import robots as robots
from tests.system.robot import Robot
from tests.system.test_recorder import ON

pytestmark = [pytest.mark.slow, pytest.mark.peers, pytest.mark.simulated("paced")]
PAST, LIVE = "document.body.dataset.past !== undefined", "document.body.dataset.past === undefined"
SHOWN = "document.querySelector('#arm-PSM1 .chip').textContent"
STATE = "trocar.value('PSM1/state.state')"
PRESENT = "document.getElementById('timeline').timeline"


def test_a_fault_is_rewound_by_its_mark_and_the_page_returns_to_live(robot: Robot) -> None:
    with served(robot, DEMO, *ON) as address, chromium(address) as page:
        page.open()
        page.take_control()
        homed(page)
        page.until("document.querySelectorAll('#messages .message').length > 3")
        robot.trocar("send", "boards", "amp_fault", "PSM1", "3", "1")
        page.until(f"{STATE} === 'FAULT' && {SHOWN} === 'FAULT'")
        page.until("document.querySelector('.fault-mark')?.title.includes('amplifier')")
        page.click(".fault-mark")
        page.until(f"{PAST} && {SHOWN} === 'ENABLED'")
        page.until("document.getElementById('past-what').textContent.includes('before the fault PSM1')")
        assert page.js("return document.title").startswith("PAST") and "THE PAST" in page.find("#past").text
        messages = page.find("#messages").text
        assert "HOMED" in messages and "amplifier is off" not in messages, "messages are those of that time"
        page.until("document.getElementById('past-news').textContent === 'Now: PSM1 is in FAULT'")
        _commands_nothing_but_stops(page)
        page.until("!document.getElementById('past-file').hidden")
        kept = page.js("return (async () => { const a = await fetch(document.getElementById('past-file').href);"
                       "return [a.status, a.headers.get('content-disposition'), (await a.text()).slice(1, 5)] })()")
        assert kept[0] == 200 and "fault-" in kept[1] and kept[2] == "MCAP"
        at = page.js(f"return {PRESENT}.at()")
        page.find("#time").send_keys(Keys.ARROW_RIGHT)  # 1 s; three would lead to the present
        page.until(f"{SHOWN} === 'FAULT' && {PRESENT}.at() > {at}")
        page.open("/3d")
        page.until(f"{PAST} && {PRESENT}.at() > {at} && trocar.data('scene').arms.PSM1.state === 'FAULT'")
        _all_views_change_at_once(page)
        page.open("/plots#PSM1/state.position[0]")
        page.until("document.querySelector('.plots').plots?.signals().length === 1")
        page.js(f"{PRESENT}.goTo({at})")  # a busy machine may take longer than a change of pages may
        page.until(f"{PAST} && trocar.data('plot:PSM1/state.position[0]')?.t?.length > 5")
        lasts = page.js("const t = trocar.data('plot:PSM1/state.position[0]').t; return [t[0], t.at(-1)]")
        assert lasts[0] * 1000 < at < lasts[1] * 1000, "times of day, around the shown one"
        page.find("#time").send_keys(Keys.END)
        page.until(f"{LIVE} && document.querySelector('.plots').plots.signals()[0].t.length > 0")
        page.open()
        page.until(f"{LIVE} && {SHOWN} === 'FAULT'")
        page.find("#time").send_keys(Keys.ARROW_LEFT * 3)
        page.until(PAST)
        page.js("location.reload()")
        page.until(f"window.trocar && {LIVE} && {SHOWN} === 'FAULT'")
        assert page.wrongs() == []


def _all_views_change_at_once(page: BrowserPage) -> None:
    seen = "document.querySelector('.stage').stage.models.PSM1.group.visible"
    page.until(seen)
    at = page.js(f"return {PRESENT}.at()")
    page.js(f"{PRESENT}.goTo(Date.now() - 86400000)")
    page.until(f"{PAST} && !{seen}")
    wrong = "trocar.onTick(() => { if (!calls) throw new Error('one view') })"
    assert page.js(f"window.calls = 0; {wrong}; trocar.onTick(() => calls++); {PRESENT}.live(); return [calls, {seen}]"
                   ) == [1, True], "without a tick, in spite of an error"
    assert ["one view" in wrong for wrong in page.wrongs()] == [True]
    page.js(f"{PRESENT}.goTo({at})")
    page.until(PAST)


def _commands_nothing_but_stops(page: BrowserPage) -> None:
    page.take_control()
    assert not page.js("return trocar.hasControl()")
    page.click("#arm-PSM1 button.commands")
    assert "shows the past" in page.note()
    page.js("trocar.call('MTMR', 'state_command', [], 'home').then((answer) => window.answer = answer)")
    assert "too late" in page.until("window.answer")[1], "the server refuses it, too"
    page.js("window.answer = null; trocar.call('MTMR', 'hold', [], '').then((answer) => window.answer = answer)")
    assert page.until("window.answer")[0] in ("done", "accepted"), "what stops is never refused"


def test_a_page_that_shows_the_past_still_powers_off(robot: Robot) -> None:
    with served(robot, KINEMATIC, *ON) as address, chromium(address, 390, 844) as page:
        page.open()
        page.until("trocar.value('PSM1/state.state') === 'DISABLED'")
        page.take_control()
        homed(page)
        page.until(f"{SHOWN} === 'ENABLED'")
        enabled = page.js("return Date.now()")
        page.until(f"Date.now() > {enabled} + 2000")
        page.js(f"{PRESENT}.goTo({enabled} + 1000)")
        page.until(f"{PAST} && {SHOWN} === 'ENABLED'")
        assert page.js("return document.documentElement.scrollWidth <= innerWidth")
        page.find("body").send_keys(Keys.CONTROL, "o")
        page.until("document.querySelector('#power-off').dataset.outcome === 'done'")
        assert page.js(f"return {SHOWN}") == "ENABLED", "the page still shows the past"
        page.js(f"{PRESENT}.goTo(Date.now() - 3600000)")
        page.until("document.getElementById('past-what').textContent.includes('Nothing is recorded')")
        assert page.js(f"return {SHOWN}") == "–", "what is not known is not shown"
        page.click("#past-live")
        page.until(f"{LIVE} && {SHOWN} === 'DISABLED'", 60)
        assert page.wrongs() == []
