"""Evaluation of one function for many cases, on all processors or on a cluster."""

import os
import time
import traceback
from _thread import start_new_thread
from collections.abc import Callable, Iterable
from typing import Any

from joblib import Parallel, delayed

#: Wraps the iterator over the results, as ``tqdm.tqdm`` does.
Progress = Callable[[Iterable[Any]], Iterable[Any]]


class CaseError(RuntimeError):
    """A case failed.

    Attributes
    ----------
    case : int
        Index of the case, from 0.
    """

    case: int


def each(function: Callable, cases: Iterable[Any], progress: Progress = iter) -> list[Any]:
    """Call a function with each case and return the results in the order of the cases.

    Joblib starts one process per processor. A ``joblib.parallel_config`` block selects another
    backend: ``backend="dask"`` uses the cluster of a Dask client, ``backend="threading"`` uses
    threads. The results do not depend on the backend. Worker processes end soon after the process
    that called, however it ended.

    Parameters
    ----------
    function : callable
        ``function(case)``; a lambda or a function defined in a notebook is allowed.
    cases : iterable
        The arguments.
    progress : callable, optional
        Wraps the iterator over the results, as ``tqdm.tqdm`` does.

    Raises
    ------
    CaseError
        If a case raises an exception, including SystemExit. The message names the case, and a
        note contains the traceback.

    Examples
    --------
    >>> each(lambda n: n**2, range(4))
    [0, 1, 4, 9]
    """
    calls = (delayed(_attempt)(function, n, case) for n, case in enumerate(cases))
    watch = {"initializer": start_new_thread, "initargs": (_end_with, (os.getpid(),))}
    return list(progress(Parallel(n_jobs=-1, return_as="generator", **watch)(calls)))


def _end_with(parent: int) -> None:
    """End this process when its parent has ended: a worker would wait for more work."""
    while os.getppid() == parent:  # the new parent of an orphan need not be process 1
        time.sleep(1.0)
    os._exit(1)


def _attempt(function: Callable[[Any], Any], n: int, case: Any) -> Any:
    try:
        return function(case)
    except (Exception, SystemExit) as error:  # not every exception can be pickled
        failure = CaseError(f"case {n}: {type(error).__name__}: {error}")
        failure.case = n
        failure.add_note(traceback.format_exc())
        raise failure from None
