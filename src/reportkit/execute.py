"""Execute a notebook so that its results appear all at once or not at all."""

import logging
import os
import re
import shutil
import signal
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from subprocess import PIPE, Popen
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import nbformat
import papermill
from jupyter_client.kernelspec import KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbclient.exceptions import DeadKernelError
from papermill.exceptions import PapermillExecutionError
from traitlets import default
from traitlets.config import Config

from reportkit.locks import LOCK_VARIABLE, locked, shared
from reportkit.program import FAILED, run
from reportkit.project import RESULTS_VARIABLE, ProjectError
from reportkit.text import plain

#: Settings of the user that could change a result, or keep a kernel from starting.
_HARMFUL = re.compile("PYTHON(?!PATH$|HOME$)|NUMBA_(?!CACHE_DIR$)|MPLBACKEND$|JUPYTER_")
_FRAME = re.compile(r"^File (.+?:\d+), in (\w+)", re.MULTILINE)
# A progress bar, in the format of `_bars`, and the blanks that take its place when it is done.
_BAR = re.compile(r"\x1b\[K([^\r\n]*?)(?:\x1b\[(?:K|0m))+ *|\r *")


#: In the scratch folder: what the kernel's process has written to standard error.
_LOG = "kernel.log"


class NotebookError(ProjectError):
    """A notebook could not be executed; the message names it, its cell and the error."""

    code = FAILED  #: exit code of the command line


def execute(source: Path, results: Path, parameters: Mapping[str, Any] | None = None) -> list[str]:
    """Execute a notebook and put it and the results it writes into a folder.

    Results of an earlier run of the same notebook in `results` are replaced only when the new
    run has succeeded. The executed notebook comes last, because make takes it as the sign that
    the rest is there. Two runs give the same bytes.

    Parameters
    ----------
    source : path
        The notebook, ``NN_topic.ipynb``.
    results : path
        The folder for the executed notebook ``NN_topic.ipynb`` and its results ``NN_topic.json``
        and ``NN_topic-*``; made if missing.
    parameters : mapping, optional
        Values for the variables of the cell tagged ``parameters``.

    Returns
    -------
    list of str
        Messages of the notebook on standard error, which are not published.

    Raises
    ------
    NotebookError
        If the notebook cannot be read or fails.
    """
    with executed(source, results, parameters or {}) as (new, complaints):
        for path in [*results.glob(f"{source.stem}[.-]*")]:
            path.unlink()
        for path in sorted(new.iterdir(), key=lambda path: path.suffix == ".ipynb"):
            path.replace(results / path.name)
    return complaints


@contextmanager
def executed(
    source: Path, parent: Path, parameters: Mapping[str, Any], closing: str = ""
) -> Iterator[tuple[Path, list[str]]]:
    """Execute a notebook into a hidden folder inside `parent`, removed when the block ends.

    Yields the folder with the executed notebook and its results, to be moved to their place, and
    the messages of the notebook on standard error. Raises `NotebookError` as `execute` does. The
    code `closing` is executed after the last cell and is no part of the executed notebook.
    """
    with _scratch(parent.resolve(), source.stem) as scratch:
        new = scratch / "results"
        new.mkdir()
        variables = {
            RESULTS_VARIABLE: str(new),
            "IPYTHONDIR": str(scratch),  # without start-up files or history of the user
            "MATPLOTLIBRC": os.devnull,  # instead of the user's file
            "PYTHONHASHSEED": "0",
            "OPENBLAS_NUM_THREADS": "1",  # the matrices are small, and another notebook may run
        }
        others = {name: os.environ[name] for name in os.environ if not _HARMFUL.match(name)}
        with patch.dict(os.environ, others | variables | _bars(source.stem), clear=True):
            notebook = _run(source, dict(parameters), scratch, closing)
        complaints = _tidy(notebook)
        nbformat.write(notebook, new / source.name)
        yield new, complaints


@contextmanager
def _scratch(parent: Path, stem: str) -> Iterator[Path]:
    """Make a hidden folder, and remove those that killed processes have left."""
    parent.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        with locked(parent):  # so that no process sees a new folder that is not yet locked
            for left in parent.glob(".[0-9][0-9]_*-????????"):
                with suppress(OSError), locked(left, wait=False):
                    shutil.rmtree(left, ignore_errors=True)
            folder = TemporaryDirectory("", f".{stem}-", parent, ignore_cleanup_errors=True)
            scratch = Path(stack.enter_context(folder))
            stack.enter_context(locked(scratch))
        # If this process is killed, its pipe to the shell closes, and the kernel ends in a second.
        shell = ["sh", "-c", 'exec > /dev/null 2>&1; read _; sleep 5; rm -rf "$0"', str(scratch)]
        guard = stack.enter_context(Popen(shell, stdin=PIPE, start_new_session=True))
        stack.callback(guard.kill)
        yield scratch


