"""FRED tabulated BSDF: a section for each incidence, rows of direction and value."""

from __future__ import annotations

import numpy as np

from pbrdf_bayes.io.export.records import Rows


def fred_text(rows: Rows) -> str:
    """Text with the two header lines of ``angles=deg bsdf=value``.

    Parameters
    ----------
    rows : Rows
        BRDF of one polarisation and wavelength, theta_r at least 0. The format has no zeros: rows
        that are not positive are left out. It has no comments either.

    Returns
    -------
    str
        Sections by increasing incidence; phi_scat 0 is the specular side, 180 the backward side.
    """
    lines = ["type bsdf_data", "format angles=deg bsdf=value scale=1"]
    theta_r, phi_r = rows.polar()
    for theta_i in np.unique(rows.theta_i_deg).tolist():
        lines.append(f"{theta_i:.10g}\t0")
        kept = (rows.theta_i_deg == theta_i) & (rows.value > 0.0)
        table = zip(
            theta_r[kept].tolist(), phi_r[kept].tolist(), rows.value[kept].tolist(), strict=True
        )
        lines += [f"{theta:.10g}\t{phi:.10g}\t{value:.6e}" for theta, phi, value in table]
    return "\n".join(lines) + "\n"
