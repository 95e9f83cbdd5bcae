"""Joining a domain of ROS."""

from __future__ import annotations

import os

import pytest

from trocar.procs.ros_messages.dds import DdsError, Participant


@pytest.mark.parametrize("interface", ["none9", "203.0.113.7"])
def test_an_interface_that_is_not_there_is_named_with_those_that_are(interface: str) -> None:
    with pytest.raises(DdsError, match=rf"{interface}: .*there are .*\blo\b"):
        Participant(1 + os.getpid() % 230, interface)
