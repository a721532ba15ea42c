"""The command line: arguments in, workflow called, exit code out; no science.

Only light modules are imported here, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import re
import signal
import sys
from collections.abc import Sequence
from typing import NoReturn

from pbrdf_bayes import __version__
from pbrdf_bayes.errors import PbrdfError
from pbrdf_bayes.verbs.arguments import (
    BAD_INPUT,
    DONE,
    INTERRUPTED,
    HelpFormatter,
    interrupted,
)
from pbrdf_bayes.verbs.batch import add_batch
from pbrdf_bayes.verbs.conform import add_conform
from pbrdf_bayes.verbs.design import add_design
from pbrdf_bayes.verbs.export import add_export
from pbrdf_bayes.verbs.one_sample import (
    add_bench,
    add_check,
    add_fit,
    add_import,
    add_predict,
    add_report,
    add_simulate,
)

_SIGNED = ("--theta-i", "--theta-r", "--dhr-theta-i", "--phi-r")
_EPILOG = """\
exit codes: 0 done (the verdict FAIL is still done; --strict makes it 4), 2 bad input or usage,
3 the computation did not converge (results kept, marked), 130 interrupted

the CSV: UTF-8 with a header; columns sample, wavelength_um, quantity (brdf or dhr),
polarization (s, p or u), theta_i_deg, theta_r_deg (brdf only; signed, + = forward), value;
optional sigma, n_repeats, phi_r_deg, scan, flag
"""


def run_program() -> NoReturn:
    """`main` for a process of its own, which ends here, with the exit code.

    Without the clean-up of the interpreter: the threads of the linear algebra libraries are joined
    there in compiled code, which no signal reaches, and under load that was seen to hang.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):  # names may have characters it has not
            stream.reconfigure(errors="backslashreplace")
    try:
        code = main()
    except SystemExit as stop:  # of argparse
        code = stop.code if isinstance(stop.code, int) else DONE
    for stream in (sys.stdout, sys.stderr):
        with contextlib.suppress(OSError, ValueError):
            stream.flush()
    os._exit(code)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one verb; returns the exit code.

    Parameters
    ----------
    arguments : sequence of str, optional
        Without the program's name; those of the process by default.

    Returns
    -------
    int
    """
    options = build_parser().parse_args(
        _attach_angles(sys.argv[1:] if arguments is None else arguments)
    )
    interrupted.clear()
    for kind in (signal.SIGINT, signal.SIGTERM):
        signal.signal(kind, _interrupt)
    try:
        code: int = options.run(options)
        sys.stdout.flush()
    except PbrdfError as error:
        print(f"pbrdf-bayes {options.verb}: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt as stop:
        return _say_interrupted(stop)
    except BrokenPipeError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:  # of standard output, or of a name no file can have
        print(f"pbrdf-bayes {options.verb}: the system refused: {error}", file=sys.stderr)
        return BAD_INPUT
    except Exception as error:
        if interrupted.is_set():  # compiled code turns the interrupt into an error of its own
            return _say_interrupted(error)
        raise
    return code


def _say_interrupted(stop: BaseException) -> int:
    notes = getattr(stop, "__notes__", [])
    print("\ninterrupted; nothing was left half written", *notes, sep="\n", file=sys.stderr)
    return INTERRUPTED


def _attach_angles(arguments: Sequence[str]) -> list[str]:
    """Write ``--theta-r -80:80:1`` as ``--theta-r=-80:80:1``, which argparse takes for an option.

    Examples
    --------
    >>> _attach_angles(["predict", "--theta-r", "-80:80:1", "--phi-r", "5"])
    ['predict', '--theta-r=-80:80:1', '--phi-r', '5']
    """
    attached: list[str] = []
    for word in arguments:
        if attached and attached[-1] in _SIGNED and re.match(r"-[\d.]", word):
            attached[-1] += f"={word}"
        else:
            attached.append(word)
    return attached


def _interrupt(*_: object) -> NoReturn:
    """Raise, and remember: an exception that meets a foreign callback is lost there."""
    interrupted.set()
    raise KeyboardInterrupt


def build_parser() -> argparse.ArgumentParser:
    """The parser with one sub-parser for each verb."""
    parser = argparse.ArgumentParser(
        prog="pbrdf-bayes",
        description="Posterior of (n, k, sigma_N0, rho0) of a paint sample from BRDF scans and DHR "
        "readings, with predicted s and p curves and a report to file.",
        epilog=_EPILOG,
        formatter_class=HelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"pbrdf-bayes {__version__}")
    verbs = parser.add_subparsers(dest="verb", required=True, metavar="VERB")
    verbs_in_order = (
        add_check, add_import, add_fit, add_batch, add_report, add_predict, add_conform, add_design,
        add_simulate, add_export, add_bench,
    )  # fmt: skip
    for add in verbs_in_order:
        add(verbs)
    return parser
