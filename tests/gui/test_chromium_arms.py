"""Arms in a real browser: jog, moves with a preview, plots, logs, two browsers. One KINEMATIC system for all."""

from __future__ import annotations

import contextlib
import csv
import json
import math
import re
import subprocess
import sys
from collections.abc import Iterator

import pytest
from selenium.webdriver.common.action_chains import ActionChains

from tests.gui.chromium import SIZES, BrowserPage, chromium
from tests.gui.test_chromium import KINEMATIC, homed
from tests.system.conftest import systems
from tests.system.test_socket_bridge import free

pytestmark = [pytest.mark.slow, pytest.mark.peers, pytest.mark.simulated("paced")]


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BrowserPage]:
    """A browser at a system whose arms are homed."""
    with systems(tmp_path_factory.mktemp("arms"), "paced") as make:
        robot, port = make(), free()
        robot.up(KINEMATIC, "--set", f"gui.listen=127.0.0.1:{port}")
        with chromium(f"http://127.0.0.1:{port}") as page:
            page.open()
            page.system = robot.name
            robot.pids.add(robot.pid("gui"))
            page.take_control()
            homed(page)
            yield page


def test_an_arm_is_jogged_while_held_and_moved_after_a_preview(page: BrowserPage) -> None:
    page.open("/arm/PSM1")
    page.take_control()
    page.until("document.querySelector('[data-goal=\"2\"]').value === '120.00'")
    before = page.value("PSM1/state.position")[0]
    page.held(".jog[data-joint='0'][data-sign='1']", f"trocar.value('PSM1/state.position')[0] > {before} + 0.02")
    page.until("Math.abs(trocar.value('PSM1/state.velocity')[0]) < 1e-4 && !document.querySelector('.jog.on')")
    stands = page.value("PSM1/state.position")[0]
    page.typed("[data-goal='1']", "4")
    page.typed("[data-goal='1']", "4abc")  # before the first preview is answered
    page.js("return new Promise((go) => setTimeout(go, 500))")
    assert "wrong" in str(page.find("[data-goal='1']").get_attribute("class"))
    page.click("[data-does=read]")
    page.typed("[data-goal='0']", "11,5")
    page.until("document.querySelector('.stage')?.stage?.ghost?.group.visible")
    assert page.value("PSM1/state.position")[0] == pytest.approx(stands, abs=1e-3), "a preview moves nothing"
    page.take_control()
    page.press("[data-does=move]")
    page.until("document.getElementById('confirm').open")
    assert re.search(r"yaw [\d.-]+ → 11.50 °, \d+\.\d s\?", page.find("#confirm-text").text)
    page.answer_yes()
    page.until("Math.abs(trocar.value('PSM1/state.position')[0] - 11.5 * Math.PI / 180) < 1e-3")
    tip = page.value("PSM1/state.measured_cp")
    page.held(".jog[data-twist=linear][data-axis='0'][data-sign='1']",
         f"trocar.value('PSM1/state.measured_cp')[0] > {tip[0]} + 0.002")
    after = page.value("PSM1/state.measured_cp")
    assert after[1:3] == pytest.approx(tip[1:3], abs=1e-3), "only along x"
    page.typed("[data-goal='0']", "170")
    page.until("document.querySelector('[data-goal=\"0\"]').classList.contains('wrong')")
    page.click("[data-does=move]")
    page.until("/limits/.test(document.querySelector('.note')?.textContent)")
    page.resize(*SIZES[1])
    page.until("document.querySelector('.stage').stage.camera.aspect < 3.0")
    assert page.js("""const { stage } = document.querySelector('.stage');
        return stage.points(() => true, true).map((point) => point.project(stage.camera))
          .every(({ x, y }) => Math.abs(x) < 1 && Math.abs(y) < 1)""")
    assert page.js("return getComputedStyle(document.querySelector('.stage')).padding") == "0px"
    assert page.js("""const { stage } = document.querySelector('.stage'), { PSM1 } = stage.models;
        trocar.data('scene').arms.PSM1.frame = 'PSM1_base';
        [stage.only, stage.carts] = ['', () => (stage.carried = { PSM1: [1, 2, 3, 0, 0, 0, 1] })];
        stage.refresh();
        return [...PSM1.group.matrix.elements.slice(12, 15), PSM1.rail.children[3].material === PSM1.warn]""") == [
        1, 2, 3, False], "at the end of its setup arm, without the colour of a limit"
    page.resize(*SIZES[0])
    assert page.wrongs() == []


