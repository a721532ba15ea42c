"""The verbs for one sample: their arguments, and the workflow called; no science.

Only light modules are imported here, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from pbrdf_bayes.errors import ConfigError, ConvergenceError
from pbrdf_bayes.verbs.arguments import (
    BAD_INPUT,
    DONE,
    NOT_CONVERGED,
    STRICT_FAIL,
    add_choices,
    add_verb,
    effects,
    grid,
    interrupted,
    numbers,
    seed,
    words,
)
from pbrdf_bayes.verbs.conform import add_paperwork, paperwork_of

_OF_SCENE = ("theta_i", "theta_r", "polarization", "dhr_theta_i", "phi_r", "normalisation")
_STDOUT = Path("-")


def add_check(verbs: Any) -> None:
    """The verb ``check``."""
    parser = add_verb(verbs, "check", _check, "Validate a CSV and summarise what it holds.")
    parser.add_argument("csv", type=Path, metavar="CSV", help="readings")
    parser.add_argument("--brdf-floor", type=float, metavar="X",
                        help="noise-equivalent BRDF [1/sr]; readings up to it are "
                        "censored")  # fmt: skip
    parser.add_argument(
        "--config",
        type=Path,
        metavar="TOML",
        help="takes brdf_floor and angle_tolerance_deg from it",
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON")


def add_import(verbs: Any) -> None:
    """The verb ``import``."""
    parser = add_verb(
        verbs, "import", _import,
        "Write files as laboratories have them as one tidy CSV. Content decides, not the "
        "extension; every decision is printed, and what a file leaves open is asked for.",
    )  # fmt: skip
    parser.add_argument("files", type=Path, metavar="FILE", nargs="+",
                        help="of one sample: BiRD, ASTM E1392, Zemax, FRED, LightTools, RT-300S, "
                        "tables (CSV, TSV, xlsx, xls), Cary, PerkinElmer, ECOSTRESS, "
                        "spectra")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="TIDY.csv", help="file to write")
    parser.add_argument("--format", metavar="NAME", help="read as this format")
    parser.add_argument("--sample", metavar="NAME", help="name of the sample, or its column")
    parser.add_argument("--polarization", metavar="s|p|u", help="of the incident light")
    parser.add_argument("--wavelength-um", type=float, metavar="X",
                        help="wavelength [um]; of a spectrum, the one wanted")  # fmt: skip
    parser.add_argument("--theta-i", type=float, metavar="DEG", dest="theta_i_deg",
                        help="angle of incidence [deg]")  # fmt: skip
    parser.add_argument("--forward", metavar="phi0|phi180", help="azimuth of the specular side")
    parser.add_argument("--value", metavar="brdf|brf|brdf_cos",
                        help="BRDF, reflectance factor (pi BRDF) or BRDF cos(theta_r)")  # fmt: skip
    parser.add_argument("--unit", metavar="fraction|percent", help="of a DHR")
    parser.add_argument("--sheet", metavar="NAME", help="of a workbook")


def add_fit(verbs: Any) -> None:
    """The verb ``fit``."""
    parser = add_verb(verbs, "fit", _fit, "Fit a sample: MAP, posterior, diagnostics, report.")
    parser.add_argument("csv", type=Path, metavar="CSV", help="readings")
    parser.add_argument("--sample", metavar="NAME", help="which sample of the file")
    parser.add_argument("--wavelength", type=float, metavar="UM", help="which wavelength [um]")
    parser.add_argument("--out", type=Path, metavar="DIR",
                        help="the run folder itself (default reports/<sample>/<time>)")  # fmt: skip
    add_choices(parser, of="the run")
    parser.add_argument("--resume", action="store_true",
                        help="go on with the run in DIR or start it")  # fmt: skip
    parser.add_argument("--strict", action="store_true", help="exit 4 when the verdict is FAIL")
    parser.add_argument("--quiet", action="store_true", help="no progress on stderr")
    add_paperwork(parser, limits=True)


def add_report(verbs: Any) -> None:
    """The verb ``report``."""
    parser = add_verb(verbs, "report", _report, "Rebuild the report of a run folder.")
    parser.add_argument("folder", type=Path, metavar="DIR", help="a finished run")
    add_paperwork(parser, limits=False)


def add_predict(verbs: Any) -> None:
    """The verb ``predict``."""
    from pbrdf_bayes.scenes import SCENE_HELP

    parser = add_verb(verbs, "predict", _predict,
                   "Predicted curves, with bands where a run folder is given.",
                   epilog=SCENE_HELP)  # fmt: skip
    parser.add_argument("folders", type=Path, metavar="DIR", nargs="*",
                        help="a finished run; of a scene, one of each wavelength")  # fmt: skip
    _add_parameters(parser, required=False)
    _add_angles(parser, theta_r="-85:85:1")
    parser.add_argument("--dhr-theta-i", type=numbers, default=[], metavar="DEG,...",
                        help="incidence angles of DHR rows [deg] (none)")  # fmt: skip
    parser.add_argument("--phi-r", type=float, default=0.0, metavar="DEG",
                        help="azimuth of the scattering directions [deg] (0)")  # fmt: skip
    parser.add_argument("--rtol", type=float, default=1e-8, metavar="X",
                        help="relative tolerance with --params (1e-8)")  # fmt: skip
    parser.add_argument("--normalisation", default="paper", choices=("paper", "reciprocal"),
                        help="with --params: that of Eq. (4) (default), or one that is reciprocal "
                        "in plane with the same DHR")  # fmt: skip
    parser.add_argument("--scene", type=Path, metavar="TOML", help="what is wanted, see below")
    parser.add_argument("--out", type=Path, metavar="CSV",
                        help="default or -: stdout; of a scene: a folder, or -")  # fmt: skip
    parser.set_defaults(defaults={name: parser.get_default(name) for name in _OF_SCENE})


def add_simulate(verbs: Any) -> None:
    """The verb ``simulate``."""
    parser = add_verb(verbs, "simulate", _simulate, "Write synthetic readings, labelled simulated.")
    _add_parameters(parser, required=True)
    _add_angles(parser, theta_r="-80:80:0.5")
    parser.add_argument("--dhr-theta-i", type=numbers, metavar="DEG,...",
                        default=[float(a) for a in range(10, 90, 10)],
                        help="incidence angles of DHR readings [deg] (10,20..80; "
                        "none: '')")  # fmt: skip
    parser.add_argument("--sample", default="paint_simulated", metavar="NAME",
                        help="name of the sample (paint_simulated)")  # fmt: skip
    parser.add_argument("--wavelength", type=float, default=3.39, metavar="UM",
                        help="wavelength [um] (3.39)")  # fmt: skip
    parser.add_argument("--seed", type=seed, default=1, metavar="N",
                        help="seed of the noise (1)")  # fmt: skip
    parser.add_argument("--noise", type=float, default=0.02, metavar="X",
                        help="relative noise of a BRDF reading [1] (0.02)")  # fmt: skip
    parser.add_argument("--dhr-noise", type=float, default=0.0005, metavar="X",
                        help="noise of a DHR reading [1] (0.0005)")  # fmt: skip
    parser.add_argument("--calibration", type=float, default=0.0, metavar="X",
                        help="relative sd of the gain of each scan [1] (0)")  # fmt: skip
    parser.add_argument("--dhr-calibration", type=float, default=0.0, metavar="X",
                        help="relative sd of the DHR gain of a polarisation [1] (0)")  # fmt: skip
    parser.add_argument("--out", type=Path, required=True, metavar="CSV",
                        help="file of the readings")  # fmt: skip


def add_bench(verbs: Any) -> None:
    """The verb ``bench``."""
    parser = add_verb(verbs, "bench", _bench, "What accuracy costs in time on this machine.")
    parser.add_argument("--quick", action="store_true", help="under a minute")
    parser.add_argument("--out", type=Path, metavar="DIR", default=None,
                        help="folder of the page (default reports/accuracy_vs_time)")  # fmt: skip


def _add_parameters(parser: argparse.ArgumentParser, *, required: bool) -> None:
    parser.add_argument(
        "--params", metavar="JSON", required=required,
        help='file or text: {"n": 1.526, "k": 0.193, "sigma_n0": 0.4528, "rho0": 0.47}',
    )  # fmt: skip


def _add_angles(parser: argparse.ArgumentParser, *, theta_r: str) -> None:
    parser.add_argument("--theta-i", type=numbers, default=[0.0, 20.0, 40.0, 60.0, 80.0],
                        metavar="DEG,...",
                        help="incidence angles [deg] (0,20,40,60,80)")  # fmt: skip
    parser.add_argument("--theta-r", type=grid, default=grid(theta_r), metavar="LO:HI:STEP",
                        help=f"scattering angles [deg], or a single one ({theta_r})")  # fmt: skip
    parser.add_argument("--polarization", type=words, default=["s", "p"], metavar="s,p,u",
                        help="polarisations (s,p)")  # fmt: skip


def _check(options: argparse.Namespace) -> int:
    from pbrdf_bayes.io.config_toml import read_config
    from pbrdf_bayes.workflow.checking import describe_file, find_in_file

    config = read_config(options.config, {"brdf_floor": options.brdf_floor})
    if options.json:
        text, message = find_in_file(options.csv, config)
        print(text)
        if message:
            print(message, file=sys.stderr)
        return BAD_INPUT if message else DONE
    text, clean = describe_file(options.csv, config)
    print(text)
    return DONE if clean else BAD_INPUT


def _import(options: argparse.Namespace) -> int:
    from pbrdf_bayes.io.formats.content import Decided
    from pbrdf_bayes.io.tidy_csv import import_to_csv

    decided = {name: getattr(options, name) for name in Decided.__dataclass_fields__}
    for text in import_to_csv(options.files, Decided(**decided), options.out):
        print(text, file=sys.stderr)
    print(options.out)
    return DONE


def _fit(options: argparse.Namespace) -> int:
    from pbrdf_bayes.io.config_toml import read_config
    from pbrdf_bayes.verbs.terminal import observer
    from pbrdf_bayes.workflow.fitting import fit_file

    config = read_config(
        options.config, {"accuracy": options.accuracy, "effects": effects(options.effects)}
    )
    run = fit_file(
        options.csv, config, sample=options.sample, wavelength_um=options.wavelength,
        out=options.out, seed=options.seed, resume=options.resume,
        paperwork=paperwork_of(options),
        observer=observer(quiet=options.quiet, interrupted=interrupted.is_set),
    )  # fmt: skip
    if run.notice:
        print(f"pbrdf-bayes fit: {run.notice}", file=sys.stderr)
    print(run.folder)
    if run.status != "done":
        error = ConvergenceError(
            f"{run.folder}: not converged within max_steps; results are kept and marked. "
            "Raise max_steps in the configuration, and go on with --resume"
        )
        print(f"pbrdf-bayes fit: {error}", file=sys.stderr)
        return NOT_CONVERGED
    return STRICT_FAIL if options.strict and run.verdict == "FAIL" else DONE


def _report(options: argparse.Namespace) -> int:
    from pbrdf_bayes.workflow.paperwork import amend_folder

    print(amend_folder(options.folder, paperwork_of(options)))
    return DONE


def _predict(options: argparse.Namespace) -> int:
    from pbrdf_bayes.workflow.parameters_json import read_parameters
    from pbrdf_bayes.workflow.prediction import predict_table

    if bool(options.folders) == (options.params is not None):
        msg = "give either a run folder or --params, not both and not neither"
        raise ConfigError(msg)
    if len(options.folders) > 1 and options.scene is None:
        msg = "several run folders make one table only with --scene. Give one, or a scene"
        raise ConfigError(msg)
    given = (None, None) if options.params is None else read_parameters(options.params)
    if options.scene is not None:
        return _predict_scene(options, *given)
    text = predict_table(
        folder=next(iter(options.folders), None), parameters=given[0], effects=given[1],
        theta_i_deg=options.theta_i, theta_r_deg=options.theta_r, phi_r_deg=options.phi_r,
        dhr_theta_i_deg=options.dhr_theta_i, polarizations=options.polarization,
        rtol=options.rtol, reciprocal=options.normalisation == "reciprocal",
    )  # fmt: skip
    _write_out(text, options.out)
    return DONE


def _predict_scene(options: argparse.Namespace, parameters: Any, effects: Any) -> int:
    from pbrdf_bayes.workflow.scene_files import scene_text, write_scene

    for name, default in options.defaults.items():
        if getattr(options, name) != default:
            msg = f"--{name.replace('_', '-')} with --scene: say it in the scene file instead"
            if name == "normalisation":
                msg = "--normalisation with --scene: scenes have that of the paper. Leave it out"
            raise ConfigError(msg)
    model = {"folders": options.folders, "parameters": parameters, "effects": effects,
             "rtol": options.rtol}  # fmt: skip
    if options.out == _STDOUT:
        sys.stdout.write(scene_text(options.scene, **model))
    else:
        print(write_scene(options.scene, options.out, **model))
    return DONE


def _write_out(text: str, out: Path | None) -> None:
    if out is None or out == _STDOUT:
        sys.stdout.write(text)
        return
    from pbrdf_bayes.io.run_folder import write_text

    write_text(out, text)
    print(out)


def _simulate(options: argparse.Namespace) -> int:
    from pbrdf_bayes.io.tidy_csv import write_tidy_csv
    from pbrdf_bayes.model.simulate import simulate_measurement
    from pbrdf_bayes.workflow.parameters_json import read_parameters

    parameters, effects = read_parameters(options.params)
    measurement = simulate_measurement(
        parameters, effects=effects, seed=options.seed, sample=options.sample,
        wavelength_um=options.wavelength, theta_i_deg=options.theta_i,
        theta_r_deg=options.theta_r, dhr_theta_i_deg=options.dhr_theta_i,
        polarizations=options.polarization, relative_noise=options.noise,
        dhr_noise=options.dhr_noise, u_brdf_cal=options.calibration,
        u_dhr_cal=options.dhr_calibration,
    )  # fmt: skip
    write_tidy_csv(measurement, options.out)
    print(options.out)
    return DONE


def _bench(options: argparse.Namespace) -> int:
    from pbrdf_bayes.bench.run import DEFAULT_FOLDER, run_bench, text_table, write_bench

    result = run_bench(
        quick=options.quick, told=lambda stage: print(f"{stage} ...", file=sys.stderr)
    )
    print(text_table(result))
    print(write_bench(result, options.out or DEFAULT_FOLDER))
    return DONE
