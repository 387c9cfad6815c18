"""The steps in which the search for a guard's crossing advances, to be drawn."""

import numpy as np

from armsim.arm import AxisParameters, dynamics, modes
from armsim.exact import crossing, modal
from armsim.exact.crossing import Mode
from armsim.exact.piecewise_affine import ExactSolution


def proven_steps(p: AxisParameters, run: ExactSolution, event: int) -> np.ndarray:
    """Search once more for the guard that caused an event, and return the ends of the steps.

    Parameters
    ----------
    p : AxisParameters
        The axis.
    run : ExactSolution
        An exact run of the arm with one input.
    event : int
        Index of an event of one cause, whose guard was inside its limits when the piece began.

    Returns
    -------
    array
        Times, from the start of the piece to the event.
    """
    room, (_, volts) = run.room, run.inputs[0]
    piece = np.searchsorted(room.start[:, 0], run.events[event].time) - 1
    n = (room.start.shape[1] - 1) // 2
    limits = np.empty((2, modes.GUARDS))
    mode = Mode(np.empty((n, n)), np.empty(n), np.empty((modes.GUARDS, n)), *limits)
    k = dynamics.constants(p)
    modes.equations(room.label[piece, 0], volts, (k, dynamics.without_offsets(k)), mode)
    ((cause, _),) = run.events[event].causes
    one = slice(guard := dynamics.Region._fields.index(cause), guard + 1)
    here = Mode(mode.A, mode.b, mode.normal[one], mode.lower[one], mode.upper[one])
    known, start, work = modal.room_for(1, n), modal.start_room(n), crossing.work_room(n, 1)
    modal.find(here.A, known, run.end)
    crossing.set_start(here.A, here.b, room.start[piece, 1 : 1 + n], start)
    crossing.stand(here, start, work)
    formula = modal.piece(known, 0, here.b, start)
    ends: list[float] = []
    found = crossing.GIVEN_UP
    while found == crossing.GIVEN_UP:  # the same search with one more step each time
        _, found, _ = crossing.first_crossing(here, formula, run.end, len(ends), work)
        ends.append(work.proven[0])
    return room.start[piece, 0] + np.array(ends)
