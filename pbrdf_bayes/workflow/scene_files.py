"""The scene of ``predict --scene``: TOML in, a folder with CSV, netCDF, page and pictures out."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pbrdf_bayes.analysis import load_analysis
from pbrdf_bayes.errors import ConfigError, DomainError
from pbrdf_bayes.io.run_folder import (
    locked,
    refuse_other_content,
    write_bytes,
    write_text,
)
from pbrdf_bayes.io.scene_arrays import scene_csv, spectral_dataset
from pbrdf_bayes.io.scene_toml import read_scene
from pbrdf_bayes.model.effects import Effects
from pbrdf_bayes.model.four_parameter import Parameters
from pbrdf_bayes.scene.prediction import predict_scene
from pbrdf_bayes.scenes import Scene, SceneValues
from pbrdf_bayes.workflow.spectral_scene import predict_spectral_scene

CSV, NETCDF, PAGE = "scene.csv", "scene.nc", "scene.html"
_PICTURES = "scene_*.svg"


def write_scene(
    scene_toml: Path,
    out: Path | None,
    *,
    folders: Sequence[Path],
    parameters: Parameters | None,
    effects: Effects | None,
    rtol: float,
) -> Path:
    """Compute the scene of a TOML file and write it.

    Parameters
    ----------
    scene_toml : Path
        Its keys are the fields of `Scene`.
    out : Path or None
        Folder to write into: new, empty, or one that holds a scene, which is replaced.
    folders : sequence of Path
        Finished runs, of one sample and each of another wavelength: with bands from their
        posteriors.
    parameters : Parameters or None
        Given parameters instead, where there is no run.
    effects : Effects or None
        Line shape and effects beside given parameters.
    rtol : float
        Tolerance of the normalisation where parameters are given.

    Returns
    -------
    Path
        ``out``.

    Raises
    ------
    ConfigError
        The message names file, key, value, what is allowed and what to do; nothing is written.
    RunFolderError
        One of ``folders`` is not a finished run, or ``out`` holds something else or cannot be
        written.
    """
    scene = read_scene(scene_toml)
    if out is None:
        msg = (
            "--scene needs --out FOLDER: it writes CSV, netCDF and pictures there. "
            "With --out - the CSV alone goes to standard output"
        )
        raise ConfigError(msg)
    refuse_other_content(
        out, known=(NETCDF,), any_of=True, what="with --scene a folder", remedy="Give another --out"
    )
    values = _compute(folders, parameters, scene, effects, rtol, scene_toml)
    with locked(out):
        _write(values, out)
    return out


def scene_text(
    scene_toml: Path, *, folders: Sequence[Path], parameters: Parameters | None,
    effects: Effects | None, rtol: float,
) -> str:  # fmt: skip
    """Text of ``scene.csv`` alone; arguments and errors as for `write_scene`."""
    scene = read_scene(scene_toml)
    return scene_csv(*_compute(folders, parameters, scene, effects, rtol, scene_toml))


def _compute(
    folders: Sequence[Path], parameters: Parameters | None, scene: Scene,
    effects: Effects | None, rtol: float, path: Path,
) -> tuple[SceneValues, ...]:  # fmt: skip
    runs = [load_analysis(folder) for folder in folders]
    try:
        if parameters is not None:
            return (predict_scene(parameters, scene, effects=effects, rtol=rtol),)
        return predict_spectral_scene(runs, scene)
    except (ConfigError, DomainError) as error:
        msg = f"{path}: {error}"
        raise ConfigError(msg) from None


def _write(values: Sequence[SceneValues], out: Path) -> None:
    """Each file whole or not at all; pictures that an earlier scene left go."""
    from pbrdf_bayes.report.figures.scene import scene_pictures  # loads the plots
    from pbrdf_bayes.report.scene_page import render_scene, standalone_svg

    drawn = [
        (v, scene_pictures(v, tag=f"_{v.wavelength_um:.10g}um" if len(values) > 1 else ""))
        for v in values
    ]
    pictures = [picture for _, of_one in drawn for picture in of_one]
    # made in memory: where the disk is full, HDF5 ends the process
    write_bytes(out / NETCDF, spectral_dataset(values).to_netcdf(engine="h5netcdf"))
    write_text(out / CSV, scene_csv(*values))
    write_text(out / PAGE, render_scene(drawn))
    for picture in pictures:
        write_text(out / f"{picture.name}.svg", standalone_svg(picture))
    kept = {f"{picture.name}.svg" for picture in pictures}
    for path in out.glob(_PICTURES):
        if path.name not in kept:
            path.unlink()
