"""The name of a system without `--system`."""

from __future__ import annotations

import os
import pwd

import pytest

from trocar.procs.machine.verb_lines import default_system, verb_line


@pytest.mark.parametrize(("user", "number", "name"), [
    ("root", 0, "trocar"), ("robot", 997, "trocar"), ("anna", 1000, "trocar"), ("bob", 1001, "trocar-bob"),
    ("LAB\\ján.x", 20001, "trocar-LAB_j_n_x"), ("l" * 60, 1002, f"trocar-{'l' * 33}"), (None, 64001, "trocar-64001")])
def test_systems_of_several_people_have_different_names(monkeypatch: pytest.MonkeyPatch, user: str | None, number: int,
                                                        name: str) -> None:
    def account(asked: int) -> pwd.struct_passwd:
        if user is None:
            raise KeyError(asked)
        return pwd.struct_passwd((user, "x", asked, asked, "", "/", "/bin/sh"))

    monkeypatch.setattr(os, "getuid", lambda: number)
    monkeypatch.setattr(pwd, "getpwuid", account)
    assert default_system() == name
    assert verb_line("down", name) == "trocar down" and verb_line("down", "other") == "trocar down --system other"
