"""The arrays of the emulated boards' stages."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, rows

ENCODERS: Final = CStruct("Encoders", (  # trocar.procs.boards.controllers.encoder.Encoders; n: axes of all boards
    *rows("i8", "", n="slots", boards="boards", width="width", columns="columns", first="first", states="states"),
    *rows("f8", "3 n", curve="curve"),
    *rows("f8", "n", was="was"),
    *rows("b1", "n", turned="turned", hidden="hidden"),
    *rows("i8", "6 n", queue="queue"),
    *rows("i8", "n", state="state", offset="offset", overflow="overflow", lag="lag"),
    *rows("i8", "states", state_table="state_table"),
    *rows("i8", "7 states", flag_table="flag_table"),
    *rows("u4", "boards", pins="pins"),
    *rows("u4", "boards columns", rows="rows"),
), {"set_out": ("i8", "i8"), "advance": ("f8",), "show": ("i8",)})

SAMPLE: Final = CStruct("Sample", (  # trocar.procs.boards.controllers.firmware.Firmware
    *rows("i8", "", boards="count", width="width", columns="encoders.columns"),
    *rows("f8", "", supply="supply_bits"),
    *rows("b1", "boards", good="power.good", expanded="expanded"),
    *rows("u4", "boards columns", rows="samples.rows"),
    *rows("u4", "boards", status="power.status", pins="encoders.pins", inputs="lines.inputs", outputs="outputs"),
    *rows("u4", "boards width", pins_shown="pins_shown", adc="lines.adc", motor_flags="power.motor_flags",
          command="motors.command"),
), {"fill": ("i8",)})

HUB_MEMORY: Final = CStruct("HubMemory", (  # trocar.procs.boards.controllers.hub.HubMemory
    *rows("i8", "", boards="boards", columns="columns", most="most", room="room"),
    *rows("u4", "boards columns", rows="samples.rows"),
    *rows("i8", "boards", sampled="samples.sampled", reporting="reporting"),
    *rows("u4", "256 boards", headers="headers"),
    *rows("u4", "boards", long_numbers="long"),
    *rows("i8", "most", selection="selection"),
    *rows("u4", "most", native="native"),
    *rows("u4", "room", memory="memory"),
), {"collect": ("i8", "i8", "i8", "i8")})

WORLD: Final = CStruct("World", (  # trocar.procs.boards.emulation.Emulation; slots: axes of all boards, axes: actuators
    *rows("i8", "", slots="slots", axes="axes", brakes="brakes"),
    *rows("f8", "", per_tick="per_tick"),
    *rows("f8", "axes", world_position="_world.position", world_velocity="_world.velocity",
          pot_position="_world.pot_position", position="position", velocity="velocity", current="current"),
    *rows("i8", "axes", motor_of="motor_of"),
    *rows("i8", "slots", axis_of="axis_of"),
    *rows("u4", "slots", dac="dac"),
    *rows("b1", "slots", on="on"),
    *rows("u2", "slots 2", adc="converted"),
    *rows("f8", "2 slots", amps="amps", scales="scales", offsets="offsets", truth="truth", seen="seen", bits="bits",
          counts_scale="counts_scale", counts_offset="counts_offset", now="now"),
    *rows("f8", "2 2 slots", to_bits="to_bits"),
    *rows("f8", "3 slots", curve="curve"),
    *rows("i8", "brakes", brake_slots="wiring.brakes.slots"),
    *rows("f8", "brakes", lets_go="wiring.brakes.lets_go", holds_off="wiring.brakes.holds_off"),
    *rows("b1", "brakes", let_go="let_go"),
), {"sense": ("i8",), "move": ()})

COMMANDS: Final = CStruct("Commands", (  # trocar.procs.boards.controllers.block_writes.WriteDecoder
    *rows("i8", "", boards="boards", width="width", columns="columns"),
    *rows("u4", "boards columns", block="block"),
    *rows("u4", "boards", heads="heads"),
    *rows("u4", "boards width", last_top="motors.last_top", command="motors.command", dac="lines.dac"),
    *rows("b1", "boards width", accept="motors.accept"),
), {"repeat": ()})

PLANT: Final = CStruct("Plant", (  # trocar.procs.boards.robots.plant.Plant, as it is assembled; joints of the model
    *rows("i8", "", joints="model.nv"),
    *rows("f8", "joints", effort="effort", applied="_applied", velocity="_joint_velocity", limit="friction.limit",
          damping="friction.damping", gain="friction.gain", spring="friction.spring", push="_push", weight="_weight"),
), {"apply": ("i8",)})

BOARDS: Final = (ENCODERS, SAMPLE, HUB_MEMORY, WORLD, COMMANDS, PLANT)
