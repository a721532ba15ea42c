"""The run folder: written atomically, locked by the operating system, read back whole."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import xarray as xr

from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.io.locks import GO_ON, try_lock
from pbrdf_bayes.io.outside import MAX_TEXT_BYTES, read_ordinary
from pbrdf_bayes.io.safe_names import safe_name
from pbrdf_bayes.io.schemas import validate
from pbrdf_bayes.records.design import Design
from pbrdf_bayes.records.summary import SCHEMA_VERSION, Summary
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.results import Analysis

SUMMARY = "summary.json"
POSTERIOR = "posterior.nc"
CONFIG = "config.toml"
REPORT = "report.html"
PDF = "report.pdf"
DESIGN = "design.json"
LOG = "log.txt"
LOCK = ".lock"
DESIGN_PAGE, PLAN = "design.html", "measurement_plan.csv"
RUN_FILES = (
    SUMMARY, POSTERIOR, CONFIG, REPORT, PDF, DESIGN, DESIGN_PAGE, PLAN, LOG, LOCK,
)  # fmt: skip
_PART = ".part"
_VOUCHED = (POSTERIOR, CONFIG)
"""Files of a run that its summary has the checksums of."""
_DAMAGED = (
    "{}: the run is damaged ({}). Fit it again: 'fit' with this --out and --resume does, and so "
    "does 'batch' with --resume"
)
_AGAIN = "Remove it, or run 'design' again"
_MOST_JSON_BYTES = 64 * 2**20
_DAMAGE = (OSError, ValueError, AttributeError, KeyError, RuntimeError, TypeError)
"""What h5netcdf and h5py raise for a file with bytes that are not what they were."""


def new_run_folder(root: Path, sample: str) -> Path:
    """Path of a run that does not exist yet: root/sample/time."""
    stamp = datetime.now(UTC).strftime("%Y%m%dT%H%M%S")
    folder = root / safe_name(sample) / stamp
    number = 2
    while folder.exists():
        folder = folder.with_name(f"{stamp}-{number}")
        number += 1
    return folder


def refuse_other_content(
    folder: Path, *, known: Iterable[str] = (), any_of: bool = False, what: str, remedy: str
) -> None:
    """Refuse a file, or a folder with visible content that does not belong there.

    Parameters
    ----------
    folder : Path
        Where something is to be written.
    known : iterable of str
        Names that may be there; with ``any_of`` one of them makes all others welcome.
    what : str
        What ``folder`` is for.
    remedy : str
        What to do about content.

    Raises
    ------
    RunFolderError
    """
    if folder.exists() and not folder.is_dir():
        msg = f"{folder}: is a file; --out is {what}. Give another one"
        raise RunFolderError(msg)
    present = sorted(p.name for p in folder.iterdir()) if folder.is_dir() else []
    visible = [name for name in present if not name.startswith(".")]
    strange = [name for name in visible if name not in set(known)]
    if strange and not (any_of and len(strange) < len(visible)):
        found = "holds something else" if known else "not empty"
        msg = f"{folder}: {found} ({', '.join(strange[:3])}). {remedy}"
        raise RunFolderError(msg)


def is_finished(folder: Path) -> bool:
    """A summary, written last, is there."""
    return (folder / SUMMARY).is_file()


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Hold the folder against a second process; the lock goes with the process that holds it.

    Raises
    ------
    RunFolderError
        When the folder cannot be made, another process holds it, its file system cannot lock, or
        the lock in it is a link.
    """
    lock = folder / LOCK
    if lock.is_symlink():  # opened, it would be followed out of the folder
        msg = (
            f"{lock}: is a symbolic link, which is not followed. Remove the link, or give another "
            "folder with --out"
        )
        raise RunFolderError(msg)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        flags = os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0)
        handle = os.open(lock, flags, 0o644)
    except OSError as error:
        msg = f"{folder}: cannot write there ({error.strerror}). Give another folder with --out"
        raise RunFolderError(msg) from None
    try:
        if not _try_lock(handle, folder):
            msg = (
                f"{folder}: another process is writing this run. Wait for it, or use another --out"
            )
            raise RunFolderError(msg)
        yield
    finally:
        os.close(handle)


