"""THE TABLE of what can be asked of a running process: one row per command, per kind of process.

A command travels as a place in its kind's table, up to 64 numbers and a short text; `values` names the numbers,
`{n}` stands for one value per joint. Replies come back on the client's reply ring.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Command:
    """One command: name (CRTK where there is one), its numbers, its text, one sentence.

    `moves` marks commands after which the robot may move or change power. Such a command is refused when it comes late,
    unless its text is among `stops`, with which it only ends something ("*": with any text).
    """

    name: str
    values: str
    text: str
    doc: str
    moves: bool = True
    stops: tuple[str, ...] = ()

    def may_be_late(self, text: str) -> bool:
        """Whether it is carried out however long it has waited."""
        return not self.moves or "*" in self.stops or text in self.stops


COMMANDS: dict[str, tuple[Command, ...]] = {
    "io": (
        Command("power_on", "", "robot", "close the safety relay, switch motor power on, enable the amplifiers"),
        Command("power_off", "open_relays", "robot", "disable the amplifiers, switch motor power off", stops=("*",)),
        Command("bias_encoders", "samples", "robot", "set encoders from potentiometers; negative: accept a preset one"),
        Command("pid_enable", "on", "robot", "joint controller on or off"),
        Command("servo_zero", "", "robot", "zero efforts, joint controller off", stops=("*",)),
        Command("enforce_limits", "on", "robot", "clip set-points to the position limits", moves=False),
        Command("tracking_check", "on", "robot", "trip on too large a tracking error", moves=False),
        Command("pot_check", "on", "robot", "compare potentiometers with encoders", moves=False),
        Command("use_setpoint_v", "on", "robot", "use the velocity feed of set-points", moves=False),
        Command("torque_mode", "{n}", "robot", "per actuator: 1 passes efforts through, 0 follows positions"),
        Command("clear_fault", "", "robot", "forget the latched fault", moves=False),
    ),
    "arm": (
        Command("state_command", "", "enable|disable|home|unhome|pause|resume", "change the operating state",
                stops=("disable", "pause")),
        Command("servo_jp", "position {n}, velocity {n} or none", "", "follow these joint positions now"),
        Command("servo_jr", "increment {n}", "", "follow the set-point plus these increments"),
        Command("servo_jf", "effort {n}", "", "apply these joint efforts"),
        Command("servo_cp", "x y z qx qy qz qw", "", "follow this tip pose now"),
        Command("move_jp", "position {n}", "", "move to these joint positions and stop there"),
        Command("move_jr", "increment {n}", "", "move by these increments"),
        Command("move_cp", "x y z qx qy qz qw", "", "move to this tip pose, joints in a straight line"),
        Command("jaw/servo_jp", "position", "", "follow this jaw angle now"),
        Command("jaw/move_jp", "position", "", "move the jaw to this angle"),
        Command("jaw/servo_jf", "effort", "", "apply this jaw effort"),
        Command("hold", "", "", "stay at the present set-point", stops=("*",)),
        Command("free", "", "", "zero efforts; gravity compensation stays"),
        Command("trajectory_j/set_ratio", "ratio", "", "speed and acceleration of moves, above 0 up to 1", moves=False),
        Command("trajectory_j/set_ratio_v", "ratio", "", "speed of moves, above 0 up to 1", moves=False),
        Command("trajectory_j/set_ratio_a", "ratio", "", "acceleration of moves, above 0 up to 1", moves=False),
        Command("set_base_frame", "x y z qx qy qz qw", "reference frame", "pose of the arm's base; no values: unknown"),
        Command("set_tool_type", "", "NAME:MODEL", "say which instrument is on"),
        Command("emulate_adapter_present", "on", "", "act as if a sterile adapter were on"),
        Command("emulate_tool_present", "on", "", "act as if an instrument were on"),
    ),
    "boards": (
        Command("press", "on", "input name", "press or release a button or switch", moves=False),
        Command("insert_instrument", "", "arm NAME:MODEL", "put an instrument on", moves=False),
        Command("remove_instrument", "", "arm", "take the instrument off", moves=False),
        Command("push", "effort {n}", "robot", "external effort on the joints of a robot"),
        Command("lose_replies", "count", "", "leave the next replies out", moves=False),
        Command("amp_fault", "axis on", "robot", "make an amplifier fail", moves=False),
        Command("power_loss", "on", "robot", "take the motor supply away", moves=False),
        Command("encoder_jump", "axis counts", "robot", "make an encoder jump", moves=False),
    ),
    "supervisor": (
        Command("stop", "", "", "stop the system"),
        Command("restart", "", "instance", "stop an instance and start it again"),
    ),
}


def code_of(kind: str, name: str) -> int:
    """The place of a command in its kind's table; KeyError names what there is."""
    for code, command in enumerate(COMMANDS.get(kind, ())):
        if command.name == name:
            return code
    known = ", ".join(c.name for c in COMMANDS.get(kind, ()))
    raise KeyError(f"{kind} has no command {name}; it has: {known}")