def test_a_tip_moves_to_a_pose_that_was_seen_before(page: BrowserPage) -> None:
    page.open("/arm/PSM1")
    page.take_control()
    x, z = "[data-pose=tip][data-part='0']", "[data-pose=tip][data-part='5']"
    page.until(f"document.querySelector(\"{x}\")?.value")
    before = page.value("PSM1/state.measured_cp")
    goal, turn = before[0] * 1e3 + 12.5, float(page.find(z).get_attribute("value") or "") - 15.0
    page.typed(x, f"{goal:.2f}".replace(".", ","))
    page.typed(z, f"{turn:.2f}".replace(".", ","))
    page.until("document.querySelector('.stage')?.stage?.ghost?.group.visible")
    assert page.value("PSM1/state.measured_cp") == pytest.approx(before, abs=1e-4), "a preview moves nothing"
    page.js("document.querySelector('[data-does=move-tip]').scrollIntoView({block: 'center'})")
    page.press("[data-does=move-tip]")
    page.answer_yes()
    page.until(f"Math.abs(trocar.value('PSM1/state.measured_cp')[0] * 1000 - {goal}) < 0.05")
    after = page.value("PSM1/state.measured_cp")
    assert after[1:3] == pytest.approx(before[1:3], abs=1e-4)
    half = abs(sum(p * q for p, q in zip(before[3:], after[3:], strict=True)))
    assert half == pytest.approx(math.cos(math.radians(7.5)), abs=1e-4)
    page.click("[data-does=read-tip]")
    assert abs(float(page.find(z).get_attribute("value") or "") - turn) < 0.05
    page.typed(x, "900")
    page.until("/cannot go there/.test(document.getElementById('tip-says').textContent)")
    page.click("[data-does=move-tip]")
    page.until("/cannot go there/.test(document.querySelector('.note.bad')?.textContent)")
    page.typed(x, "zwölf")
    page.click("[data-does=move-tip]")
    page.until("/or invalid/.test(document.querySelector('.note.bad')?.textContent)")


def test_nothing_is_read_of_an_arm_without_power(page: BrowserPage) -> None:
    page.open("/arm/PSM1")
    page.take_control()
    page.until("document.querySelector('[data-goal=\"2\"]').value === '120.00' || trocar.value('PSM1/state.valid')")
    page.js("trocar.call('PSM1', 'state_command', [], 'disable')")
    page.until("trocar.value('PSM1/state.valid') === false")
    goal, x = "[data-goal='1']", "[data-pose=tip][data-part='0']"
    for css, does in ((goal, "read"), (x, "read-tip")):
        page.typed(css, "11,5")
        page.js("document.querySelector('.note')?.remove()")
        page.click(f"[data-does={does}]")
        assert "Nothing is measured now" in page.note()
        assert page.find(css).get_attribute("value") == "11,5"
    page.until("[...document.querySelectorAll('.numbers .live, .joints td.live:nth-child(2)')]"
               ".every((part) => part.textContent === '–')")
    page.open()
    page.take_control()
    homed(page)
    page.until("trocar.value('PSM1/state.is_homed')", 60)


def test_what_is_typed_keeps_its_meaning_where_units_change(page: BrowserPage) -> None:
    page.open("/arm/PSM1")
    turning, sliding, jaw = "[data-goal='0']", "[data-goal='2']", "#jaw-goal"
    x, turn = "[data-pose=tip][data-part='0']", "[data-pose=tip][data-part='3']"
    page.until(f"document.querySelector(\"{x}\")?.value && document.querySelector(\"{sliding}\")?.value")
    for css, text in ((turning, "11,5"), (sliding, "120"), (jaw, "20"), (x, "12.5"), (turn, "nothing")):
        page.typed(css, text)

    def seen() -> list[str]:
        return [str(page.find(css).get_attribute("value")) for css in (turning, sliding, jaw, x, turn)]

    assert page.js("""const live = document.querySelector('script').src;
        const { inUnits, typed } = await import(live.replace('live', 'units'));
        return [...['1,000', '0x10', '12abc', '1e', '0,125', '−3.5', '2.', '1500'].map(typed),
          inUnits('insertion 0.3 m is beyond 0.24 m, at 1 m/s and 0.5 rad')]""") == [
        None, None, None, None, 0.125, -3.5, 2, 1500, "insertion 300 mm is beyond 240 mm, at 1 m/s and 28.648 °"]
    page.click("[data-does=units]")
    assert seen() == ["0.2007129", "0.12", "0.3490659", "0.0125", "nothing"]
    page.until("[...document.querySelectorAll('[data-unit=r]')].every((unit) => unit.textContent === 'rad')")
    tab = page.driver.current_window_handle
    page.driver.switch_to.new_window("tab")
    page.open("/arm/PSM1")
    page.click("[data-does=units]")
    page.driver.close()
    page.driver.switch_to.window(tab)
    page.until("trocar && document.querySelector('#jaw-goal').value === '20'")
    assert seen() == ["11.5", "120", "20", "12.5", "nothing"]
    page.take_control()
    page.js("document.querySelector('[data-does=jaw]').click()")  # hidden: this arm carries none
    page.until("document.getElementById('confirm').open")
    assert "jaw of PSM1 to 20 °?" in page.find("#confirm-text").text
    page.find("#confirm button.quiet").click()
    assert page.wrongs() == []


