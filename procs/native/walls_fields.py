"""The arrays of an arm's walls. n: joints, m: independent ones, w: walls, p: points of the arm, s: its segments."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.arm_fields import links
from trocar.procs.native.fields import CStruct, places, rows

WALLS: Final = CStruct("Walls", (
    *links("kinematics.links"),
    *rows("f8", "3 4", end="kinematics.end"),
    *rows("i8", "", m="m", w="w", p="p", s="s", halvings="HALVINGS", samples="samples", sweeps="SWEEPS", steps="STEPS"),
    *rows("f8", "", grain="GRAIN", near="NEAR", safe="SAFE", tiny="TINY", small="SMALL", flat="FLAT", turn="TURN",
          apex="APEX", over="OVER", spare="SPARE", along="ALONG", thickest="thickest", zone="ZONE", spring="SPRING",
          damper="DAMPER", largest="LARGEST"),
    *rows("i8", "p", of="body.of"),
    *rows("f8", "p 3", place="body.place"),
    *places("s", "p", starts="body.starts", stops="body.stops"),
    *rows("i8", "s", parts="body.parts"),
    *rows("f8", "s", radius="body.radius"),
    *rows("f8", "n", reach="body.reach", before="before", goal="goal", lower="lower", upper="upper",
          rates="rates", efforts="efforts"),
    *rows("f8", "2 n", step="step"),
    *rows("f8", "n m", free="free"),
    *rows("f8", "m n", gather="gather"),
    *rows("i8", "w", kind="kind", keeps_in="keeps_in", guards="guards", group="group"),
    *rows("f8", "w 3 4", frames="frames"),
    *rows("f8", "w 3", size="size"),
    *rows("f8", "w", margin="margin", pace="pace"),
    *rows("f8", "w s", value="value"),
    *rows("f8", "1", share="share"),
), {"keep": ("f8", "i8"), "way": (), "look": (), "push": (), "slow": ("f8",), "meets": ("f8",)})
"""From `trocar.procs.kinematics.walls.walls.ArmWalls`."""

MOVED: Final = CStruct("MovedWalls", (
    *links("kinematics.links"),
    *rows("f8", "3 4", end="kinematics.end", relation="relation", pose="pose"),
    *rows("i8", "", axes="axes", p="p", s="s", t="t", hangs="hangs"),
    *rows("f8", "n axes", to_joint="to_joint"),
    *rows("f8", "axes", position="position"),
    *rows("f8", "n", least="least", most="most"),
    *rows("i8", "p", of="body.of"),
    *rows("f8", "p 3", place="body.place"),
    *places("s", "p", starts="starts", stops="stops"),
    *rows("f8", "t 3 4", frames="frames"),
    *rows("f8", "t 3", size="size"),
    *rows("b1", "1", biased="biased"),
    *rows("i8", "1", age_ns="age_ns", by_tip="by_tip"),
), {"follow": (), "follow_all": ("i8", "i8", "i8")})
"""From `trocar.procs.kinematics.walls.moved.MovedWalls`; t: walls that move, of which s are segments."""
