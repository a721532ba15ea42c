"""What a batch has to do: the samples of all files, each with a run folder of its own."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pbrdf_bayes import __version__
from pbrdf_bayes.config import RunConfig
from pbrdf_bayes.errors import DataError
from pbrdf_bayes.io.config_toml import config_table
from pbrdf_bayes.io.run_folder import safe_name
from pbrdf_bayes.io.tidy_csv import TidyFile, read_samples
from pbrdf_bayes.measurement import Measurement

_NOT_DECISIVE = ("threads", "max_steps")
_COLUMNS = (
    "polarization", "theta_i_deg", "theta_r_deg", "phi_r_deg", "value", "u_value", "repeated",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Job:
    """One sample at one wavelength, or why there is none.

    Attributes
    ----------
    sample : str
        Name; that of the file where its samples cannot be told.
    source : str
        The file as it was given.
    wavelength_um : float or None
        [um]
    measurement : Measurement or None
        None where the readings are not usable.
    folder : str
        Name of the run folder: a function of readings, configuration, seed and version. Empty
        where there is no measurement.
    error : str
        What is wrong with the readings.
    """

    sample: str
    source: str
    wavelength_um: float | None = None
    measurement: Measurement | None = None
    folder: str = ""
    error: str = ""


def plan_batch(files: Sequence[Path], config: RunConfig, *, seed: int) -> tuple[Job, ...]:
    """Every sample of every file, in the order given and, in a file, in that of its lines.

    A sample whose rows are bad leaves the others of its file usable. A file that cannot be read at
    all is one job with an error.

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
    taken: set[str] = set()
    for file in files:
        for job in _jobs_of(file, config.brdf_floor):
            if job.measurement is None:
                jobs.append(job)
                continue
            folder = _folder_name(job, config, seed, taken)
            taken.add(folder)
            jobs.append(
                Job(job.sample, job.source, job.wavelength_um, job.measurement, folder, job.error)
            )
    return tuple(jobs)


def _jobs_of(file: Path, brdf_floor: float) -> list[Job]:
    try:
        content = read_samples(file, brdf_floor=brdf_floor)
    except DataError as error:
        return [Job(file.name, str(file), error=str(error))]
    return [*_good(file, content), *_bad(file, content)]


def _good(file: Path, content: TidyFile) -> list[Job]:
    found = sorted(content.measurements.values(), key=_first_line)
    return [Job(m.sample, str(file), m.wavelength_um, m) for m in found]


def _first_line(m: Measurement) -> int:
    return int(min(rows.row.min() for rows in (m.brdf, m.dhr) if len(rows)))


def _bad(file: Path, content: TidyFile) -> list[Job]:
    return [Job(name, str(file), error=text) for name, text in content.errors.items()]


def _folder_name(job: Job, config: RunConfig, seed: int, taken: set[str]) -> str:
    """Name of the sample and a hash of all that its result is a function of."""
    m = job.measurement
    assert m is not None
    found = hashlib.sha256()
    for rows in (m.brdf, m.dhr):
        for name in _COLUMNS:
            found.update(getattr(rows, name).tobytes())
    table = {k: v for k, v in config_table(config).items() if k not in _NOT_DECISIVE}
    scans = [scan.label for scan in m.scans]
    decisive = [m.sample, m.wavelength_um, job.source, scans, table, seed, __version__]
    found.update(json.dumps(decisive, sort_keys=True).encode())
    number, name = 1, ""
    while not name or name in taken:
        again = found.hexdigest() if number == 1 else f"{found.hexdigest()}{number}"
        name = f"{safe_name(m.sample)}-{hashlib.sha256(again.encode()).hexdigest()[:10]}"
        number += 1
    return name
