"""One function, many cases: on all processors, or on a cluster."""

import traceback
from collections.abc import Callable, Iterable
from typing import Any

from joblib import Parallel, delayed


class CaseError(RuntimeError):
    """A case failed.

    Attributes
    ----------
    case : int
        Its number, from 0.
    """

    def __init__(self, text: str, case: int) -> None:
        super().__init__(text, case)
        self.case = case

    def __str__(self) -> str:
        return str(self.args[0])


def each(
    function: Callable[[Any], Any],
    cases: Iterable[Any],
    progress: Callable[[Iterable[Any]], Iterable[Any]] = iter,
) -> list[Any]:
    """Call a function with each case and return the results in the order of the cases.

    Joblib starts a process for each processor. In the block of a ``joblib.parallel_config`` the
    work goes where that says: ``backend="dask"`` to the cluster of a Dask client,
    ``backend="threading"`` to threads. The results do not depend on it.

    Parameters
    ----------
    function : callable
        ``function(case)``; a lambda or a function of a notebook will do.
    cases : iterable
        The arguments.
    progress : callable, optional
        Wraps the iterator over the results, as ``tqdm.tqdm`` does.

    Raises
    ------
    CaseError
        If a case raises, even SystemExit; the text names the case, and a note has its traceback.

    Examples
    --------
    >>> each(lambda n: n**2, range(4))
    [0, 1, 4, 9]
    """
    calls = (delayed(_attempt)(function, n, case) for n, case in enumerate(cases))
    results = Parallel(n_jobs=-1, return_as="generator")(calls)
    return list(progress(results))


def _attempt(function: Callable[[Any], Any], n: int, case: Any) -> Any:
    try:
        return function(case)
    except (Exception, SystemExit) as error:  # not every exception survives the way back
        failure = CaseError(f"case {n}: {type(error).__name__}: {error}", n)
        failure.add_note(traceback.format_exc())
        raise failure from None
