"""The verb ``conform``, and the options of others that have to do with it; no science.

Only light modules are imported here, so that ``--help`` answers at once.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pbrdf_bayes.verbs.arguments import DONE, STRICT_FAIL, add_verb

_EPILOG = """\
limits.toml (angles in degrees: a number, a list, or "LO:HI:STEP"; measured or not):
  specification = "PS-114, issue 3"
  rule = "risk"                     # simple | guard | risk, after JCGM 106:2012
  max_consumer_risk = 0.05          # risk: accepts up to this probability of not conforming
  max_producer_risk = 0.05          #       rejects up to this probability of conforming
                                    #       below 4e-4 no --accuracy decides, below 4e-3 not all
                                    # guard: guard_factor = 1.645 in place of these two, the
                                    #       length of the guard bands in standard uncertainties

  [[limit]]                         # as many as wanted; lower, upper or both
  name = "refractive index"
  parameter = "n"                   # k, sigma_n0, rho0, lambert, ...
  lower = 1.45
  upper = 1.60

  [[limit]]                         # all angles of a band together
  name = "glare"
  quantity = "brdf"                 # brdf [1/sr] | dhr | brdf_ratio (s over p)
  polarization = "s"
  theta_i_deg = 60
  theta_r_deg = "40:80:2"
  upper = 0.5                       # rule "guard": guard = 0.02, in its unit

  [[difference]]                    # to the sample of --reference
  name = "shade"
  quantity = "brdf"
  polarization = "p"
  theta_i_deg = 20
  theta_r_deg = "-60:60:2"
  tolerance = 0.05                  # dex for curves, the parameter's unit for a parameter