def test_a_base_frame_is_set_and_forgotten(page: BrowserPage) -> None:
    page.open("/arm/PSM1")
    page.take_control()
    page.until("document.querySelector(\"[data-pose=base][data-part='0']\")?.value")
    page.press("details summary")
    before = page.value("PSM1/state.measured_cp")
    page.typed("[data-pose=base][data-part='2']", "100,5")
    page.typed("#base-in", "table")
    page.press("[data-does=set-base]")
    page.until("document.getElementById('confirm').open")
    asked = page.find("#confirm-text").text
    assert "z 100.50 mm" in asked and ", in table?" in asked
    page.answer_yes()
    page.until(f"Math.abs(trocar.value('PSM1/state.measured_cp')[2] - {before[2]} - 0.1005) < 1e-6")
    assert page.value("PSM1/state.reference_frame") == "table"
    page.typed("[data-pose=base][data-part='2']", "0")
    page.press("[data-does=set-base]")
    page.answer_yes()
    page.until(f"Math.abs(trocar.value('PSM1/state.measured_cp')[2] - {before[2]}) < 1e-6")
    assert page.wrongs() == []


def test_the_log_of_a_process_is_seen_while_it_is_written(page: BrowserPage) -> None:
    page.open("/processes")
    page.until("document.querySelector('#processes tr[data-name=PSM1]')")
    page.click("#processes tr[data-name=PSM1] button")
    page.until("document.getElementById('log-of').textContent === 'Log of PSM1' && !trocar.value('log:PSM1')?.problem")
    page.take_control()
    page.js("document.querySelector('#processes tr[data-name=PSM1] button').focus()")
    seen = page.js("return JSON.stringify(trocar.value('processes.rows'))")
    page.until(f"JSON.stringify(trocar.value('processes.rows')) !== {json.dumps(seen)}")
    page.until("document.activeElement.closest('tr')?.dataset.name === 'PSM1'")
    lines = page.js("return document.querySelectorAll('#log .message').length")
    page.js("trocar.call('PSM1', 'move_jp', [9, 0, 0, 0, 0, 0], '')")  # a warning
    page.until(f"document.querySelectorAll('#log .message').length > {lines}")
    page.click("#processes tr[data-name=PSM1] button")
    page.until("document.getElementById('log-card').hidden")
    assert page.wrongs() == []


def test_a_plot_shows_a_move_and_gives_it_as_a_table(page: BrowserPage) -> None:
    page.open("/plots")  # nothing is shown yet, and it is connected all the same
    page.take_control()
    assert page.js("return document.getElementById('plot-field').value") == "position"
    page.open("/processes")
    page.open("/plots#PSM1/state.position[0]")
    page.until("document.querySelector('.plots').plots.signals()[0].t.length > 50")
    page.js("document.querySelector('.plots').plots.add('PSM1/state.velocity[0]')")
    page.until("document.querySelector('.plots').plots.signals()[1].t.length > 50")
    assert "velocity" in page.js("return location.hash")
    page.click("[data-plot=pause]")
    count = page.js("return document.querySelector('.plots').plots.csv()").splitlines()
    assert count[0] == "stamp_s,PSM1/state.position[0] rad or m,PSM1/state.velocity[0] rad/s or m/s"
    assert len(count) > 50
    page.js("document.querySelector('.plots').plots.signals()[1].unit = 'counts, \"raw\"'")
    (head, *rows) = csv.reader(page.js("return document.querySelector('.plots').plots.csv()").splitlines())
    assert head[2] == 'PSM1/state.velocity[0] counts, "raw"' and {len(row) for row in rows} == {3}
    page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True})
    try:  # a finger on a tablet
        x, y = page.js("const at = document.getElementById('plot').getBoundingClientRect();"
                       "return [at.x + 200, at.y + 99]")
        for kind, points in (("touchStart", [0]), *(("touchMove", [20 * k]) for k in range(1, 12)), ("touchEnd", [])):
            page.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {
                "type": kind, "touchPoints": [{"x": x + moved, "y": y} for moved in points]})
    finally:
        page.driver.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    page.until("document.querySelector('.plots')?.plots.zoom()")
    assert page.wrongs() == []


