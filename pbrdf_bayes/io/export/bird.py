"""BiRD JSON v1.0: rows with wavelength and polarisation, the model and its parameters."""

from __future__ import annotations

import json
import uuid
from typing import Any

import numpy as np

from pbrdf_bayes.io.export.records import Origin, Rows

SCHEMA = (
    "https://raw.githubusercontent.com/BiRD-project/BiRD_view/master/BRDF_JSON_schema/"
    "brdf_json_schema_v1.0.json"
)
_EQUATION = "f_q = sigma_N^q(alpha_i) A_q(alpha; alpha_i) B_q'(beta); DHR_q = sigma_N0 F_q"
_MODEL = "Four-parameter polarised BRDF of rough surfaces, doi:10.1364/OE.19.001027"
_NOT_STATED = "not stated"


def bird_text(rows: Rows, origin: Origin, dhr: Rows) -> str:
    """JSON text that the official schemas accept.

    Parameters
    ----------
    rows : Rows
        BRDF. Rows at or beyond the horizon are not allowed in the format: give none.
    origin : Origin
        The parameters go into ``software.simulation_model``.
    dhr : Rows
        One row [1], for ``sample.total_reflectance``.

    Returns
    -------
    str
        phi_i is 0, and phi_r = 180 the specular side.
    """
    content = {"metadata": _metadata(origin, dhr), "data": _data(rows)}
    return json.dumps(content, ensure_ascii=False, allow_nan=False) + "\n"


def _data(rows: Rows) -> dict[str, Any]:
    theta_r, phi_r = rows.polar()
    angles = {
        "theta_i": rows.theta_i_deg,
        "phi_i": 0.0 * theta_r,
        "theta_r": theta_r,
        "phi_r": 180.0 - phi_r,
    }
    data: dict[str, Any] = {
        name: {"unit": "deg", "values": np.round(values, 9).tolist()}
        for name, values in angles.items()
    }
    data["BRDF"] = {"unit": "1/sr", "values": _digits(rows.value)}
    if rows.u_value is not None:
        data["uBRDF"] = {
            "unit": "1/sr",
            "values": _digits(rows.u_value),
            "comments": "standard deviation of the posterior of the model, without the noise of a "
            "reading",
        }
    nm = np.round(1e3 * rows.wavelength_um, 6).tolist()
    data["wavelength_i"] = {"unit": "nm", "values": nm}
    data["polarization_i"] = {"notation": "sp", "values": rows.polarization.tolist()}
    return data


def _metadata(origin: Origin, dhr: Rows) -> dict[str, Any]:
    theta_i, q = float(dhr.theta_i_deg[0]), str(dhr.polarization[0])
    total: dict[str, Any] = {"value": round(100.0 * float(dhr.value[0]), 6), "unit": "%"}
    if dhr.u_value is not None:
        total |= {"uncertainty": 100.0 * float(f"{dhr.u_value[0]:.3g}"), "uncertainty_unit": "%"}
    return {
        "schema": SCHEMA,
        "id": f"urn:uuid:{uuid.uuid4()}",
        "type": "BRDF",
        "timestamp": origin.timestamp,
        "provenance": {
            "organization": _NOT_STATED,
            "location": dict.fromkeys(
                ("country", "city", "street", "building_nr", "postal_code"), _NOT_STATED
            ),
            "email": "not-stated@example.org",
            "contact_person": _NOT_STATED,
        },
        "description": origin.statement,
        "method": "simulation",
        "instrumentation": "NA",
        "software": {
            "name": "pbrdf-bayes",
            "version": origin.program,
            "simulation_model": {
                "name": "pbrdf",
                "description": _MODEL,
                "equation": _EQUATION,
                "parameters": _parameters(origin),
            },
        },
        "sample": {
            "name": origin.sample,
            "type": _NOT_STATED,
            "shape": _NOT_STATED,
            "dimensions": {},
            "zero_azimuth_location": "the model is isotropic",
            "properties_symmetry": "isotropic",
            "total_reflectance": total,
            "comments": f"total_reflectance is that of {q} light at theta_i = {theta_i:g} deg, "
            f"{float(dhr.wavelength_um[0]):.10g} um",
        },
        "environment": "NA",
    }


def _parameters(origin: Origin) -> list[dict[str, Any]]:
    """Of each wavelength; a name has the wavelength in it where there are several."""
    found = []
    for wavelength, model in zip(origin.wavelengths_um, origin.fitted, strict=True):
        of_one = f" at {wavelength:.10g} um" if len(origin.fitted) > 1 else ""
        for fitted in model:
            row: dict[str, Any] = {
                "name": fitted.name + of_one,
                "description": fitted.description,
                "value": float(f"{fitted.value:.8g}"),
                "unit": fitted.unit,
            }
            if fitted.u is not None:
                row |= {"uncertainty": float(f"{fitted.u:.3g}"), "uncertainty_unit": fitted.unit}
            found.append(row)
    return found


def _digits(values: np.typing.NDArray[np.float64]) -> list[float]:
    """Numbers with seven significant digits."""
    return [float(f"{value:.6e}") for value in values.tolist()]
