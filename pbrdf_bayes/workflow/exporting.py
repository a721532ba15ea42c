"""Files for other programs: the model of a run or of given parameters in the format of each.

Formats with uncertainties (csv, bird) have the median of the BRDF over the posterior. The others
have the BRDF at the median of each parameter: one model, whose DHR is its integral.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pbrdf_bayes import __version__
from pbrdf_bayes.analysis import Analysis
from pbrdf_bayes.config import did_you_mean
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.export.astm import astm_text
from pbrdf_bayes.io.export.bird import bird_text
from pbrdf_bayes.io.export.fred import fred_text
from pbrdf_bayes.io.export.records import Origin, Rows
from pbrdf_bayes.io.export.tensor import pbsdf_bytes
from pbrdf_bayes.io.export.tidy import csv_text
from pbrdf_bayes.io.export.zemax import zemax_text
from pbrdf_bayes.io.run_folder import refuse_to_replace, write_bytes
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import Parameters, check_directions
from pbrdf_bayes.quantities import POLARIZATIONS
from pbrdf_bayes.workflow.export_grids import (
    COUNTED_DEG,
    Error,
    Peaks,
    fill_half_angles,
    fill_specular,
    half_angle_axes,
    hemisphere_of,
    line_of,
    specular_axes,
)
from pbrdf_bayes.workflow.export_source import (
    Source,
    source_of_parameters,
    source_of_run,
    sources_of_runs,
)

Array = NDArray[np.float64]

_THETA_I_DEG = tuple(float(a) for a in range(0, 90, 10))
_MOST_INCIDENCES = 361
_WAVELENGTH_UM = 3.39
_SAMPLE = "paint_simulated"
_VISIBLE_NM = (360, 478, 595, 713, 830)
_N_MITSUBA = len(_VISIBLE_NM)
_MOST_NM = 65535


@dataclass(frozen=True, kw_only=True)
class Exported:
    """Files that were written.

    Attributes
    ----------
    paths : tuple of Path
    notes : tuple of str
        What a format does not hold, what was assumed, and the errors of interpolation.
    """

    paths: tuple[Path, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class _Task:
    sources: tuple[Source, ...]
    polarizations: tuple[str, ...]
    theta_i_deg: tuple[float, ...] | None
    origin: Origin

    @property
    def incidences(self) -> tuple[float, ...]:
        return self.theta_i_deg or _THETA_I_DEG


@dataclass(frozen=True, kw_only=True)
class _File:
    """Content of a file; ``q`` and ``nm`` go into its name."""

    content: bytes
    q: str = ""
    nm: str = ""


_Files = tuple[list[_File], list[str]]


def export_brdf(
    model: Parameters | Analysis | Path | str | Sequence[Path | str],
    path: Path | str,
    *,
    format: str,  # noqa: A002
    polarizations: Sequence[str] = POLARIZATIONS,
    theta_i_deg: Sequence[float] | None = None,
    wavelength_um: float | None = None,
    effects: Effects | None = None,
) -> Exported:
    """Write the BRDF of a model for a ray tracer, a renderer or another laboratory.

    Parameters
    ----------
    model : Parameters, Analysis, Path, str, or sequence of Path or str
        Given parameters, a run, its folder, or folders of runs of one sample, each of another
        wavelength. Effects of the instrument are left out.
    path : Path or str
        File to write. A format without polarisation has a file for each: ``NAME_s.EXT``; one that
        holds one wavelength has ``NAME_650nm_s.EXT`` where there are several runs.
    format : {"csv", "bird", "zemax", "fred", "astm", "mitsuba"}
        ``csv`` and ``bird`` hold directions in the plane of incidence, the others all directions.
    polarizations : sequence of {"s", "p", "u"}
    theta_i_deg : sequence of float, optional
        Angles of incidence [deg]; 0 to 80 by 10 by default, and in a Zemax file as many as
        interpolation needs.
    wavelength_um : float, optional
        Of given parameters [um], 3.39 by default; of runs, take the run of this wavelength alone.
    effects : Effects, optional
        Line shape and effects beside given parameters.

    Returns
    -------
    Exported

    Raises
    ------
    ConfigError
        When format, polarisation, wavelength or the number of runs is not allowed.
    DomainError
        When an angle is not allowed.
    RunFolderError
        When a folder is no finished run, or a file cannot be written. Each file is written whole
        or not at all, and none before all are computed.

    Examples
    --------
    >>> import tempfile
    >>> green = Parameters(n=1.526, k=0.193, sigma_n0=0.4528, rho0=0.47)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     done = export_brdf(green, f"{folder}/green.txt", format="fred", theta_i_deg=[20.0])
    >>> [path.name for path in done.paths]
    ['green_s.txt', 'green_p.txt', 'green_u.txt']
    """
    if format not in FORMATS:
        hint = did_you_mean(format, list(FORMATS))
        msg = f"format = {format!r} is not known.{hint} Allowed: {', '.join(FORMATS)}"
        raise ConfigError(msg)
    target = Path(path)
    if target.is_dir() or not target.parent.is_dir() or not target.name:
        msg = f"{target}: give the name of a file in a folder that exists"
        raise ConfigError(msg)
    chosen = _checked_polarizations(polarizations)
    theta_i = None if theta_i_deg is None else _checked_incidences(theta_i_deg)
    sources, folders, notes = _sources(model, effects, wavelength_um)
    task = _Task(
        sources=sources, polarizations=chosen, theta_i_deg=theta_i, origin=_origin(sources)
    )
    files, of_format = FORMATS[format](task)
    paths = [_name(target, file, several=len(sources) > 1) for file in files]
    for one in paths:
        refuse_to_replace(one, (), folders)
    for one, file in zip(paths, files, strict=True):
        write_bytes(one, file.content)
    return Exported(paths=tuple(paths), notes=tuple(notes + of_format))


def _name(target: Path, file: _File, *, several: bool) -> Path:
    parts = [target.stem] + [f"{file.nm}nm"] * (several and bool(file.nm)) + [file.q] * bool(file.q)
    return target.with_name("_".join(parts) + target.suffix)


def _checked_polarizations(polarizations: Sequence[str]) -> tuple[str, ...]:
    chosen = tuple(dict.fromkeys(polarizations))
    if not chosen or any(q not in POLARIZATIONS for q in chosen):
        msg = f"polarizations = {list(polarizations)!r} is not allowed. Give some of 's', 'p', 'u'"
        raise ConfigError(msg)
    return chosen


def _checked_incidences(theta_i_deg: Sequence[float]) -> tuple[float, ...]:
    """Increasing, each once."""
    check_directions(theta_i_deg=np.asarray(theta_i_deg, dtype=np.float64))
    given = tuple(np.unique(np.asarray(theta_i_deg, dtype=np.float64)).tolist())
    if not 0 < len(given) <= _MOST_INCIDENCES:
        msg = f"theta_i_deg has {len(given)} angles: give from 1 to {_MOST_INCIDENCES}"
        raise ConfigError(msg)
    return given


def _sources(
    model: object, effects: Effects | None, wavelength_um: float | None
) -> tuple[tuple[Source, ...], list[Path], list[str]]:
    """The models, the folders they come from, and what was assumed."""
    notes = []
    folders: list[Path] = []
    if wavelength_um is not None and not 0.1 <= wavelength_um <= 1000.0:
        msg = f"wavelength_um = {wavelength_um!r} is not allowed: give 0.1 to 1000 um"
        raise ConfigError(msg)
    if isinstance(model, Parameters):
        if wavelength_um is None:
            notes.append(
                f"wavelength: {_WAVELENGTH_UM:g} um is assumed; wavelength_um gives another"
            )
        sources: tuple[Source, ...] = (
            source_of_parameters(
                model, effects, sample=_SAMPLE, wavelength_um=wavelength_um or _WAVELENGTH_UM
            ),
        )
    elif effects is not None:
        msg = "effects go with given parameters: a run has its own. Leave them out"
        raise ConfigError(msg)
    elif isinstance(model, Analysis):
        sources = (source_of_run(model),)
    elif isinstance(model, str | Path):
        folders = [Path(model)]
        sources = sources_of_runs(folders, wavelength_um)
    elif isinstance(model, Sequence) and model:
        folders = [Path(folder) for folder in model]
        sources = sources_of_runs(folders, wavelength_um)
    else:
        msg = f"model = {model!r} is no model. Give Parameters, a run, or folders of runs"
        raise ConfigError(msg)
    without = dict.fromkeys(name for source in sources for name in source.without)
    if without:
        notes.append(f"effects of the instrument are left out: {', '.join(without)}")
    return sources, folders, notes


def _origin(sources: Sequence[Source]) -> Origin:
    of_run = sources[0].of_run
    return Origin(
        sample=sources[0].sample,
        program=__version__,
        statement="Four-parameter polarised BRDF model, "
        + ("posterior medians of a fit" if of_run else "given parameters: simulated"),
        measured=of_run,
        timestamp=datetime.now(UTC).strftime("%Y-%m-%dT%H:%M:%SZ"),
        wavelengths_um=tuple(source.wavelength_um for source in sources),
        fitted=tuple(source.fitted for source in sources),
    )


def _said(where: str, error: Error) -> str:
    most = f"at most {100.0 * error.most:.2g} %, in the median {100.0 * error.median:.2g} %"
    return f"{where}: linear interpolation errs by {most} where the BRDF is above 1 % of its peak"


def _worst(errors: Sequence[Error]) -> Error:
    return Error(median=max(e.median for e in errors), most=max(e.most for e in errors))


def _in_plane(task: _Task) -> tuple[Rows, Rows, Error]:
    """BRDF of scans in plane and DHR, of every source and polarisation."""
    peaks = Peaks(task.sources, task.polarizations)
    lines = [line_of(peaks, theta_i) for theta_i in task.incidences]
    theta_i = np.concatenate(
        [np.full(x.size, at) for at, (x, _) in zip(task.incidences, lines, strict=True)]
    )
    theta_r = np.concatenate([x for x, _ in lines])
    incidences = np.array(task.incidences)
    nowhere = np.full(incidences.size, np.nan)
    return (
        _rows(task, theta_i, theta_r, np.zeros(theta_r.size)),
        _rows(task, incidences, nowhere, nowhere),
        _worst([error for _, error in lines]),
    )


def _rows(task: _Task, theta_i: Array, theta_r: Array, phi_r: Array) -> Rows:
    """The same directions for every source and polarisation."""
    targets = [(source, q) for source in task.sources for q in task.polarizations]
    found = [source.values(theta_i, theta_r, phi_r, q) for source, q in targets]
    n = len(targets)
    return Rows(
        polarization=np.repeat([q for _, q in targets], theta_i.size),
        wavelength_um=np.repeat([source.wavelength_um for source, _ in targets], theta_i.size),
        theta_i_deg=np.tile(theta_i, n),
        theta_r_deg=np.tile(theta_r, n),
        phi_r_deg=np.tile(phi_r, n),
        value=np.concatenate([value for value, _ in found]),
        u_value=np.concatenate([u for _, u in found if u is not None])
        if task.origin.measured
        else None,
    )


def _csv(task: _Task) -> _Files:
    rows, dhr, error = _in_plane(task)
    text = csv_text(rows, task.origin, dhr)
    return [_File(content=text.encode())], [
        _said("theta_r", error),
        "not in the file: directions out of plane, correlations of the uncertainties",
    ]


def _bird(task: _Task) -> _Files:
    rows, _, error = _in_plane(task)
    source, at = task.sources[0], np.array(task.incidences[:1])
    value, u = source.values(at, np.array([np.nan]), np.array([np.nan]), "u")
    dhr = Rows(
        polarization=np.array(["u"]), wavelength_um=np.array([source.wavelength_um]),
        theta_i_deg=at, theta_r_deg=np.array([np.nan]), phi_r_deg=np.array([np.nan]),
        value=value, u_value=u,
    )  # fmt: skip
    text = bird_text(rows, task.origin, dhr)
    lost = (
        "not in the file: directions out of plane, correlations of the uncertainties, DHR beyond "
        f"that of u at theta_i = {at[0]:g} deg; provenance and sample are placeholders to fill in"
    )
    return [_File(content=text.encode())], [_said("theta_r", error), lost]


def _hemispheres(task: _Task, q: str) -> tuple[Rows, Error]:
    """BRDF over the hemisphere of one polarisation, at the same directions for every source."""
    peaks = Peaks(task.sources, [q])
    angles, errors = [], []
    for incidence in task.incidences:
        axes, error = hemisphere_of(peaks, incidence)
        polar = np.meshgrid(axes[0][1:], axes[1], indexing="ij")
        grid = [np.append(0.0, x.ravel()) for x in polar]  # the normal once
        angles.append([np.full(grid[0].size, incidence), *grid])
        errors.append(error)
    theta_i, theta_r, phi_r = (np.concatenate(x) for x in zip(*angles, strict=True))
    n = len(task.sources)
    return Rows(
        polarization=np.full(n * theta_i.size, q),
        wavelength_um=np.repeat([source.wavelength_um for source in task.sources], theta_i.size),
        theta_i_deg=np.tile(theta_i, n),
        theta_r_deg=np.tile(theta_r, n),
        phi_r_deg=np.tile(phi_r, n),
        value=np.concatenate([s.at(theta_i, theta_r, phi_r, q) for s in task.sources]),
        u_value=None,
    ), _worst(errors)


_BETWEEN = "between the angles of incidence the error is that of the program which reads the file"


def _astm(task: _Task) -> _Files:
    files, notes = [], []
    for q in task.polarizations:
        rows, error = _hemispheres(task, q)
        files.append(_File(content=astm_text(rows, task.origin, q).encode(), q=q))
        notes.append(_said(f"{q}, theta_r and phi_r", error))
    lost = (
        "not in the file: uncertainties, DHR, polarisation of the scattered light; the incident "
        "polarisation stands in LAB_COMMENTS"
    )
    return files, [*notes, _BETWEEN, lost]


def _of_one_wavelength(
    task: _Task, write: Callable[[_Task, str], tuple[str, Error]], lost: str
) -> _Files:
    """A file for each wavelength and polarisation."""
    files, notes = [], []
    for source in task.sources:
        nm = f"{1e3 * source.wavelength_um:.10g}"
        alone = _Task(
            sources=(source,), polarizations=task.polarizations, theta_i_deg=task.theta_i_deg,
            origin=_origin([source]),
        )  # fmt: skip
        for q in task.polarizations:
            text, error = write(alone, q)
            files.append(_File(content=text.encode(), q=q, nm=nm))
            notes.append(_said(f"{nm} nm, {q}", error))
    return files, [*notes, f"not in the file: {lost}"]


def _fred(task: _Task) -> _Files:
    def write(alone: _Task, q: str) -> tuple[str, Error]:
        rows, error = _hemispheres(alone, q)
        return fred_text(rows), error

    lost = "uncertainties, DHR, wavelength, sample, parameters, polarisation"
    files, notes = _of_one_wavelength(task, write, lost)
    return files, [*notes, _BETWEEN]


def _zemax(task: _Task) -> _Files:
    def write(alone: _Task, q: str) -> tuple[str, Error]:
        axes, error = specular_axes(Peaks(alone.sources, [q]), alone.theta_i_deg)
        grid = fill_specular(axes, alone.sources[0], q)
        return zemax_text(grid, alone.origin, q), error

    lost = (
        "uncertainties, polarisation of the scattered light; wavelength and incident polarisation "
        "stand in comments. Next to the horizon, where cells hold zeros, no error is counted"
    )
    files, notes = _of_one_wavelength(task, write, lost)
    given = task.theta_i_deg is not None
    return files, [*notes, *[_BETWEEN] * given]


def _mitsuba(task: _Task) -> _Files:
    n = len(task.sources)
    if n not in (1, _N_MITSUBA):
        msg = f"a .pbsdf has five wavelengths, and {n} runs are given. Give one run, or five"
        raise ConfigError(msg)
    nm = [round(1e3 * source.wavelength_um) for source in task.sources]
    if max(nm) > _MOST_NM:
        msg = f"wavelength {max(nm)} nm: a .pbsdf stores up to {_MOST_NM} nm. Give one run alone"
        raise ConfigError(msg)
    if n == 1:
        sources, stored = task.sources * _N_MITSUBA, list(_VISIBLE_NM)
        said = (
            f"the one wavelength, {task.sources[0].wavelength_um:g} um, is repeated at "
            f"{', '.join(map(str, stored))} nm: it stands for every wavelength of a rendering"
        )
    else:
        sources, stored = task.sources, nm
        if len(set(stored)) < n:
            msg = f"wavelengths {nm} nm: a .pbsdf stores whole nanometres, each once"
            raise ConfigError(msg)
        outside = [x for x in stored if not _VISIBLE_NM[0] <= x <= _VISIBLE_NM[-1]]
        said = f"five wavelengths, {', '.join(map(str, stored))} nm, of five runs"
        said += ": Mitsuba renders 360 to 830 nm only" if outside else ""
    axes, error = half_angle_axes(Peaks(task.sources, ["u"]))
    content = pbsdf_bytes(fill_half_angles(axes, sources, stored))
    lost = (
        "not in the file: uncertainties; retardance: circular light keeps the share that light at "
        "45 deg keeps, and nothing passes between the two"
    )
    return [_File(content=content)], [
        said,
        _said("u, light and viewer {:g} to {:g} deg from the normal".format(*COUNTED_DEG), error),
        "polarisation and angles of incidence are all in the file, whatever is asked for",
        lost,
    ]


FORMATS: Mapping[str, Callable[[_Task], _Files]] = {
    "csv": _csv,
    "bird": _bird,
    "zemax": _zemax,
    "fred": _fred,
    "astm": _astm,
    "mitsuba": _mitsuba,
}
"""Writers by the name of their format."""
