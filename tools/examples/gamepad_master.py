"""A gamepad as the master of a teleoperation: an example of a program that takes an arm's place.

    pip install 'trocar[gamepad]'
    python -m trocar.tools.examples.gamepad_master
"""

from __future__ import annotations

import contextlib
import importlib
from collections.abc import Callable
from typing import Annotated, Any

import typer

from trocar.procs.machine.extras import missing
from trocar.tools.cli import guarded
from trocar.tools.client.provider import Provider
from trocar.tools.client.scripting import provide
from trocar.tools.examples.gamepad import BUTTONS, Device, Gamepad, GamepadTip, is_gamepad
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import note
from trocar.tools.verbs.options import SystemOption

HELD = "hold the left bumper to move, right trigger: gripper, B: clutch, X: camera; Ctrl-C ends it"


def evdev() -> Any:
    """The package; Problem if it is not installed."""
    if lacks := missing("evdev"):
        raise Problem(lacks)
    return importlib.import_module("evdev")


def devices(package: Any) -> list[Device]:
    """All input devices that may be read."""
    found: list[Device] = []
    for path in package.list_devices():
        with contextlib.suppress(OSError):
            found.append(package.InputDevice(path))
    return found


def chosen(package: Any, path: str) -> Device:
    """The device of this path, or the first gamepad; Problem names the existing ones."""
    if path:
        try:
            device: Device = package.InputDevice(path)
        except OSError as error:
            raise Problem(f"{path} cannot be read: {error.strerror or error}") from None
        return device
    there = devices(package)
    for device in there:
        if is_gamepad(device):
            return device
    known = ", ".join(f"{device.path} {device.name}" for device in there)
    raise Problem(f"no readable gamepad was found (member of the group input?); there are: {known or 'none'}")


def drive(master: Provider, pad: Gamepad, hand: GamepadTip, report: Callable[[str], None]) -> None:
    """Publish the hand at the master's rate until the system ends; Problem: the gamepad is gone."""
    before = master.now_ns
    wired = [button for button in BUTTONS if button in master.buttons]
    if "operator_present" not in wired:
        report("the console does not take operator_present from here: show the operator's presence in another way")
    while master.tick():
        try:
            sticks = pad.poll()
        except OSError as error:
            raise Problem(f"the gamepad is gone ({error.strerror or error})") from None
        for button in wired:
            master.press(button, BUTTONS[button] in sticks.keys)
        pose = hand.step(sticks, (master.now_ns - before) * 1e-9)
        master.write(pose, hand.twist, gripper=hand.gripper)
        before = master.now_ns


def gamepad_master(
    arm: Annotated[str, typer.Option("--arm", help="The arm that it replaces.")] = "MTMR",
    device: Annotated[str, typer.Option("--device", metavar="PATH", help="Default: the first gamepad.")] = "",
    speed: Annotated[float, typer.Option("--speed", min=0.0, max=0.5, help="Stick at its end, m/s.")] = 0.05,
    turn: Annotated[float, typer.Option("--turn", min=0.0, max=5.0, help="Stick at its end, rad/s.")] = 0.7,
    rate: Annotated[float, typer.Option("--rate", min=50.0, max=2000.0, help="Records a second.")] = 200.0,
    listing: Annotated[bool, typer.Option("--list", help="Show the input devices and end.")] = False,
    system: SystemOption = None,
) -> int:
    """Be the master of a teleoperation with a gamepad. Nothing moves unless the left bumper is held.

    Left stick: x and y; right stick: z and roll; cross: wrist; right trigger: gripper, pulled and let go: presence.

    Example: python -m trocar.tools.examples.gamepad_master --arm MTMR --speed 0.03
    """
    package = evdev()
    if listing:
        for each in devices(package):
            print(f"{each.path} {each.name}{' (gamepad)' if is_gamepad(each) else ''}")
        return 0
    found = chosen(package, device)
    with provide(arm, system, rate=rate, program="gamepad_master") as master:
        note(f"{arm} is {found.name}: {HELD}")
        with contextlib.suppress(KeyboardInterrupt):
            drive(master, Gamepad(found), GamepadTip(speed, turn), note)
    note(f"{arm} has no program now")
    return 0


if __name__ == "__main__":
    typer.run(guarded(gamepad_master))
