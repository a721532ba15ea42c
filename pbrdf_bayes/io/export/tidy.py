"""The tidy CSV of this package."""

from __future__ import annotations

import numpy as np

from pbrdf_bayes.io.export.records import Origin, Rows
from pbrdf_bayes.io.tidy_writer import tidy_text


def csv_text(rows: Rows, origin: Origin, dhr: Rows) -> str:
    """BRDF and DHR with their standard uncertainties where there are some.

    Parameters
    ----------
    rows, dhr : Rows
    origin : Origin

    Returns
    -------
    str
    """
    both = [rows, dhr]
    columns = {
        name: np.concatenate([getattr(part, name) for part in both])
        for name in ("polarization", "wavelength_um", "theta_i_deg", "theta_r_deg", "value")
    }
    columns["quantity"] = np.repeat(["brdf", "dhr"], [rows.value.size, dhr.value.size])
    if rows.u_value is not None and dhr.u_value is not None:
        columns["sigma"] = np.concatenate([rows.u_value, dhr.u_value])
    return tidy_text({"sample": origin.sample, "scan": "model", **columns})
