"""The verb ``export``: its arguments, and the workflow called; no science.

Only light modules are imported here, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.verbs.arguments import DONE, add_verb, angles, words

FORMATS = ("bird", "zemax", "fred", "astm", "mitsuba", "csv")
_HELP = """\
A format without polarisation has a file for each: NAME_s.EXT, NAME_p.EXT, NAME_u.EXT. Zemax and
FRED hold one wavelength: several runs make NAME_650nm_s.EXT and so on. The paths are printed to
stdout. What a format does not hold, and how well interpolation keeps to the model, is printed to
stderr.

  pbrdf-bayes export reports/paint/run --format zemax --polarization u --out paint.bsdf
"""


def add_export(verbs: Any) -> None:
    """The verb ``export``."""
    parser = add_verb(verbs, "export", _export,
                      "Write files for ray tracers, renderers and other laboratories.",
                      epilog=_HELP)  # fmt: skip
    parser.add_argument("folders", type=Path, metavar="RUN", nargs="*",
                        help="finished runs, each of another wavelength")  # fmt: skip
    parser.add_argument("--params", metavar="JSON",
                        help='file or text: {"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, '
                        '"rho0": 0.47}')  # fmt: skip
    parser.add_argument("--format", required=True, choices=FORMATS, help="format of the file")
    parser.add_argument("--out", type=Path, required=True, metavar="PATH", help="file to write")
    parser.add_argument("--polarization", type=words, default=["s", "p", "u"], metavar="s,p,u",
                        help="incident polarisations (s,p,u)")  # fmt: skip
    parser.add_argument("--theta-i", type=angles, metavar="DEG,...",
                        help="incidence angles [deg], or LO:HI:STEP (0:80:10; in Zemax files as "
                        "many as interpolation needs)")  # fmt: skip
    parser.add_argument("--wavelength-um", type=float, metavar="UM",
                        help="wavelength of --params [um] (3.39), or take the run of this "
                        "one")  # fmt: skip


def _export(options: argparse.Namespace) -> int:
    from pbrdf_bayes.workflow.exporting import export_brdf
    from pbrdf_bayes.workflow.parameters_json import read_parameters

    if bool(options.folders) == (options.params is not None):
        msg = "Give run folders or --params"
        raise ConfigError(msg)
    model, effects = options.folders, None
    if options.params is not None:
        model, effects = read_parameters(options.params)
    done = export_brdf(
        model, options.out, format=options.format, polarizations=options.polarization,
        theta_i_deg=options.theta_i, wavelength_um=options.wavelength_um, effects=effects,
    )  # fmt: skip
    for note in done.notes:
        print(note, file=sys.stderr)
    for path in done.paths:
        print(path)
    return DONE
