"""ASTM E1392 text: key and value lines, then rows in radians, a column for each wavelength."""

from __future__ import annotations

import numpy as np

from pbrdf_bayes.io.export.records import Origin, Rows


def astm_text(rows: Rows, origin: Origin, polarization: str) -> str:
    """Text of one polarisation, lines ended by CR LF.

    Parameters
    ----------
    rows : Rows
        BRDF of one polarisation; each wavelength has the same directions in the same order.
    origin : Origin
    polarization : {"s", "p", "u"}
        Written into LAB_COMMENTS: the format has no key for it.

    Returns
    -------
    str
        phi_s = pi is the specular side.
    """
    wavelengths = np.unique(rows.wavelength_um)
    first = rows.wavelength_um == wavelengths[0]
    theta_r, phi_r = (x[first] for x in rows.polar())
    angles = np.deg2rad([rows.theta_i_deg[first], 0.0 * theta_r, theta_r, 180.0 - phi_r])
    values = [rows.value[rows.wavelength_um == w] for w in wavelengths]
    columns = ",".join(f"{1e3 * w:.10g}nm" for w in wavelengths)
    head, *others = origin.lines()
    comments = "; ".join([f"incident polarization {polarization}", *others])
    day, time = origin.timestamp.split("T")
    lines = [
        "LAB_NAME pbrdf-bayes",
        f"LAB_COMMENTS {comments}",
        "SYSTEM_NAME pbrdf-bayes",
        f"SAMPLE_NAME {head.removeprefix('sample: ')}",
        "MEAS_NAME BRDF",
        f"MEAS_DATE {day}",
        f"MEAS_TIME {time.rstrip('Z')}",
        f"NUM_POINTS {theta_r.size}",
        f"VARS theta_i,phi_i,theta_s,phi_s,{columns}",
        "",
    ]
    for where, row in zip(angles.T.tolist(), np.transpose(values).tolist(), strict=True):
        cells = [f"{x:.8f}" for x in where] + [f"{x:.6e}" for x in row]
        lines.append(",".join(cells))
    return "\r\n".join(lines) + "\r\n"
