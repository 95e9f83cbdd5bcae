"""The arrays of the halves of io's cycle, from `Parts` (procs/io/assemble.py).

n: actuators, d: drives, i.e. actuators and brakes.
"""

from __future__ import annotations

from typing import Final

from trocar.procs.document.gains import GAINS
from trocar.procs.native.fields import CStruct, places, rows

MISSED: Final = 1
STATUS: Final = 2
LIMIT: Final = 4
TRACKING: Final = 8
"""Bits of `Halves.receive_and_check` (procs/io/halves.py)."""
NOT_FINITE: Final = 16
CONTROLLED: Final = 32
SENT: Final = 64
"""Bits of `Halves.control_and_send`. CONTROLLED: the joint controllers have run, SENT: the words were sent."""

IO: Final = CStruct("Io", (
    *rows("i8", "", n="robots.axes", d="robots.drives", boards="robots.board_count", columns="port.columns.count",
          out_columns="outputs.columns", robots="robots.count", brakes="robots.brake_count", inputs="buttons.count",
          outputs="digital_outputs.count", any_software="samples.any_software", table_rows="samples.pots.table_rows",
          entries="samples.pots.entries", limit_rows="safety.rows", status_column="power.status_column"),
    # decode: words of the blocks to SI units; nine rows (procs/io/robots.py), of which safety compares the first five
    *rows("u4", "boards columns", blocks="port.blocks"),
    *places("9 d", "boards columns", index="samples.index"),
    *rows("u4", "9 d", shift="samples.shift", mask="samples.mask", words="samples.words"),
    *rows("f8", "9 d", bias="samples.bias", scale="samples.scale", offset="samples.offset", values="samples.values"),
    # potentiometers, decoded to positions
    *rows("f8", "n", pot_scale="samples.pots.scale", pot_offset="samples.pots.offset",
          pot_position="samples.pot_position"),
    *rows("i8", "n", table_row="samples.pots.table_row", pot_first="samples.pots.first",
          pot_count="samples.pots.count"),
    *rows("f8", "table_rows entries", tables="samples.pots.tables"),
    *rows("f8", "n n", pot_coupling="samples.pots.coupling"),
    # velocities of the encoders, two ways
    *places("4 n", "boards columns", velocity_index="samples.velocity_index"),
    *rows("f8", "n", hz="samples.firmware.hz", rate="samples.firmware.rate", sign="samples.firmware.sign",
          predicted="samples.firmware.predicted", position_scale="robots.position_scale", velocity="record.velocity",
          soft="samples.softly.velocity", soft_previous="samples.softly.previous", soft_since="samples.softly.since",
          soft_slope="samples.softly.slope", software_velocity="record.software_velocity"),
    *rows("b1", "1", soft_known="samples.softly.known"),
    *rows("i8", "1", wanted="samples.wanted"),
    *rows("b1", "n", software="robots.software"),
    # watch: status words and amplifiers that changed
    *rows("u4", "boards", status_mask="power.mask", status_now="power.now", status_before="power.before"),
    *rows("b1", "boards", relay_unseen="power.relay_unseen"),
    *rows("f8", "d", amps_before="power.amps_before"),
    # check: a sixth row where currents are compared with requests
    *rows("f8", "limit_rows d", magnitude="safety.magnitude", limits="safety.limits"),
    *rows("b1", "limit_rows d", within_limits="safety.within"),
    *rows("f8", "d", current_request="record.current_request"),
    # control: state and gains of the law in procs/io/pid.py
    *rows("i8", "10", switches="pid.switches"),
    *rows("f8", "n", setpoint="pid.setpoint_position", feed="pid.setpoint_velocity", effort="pid.effort",
          error="pid.position_error", requested="pid.requested_effort", feed_forward="pid.feed_forward",
          contribution="pid.contribution", effort_when_off="pid.effort_when_off", integral="pid.integral",
          disturbance="pid.disturbance", observer_input="pid.observer_input", observer_state="pid.observer_state",
          filtered="pid.filtered",
          has_velocity="pid.has_velocity", allowed="pid.allowed", excess="pid.excess",
          per_width="pid.per_width", share_old="pid.share_old", output_limit="pid.output_limit",
          momentum="pid.momentum", observer_rate="pid.rate", effort_limit="pid.effort_limit"),
    *rows("f8", "n", **{f"pid_{gain.field}": f"pid.{gain.field}" for gain in GAINS}),
    *rows("b1", "n", effort_mode="pid.effort_mode", off="pid.off", within="pid.within", finite="pid.finite"),
    # encode: efforts to words for the boards
    *rows("f8", "n", effort_to_current="robots.effort_to_current"),
    *rows("f8", "brakes", brake_current="outputs.brakes"),
    *rows("f8", "d", least="outputs.least", most="outputs.most", dac_scale="robots.dac_scale",
          dac_offset="robots.dac_offset", dac_zero="outputs.encoder.zero"),
    *places("d", "boards out_columns", out_index="outputs.index"),
    *rows("i8", "d", out_flags="outputs.flags", out_words="outputs.words"),
    *rows("u4", "boards out_columns", out="port.out"),
    *rows("u4", "boards", control="outputs.control"),
    # show: the rest of the record
    *rows("f8", "n", position="record.position", firmware_velocity="record.firmware_velocity",
          acceleration="record.acceleration", measured_effort="record.effort", shown_pot="record.pot_position",
          pot_voltage="record.pot_voltage", current_to_effort="robots.current_to_effort"),
    *rows("f8", "d", current="record.current", temperature="record.temperature"),
    *rows("u2", "n", pot_bits="record.pot_bits"),
    *rows("i4", "n", encoder_bits="record.encoder_bits"),
    *rows("b1", "d", amp_on="record.amp_on"),
    *rows("b1", "n", no_pot="samples.no_pot"),
    *rows("f8", "robots", board_period="record.board_period"),
    *places("robots", "d", first_axis="samples.first_axis"),
    *places("inputs", "boards columns", input_index="buttons.index"),
    *rows("u4", "inputs", input_bit="buttons.bit"),
    *rows("b1", "inputs", when_low="buttons.debounce.when_low", pressed="buttons.debounce.pressed",
          pressed_value="buttons.debounce.value", pending="buttons.debounce.pending"),
    *places("outputs", "boards columns", output_index="digital_outputs.index"),
    *rows("u4", "outputs", output_bit="digital_outputs.bit"),
    *rows("b1", "outputs", output_unseen="digital_outputs.unseen", output_written="digital_outputs.written",
          output="record.output"),
), {"decode_and_check": (), "control_and_encode": ("f8", "i8"), "show": ()})

