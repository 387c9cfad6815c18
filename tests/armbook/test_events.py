"""Events in words; references against the exact solver."""

import json
from pathlib import Path

import numpy as np
import pytest

from armbook.events import agreement, story
from armsim.arm.dynamics import STUCK, Region

REFERENCES = Path(__file__).parents[1] / "reference"


@pytest.fixture
def wanted():
    return json.loads((REFERENCES / "published_step.json").read_text())


@pytest.fixture
def file(tmp_path):
    return tmp_path / "changed.json"


def test_a_planted_error_is_found(wanted, file):
    file.write_text(json.dumps(wanted))
    found = agreement(file)
    assert found.events == len(wanted["events"])
    assert found.error < 1e-12
    assert found.delay < 1e-14
    sample, event = wanted["samples"][3], wanted["events"][2]
    sample["y"][6] = str(float(sample["y"][6]) + 1e-6 * float(wanted["y_largest"][6]))
    event["time"] = str(float(event["time"]) + 3e-9)
    file.write_text(json.dumps(wanted))
    found = agreement(file)
    assert found.error == pytest.approx(1e-6, rel=1e-5)
    assert found.delay == pytest.approx(3e-9, rel=1e-5)


def test_other_events_are_an_error(wanted, file):
    del wanted["events"][-1]
    file.write_text(json.dumps(wanted))
    with pytest.raises(ValueError, match=r"changed.json: .* other events"):
        agreement(file)


def test_a_run_without_events_has_no_delay(wanted, file):
    zeros = [["0"] * 7]
    wanted |= {"set_velocity": [[0.0, 0.0]], "y_initial": [0.0] * 7, "events": []}
    wanted["samples"] = [{"t": 0.1, "y": y} for y in zeros]
    file.write_text(json.dumps(wanted))
    assert agreement(file)[::2] == (0, 0.0)
    assert np.isfinite(agreement(file).error)


@pytest.mark.parametrize(
    ("before", "after", "words"),
    [
        (Region(0, 0, 0, 0), Region(1, 0, 0, 0), "preamplifier reaches its limit"),
        (Region(0, -1, 0, 0), Region(0, 0, 0, 0), "motor voltage leaves its limit"),
        (Region(0, 0, 1, 0), Region(0, 0, 0, 0), "teeth part from the driving flank"),
        (Region(0, 0, 0, 0), Region(0, 0, -1, 0), "teeth meet on the braking flank"),
        (
            Region(1, 0, 0, STUCK),
            Region(1, 0, 1, 1),
            "teeth meet on the driving flank, the arm breaks loose",
        ),
        (Region(0, 0, 1, 1), Region(0, 0, 1, STUCK), "the arm comes to rest and sticks"),
        (Region(0, 0, 1, 0), Region(0, 0, 1, 1), "static friction sets in"),
    ],
)
def test_events_in_words(before, after, words):
    assert story(before, after) == words