def test_a_paused_plot_takes_nothing_and_goes_on_with_a_gap(page: BrowserPage) -> None:
    page.open("/processes")  # by its hash alone a page is not loaded anew
    page.open("/plots#PSM1/state.position[0]")
    signal = "document.querySelector('.plots').plots.signals()[0]"
    newest = "trocar.data('plot:PSM1/state.position[0]').t"
    page.until(f"{signal}.t.length > 50")
    page.click("[data-plot=pause]")
    kept = page.js(f"return [{signal}.t.length, {newest}.at(-1)]")
    page.until(f"{newest}.at(-1) > {kept[1] + 1.0}")
    assert page.js(f"return {signal}.t.length") == kept[0]
    page.js("document.querySelector('.plots').plots.add('PSM1/state.position[1]')")
    page.until("document.querySelector('.plots').plots.signals()[1].t.length > 50")  # what was before
    assert "–" not in page.js("return document.getElementById('plot-legend').textContent")
    page.click("[data-plot=pause]")
    page.until(f"{signal}.t.length > {kept[0] + 5}")
    assert page.js(f"return {signal}.v[{kept[0]}]") is None
    times = page.js(f"return {signal}.t")
    assert times == sorted(times) and times[kept[0]] > times[kept[0] - 1] + 0.9
    rows = page.js("return document.querySelector('.plots').plots.csv()").splitlines()[1:]
    assert len({row.split(",")[0] for row in rows}) == len(rows), "a gap is no row of its own"


@pytest.mark.parametrize(("width", "height"), SIZES)
def test_no_page_is_wider_than_the_screen(page: BrowserPage, width: int, height: int) -> None:
    with chromium(page.address, width, height) as other:
        other.open()
        assert other.too_wide() == []


def test_one_of_two_browsers_has_control_and_loses_it(page: BrowserPage) -> None:
    one = page
    with chromium(page.address, 820, 1180) as other:
        one.open()
        other.open()
        one.take_control()
        other.until("document.body.dataset.control === 'other'")
        other.click("#arm-PSM1 button.commands")
        assert "Take control first" in other.note()
        other.js("trocar.call('PSM1', 'state_command', [], 'enable', (...answer) => (window.answer = answer))")
        assert "take control first" in other.until("window.answer")[1]  # forged: no button says this
        other.click("#control", yes=False)
        assert other.js("return document.body.dataset.control") != "you"
        other.take_control()
        one.until("document.body.dataset.control === 'other'")
        assert "Tester took it" in one.find("#control-lost").text
        other.driver.get("about:blank")
        one.until("document.body.dataset.control === 'none'")
        one.take_control()
        one.js("setInterval = null; for (let i = 0; i < 10000; i++) clearInterval(i)")  # it is silent
        one.until("document.body.dataset.control !== 'you'", 10)
        assert "silent for too long" in one.find("#control-lost").text


def test_a_refused_command_says_why_where_it_was_pressed(page: BrowserPage) -> None:
    page.open()
    page.take_control()
    page.click("#arm-PSM1 button.quiet:last-child")
    page.until("trocar.value('PSM1/state.state') === 'DISABLED'")
    page.click("#arm-PSM1 button.commands:nth-child(2)")  # Home, of an arm without power
    page.until("document.querySelector('#arm-PSM1 button.commands:nth-child(2)').dataset.outcome === 'refused'")
    assert "PSM1" in page.note() and "refused" in page.note()


