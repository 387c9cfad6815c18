"""Where the numbers of a report come from: software, computer, run times and data."""

import hashlib
import platform
import subprocess
import sys
import zipfile
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from reportkit import text
from reportkit.project import Project
from reportkit.timing import computer


def software(project: Project) -> list[tuple[str, str]]:
    """List the report, Python and the packages that the report requires, each with its version.

    The report's version ends with the commit if it lies in a repository. The requirements are
    those of the installed distribution and its extra ``project.extra``; a report that is not
    installed requires ``project.versions``.
    """
    try:
        own, wanted = metadata.version(project.name), metadata.requires(project.name) or []
    except metadata.PackageNotFoundError:
        own, wanted = "not installed", [*project.versions]
    extra = {"extra": project.extra}
    needed = {r.name for r in map(Requirement, wanted) if not r.marker or r.marker.evaluate(extra)}
    commit = _commit(project.root)
    return [
        (project.name, f"{own}, commit {commit}" if commit else own),
        ("Python", platform.python_version()),
        *((name, metadata.version(name)) for name in sorted(needed, key=str.lower)),
    ]


def _commit(root: Path) -> str:
    """Return the commit of the repository in a folder, or an empty text if there is none."""
    command = ["git", "-C", str(root), "describe", "--always", "--dirty"]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return ""


def version(project: Project) -> str:
    """Return the version of the report, with its commit and the commit's date if there is one."""
    own = software(project)[0][1]
    if "commit" not in own:
        return own
    command = ["git", "-C", str(project.root), "log", "-1", "--format=%cs"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return ", ".join(filter(None, [own, done.stdout.strip()]))


def bundle(results: Path, file: Path) -> None:
    """Pack the executed notebooks with their values, tables, data and figures; the same each time.

    Parameters
    ----------
    results, file
        The folder of the results, and the ZIP file to write.
    """
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for path in sorted(results.glob("[0-9][0-9]_*.*")):
            if path.suffix in (".ipynb", ".json", ".csv", ".svg", ".md"):
                entry = zipfile.ZipInfo(f"results/{path.name}")  # of 1980, not of today
                archive.writestr(entry, path.read_bytes(), zipfile.ZIP_DEFLATED)


def run_times(results: Path) -> Iterator[tuple[str, str]]:
    """List the executed notebooks, as links, each with the seconds that it took."""
    for path in text.studies(results, ".ipynb"):
        seconds = results / f"{path.stem}-seconds.txt"
        told = seconds.read_text().strip() if seconds.exists() else "–"
        yield f"{{doc}}`{path.stem} <{results.name}/{path.stem}>`", told


def sums(project: Project) -> list[tuple[str, str]]:
    """List the SHA-256 sums of the data files, each with the file's path from the root.

    Expected results only judge, so they are left out.
    """
    files = (path for path in sorted(project.data.rglob("*")) if path.is_file())
    return [
        (hashlib.sha256(path.read_bytes()).hexdigest(), str(path.relative_to(project.root)))
        for path in files
        if project.expected not in path.parents and path.parent.name != "__pycache__"
    ]


def write(project: Project, results: Path) -> None:
    """Write ``appendix-*`` beside the results: four tables for pages, and ``SHA256SUMS``."""
    data = sums(project)
    short = [(f"`{name}`", f"`{digest[:16]}`") for digest, name in data]
    parts = {
        "software.md": text.markdown_table(["package", "version"], software(project)),
        "version.md": f"**Version** {version(project)}\n",
        "computer.md": f"{computer()}\n",
        "run-times.md": text.markdown_table(["notebook", "run time / s"], run_times(results), [1]),
        "sums.md": text.markdown_table(["file", "SHA-256, first 16 digits"], short),
        "SHA256SUMS": "".join(f"{digest}  {name}\n" for digest, name in data),
    }
    for name, content in parts.items():
        text.write(results / f"appendix-{name}", content)
    bundle(results, results / "appendix-results.zip")


def main(arguments: list[str]) -> int:
    """Run ``python -m reportkit.provenance RESULTS``; return the exit code."""
    (results,) = map(Path, arguments)
    write(Project.find(), results)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
