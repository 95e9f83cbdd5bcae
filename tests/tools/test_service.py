"""`trocar doctor` on the unit of systemd and on FireWire devices: what the unit's user lacks, and what grants it."""

from __future__ import annotations

import os
import pwd
import shutil
from pathlib import Path

import pytest

from tests.conftest import ROOT
from trocar.tools.inspect import machine, service
from trocar.tools.inspect.machine import BAD, OK

UNIT = "etc/systemd/system/trocar.service"
SYSTEM_USER = pwd.getpwnam("daemon")


def install(root: Path, user: str = SYSTEM_USER.pw_name, **changed: str) -> None:
    """Our unit, run by this user, with keys of a drop-in."""
    (root / UNIT).parent.mkdir(parents=True, exist_ok=True)
    shutil.copy(ROOT / "tools/trocar.service", root / UNIT)
    (root / f"{UNIT}.d").mkdir(exist_ok=True)
    lines = ["[Service]", f"User={user}", *(f"{key}={value}" for key, value in changed.items())]
    (root / f"{UNIT}.d/site.conf").write_text("\n".join(lines))


def test_without_a_unit_nothing_is_reported_of_it(tmp_path: Path) -> None:
    assert not list(machine.as_service(tmp_path))


def test_our_unit_lacks_nothing_for_a_system_user(tmp_path: Path) -> None:
    install(tmp_path)
    (tmp_path / "run/systemd/users").mkdir(parents=True)  # logind runs
    (found,) = machine.as_service(tmp_path)
    assert found.state == OK and SYSTEM_USER.pw_name in found.found


@pytest.mark.parametrize(("changed", "lacks"), [
    ({"LimitRTPRIO": "50"}, True), ({"LimitMEMLOCK": "8388608"}, True), ({"LimitRTPRIO": "20:98"}, True),
    ({"LimitRTPRIO": "infinity"}, False), ({"LimitMEMLOCK": "infinity:infinity"}, False),
])
def test_limits_that_a_drop_in_lowers_are_named(tmp_path: Path, changed: dict[str, str], lacks: bool) -> None:
    install(tmp_path, **changed)
    (found,) = machine.as_service(tmp_path)
    assert (found.state == BAD and "systemctl edit" in found.mend) == lacks


def test_a_user_that_does_not_exist_comes_with_the_command_that_makes_it(tmp_path: Path) -> None:
    install(tmp_path, user="nosuchuser")
    (found,) = machine.as_service(tmp_path)
    assert found.state == BAD and found.mend.startswith("sudo useradd --system") and found.mend.endswith("nosuchuser")


@pytest.mark.skipif(os.getuid() != 0, reason="gives a device away")
def test_a_firewire_device_that_the_units_user_may_not_use_is_named(tmp_path: Path) -> None:
    install(tmp_path)
    device = tmp_path / "dev/fw0"
    device.parent.mkdir()
    device.touch()
    os.chown(device, 0, SYSTEM_USER.pw_gid)
    for mode, is_open in ((0o660, True), (0o666, True), (0o600, False)):
        device.chmod(mode)
        (found,) = machine.as_service(tmp_path)
        assert (found.state == OK) == is_open
    assert "80-trocar.rules" in found.mend


def test_who_may_not_use_a_device_joins_its_group_or_installs_the_rule(tmp_path: Path) -> None:
    device = tmp_path / "fw0"
    device.touch()
    device.chmod(0o600)
    assert f"usermod -aG {service.GROUP} alice" in service.opens(device, "alice")
    assert f'GROUP="{service.GROUP}"' in service.RULES.read_text(encoding="utf-8")
    device.chmod(0o660)
    if os.getuid() == 0:
        os.chown(device, 0, SYSTEM_USER.pw_gid)
    assert service.opens(device, "alice") == f"sudo usermod -aG {device.group()} alice"
