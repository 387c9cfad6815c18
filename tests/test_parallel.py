"""Many cases in parallel: the same results everywhere, also when a worker is killed midway."""

import os
import signal
import uuid

import pytest
from distributed import Client, LocalCluster
from joblib import parallel_config

from armsim.arm import AxisParameters, simulate
from armsim.parallel import CaseError, each


def final_position(T_p):
    return float(simulate(AxisParameters.paper_x_axis(T_p=T_p), 10.0, 0.1)(0.1)[0])


def killed_once(flag):
    """Make a function whose first call in case 3 kills its process."""

    def run(n):
        if n == 3:
            try:
                os.close(os.open(flag, os.O_CREAT | os.O_EXCL))
            except FileExistsError:
                return n * n
            os.kill(os.getpid(), signal.SIGKILL)
        return n * n

    return run


@pytest.fixture(scope="module", params=["loky", "threading", "dask"])
def backend(request):
    if request.param != "dask":
        with parallel_config(request.param):
            yield request.param
        return
    quiet = {"dashboard_address": ":0", "worker_dashboard_address": ":0"}
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, **quiet) as cluster,
        Client(cluster),
        parallel_config("dask"),
    ):
        yield request.param


def test_results_are_those_of_a_loop_in_its_order(backend):
    cases = [0.02 + 0.002 * n for n in range(12)]
    assert each(final_position, cases) == [final_position(T_p) for T_p in cases]


def test_function_without_a_module_works(backend):
    offset = 3
    assert each(lambda n: n + offset, iter(range(5))) == [3, 4, 5, 6, 7]


def test_no_cases_no_results(backend):
    assert each(abs, []) == []


def test_equal_cases_are_run_each(backend):
    assert len(set(each(lambda _: uuid.uuid4().hex, [1, 1, 1, 1]))) == 4


@pytest.mark.parametrize("error", [ValueError("not with me"), SystemExit("not with me")])
def test_failure_names_the_case(backend, error):
    def fails(n):
        if n == 13:
            raise error
        return n

    told = f"case 13: {type(error).__name__}: not with me"
    with pytest.raises(CaseError, match=told) as caught:
        each(fails, range(20))
    assert caught.value.case == 13
    assert "in fails" in "".join(caught.value.__notes__)


def test_killed_worker_of_a_cluster_loses_nothing(backend, tmp_path):
    if backend != "dask":
        pytest.skip("joblib's own workers are not replaced")
    flag = str(tmp_path / "killed")
    assert each(killed_once(flag), range(8)) == [n * n for n in range(8)]
    assert os.path.exists(flag)


def test_progress_sees_every_result():
    seen = []

    def watch(results):
        for result in results:
            seen.append(result)
            yield result

    assert each(str, range(3), progress=watch) == ["0", "1", "2"] == seen
