"""A robot as a systemd service: what the installed unit and its user lack, and who may use FireWire."""

from __future__ import annotations

import contextlib
import grp
import os
import pwd
import shlex
import stat
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Final

from trocar.procs.machine.logind import at_logout
from trocar.procs.machine.paths import PACKAGE
from trocar.procs.node.realtime import HIGHEST, SYSTEMD

UNIT: Final = "trocar.service"
FOLDERS: Final = ("etc/systemd/system", "usr/local/lib/systemd/system", "usr/lib/systemd/system")
RULES: Final = PACKAGE / "tools" / "trocar.rules"
GROUP: Final = "fpgaqla"  # of the dVRK's own rule


@dataclass(frozen=True, slots=True)
class ServiceUnit:
    """The installed unit, and its section [Service]; drop-ins come last."""

    file: Path
    keys: dict[str, str]

    @property
    def user(self) -> str:
        """Its user; systemd's default is root."""
        return self.keys.get("User") or "root"

    def problems(self, root: Path = Path("/")) -> Iterator[tuple[str, str]]:
        """Each with the command that fixes it."""
        try:
            account = pwd.getpwnam(self.user)
        except KeyError:
            yield (f"{self.file}: this machine has no user {self.user}",
                   f"sudo useradd --system --home-dir /var/lib/trocar {self.user}")
            return
        if account.pw_uid == 0:
            return
        text, mend = at_logout(account.pw_uid, root)
        if text:
            yield f"{self.file}: {text}", mend
        priority, memory = self.keys.get("LimitRTPRIO", "0"), self.keys.get("LimitMEMLOCK", "0")
        if not (_allows(priority, HIGHEST) and _allows(memory, inf)):
            yield f"{self.file} lacks {SYSTEMD}", f"sudo systemctl edit {UNIT}    # [Service], and these two"
        groups = os.getgrouplist(account.pw_name, account.pw_gid)
        closed = [device for device in firewire_devices(root) if not _is_open(device.stat(), groups)]
        if closed and "SupplementaryGroups" not in self.keys:
            text = f"{self.user} has no right to use {', '.join(map(str, closed))}"
            yield f"{self.file}: {text}", f"{opens(closed[0], self.user)} && sudo systemctl restart {UNIT}"


def installed(root: Path = Path("/")) -> ServiceUnit | None:
    """The unit that systemd finds first."""
    files = [file for folder in FOLDERS if (file := root / folder / UNIT).is_file()]
    if not files:
        return None
    more = (path for folder in FOLDERS for path in (root / folder / f"{UNIT}.d").glob("*.conf"))
    keys, section = dict[str, str](), ""
    for path in (files[0], *sorted(more, key=lambda path: path.name)):
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines():
            section = line.strip() if line.startswith("[") else section
            key, is_value, value = line.partition("=")
            if section == "[Service]" and is_value:
                keys[key.strip()] = value.strip()
    return ServiceUnit(files[0], keys)


def firewire_devices(root: Path = Path("/")) -> list[Path]:
    """Cards and the nodes on their buses."""
    return sorted((root / "dev").glob("fw[0-9]*"))


def opens(device: Path, user: str) -> str:
    """The command that lets a user use a FireWire device: joining its group, or installing our rule."""
    about = device.stat()
    if about.st_gid and about.st_mode & stat.S_IWGRP:
        with contextlib.suppress(KeyError):
            return f"sudo usermod -aG {grp.getgrgid(about.st_gid).gr_name} {user}"
    return (f"sudo groupadd -rf {GROUP} && sudo usermod -aG {GROUP} {user} && sudo cp {shlex.quote(str(RULES))} "
            "/etc/udev/rules.d/80-trocar.rules && sudo udevadm control --reload && sudo udevadm trigger -s firewire")


def _is_open(about: os.stat_result, groups: Iterable[int]) -> bool:
    return bool(about.st_mode & stat.S_IWOTH or (about.st_mode & stat.S_IWGRP and about.st_gid in groups))


def _allows(limit: str, least: float) -> bool:
    """Whether a limit of a unit, one number or soft:hard, is at least so high."""
    return all(part == "infinity" or (part.isdigit() and int(part) >= least) for part in limit.split(":"))