def _try_lock(handle: int, folder: Path) -> bool:
    try:
        return try_lock(handle)
    except OSError as error:
        msg = (
            f"{folder}: this file system cannot lock files ({error.strerror}), so that a second "
            "process would not be refused. Give an --out on another one, or set the environment "
            f"variable {GO_ON}=1 if no other process writes there"
        )
        raise RunFolderError(msg) from None


def refuse_to_replace(path: Path, files: Iterable[Path], runs: Iterable[Path]) -> None:
    """Refuse to write where one of some files is, or what belongs to a run.

    Raises
    ------
    RunFolderError
    """
    own = [run / name for run in runs for name in RUN_FILES]
    if path.resolve() in {file.resolve() for file in (*files, *own)}:
        msg = f"{path}: would replace a file that is read here. Give another name"
        raise RunFolderError(msg)


def write_text(path: Path, text: str) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    RunFolderError
    """
    write_bytes(path, text.encode("utf-8"))


def write_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write a file whole or not at all.

    Raises
    ------
    RunFolderError
    """
    temporary = None
    try:
        handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=_PART)
        with os.fdopen(handle, "wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(temporary, 0o644)  # noqa: PTH101
        os.replace(temporary, path)  # noqa: PTH105
    except OSError as error:
        msg = (
            f"{path}: cannot be written ({error.strerror}); what was there before is unchanged. "
            "Make room or write elsewhere; an unfinished fit goes on with --resume"
        )
        raise RunFolderError(msg) from None
    finally:
        if temporary is not None:
            Path(temporary).unlink(missing_ok=True)


def remove_parts(folder: Path) -> None:
    """Remove what a killed process had not finished writing; only with the lock in hand."""
    for part in folder.glob(f".*{_PART}"):
        part.unlink(missing_ok=True)


def refuse_difference(
    found: Mapping[str, Any], wanted: Mapping[str, Any], *, what: str, remedy: str
) -> None:
    """Refuse what was made from something else than what is wanted now.

    Raises
    ------
    RunFolderError
        With one line for every key that differs: its value there and now.
    """
    different = [
        f"  {key}: {found.get(key)!r} there, {wanted.get(key)!r} now"
        for key in {**wanted, **found} if found.get(key) != wanted.get(key)
    ]  # fmt: skip
    if different:
        raise RunFolderError("\n".join([f"{what} of something else:", *different, remedy]))


def save_analysis(analysis: Analysis, folder: Path, *, report: str, log: str) -> None:
    """Write a run; the summary comes last and marks it as finished.

    Parameters
    ----------
    analysis : Analysis
    folder : Path
    report, log : str
        The page and the log of the run.

    Raises
    ------
    RunFolderError
        When the folder cannot be written.
    """
    # made in memory: where the disk is full, HDF5 ends the process
    posterior = bytes(analysis.draws.to_netcdf(engine="h5netcdf"))
    contents = {POSTERIOR: posterior, CONFIG: analysis.config_toml.encode("utf-8")}
    files = {name: {"sha256": hashlib.sha256(contents[name]).hexdigest()} for name in _VOUCHED}
    summary = plain({**analysis.summary, "files": files})
    validate_summary(summary, where=str(folder))
    for name, content in contents.items():
        write_bytes(folder / name, content)
    write_text(folder / LOG, log)
    write_text(folder / REPORT, report)
    _write_summary(folder, summary)


def amend_run(folder: Path, summary: Mapping[str, Any], *, report: str) -> None:
    """Replace summary and report of a finished run; only with the lock in hand.

    A PDF of the report that was there goes: it would say something else.

    Raises
    ------
    RunFolderError
        When the folder cannot be written, or the summary does not fit its record.
    """
    content = plain(summary)
    validate_summary(content, where=str(folder))
    (folder / PDF).unlink(missing_ok=True)
    write_text(folder / REPORT, report)
    _write_summary(folder, content)


def _write_summary(folder: Path, summary: Mapping[str, Any]) -> None:
    write_text(folder / SUMMARY, json.dumps(summary, indent=1, ensure_ascii=False) + "\n")


def damage_of(folder: Path, summary: Mapping[str, Any]) -> str:
    """What is wrong with the files of a finished run, in words; empty where they are whole.

    Parameters
    ----------
    folder : Path
    summary : mapping
        Of the run: ``files`` has the checksums. An early version stored none of ``config.toml``.
    """
    faults = (_fault(folder / name, summary.get("files", {}).get(name)) for name in _VOUCHED)
    return "; ".join(fault for fault in faults if fault)


def _fault(path: Path, stored: Mapping[str, str] | None) -> str:
    try:
        if not path.is_file():
            return f"{path.name} is missing"
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"{path.name} cannot be read ({error.strerror})"
    changed = stored is not None and stored["sha256"] != found
    return f"{path.name} does not have the checksum in {SUMMARY}" if changed else ""


def refuse_damage(folder: Path, summary: Mapping[str, Any]) -> None:
    """Refuse a run whose files differ from what was written.

    Raises
    ------
    RunFolderError
        With the files and the remedy.
    """
    if damage := damage_of(folder, summary):
        raise RunFolderError(_DAMAGED.format(folder, damage))


def read_run(folder: Path) -> Analysis:
    """Read a finished run back.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    Analysis
        As it is stored; see `pbrdf_bayes.load_analysis`.

    Raises
    ------
    RunFolderError
        Not a finished run, or a file of it is missing or damaged.
    """
    summary = load_summary(folder)
    refuse_damage(folder, summary)
    try:
        with xr.open_datatree((folder / POSTERIOR).read_bytes(), engine="h5netcdf") as tree:
            draws = tree.load()
        text = read_ordinary(folder / CONFIG, MAX_TEXT_BYTES).decode("utf-8")
    except _DAMAGE as error:
        raise RunFolderError(_DAMAGED.format(folder, error)) from None
    return Analysis(summary, draws, text, design=load_design(folder, summary))


def load_summary(folder: Path) -> dict[str, Any]:
    """Read and validate ``summary.json``, as `Analysis` has it.

    Raises
    ------
    RunFolderError
    """
    if not is_finished(folder):
        msg = f"{folder}: not a finished run (no {SUMMARY}). Give the folder that 'fit' printed"
        raise RunFolderError(msg)
    try:
        summary: dict[str, Any] = json.loads(read_ordinary(folder / SUMMARY, _MOST_JSON_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        msg = f"{folder / SUMMARY}: damaged ({error})"
        raise RunFolderError(msg) from None
    version = summary.get("schema_version") if isinstance(summary, dict) else None
    if version != SCHEMA_VERSION:
        msg = f"{folder / SUMMARY}: schema version {version!r}; this program reads {SCHEMA_VERSION}"
        raise RunFolderError(msg)
    validate_summary(summary, where=str(folder / SUMMARY))
    if (early := summary.pop("posterior_sha256", None)) is not None:  # version 0.1
        summary["files"] = {POSTERIOR: {"sha256": early}}
    return summary


def load_design(folder: Path, summary: Mapping[str, Any]) -> dict[str, Any] | None:
    """What to measure next, as it was computed from this run; None where it was not.

    Parameters
    ----------
    folder : Path
    summary : mapping
        Of the run: a design from draws that are no longer there does not count.

    Raises
    ------
    RunFolderError
        The file is damaged.
    """
    path = folder / DESIGN
    if not path.is_file():
        return None
    try:
        design: dict[str, Any] = json.loads(read_ordinary(path, _MOST_JSON_BYTES))
    except (OSError, ValueError, RecursionError) as error:
        msg = f"{path}: damaged ({error}). {_AGAIN}"
        raise RunFolderError(msg) from None
    validate_design(design, where=str(path))
    run = design["run"]
    return design if run is not None and run["created_utc"] == summary["created_utc"] else None


def validate_design(design: Mapping[str, Any], *, where: str) -> None:
    """Hold a design against its record.

    Raises
    ------
    RunFolderError
        Naming the first entry that does not fit.
    """
    validate(design, Design, where=where, remedy=_AGAIN)


def validate_summary(summary: Mapping[str, Any], *, where: str) -> None:
    """Hold a summary against its record.

    Raises
    ------
    RunFolderError
        Naming the first entry that does not fit.
    """
    validate(summary, Summary, where=where, remedy="Fit again into another folder")
