"""Run a module as a program: paths as arguments, errors in one line, an exit code."""

import inspect
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from reportkit.project import ProjectError

FAILED, MISUSED, INTERRUPTED = 1, 2, 130


def run(work: Callable[..., None], arguments: Sequence[str]) -> int:
    """Call a function with the paths that the command line gives, and return the exit code.

    The code is 0 for success, 1 for an error, 2 for another number of paths than the function
    takes, and 130 after an interruption.
    """
    module, names = inspect.getmodule(work), inspect.signature(work).parameters
    if len(arguments) != len(names):
        name = module.__spec__.name if module and module.__spec__ else ""
        print(f"usage: python -m {name}", *map(str.upper, names), file=sys.stderr)
        return MISUSED
    try:
        work(*map(Path, arguments))
    except (ProjectError, OSError) as error:
        print(error, file=sys.stderr)
        return FAILED
    except KeyboardInterrupt:
        print(f"{arguments[0]}: interrupted, nothing published", file=sys.stderr)
        return INTERRUPTED
    return 0
