from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trocar.procs.fpga import registers


def test_axis_registers_start_at_channel_one():
    assert registers.axis_register(0, registers.ENCODER_PRELOAD) == 0x14
    assert registers.axis_register(3, registers.MOTOR_STATUS) == 0x4C


def test_status_names_board_and_axes():
    assert registers.board_of(0x453F0000) == 5
    assert registers.axes_of(0x453F0000) == 4


@pytest.mark.parametrize(("status", "fpga"), [(0, 1), (0xA01C0000, 2), (0x40B1A0A0, 3), (0xC0000000, 2)])
def test_ethernet_status_names_the_fpga(status, fpga):
    assert registers.fpga_of(status) == fpga


def test_hardware_is_named_or_shown():
    assert registers.hardware_name(0x514C4131) == "QLA1"
    assert registers.hardware_name(0x12345678) == "0x12345678"


def test_watchdog_of_thirty_milliseconds_is_power_up_value():
    assert registers.watchdog_counts(0.03) == registers.WATCHDOG_POWER_UP
    assert registers.watchdog_counts(0.0) == 0
    assert registers.watchdog_counts(1e-9) == 1


@given(st.integers(1, 0xFFFF))
def test_whole_watchdog_counts_are_kept(count):
    assert registers.watchdog_counts(count * registers.WATCHDOG_UNIT_S) == count


@pytest.mark.parametrize("seconds", [-0.001, 0.35, float("nan"), float("inf")])
def test_watchdog_that_does_not_fit_is_refused(seconds):
    with pytest.raises(ValueError, match="allowed"):
        registers.watchdog_counts(seconds)


def test_ip_register_has_last_octet_on_top():
    assert registers.ip_quadlet("127.0.0.1") == 0x0100007F
    assert registers.ip_text(0x6400FEA9) == "169.254.0.100"


def test_gap_count_follows_the_bus_size():
    assert registers.gap_count(2) == 7
    assert registers.gap_count(60) == registers.GAP_DEFAULT


def test_current_scale_is_the_usual_one():
    assert pytest.approx(5242.88) == registers.CURRENT_BITS_PER_A
