"""A run and the posterior that it was drawn from.

`results.Analysis` is the stored record, which the report draws without any model. The class here
adds what needs one, so that imports go one way.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from pbrdf_bayes import results
from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.inference.posterior import Posterior, build_posterior
from pbrdf_bayes.io import run_folder
from pbrdf_bayes.io.config_toml import config_from_table
from pbrdf_bayes.io.measurement_arrays import measurement_of
from pbrdf_bayes.measurement import Measurement


@dataclass(frozen=True, eq=False)
class Analysis(results.Analysis):
    """A finished run, fitted in this process or read from its folder.

    Attributes
    ----------
    summary : mapping
        The content of ``summary.json``, see `pbrdf_bayes.records.summary`.
    draws : xarray.DataTree
        The content of ``posterior.nc``, see `pbrdf_bayes.results`.
    config_toml : str
        The resolved configuration.
    design : mapping, optional
        The content of ``design.json``: what to measure next, where that was computed.
    fitted : Posterior, optional
        The posterior, where this process has fitted it.
    """

    fitted: Posterior | None = None

    @property
    def measurement(self) -> Measurement:
        """The readings that were fitted.

        Raises
        ------
        RunFolderError
            An earlier version has stored the run, without all columns of its readings.
        """
        if self.fitted is not None:
            return self.fitted.measurement
        try:
            return measurement_of(self.draws)
        except KeyError:
            msg = (
                f"the run of {self.summary['sample']!r} was stored by pbrdf-bayes "
                f"{self.summary['versions']['pbrdf-bayes']} without all columns of its readings, "
                "so that its posterior cannot be rebuilt. 'report' reads it; for all else fit the "
                "sample again into another folder"
            )
            raise RunFolderError(msg) from None

    def posterior(self) -> Posterior:
        """The posterior that was fitted: ``log_prob`` is equal to the last bit.

        Its configuration is the resolved one, with the effects and the line shape that the fit has
        chosen where it was left to choose.

        Raises
        ------
        RunFolderError
            See `measurement`.
        """
        if self.fitted is not None:
            return self.fitted
        return build_posterior(self.measurement, config_from_table(self.summary["config"]))


def load_analysis(folder: Path | str) -> Analysis:
    """Read a finished run back.

    Parameters
    ----------
    folder : Path or str
        The run folder.

    Returns
    -------
    Analysis

    Raises
    ------
    RunFolderError
        Not a finished run, or a file of it is missing or damaged.
    """
    stored = run_folder.read_run(Path(folder))
    return Analysis(stored.summary, stored.draws, stored.config_toml, stored.design)
