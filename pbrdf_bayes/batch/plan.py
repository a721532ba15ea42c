"""What a batch has to do: the samples of all files, each with a run folder of its own."""

from __future__ import annotations

import hashlib
import json
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path

from pbrdf_bayes import __version__
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.config_toml import config_table
from pbrdf_bayes.io.problems import printable
from pbrdf_bayes.io.safe_names import safe_name
from pbrdf_bayes.io.tidy_csv import TidyFile, read_usable_samples
from pbrdf_bayes.measurement import Measurement

_NOT_DECISIVE = ("threads", "max_steps")
_COLUMNS = (
    "polarization", "theta_i_deg", "theta_r_deg", "phi_r_deg", "value", "u_value", "repeated",
)  # fmt: skip

_MOST_ALIKE = 6


@dataclass(frozen=True, eq=False)
class Job:
    """One sample at one wavelength, or why there is none.

    Attributes
    ----------
    sample : str
        Name; that of the file where its samples cannot be told.
    source : str
        The file as it was given, what cannot be seen in its name escaped.
    wavelength_um : float or None
        [um]
    measurement : Measurement or None
        None where the readings are not usable.
    folder : str
        Name of the run folder: a function of name, readings, configuration, seed and version,
        wherever the file is. Empty where there is no measurement of its own.
    error : str
        What is wrong with the readings.
    repeat_of : int or None
        Position in the batch of the sample with the same readings, which is fitted instead.
    notice : str
        What its reader should know that is no error.
    """

    sample: str
    source: str
    wavelength_um: float | None = None
    measurement: Measurement | None = None
    folder: str = ""
    error: str = ""
    repeat_of: int | None = None
    notice: str = ""


def plan_batch(files: Sequence[Path], config: RunConfig, *, seed: int) -> tuple[Job, ...]:
    """Every sample of every file, see `in_order`, and in a file in the order of its lines.

    A sample whose rows are bad leaves the others of its file usable, and so do rows that belong to
    no sample, which are a job of their own with an error. A file that cannot be read at all is one
    job with an error. Readings that an earlier sample has bit for bit, under whatever
    name, are no measurement of their own: such a sample is a repeat.

    Parameters
    ----------
    files : sequence of Path
    config : RunConfig
    seed : int

    Returns
    -------
    tuple of Job
        Run folders are all different, whatever the names of the samples are.
    """
    jobs: list[Job] = []
    first: dict[str, int] = {}
    for file in in_order(files):
        for job in _jobs_of(file, config):
            if job.measurement is None:
                jobs.append(job)
                continue
            readings = _digest(job.measurement)
            at = first.setdefault(readings, len(jobs))
            if at < len(jobs):
                jobs.append(replace(job, repeat_of=at, error=_repeat(jobs[at], at)))
            else:
                folder = _folder_name(job.measurement, readings, config, seed)
                jobs.append(replace(job, folder=folder))
    return _with_look_alikes(jobs)


def _with_look_alikes(jobs: Sequence[Job]) -> tuple[Job, ...]:
    """The jobs, with a notice where the name of another looks the same and is not."""
    alike: dict[str, dict[str, int]] = {}
    for i, job in enumerate(jobs):
        alike.setdefault(_likeness(job.sample), {}).setdefault(job.sample, i)
    found = []
    for job in jobs:
        others = [
            f"No. {i + 1} {name!a}"
            for name, i in islice(alike[_likeness(job.sample)].items(), _MOST_ALIKE)
            if name != job.sample
        ]
        text = f"The name {job.sample!a} is easily taken for that of {', '.join(others)}."
        notice = f"{job.notice} {text}".strip() if others else job.notice
        found.append(replace(job, notice=notice))
    return tuple(found)


def _likeness(name: str) -> str:
    """What names have in common that differ by capitals, blanks or widths alone."""
    return " ".join(unicodedata.normalize("NFKC", name).casefold().split())


def in_order(files: Sequence[Path]) -> list[Path]:
    """The files as they are given; where a pattern of the shell has sorted them, numbers count.

    A shell sorts letter by letter, so that lot_10 comes before lot_2. Files in such an order, of
    which nobody has chosen another, are taken by the value of the numbers in their names.

    Examples
    --------
    >>> [str(file) for file in in_order([Path("lot_1"), Path("lot_10"), Path("lot_2")])]
    ['lot_1', 'lot_2', 'lot_10']
    >>> [str(file) for file in in_order([Path("lot_10"), Path("lot_2"), Path("lot_1")])]
    ['lot_10', 'lot_2', 'lot_1']
    """
    names = [str(file) for file in files]
    if any(names == sorted(names, key=collation) for collation in _COLLATIONS):
        return sorted(files, key=_natural)
    return list(files)


def _plain(name: str) -> str:
    return re.sub(r"[\W_]", "", name.casefold())


_COLLATIONS = (str, str.casefold, _plain)
"""By which shells sort: bytes, letters of either case alike, letters and digits alone."""


def _natural(file: Path) -> list[str | int]:
    """Text and numbers in turn, as they stand in the name."""
    parts = re.split(r"([0-9]+)", str(file).casefold())
    return [int(part[:4000]) if i % 2 else part for i, part in enumerate(parts)]


def _repeat(job: Job, at: int) -> str:
    return (
        f"the readings are those of No. {at + 1} to the last digit (sample {job.sample!r} of "
        f"{Path(job.source).name}): fitted and counted once. Correct the file if these are two"
    )


def _jobs_of(file: Path, config: RunConfig) -> list[Job]:
    source = printable(str(file))
    try:
        content = read_usable_samples(
            file, brdf_floor=config.brdf_floor, angle_tolerance_deg=config.angle_tolerance_deg
        )
    except DataError as error:
        return [Job(printable(file.name), source, error=str(error))]
    good = [
        (_first_line(m), Job(m.sample, source, m.wavelength_um, m, notice=_notice(content, m)))
        for m in content.measurements.values()
    ]
    bad = [(content.first_lines[name], _bad(file, content, name)) for name in content.errors]
    return [job for _, job in sorted([*good, *bad], key=lambda pair: pair[0])]


def _notice(content: TidyFile, m: Measurement) -> str:
    """What was noticed of the sample itself; what concerns the file is in every report."""
    return " ".join(m.warnings[len(content.warnings) :])


def _first_line(m: Measurement) -> int:
    return int(min(rows.row.min() for rows in (m.brdf, m.dhr) if len(rows)))


def _bad(file: Path, content: TidyFile, name: str) -> Job:
    """What a sample is called that has no name: the file and the first line of such rows."""
    called = name or f"{printable(file.name)}, line {content.first_lines[name]}"
    return Job(called, printable(str(file)), error=content.errors[name])


def _digest(m: Measurement) -> str:
    """Hash of wavelength and readings, without any name."""
    found = hashlib.sha256(repr(m.wavelength_um).encode())
    for rows in (m.brdf, m.dhr):
        for name in _COLUMNS:
            found.update(getattr(rows, name).tobytes())
    return found.hexdigest()


def _folder_name(m: Measurement, readings: str, config: RunConfig, seed: int) -> str:
    """Name of the sample and a hash of all that its result is a function of."""
    table = {k: v for k, v in config_table(config).items() if k not in _NOT_DECISIVE}
    scans = [scan.label for scan in m.scans]
    decisive = [m.sample, readings, scans, table, seed, __version__]
    text = json.dumps(decisive, sort_keys=True)
    return f"{safe_name(m.sample)}-{hashlib.sha256(text.encode()).hexdigest()[:10]}"
