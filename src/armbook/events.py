"""Events of an exact run in words, and compared with reference solutions of 35 digits."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armsim.arm import AxisParameters, simulate
from armsim.arm.dynamics import STUCK, Region
from armsim.methods.convergence import relative_error


def story(before: Region, after: Region) -> str:
    """Return in words what the change from one region to another means for the arm."""
    told = []
    for part, name in (("preamplifier", "preamplifier"), ("power", "motor voltage")):
        if getattr(before, part) != getattr(after, part):
            told.append(f"{name} {'reaches' if getattr(after, part) else 'leaves'} its limit")
    if before.contact != after.contact:
        verb, where = ("meet on", after) if after.contact else ("part from", before)
        told.append(f"teeth {verb} the {'driving' if where.contact > 0 else 'braking'} flank")
    if before.friction != after.friction:
        begins = "the arm breaks loose" if before.friction == STUCK else "static friction sets in"
        ends = {0: "static friction ends", STUCK: "the arm comes to rest and sticks"}
        told.append(ends.get(after.friction, begins))
    return ", ".join(told)


class Agreement(NamedTuple):
    """How far an exact run is from a reference solution."""

    events: int  #: number of them
    error: float  #: largest of a state, relative to the largest value of that state
    delay: float  #: largest difference of an event's time, s


def agreement(file: Path) -> Agreement:
    """Run the scenario of a file of ``tests/reference`` and compare.

    Raises
    ------
    ValueError
        If the run meets other events than the reference.
    """
    wanted = json.loads(file.read_text(encoding="utf-8"))
    axis, start = AxisParameters(**wanted["parameters"]), wanted["y_initial"]
    run = simulate(axis, wanted["set_velocity"], wanted["t_end"], y0=start)
    told = [(list(event.before), list(event.after)) for event in run.events]
    if told != [(event["before"], event["after"]) for event in wanted["events"]]:
        raise ValueError(f"{file}: the run meets other events than this reference")
    pairs = zip(run.events, wanted["events"], strict=True)
    delay = max((abs(event.time - float(other["time"])) for event, other in pairs), default=0.0)
    times = np.array([sample["t"] for sample in wanted["samples"]])
    states = np.array([sample["y"] for sample in wanted["samples"]], dtype=float).T
    error = relative_error(run(times), states, wanted["y_largest"])
    return Agreement(len(run.events), error, delay)