def _bars(name: str) -> dict[str, str]:
    """Settings of tqdm in a kernel: a bar on a terminal, and a line now and then elsewhere."""
    form, pause = "{l_bar}{bar}{r_bar}", {"TQDM_MININTERVAL": "1"}
    if not sys.stderr.isatty():
        form = "{desc}: {n_fmt} of {total_fmt} {unit}, about {remaining} left"
        pause = {"TQDM_MININTERVAL": "10", "TQDM_DELAY": "10"}
    # An empty text is false.
    return {"TQDM_DESC": name, "TQDM_LEAVE": "", "TQDM_BAR_FORMAT": f"\x1b[K{form}\x1b[K"} | pause


def _show_bars(text: str) -> None:
    """Show the progress bars in what a kernel has written to standard error."""
    told = (m[0] if sys.stderr.isatty() else m[1] and f"{m[1]}\n" for m in _BAR.finditer(text))
    print(*filter(None, told), sep="", end="", file=sys.stderr, flush=True)


class _Kernel(AsyncKernelManager):
    """A kernel of the Python that runs this, whatever kernels the user's folders name."""

    @default("kernel_spec_manager")
    def _own_kernel_only(self) -> KernelSpecManager:
        return KernelSpecManager(kernel_dirs=[])

    async def start_kernel(self, **options: Any) -> None:  # type: ignore[override]
        """Start it, and keep what it writes before it can send messages."""
        lock = filter(None, [os.environ.get(LOCK_VARIABLE)])
        with Path(self.connection_file).with_name(_LOG).open("w") as log:
            await super().start_kernel(stderr=log, pass_fds=[*map(int, lock)], **options)


def _run(
    source: Path, parameters: dict[str, Any], folder: Path, closing: str
) -> nbformat.NotebookNode:
    try:
        notebook = nbformat.read(source, as_version=4)
    except nbformat.reader.NotJSONError as error:
        raise NotebookError(f"{source} is not a notebook: {error}") from None
    # whatever kernel the author used
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    notebook.metadata["kernelspec"] = kernel
    last = [nbformat.v4.new_code_cell(closing)] if closing else []
    notebook.cells += last
    try:
        done = papermill.execute_notebook(
            notebook,
            None,
            parameters,
            cwd=folder,  # no file of the user is imported instead of a module
            progress_bar={"leave": False} if sys.stderr.isatty() else False,
            stderr_file=SimpleNamespace(write=_show_bars, flush=lambda: None),
            coalesce_streams=True,  # however the kernel has divided them
            kernel_manager_class=_Kernel,
            extra_arguments=["--log-level=CRITICAL"],  # of the kernel's own log
            # not in /tmp, where it stays if this process is killed
            config=Config(ConnectionFileMixin={"connection_file": str(folder / "kernel.json")}),
        )
    except PapermillExecutionError as error:
        raise NotebookError(_explain(source, error)) from None
    except DeadKernelError:
        raise NotebookError(f"{source} failed: its Python died (out of memory?)") from None
    except RuntimeError as error:  # before the first cell
        written = "".join(log.read_text(errors="replace") for log in folder.glob(_LOG))
        why = written.strip().rpartition("\n")[2] or error
        raise NotebookError(f"{source} failed: its Python did not start: {why}") from None
    del done.cells[len(done.cells) - len(last) :]
    return done


def _explain(source: Path, error: PapermillExecutionError) -> str:
    frames = _FRAME.findall(plain("\n".join(error.traceback)))
    places = "".join(f"\n  in {function}, {file}" for file, function in frames)
    code = "".join(f"\n    {line}" for line in error.source.splitlines())
    told = f"{source} failed in its code cell {error.exec_count}:\n{code}\n{places}\n"
    return f"{told}  {error.ename}: {plain(error.evalue)}"


def _tidy(notebook: nbformat.NotebookNode) -> list[str]:
    """Remove times, random ids and messages; move alt texts to where MyST-NB reads them."""
    complaints: list[str] = []
    notebook.metadata.pop("papermill", None)
    for number, cell in enumerate(notebook.cells):
        cell.id = f"cell-{number}"
        for name in ("papermill", "execution"):
            cell.metadata.pop(name, None)
        for output in list(cell.get("outputs", ())):
            if output.get("name") == "stderr":
                complaints += filter(None, [_BAR.sub("", output.text).strip()])
                cell.outputs.remove(output)
            elif alt := output.get("metadata", {}).get("image/svg+xml", {}).get("alt"):
                cell.metadata.setdefault("mystnb", {}).setdefault("image", {})["alt"] = alt
    return complaints


def be_a_program() -> None:
    """Take SIGTERM for an interruption, and silence libraries that tell of errors with stacks."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # make ends its children by it
    for logger in ("asyncio", "papermill", "traitlets"):
        logging.getLogger(logger).disabled = True


def main(source: Path, results: Path) -> None:
    """Run ``python -m reportkit.execute SOURCE RESULTS``."""
    be_a_program()
    print(f"{source}: executing", flush=True)
    start = time.perf_counter()
    with shared(source.parent):
        complaints = execute(source, results)
    for complaint in complaints:
        print(f"{source} warned: {complaint}", file=sys.stderr)
    seconds = f"{time.perf_counter() - start:.1f}"
    (results / f"{source.stem}-seconds.txt").write_text(f"{seconds}\n")
    print(f"{source}: done in {seconds} s", flush=True)


if __name__ == "__main__":
    sys.exit(run(main, sys.argv[1:]))