def test_a_jog_that_the_arm_refuses_ends_and_says_why_while_it_is_held(page: BrowserPage) -> None:
    page.open()
    page.take_control()
    homed(page)
    page.open("/arm/PSM1")
    page.take_control()
    page.until("trocar.value('PSM1/state.valid')")
    before = page.value("PSM1/state.position")[0]
    sign = -1 if before > 0.0 else 1  # other tests may have left it at a limit
    button = page.find(f".jog[data-joint='0'][data-sign='{sign}']")
    page.js("arguments[0].scrollIntoView({block: 'center'})", button)
    ActionChains(page.driver).move_to_element(button).click_and_hold().perform()
    try:
        page.until(f"{sign} * (trocar.value('PSM1/state.position')[0] - {before}) > 0.002")
        page.js("trocar.call('PSM1', 'state_command', [], 'disable')")
        page.until("!document.querySelector('.jog.on')")
        assert "refused" in page.note() and "power-off" in page.note()
    finally:
        ActionChains(page.driver).release().perform()
    assert page.wrongs() == []


SHOWS = """
import sys, time
from trocar.tools.client.remote import Remote
with Remote(sys.argv[1], "system") as system:
    system.ask("show_pose", [0.5, -0.3, 0.1, 0.0, 0.0, 0.0], sys.argv[2])
    print("shown", flush=True)
    time.sleep(600)
"""


@contextlib.contextmanager
def showing(system: str, name: str) -> Iterator[subprocess.Popen[str]]:
    """A program that shows a pose of an arm."""
    with subprocess.Popen([sys.executable, "-c", SHOWS, system, name], stdout=subprocess.PIPE, text=True) as program:
        try:
            assert program.stdout is not None and program.stdout.readline() == "shown\n"
            yield program
        finally:
            program.kill()


FULL = KINEMATIC.with_name("kinematic-full.yaml")
GHOST = "document.querySelector('.stage')?.stage?.asked"


@pytest.mark.parametrize(("width", "height"), SIZES[:2])
def test_a_pose_that_is_asked_for_is_a_ghost_until_the_asking_program_is_killed(
        page: BrowserPage, width: int, height: int) -> None:
    with chromium(page.address, width, height) as other:
        for path in ("/3d", "/arm/PSM1"):
            other.open(path)
            other.until(f"document.querySelector('.stage')?.stage?.isPlaced && !{GHOST}")
            with showing(page.system, "PSM1") as program:
                other.until(f"{GHOST}?.group.visible && {GHOST}.at.length === 8 && !{GHOST}.label.hidden")
                moved = other.js(f"const ghost = {GHOST}, own = document.querySelector('.stage').stage.models.PSM1;"
                                 "return ghost.at[3].distanceTo(own.at[3])")
                assert moved > 0.02, "the arm itself is elsewhere"
                assert other.find(".names .asked").text == "bring PSM1 here"
                assert other.js(f"return {GHOST}.body.transparent && {GHOST}.body.opacity") == pytest.approx(0.35)
                program.kill()
                other.until(f"!{GHOST} && !document.querySelector('.names .asked')")
        assert other.wrongs() == []


def test_the_page_of_another_arm_shows_no_ghost(page: BrowserPage) -> None:
    page.open("/arm/MTMR")
    with showing(page.system, "PSM1"):
        page.until("trocar.data('scene')?.shown?.name === 'PSM1'")
        page.until("document.querySelector('.stage')?.stage?.shown > 3")
        assert not page.js(f"return Boolean({GHOST})")
    assert page.wrongs() == []


def test_a_setup_arm_has_a_ghost_in_its_cart(tmp_path_factory: pytest.TempPathFactory) -> None:
    with systems(tmp_path_factory.mktemp("cart"), "paced") as make:
        robot, port = make(), free()
        robot.up(FULL, "--set", f"gui.listen=127.0.0.1:{port}")
        with chromium(f"http://127.0.0.1:{port}") as page:
            page.open("/3d")
            page.until(f"document.querySelector('.stage')?.stage?.isPlaced && !{GHOST}")
            with showing(robot.name, "SUJ/PSM1"):
                page.until(f"{GHOST}?.at.length > 4 && {GHOST}.label.textContent === 'bring SUJ/PSM1 here'")
                assert page.js(f"const own = document.querySelector('.stage').stage.setups.SUJ.PSM1, ghost = {GHOST};"
                               "return [ghost.body.opacity, ghost.at.length === own.at.length, own.body.opacity,"
                               "ghost.at.at(-1).distanceTo(own.at.at(-1)) > 0.1]") == [0.35, True, 1, True]
            page.until(f"!{GHOST}")
            assert page.wrongs() == []
