"""The situations a report has to cope with, as data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

PHYSICAL = ("n", "k", "sigma_n0", "rho0")
SYMBOLS = {"n": "n", "k": "k", "sigma_n0": "σ_N0", "rho0": "ρ_0", "s_rel_s": "s_rel,s",
           "s_rel_p": "s_rel,p", "s_rel_u": "s_rel,u", "u_dhr": "u_DHR"}  # fmt: skip
DESCRIPTIONS = {
    "n": "refractive index",
    "k": "extinction coefficient",
    "sigma_n0": "scattering strength at normal incidence",
    "rho0": "half width at half maximum in direction cosine",
    "s_rel_s": "relative white noise, s scans",
    "s_rel_p": "relative white noise, p scans",
    "s_rel_u": "relative white noise, unpolarised scans",
    "u_dhr": "standard uncertainty of a DHR reading",
}
CENTRES = {"n": (1.526, 0.0012), "k": (0.193, 0.0021), "sigma_n0": (0.4528, 0.0017),
           "rho0": (0.47, 0.0006), "s_rel_s": (0.00993, 0.00018), "s_rel_p": (0.0101, 0.00019),
           "s_rel_u": (0.262, 0.0079), "u_dhr": (0.0021, 0.0004)}  # fmt: skip
PRIORS = {"n": "Normal(1.5, 0.2) on [1, 3]", "k": "HalfNormal(0.5)", "sigma_n0": "Uniform(0, 1)",
          "rho0": "LogUniform(0.001, 4)"}  # fmt: skip


@dataclass(frozen=True)
class Case:
    """What a synthetic analysis looks like."""

    sample: str = "Green paint (simulated)"
    theta_i_deg: tuple[float, ...] = (0.0, 20.0, 40.0, 60.0, 80.0)
    polarizations: tuple[str, ...] = ("s", "p")
    n_points: int = 321
    dhr: bool = True
    holdout: bool = True
    status: str = "done"
    verdict: str = "PASS"
    misfit: float = 0.0
    unidentified: tuple[str, ...] = ()
    runs: int = 1
    method: str = "emcee"
    broken_values: bool = False
    label_suffix: str = ""
    warnings: tuple[str, ...] = ()
    excluded: Mapping[str, int] = field(default_factory=dict)


CASES: dict[str, Case] = {
    "demo": Case(excluded={"obscured": 12}),
    "misfit": Case(
        sample="aeroglaze_z307", theta_i_deg=(10.0, 30.0, 50.0, 70.0), polarizations=("u",),
        n_points=150, dhr=False, holdout=True, verdict="FAIL", misfit=0.26,
        unidentified=("n", "k"), excluded={"obscured": 44},
        warnings=("4 geometries were read more than once; every reading is used.",),
    ),
    "not_converged": Case(status="not_converged", verdict="FAIL", theta_i_deg=(20.0, 60.0)),
    "one_scan": Case(theta_i_deg=(20.0,), polarizations=("s",), dhr=False, holdout=False,
                     verdict="WARN", unidentified=("n",), method="psis"),
    "dhr_only": Case(theta_i_deg=(), holdout=False, verdict="WARN", unidentified=("rho0",)),
    "hostile": Case(
        sample="<script>alert('x')</script> & \"q\" $\\frac{a$ {{ 7*7 }} \x00\x1b[31m\u202e "
        + "W" * 260,
        theta_i_deg=(20.0,), label_suffix=" <img src=x onerror=alert(1)> " + "L" * 280,
        broken_values=True, verdict="WARN", warnings=("<b>bold</b> " + "w" * 300,),
        excluded={"<i>flag</i>": 3},
    ),
    "many_scans": Case(theta_i_deg=tuple(np.linspace(0, 81, 10).tolist()), runs=1),
    "many_points": Case(theta_i_deg=(30.0,), n_points=50_000, holdout=False),
    "repeats": Case(theta_i_deg=(20.0, 60.0), runs=10, n_points=81, holdout=False),
}  # fmt: skip
