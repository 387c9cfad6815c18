"""The steps that the book draws are those of the search: they end at the event."""

import numpy as np
import pytest

from armbook.proof import proven_steps
from armsim.arm import AxisParameters, simulate


@pytest.mark.parametrize("event", [0, 5, 6, 7, 10])
def test_steps_lead_from_the_event_before_to_the_event(event):
    p = AxisParameters.paper_x_axis()
    run = simulate(p, 10.0, 1.0).solution
    ends = proven_steps(p, run, event)
    assert ends[0] >= (run.events[event - 1].time if event else 0.0)
    assert ends[-1] == pytest.approx(run.events[event].time, rel=1e-14)
    rounding = 1e-12 * ends[-1]  # the last step, Newton's, may go back by that much
    assert np.all(np.diff(ends) >= -rounding)
    assert 5 < ends.size < 15