KINEMATIC: Final = CStruct("Kinematic", (
    *rows("i8", "", io="bound.address", n="robots.axes", drives="robots.drives", boards="robots.board_count",
          robots="robots.count", followers="tracker.count", moving_ns="MOVING_NS"),
    *rows("f8", "n", setpoint="pid.setpoint_position", step="step", position="samples.position",
          velocity="samples.velocity"),
    *rows("b1", "n", enabled="pid.enabled", effort_mode="pid.effort_mode"),
    *rows("f8", "drives", current_request="record.current_request"),
    *rows("u4", "boards", control="outputs.control", commanded="commanded"),
    *rows("b1", "robots", robot_enabled="record.pid_enabled", moves="moves"),
    *rows("i8", "robots", stamps_ns="stamps_ns"),
    *places("followers", "robots", robot="tracker.robot"),
    *places("followers", "n", first="tracker.first"),
    *rows("i8", "followers", axes="tracker.axes", taken_ns="tracker.taken_ns"),
), {"move": ("i8",), "follow": ("i8", "i8", "i8")})
"""From `trocar.procs.io.kinematic.KinematicHalves`."""

TRACK: Final = CStruct("Track", (
    *rows("i8", "", n="robots.axes", robots="robots.count", followers="follow.count", timeout_ns="follow.timeout_ns"),
    # the rings, and the places of fields in a record
    *rows("i8", "followers", head="follow.rings.head", slots="follow.rings.slots", depth="follow.rings.depth",
          stride="follow.rings.stride", size="follow.rings.size", copy="follow.rings.copy", seen="follow.rings.seen",
          axes="follow.axes"),
    *places("followers", "robots", robot="follow.robot"),
    *places("followers", "n", first="follow.first"),
    *rows("i8", "11", offsets="follow.rings.offsets"),
    # results for each robot
    *rows("i8", "followers", taken_ns="follow.taken_ns", fresh_ns="follow.fresh_ns"),
    *rows("b1", "followers", is_fresh="follow.is_fresh", resting="follow.resting", follows_velocity="follow.velocity",
          applies_effort="follow.applies_effort", own="follow.own"),
    *rows("b1", "1", dirty="follow.dirty"),
    *rows("i8", "robots", age_ns="record.setpoint_age_ns"),
    *rows("b1", "robots", enabled="record.pid_enabled", holding="record.holding",
          uses_velocity="record.use_setpoint_velocity", desired_open="desired.open"),
    *rows("u4", "robots", bias_generation="record.bias_generation", pid_generation="record.pid_generation",
          desired_taken="desired.taken"),
    # position, velocity, effort and feed-forward as received, and their values for the joint controller
    *rows("f8", "4 n", incoming="follow.incoming"),
    *rows("f8", "n", low="follow.low", high="follow.high", most_step="follow.most_step",
          setpoint="pid.setpoint_position", feed="pid.setpoint_velocity"),
    *rows("b1", "n", at_limit="record.at_limit"),
), {"track": ("i8",)})
"""Fields of the setpoint tracker, from `Parts`."""
