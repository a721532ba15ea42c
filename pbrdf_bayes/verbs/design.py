"""The verb ``design``: its arguments, and the calculation called; no science.

Only light modules are imported here, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.verbs.arguments import DONE, add_verb, angles, grid, interrupted, seed, words

_BEST_SHOWN = 10
_EPILOG = """\
goals: dhr:Q:THETA_I, brdf:Q:THETA_I:THETA_R, scan:Q:THETA_I or ratio:THETA_I:THETA_R, with Q one of
s, p, u and angles in degrees; the expected standard deviation of each is told beside the
parameters. A scan counts by its mean variance at theta_r -80 to 80 by 8 degrees

a CSV of candidates has the columns quantity (brdf, dhr or ddr), polarization, theta_i_deg; optional
theta_r_lo_deg, theta_r_hi_deg, theta_r_step_deg (brdf), port_deg (ddr), minutes. A
measurement_plan.csv is one

minutes decide what is best for each minute: replace the default costs by those of your bench

written to the run folder or --out: design.json, design.html, measurement_plan.csv; report.html of
the run gets a section. Without DIR, --config TOML designs from its priors, before any reading
"""


def add_design(verbs: Any) -> None:
    """The verb ``design``."""
    parser = add_verb(
        verbs,
        "design",
        _design,
        "What to measure next: expected information of each measurement.",
        epilog=_EPILOG,
    )
    parser.add_argument("folder", type=Path, metavar="DIR", nargs="?", help="a finished run")
    parser.add_argument(
        "--config",
        type=Path,
        metavar="TOML",
        help="without DIR: design from the priors of this configuration",
    )
    _add_candidates(parser)
    _add_costs(parser)
    parser.add_argument(
        "--minutes",
        type=_positive,
        default=float("inf"),
        metavar="BUDGET",
        help="budget of the measurements taken together (none)",
    )
    parser.add_argument(
        "--batch",
        type=int,
        metavar="K",
        help="measurements taken together at most (4; 20 with --minutes)",
    )
    parser.add_argument(
        "--about",
        type=_names,
        default=[],
        metavar="NAMES",
        help="parameters that the information is about (n,k,sigma_n0,rho0)",
    )
    parser.add_argument(
        "--goal",
        action="append",
        default=[],
        metavar="NAME",
        help="a prediction to be sharpened, see below; may be repeated",
    )
    parser.add_argument(
        "--draws",
        type=int,
        default=400,
        metavar="N",
        help="simulated paints, each compared with twice as many (400)",
    )
    parser.add_argument("--seed", type=seed, default=1, metavar="N", help="seed (default 1)")
    parser.add_argument(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder to write into (default: the run folder itself)",
    )
    parser.add_argument("--json", action="store_true", help="JSON on stdout instead of words")
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")


def _add_candidates(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--candidates",
        default="scan,dhr,ddr",
        metavar="KINDS",
        help="scan,dhr,ddr (default) and/or a CSV of explicit candidates",
    )
    parser.add_argument(
        "--theta-i",
        type=angles,
        metavar="LO:HI:STEP",
        help="angles of incidence [deg], or a list with commas (0:85:5 and all measured)",
    )
    parser.add_argument(
        "--theta-r",
        type=grid,
        default=[],
        metavar="LO:HI:STEP",
        help="of every scan [deg] (as the sample has been scanned so far)",
    )
    parser.add_argument(
        "--polarization",
        type=words,
        default=["s", "p", "u"],
        metavar="s,p,u",
        help="polarisations (s,p,u)",
    )
    parser.add_argument(
        "--port-deg",
        type=angles,
        default=[5.0],
        metavar="DEG,...",
        help="half angle of the specular port of a DDR, 0.1 to 45, or several with commas (5)",
    )


_COSTS = (
    ("scan_minutes", "MIN", 5.0, "set-up of a scan"),
    ("dwell_seconds", "S", 5.0, "each reading of a scan, with the move to its angle"),
    ("dhr_minutes", "MIN", 3.0, "a DHR reading"),
    ("ddr_minutes", "MIN", 3.0, "a DDR reading"),
)


def _add_costs(parser: argparse.ArgumentParser) -> None:
    for name, unit, default, what in _COSTS:
        parser.add_argument(
            f"--{name.replace('_', '-')}",
            type=_positive,
            default=default,
            metavar=unit,
            help=f"cost of {what} ({default:g})",
        )


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not 0.0 < value < float("inf"):
        msg = f"{text!r}: give a number above 0"
        raise argparse.ArgumentTypeError(msg)
    return value


def _names(text: str) -> list[str]:
    return [part.strip() for part in text.split(",") if part.strip()]


def _design(options: argparse.Namespace) -> int:
    if (options.folder is None) == (options.config is None):
        msg = "give a run folder, or --config TOML to design from its priors; not both"
        raise ConfigError(msg)
    from pbrdf_bayes.design.candidates import Costs
    from pbrdf_bayes.io.config_toml import read_config
    from pbrdf_bayes.verbs.terminal import counter
    from pbrdf_bayes.workflow.candidates_csv import Wanted, parse_kinds
    from pbrdf_bayes.workflow.design_files import DesignRequest, run_design
    from pbrdf_bayes.workflow.next_measurement import choices_of

    kinds, csv = parse_kinds(options.candidates)
    wanted = Wanted(
        kinds=kinds, csv=csv,
        theta_i_deg=None if options.theta_i is None else tuple(options.theta_i),
        theta_r_deg=tuple(options.theta_r), polarizations=tuple(options.polarization),
        port_deg=tuple(options.port_deg),
        costs=Costs(**{name: getattr(options, name) for name, *_ in _COSTS}),
    )  # fmt: skip
    choices = choices_of(
        minutes=options.minutes, batch=options.batch, draws=options.draws, seed=options.seed
    )
    request = DesignRequest(
        folder=options.folder, config=read_config(options.config, {}), wanted=wanted,
        goals=options.goal, about=options.about, choices=choices, out=options.out,
    )  # fmt: skip
    design = run_design(request, counter(quiet=options.quiet, interrupted=interrupted.is_set))
    if options.json:
        print(json.dumps(design, indent=1, ensure_ascii=False))
        return DONE
    print(design["recommendation"], "", best_table(design), sep="\n")
    out = options.out or options.folder
    if out is not None:
        print("", out / "design.html", sep="\n")
    return DONE


def best_table(design: dict[str, Any]) -> str:
    """The ten best candidates as lines of text."""
    rows = [row for row in design["candidates"] if row["eig_nats"] is not None][:_BEST_SHOWN]
    names = list(design["sd_before"])
    head = ["", "min", "nat", "+-", "nat/min", "best", *(f"sd {name}" for name in names)]
    cells = [head, *([
        row["label"], f"{row['minutes']:.3g}", *_gain(row), _unsigned(row["eig_per_minute"], 4),
        f"{100.0 * row['p_best']:.0f} %",
        *(_left(row, row["sd_ratio"][name]) for name in names),
    ] for row in rows)]  # fmt: skip
    widths = [max(len(line[i]) for line in cells) for i in range(len(head))]
    lines = [
        "  ".join([line[0].ljust(widths[0]),
                   *(c.rjust(w) for c, w in zip(line[1:], widths[1:], strict=True))]).rstrip()
        for line in cells
    ]  # fmt: skip
    if any(_is_local(row, key) for row in rows for key in ("eig_method", "sd_method")):
        lines.append("* local normal approximation")
    return "\n".join([*lines, *_counts(design)])


def _counts(design: dict[str, Any]) -> list[str]:
    """How many candidates were only screened."""
    n = design.get("n_candidates", 0) - design.get("n_evaluated", 0)
    if not n:
        return []
    return [f"{n} of {design['n_candidates']} candidates were only screened by a linear estimate"]


def _gain(row: dict[str, Any]) -> tuple[str, str]:
    """Gain and error."""
    mark = "*" * _is_local(row, "eig_method")
    return _unsigned(row["eig_nats"], 3) + mark, f"{row['eig_se']:.3f}"


def _is_local(row: dict[str, Any], key: str) -> bool:
    """Whether a figure is by the local normal approximation."""
    return row.get(key) == "local"


def _unsigned(value: float, decimals: int) -> str:
    """Fixed decimals, and no zero with a sign."""
    return f"{round(value, decimals) + 0.0:.{decimals}f}"


def _left(row: dict[str, Any], ratio: dict[str, Any]) -> str:
    """Standard deviation after over before, with its error."""
    if ratio["ratio"] is None:
        return "-"
    value, se = 100.0 * ratio["ratio"], 100.0 * ratio["se"]
    places = 0 if value >= 9.95 else 1
    return f"{value:.{places}f} +- {se:.{places}f} %" + "*" * _is_local(row, "sd_method")
