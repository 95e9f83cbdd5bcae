"""Robots that are homed once: environments and attached systems of one test after another take the same ones back."""

from __future__ import annotations

import dataclasses
import functools
import os
from collections.abc import Callable, Sequence
from typing import Any

import pytest

from tests.rl.running import home
from trocar.procs.host.host import Host
from trocar.procs.host.snapshot import HostSnapshot
from trocar.procs.rl.hosted import HostedRobot, document
from trocar.procs.rl.model import StartPose
from trocar.shm.mailbox.audit import Audit

OPEN, BEGIN, CLOSE = HostedRobot._open, HostedRobot.begin, HostedRobot.close


def _with_robot(robot: HostedRobot, instead: Callable[..., Any], *given: Any) -> Any:
    return instead(robot, *given)


class LentHosts:
    """Hosts of `HostedRobot`, with the snapshots of their starts; a robot that closes gives its own back."""

    def __init__(self) -> None:
        self._free: dict[Any, list[dict[str, Any]]] = {}

    def patch(self, patch: pytest.MonkeyPatch) -> None:
        for name, instead in (("_open", self.open), ("begin", self.begin), ("close", self.close)):
            patch.setattr(HostedRobot, name, functools.partialmethod(_with_robot, instead))

    def _of(self, robot: HostedRobot) -> list[dict[str, Any]]:
        same = dataclasses.replace(robot._document, name=""), tuple(model.name for model in robot.models)
        return self._free.setdefault(same, [])

    def open(self, robot: HostedRobot) -> Host:
        if robot.host is None and robot._pid == os.getpid() and (free := self._of(robot)):
            vars(robot).update(free.pop())
            robot.host.restore(robot._snapshots[-1])  # type: ignore[attr-defined]
        return OPEN(robot)

    def begin(self, robot: HostedRobot, number: int, starts: Sequence[StartPose], seed: int) -> None:
        """Under a number of these starts, also if the next robot has others; a robot numbers each start once."""
        robot._open()
        known = vars(robot).setdefault("_lent_starts", {})
        assert known.setdefault(number, str(starts)) == str(starts), f"start {number} is another one"
        BEGIN(robot, hash(str(starts)) if number >= 0 else number, starts, seed)

    def close(self, robot: HostedRobot) -> None:
        if robot.host is not None and robot._pid == os.getpid():
            self._of(robot).append({name: getattr(robot, name) for name in ("host", "links", "_snapshots")})
            robot.host, robot.links, robot._snapshots = None, (), {}

    def end(self) -> None:
        for robots in self._free.values():
            for robot in robots:
                robot["host"].close()


class RunningHosts:
    """Running systems, nothing of them powered, and with these arms homed by a person."""

    def __init__(self) -> None:
        self._hosts: dict[tuple[str, str, int], Host] = {}
        self._homed: dict[tuple[Host, tuple[str, ...]], HostSnapshot] = {}

    def up(self, file: str, backend: str, history: int, homed: tuple[str, ...]) -> Host:
        known = file, backend, history
        if known not in self._hosts:
            with pytest.MonkeyPatch.context() as patch:  # of streams only their beginnings are in audits
                patch.setattr("trocar.procs.node.node.Audit", lambda ring, now_ns, every: Audit(ring, now_ns))
                host = self._hosts[known] = Host(document(file, backend, 0.002, 0.002), history)
            host.run(0.05)
            self._homed[host, ()] = host.snapshot()
        host = self._hosts[known]
        if (host, homed) not in self._homed:
            host.restore(self._homed[host, ()])
            home(host, *homed)
            self._homed[host, homed] = host.snapshot()
        host.restore(self._homed[host, homed])
        return host

    def end(self) -> None:
        for host in self._hosts.values():
            host.close()
