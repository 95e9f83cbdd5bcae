"""Addresses that a process listens at, as files say them."""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, BeforeValidator, Field

from trocar.procs.config.read.validate import Rows
from trocar.procs.document.process import host_and_port


def _as_addresses(value: object) -> object:
    """One address stands for a list of one."""
    return (value,) if isinstance(value, str) else value


def _known_address(address: str) -> str:
    try:
        host_and_port(address)
    except ValueError:
        raise ValueError("not an address with a port") from None
    return address


Address = Annotated[str, AfterValidator(_known_address), Field(description="IP address and port: 127.0.0.1:8080")]
Addresses = Annotated[Rows[Address], BeforeValidator(_as_addresses)]
