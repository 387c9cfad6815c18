"""What holds for all tests."""

import gc
import os
import signal
from pathlib import Path

import pytest
from hypothesis import HealthCheck, is_hypothesis_test, settings
from hypothesis.database import DirectoryBasedExampleDatabase

# Who starts the tests in the background makes them ignore Ctrl-C, and so the programs that they
# start and interrupt. A handler here is the default there.
signal.signal(signal.SIGINT, signal.default_int_handler)

# `make test` tries the same examples each time, on however busy a machine. `make fuzz` tries new
# ones, and keeps those that fail in .hypothesis.
_ANY_SPEED = {"deadline": None, "suppress_health_check": [HealthCheck.too_slow]}
settings.register_profile("ci", derandomize=True, database=None, **_ANY_SPEED)
settings.register_profile(
    "fuzz",
    max_examples=2000,
    derandomize=False,
    database=DirectoryBasedExampleDatabase(Path(__file__).parents[1] / ".hypothesis"),
    print_blob=True,
    **_ANY_SPEED,
)
settings.load_profile("ci")

#: Files with tests of half a minute.
LONG = ("armbook/test_rerun.py", "book/test_pdf.py", "reportkit/test_readme.py",
        "second_opinion/test_second_opinion.py")  # fmt: skip


@pytest.hookimpl(wrapper=True)
def pytest_collection():
    """Do not search for garbage among modules and tests, all of which live until the end."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_xdist_auto_num_workers():
    """One process more than there are processors, since tests wait for browsers and programs."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items):
    """Put the longest tests first, so that none is the last, and give properties a seed.

    The seed is that of `make fuzz`. Hypothesis keeps no failures of a test with a seed, by its
    decorator or by pytest's option.
    """
    items.sort(key=lambda item: not item.path.as_posix().endswith(LONG))
    number = os.environ.get("FUZZ_SEED")
    for item in items if number else ():
        if is_hypothesis_test(getattr(item, "function", None)):
            item.function._hypothesis_internal_use_seed = int(number)
