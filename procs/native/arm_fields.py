"""The arrays of an arm's kinematics, governor and records. n: joints; for the governor including the jaw."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CField, CStruct, rows


def links(of: str) -> tuple[CField, ...]:
    """Fields of `trocar.procs.kinematics.forward.Links`, from an object that has them as `of`."""
    return (*rows("i8", "", n=f"{of}.n"), *rows("f8", "n 3 4", placements=f"{of}.placements"),
            *rows("b1", "n", slides=f"{of}.slides"))


CHAIN: Final = CStruct("Chain", (
    *links("links"),
    *rows("i8", "", ends_count="links.ends_count"),
    *rows("f8", "ends_count 3 4", ends="links.ends"),
    *rows("f8", "3 4", end="end"),
    *rows("f8", "n", q="q"),
    *rows("f8", "4 4", tip="tip", frame="frame"),
    *rows("f8", "n 6", body="body_columns", spatial="spatial_columns"),
), {"update": (), "frame": ("i8",)})
"""From `trocar.procs.kinematics.forward.Kinematics`."""

INVERSE: Final = CStruct("Inverse", (
    *links("kinematics.links"),
    *rows("f8", "3 4", end="kinematics.end"),
    *rows("i8", "", m="m", rows_count="rows_count", max_steps="STEPS"),
    *rows("i8", "rows_count", rows="rows"),
    *rows("f8", "n m", free="free"),
    *rows("f8", "n", q="q", seed="seed", lower="lower", upper="upper", most="most"),
    *rows("b1", "n", turns="turns"),
    *rows("f8", "4 4", goal="goal"),
    *rows("f8", "1", beyond="beyond"),
    *rows("f8", "", converged="CONVERGED", accepted="ACCEPTED", slow="SLOW", last_step="LAST_STEP",
          last_error="LAST_ERROR", max_step="MAX_STEP", damping="DAMPING", furthest_place="FURTHEST_PLACE",
          furthest_turn="FURTHEST_TURN", turn_weight="TURN_WEIGHT", nearest_damping="NEAREST_DAMPING"),
), {"newton": ("f8",), "fits": ("f8",), "approach": ()})
"""From `trocar.procs.kinematics.inverse.solver.InverseSolver`; m: coordinates that are independent."""

CARTESIAN: Final = CStruct("Cartesian", (
    *links("kinematics.links"),
    *rows("f8", "3 4", end="kinematics.end"),
    *rows("f8", "4 4", tip="kinematics.tip", reference_tip="reference_tip", base="base"),
    *rows("f8", "n 6", body="kinematics.body_columns"),
    *rows("i8", "", m="m", size="size", columns="columns"),
    *rows("f8", "n m", free="free"),
    *rows("f8", "6 size", readings="io.rows"),
    *rows("f8", "7", measured="measured", setpoint="setpoint", local_measured="local_measured",
          local_setpoint="local_setpoint"),
    *rows("f8", "6", twist="twist", setpoint_twist="setpoint_twist", body_twist="body_twist",
          body_wrench="body_wrench", spatial_wrench="spatial_wrench", wanted_twist="wanted_twist"),
    *rows("f8", "6 columns", shown_body="shown_body", shown_spatial="shown_spatial"),
    *rows("f8", "n", found_rates="found_rates"),
    *rows("f8", "", damping="DAMPING"),
), {"show": ("i8", "i8", "i8"), "rates": ()})
"""From `trocar.procs.arm.cartesian.Cartesian`."""

GRAVITY: Final = CStruct("Gravity", (
    *links("links"),
    *rows("i8", "", moved="moved"),
    *rows("f8", "n", masses="masses"),
    *rows("f8", "n 3", centres="centres"),
    *rows("f8", "n moved", follow="follow"),
    *rows("f8", "moved n", bear="bear"),
    *rows("f8", "3", up="up"),
    *rows("f8", "moved", q="q", borne="borne"),
), {"hold": ()})
"""From `trocar.procs.kinematics.gravity.Gravity`; moved: joints of the arm that move links."""

GOVERNOR: Final = CStruct("Governor", (
    *rows("i8", "", n="size"),
    *rows("f8", "n", goal="goal", target="target", asked="asked", velocity="velocity", feed="feed", rate="rate",
          speed="speed", acceleration="acceleration", lower="lower", upper="upper", behind="behind"),
    *rows("f8", "1", most="most"),
), {"advance": ("f8", "i8"), "measure": ()})
"""From `trocar.procs.arm.governor.Governor`."""

NEAR: Final = CStruct("Near", (
    *rows("i8", "", n="n", inverse="inverse"),  # the address of the solver's struct
    *rows("f8", "7", pose="pose"),
    *rows("f8", "4 4", to_base="to_base", goal="solver.goal"),
    *rows("f8", "n", at="at", seed="solver.seed", q="solver.q"),
    *rows("f8", "", slack="slack", close="close", room="room", furthest_turn="furthest_turn"),
), {"find": ("i8",)})
"""From `trocar.procs.arm.near.Near`."""

FRESH, POWER, VALID, CHANGED, FAULTY = 1, 2, 4, 8, 16
"""Of readings."""

READINGS: Final = CStruct("Readings", (
    *rows("i8", "", axes="axes", size="size", late_ns="LATE_NS"),
    *rows("b1", "1", powered="powered", amps_on="amps_on", biased="biased"),
    *rows("i8", "1", age_ns="age_ns"),
    *rows("u2", "1", fault="fault"),
    *rows("f8", "axes", position="given_position", velocity="given_velocity", effort="given_effort",
          setpoint="given_setpoint", setpoint_velocity="given_setpoint_velocity",
          setpoint_effort="given_setpoint_effort"),
    *rows("f8", "6 axes", read="read"),
    *rows("f8", "6 size", rows="rows"),
    *rows("f8", "size axes", to_joint="to_joint"),
    *rows("f8", "axes size", to_actuator="to_actuator"),
), {"update": ("i8", "i8")})
"""From `trocar.procs.arm.readings.ArmReadings`; size: joints with the jaw."""

SETPOINT: Final = CStruct("Setpoint", (
    *rows("i8", "", axes="axes", size="size"),
    # of all joints: setpoint and its velocity; efforts in effort mode and for which; added efforts
    *rows("f8", "2 size", goal="motion.rows"),
    *rows("f8", "size", wanted="motion.effort", feed="motion.feed", gravity="gravity", measured="measured"),
    *rows("b1", "size", pushed="motion.in_effort"),
    *rows("f8", "size axes", to_joint="to_joint"),
    *rows("f8", "axes size", to_actuator="to_actuator"),
    # of the actuators
    *rows("f8", "axes", position="position", velocity="velocity", effort="effort", feed_forward="feed_forward"),
    *rows("b1", "axes", in_effort="in_effort"),
), {"show": ("i8",)})
"""From `trocar.procs.arm.record.SetpointRecord`."""

LIMITS: Final = CStruct("Limits", (
    *rows("i8", "", axes="axes", size="size"),
    *rows("f8", "size", wanted="wanted", rated="rated", of_joints="of_joints"),
    *rows("f8", "axes", motors="motors", of_motors="of_motors"),
    *rows("f8", "size axes", to_joint="map"),
), {"bear": ()})
"""From `trocar.procs.arm.effort_limits.EffortLimits`."""

ARM: Final = (CHAIN, INVERSE, CARTESIAN, GRAVITY, GOVERNOR, NEAR, READINGS, SETPOINT, LIMITS)
