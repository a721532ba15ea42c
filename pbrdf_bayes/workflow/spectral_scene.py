"""A scene at several wavelengths: a run of each, and only those that the scene asks for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from pbrdf_bayes.analysis import Analysis
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.scene.prediction import predict_scene, same_wavelength
from pbrdf_bayes.scenes import Scene, SceneValues


def predict_spectral_scene(runs: Sequence[Analysis], scene: Scene) -> tuple[SceneValues, ...]:
    """BRDF, DHR and Stokes components of what a scene asks for, at each of its wavelengths.

    Parameters
    ----------
    runs : sequence of Analysis
        Finished runs of one sample, each of another wavelength.
    scene : Scene
        ``wavelength_um`` names the wavelengths; empty for those of all runs. Nothing is computed
        for a run that is not asked for.

    Returns
    -------
    tuple of SceneValues
        In the order of their wavelengths, each as `predict_scene` gives it. Runs are independent
        posteriors: a difference of two wavelengths has the spreads of both.

    Raises
    ------
    ConfigError
        No run, two runs of one wavelength or of different samples, a wavelength that has no run.
        And as `predict_scene`.

    Examples
    --------
    >>> scene = Scene(theta_i_deg=(20.0,), theta_r_deg=(-10.0, 10.0), wavelength_um=(0.65, 3.39))
    >>> predict_spectral_scene([visible, infrared], scene)  # doctest: +SKIP
    (SceneValues(...), SceneValues(...))
    """
    found = _by_wavelength(runs)
    wanted = scene.wavelength_um or tuple(found)
    asked = [(_run_of(w, found), replace(scene, wavelength_um=(w,))) for w in wanted]
    return tuple(predict_scene(run, at_one) for run, at_one in asked)


def _by_wavelength(runs: Sequence[Analysis]) -> dict[float, Analysis]:
    """The runs by their wavelengths [um], in increasing order."""
    if not runs:
        msg = "no run is given: give a finished run of each wavelength"
        raise ConfigError(msg)
    samples = list(dict.fromkeys(str(run.summary["sample"]) for run in runs))
    if len(samples) > 1:
        msg = (
            f"the runs are of different samples ({', '.join(map(repr, samples))}): a scene is of "
            "one. Give runs of one sample, each of another wavelength"
        )
        raise ConfigError(msg)
    found = sorted(((float(run.summary["wavelength_um"]), run) for run in runs), key=lambda x: x[0])
    for (a, _), (b, _) in pairwise(found):
        if same_wavelength(a, b):
            msg = f"two of the runs are of {a:g} um: give one run of each wavelength"
            raise ConfigError(msg)
    return dict(found)


def _run_of(wanted: float, found: dict[float, Analysis]) -> Analysis:
    """The run of a wavelength; of a single run `predict_scene` tells whether it is of another."""
    for wavelength, run in found.items():
        if len(found) == 1 or same_wavelength(wanted, wavelength):
            return run
    there = ", ".join(f"{w:g}" for w in found)
    msg = (
        f"wavelength_um: there is no run of {wanted:g}, they are of {there}. Give a run at this "
        "wavelength, or leave it out of the list"
    )
    raise ConfigError(msg)