verdicts: ACCEPT, REJECT, UNDECIDED. A limit on a parameter of a model that does not apply, or that
the readings do not identify, is UNDECIDED, whatever its draws say. Unpolarised light that was not
measured is the mean of s and p of the same draw. Of a difference the probability that it exceeds
its tolerance is told.
"""


def add_conform(verbs: Any) -> None:
    """The verb ``conform``."""
    parser = add_verb(
        verbs, "conform", _conform, "Judge a fitted sample against a specification.",
        epilog=_EPILOG,
    )  # fmt: skip
    parser.add_argument("folder", type=Path, metavar="DIR", help="a finished run")
    parser.add_argument("--limits", type=Path, metavar="TOML", required=True,
                        help="the specification, see below")  # fmt: skip
    parser.add_argument("--reference", type=Path, metavar="DIR",
                        help="run of the sample that differences are to")  # fmt: skip
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result there")
    parser.add_argument("--save", action="store_true",
                        help="put it into summary and report of the run")  # fmt: skip
    parser.add_argument("--strict", action="store_true", help="exit 4 unless it is ACCEPT")


def add_paperwork(
    parser: argparse.ArgumentParser, *, limits: bool = True, pdf: bool = True
) -> None:
    """Options of ``fit``, ``batch`` and ``report``: limits, items of the laboratory, PDF."""
    if limits:
        parser.add_argument("--limits", type=Path, metavar="TOML",
                            help="specification to judge it against, see conform")  # fmt: skip
        parser.add_argument("--reference", type=Path, metavar="DIR",
                            help="run of the sample that differences in it are to")  # fmt: skip
    parser.add_argument("--document", type=Path, metavar="TOML",
                        help="items of the report: laboratory, customer, dates, ...; {sample} and "
                        "{run} in its title, report_number, item_id")  # fmt: skip
    if pdf:
        text = "the report as report.pdf too (needs Chromium or Chrome)"
        parser.add_argument("--pdf", action="store_true", help=text)


def paperwork_of(options: argparse.Namespace) -> Any:
    """What the options ask for, checked before anything is computed.

    Raises
    ------
    ConfigError
    """
    from pbrdf_bayes.io.document_toml import read_document
    from pbrdf_bayes.io.limits_toml import read_limits
    from pbrdf_bayes.workflow.paperwork import Paperwork

    limits = getattr(options, "limits", None)
    wanted = Paperwork(
        specification=None if limits is None else read_limits(limits),
        reference=getattr(options, "reference", None),
        document=None if options.document is None else read_document(options.document),
        pdf=getattr(options, "pdf", False),
    )
    wanted.check()
    return wanted


def _conform(options: argparse.Namespace) -> int:
    from dataclasses import replace

    from pbrdf_bayes.analysis import load_analysis
    from pbrdf_bayes.conform.assessment import assess_conformity
    from pbrdf_bayes.io.limits_toml import read_limits
    from pbrdf_bayes.io.run_folder import refuse_to_replace, write_text
    from pbrdf_bayes.workflow.paperwork import store

    folders = [folder for folder in (options.folder, options.reference) if folder is not None]
    if options.json is not None:
        refuse_to_replace(options.json, [options.limits], folders)
    specification = read_limits(options.limits)
    analysis = load_analysis(options.folder)
    reference = None if options.reference is None else load_analysis(options.reference)
    found = assess_conformity(analysis, specification, reference)
    if options.json is not None:
        write_text(options.json, json.dumps(found, indent=1, ensure_ascii=False) + "\n")
    if options.save:
        summary = {**analysis.summary, "conformity": found}
        print(store(options.folder, replace(analysis, summary=summary)), file=sys.stderr)
    print(text_table(found))
    return DONE if found["verdict"] == "ACCEPT" or not options.strict else STRICT_FAIL


def text_table(found: Mapping[str, Any]) -> str:
    """The result as lines of text, for a terminal."""
    lines = []
    width = max(len(limit["name"]) for limit in found["limits"])
    for limit in found["limits"]:
        at = limit["worst"]
        value = "no value" if limit["mean"][at] is None else (
            f"{limit['mean'][at]:.4g} +- {limit['u'][at]:.2g}"
            f"{_where(limit, at)}, p_c {_probability(limit['probability'])}"
        )  # fmt: skip
        lines.append(f"{limit['verdict']:<10}{limit['name']:<{width}}  {value}")
        if limit["probability_exceeds"] and limit["mean"][at] is not None:
            exceeds = _probability(limit["probability_exceeds"])
            lines.append(f"{'':<10}probability that the tolerance is exceeded: {exceeds}")
        lines += [f"{'':<10}{text}" for text in (limit["reason"], limit["remark"]) if text]
    p = _probability(found["probability"])
    title = found["specification"] or "all limits"
    because = f" ({found['reason']})" if found["reason"] else ""
    judged = sum(limit["judged"] for limit in found["limits"])
    of = "" if judged == len(found["limits"]) else f" of the {judged} that can be judged"
    lines.append(f"{found['verdict']}: {title}{because}")
    if found["remark"]:
        lines.append(found["remark"])
    if judged:
        lines.append(f"joint probability of conformity{of}: {p}{_risk(found)}")
    return "\n".join(lines)


def _where(limit: Mapping[str, Any], at: int) -> str:
    if len(limit["mean"]) == 1:
        return ""
    theta_r = f", theta_r {limit['theta_r_deg'][at]:g}" if limit["theta_r_deg"] else ""
    return f" at theta_i {limit['theta_i_deg'][at]:g}{theta_r}"


def _probability(p: Mapping[str, float]) -> str:
    if p["value"] == 1.0:
        return f"> {p['low']:.4f}"
    if p["value"] == 0.0:
        return f"< {p['high']:.4f}"
    return f"{p['value']:.4f} +- {p['u']:.4f}"


def _risk(found: Mapping[str, Any]) -> str:
    p = found["probability"]
    if found["verdict"] == "ACCEPT":
        risk = found["consumer_risk"]
        return "; consumer's risk " + (f"{risk:.4f}" if risk else f"< {1.0 - p['low']:.4f}")
    if found["verdict"] == "REJECT":
        risk = found["producer_risk"]
        return "; producer's risk " + (f"{risk:.4f}" if risk else f"< {p['high']:.4f}")
    return ""
