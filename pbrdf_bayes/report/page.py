"""The report: one HTML page from one analysis, nothing evaluated, nothing fetched."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup, escape

from pbrdf_bayes.report import conformity, design_tables, document, structure, tables, texts
from pbrdf_bayes.report.arrays import draws_of
from pbrdf_bayes.report.figures.looks import LOOKS
from pbrdf_bayes.report.figures.of_analysis import Figures, draw_figures
from pbrdf_bayes.report.numbers import count
from pbrdf_bayes.results import Analysis

TITLES = {
    "document": "The measurement",
    "conformity": "Conformity",
    "parameters": "Parameters",
    "measured": "BRDF at the measured angles",
    "between": "BRDF at angles not measured",
    "dhr": "Hemispherical reflectance",
    "residuals": "Residuals",
    "leave_one_out": "Each reading against all others",
    "holdout": "Hold-out prediction",
    "structure": "Lobe widths and reciprocity",
    "posterior": "Posterior and sampling",
    "diagnostics": "Diagnostics",
    "next": "What to measure next",
    "data": "Data",
    "model": "Model and priors",
    "cost": "Accuracy and cost",
    "uncertainty": "Statement of uncertainty",
    "provenance": "Provenance",
}
MOST_COLUMNS = 14
"""Of the table of optima, which is turned where it would have more."""
VERDICT_WORDS = {"PASS": "Pass", "WARN": "Warning", "FAIL": "Fail", "SKIP": "Not applicable"}
SYMBOLS = {
    r"σ_N0|\bsigma_n0\b": "σ<sub>N0</sub>",
    r"ρ_0|\brho0\b": "ρ<sub>0</sub>",
    r"θ_i|\btheta_i\b": "θ<sub>i</sub>",
    r"θ_r|\btheta_r\b": "θ<sub>r</sub>",
    r"\bsr\^-1\b": "sr⁻¹",
    r"\b(DHR|DDR|f)_([spu])\b": r"\1<sub>\2</sub>",
}
"""Symbols in running text, as they are typed and as they are set."""


def render_report(analysis: Analysis, *, brief: bool = False) -> str:
    """Write an analysis as one self-contained HTML page.

    Parameters
    ----------
    analysis : Analysis
        Finished run, from memory or from its folder.
    brief : bool
        All numbers, but one figure alone, for runs of many samples; the page says so.

    Returns
    -------
    str
        The page. The same analysis gives the same text, character by character.
    """
    return environment().get_template("template.html.j2").render(_context(analysis, brief))


@cache
def environment() -> Environment:
    """Where templates come from, and how what they place is escaped; compiled once a process."""
    found = Environment(
        loader=FunctionLoader(_template_text),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        finalize=_finalize,
    )
    found.globals["looks"] = LOOKS
    found.filters["symbols"] = _with_symbols
    found.filters["css_string"] = _as_css_string
    return found


def _template_text(name: str) -> str:
    return files("pbrdf_bayes.report").joinpath(name).read_text(encoding="utf-8")


def _with_symbols(text: str) -> Markup:
    """Escape a text and typeset the symbols in it."""
    safe = str(escape(_finalize(text)))
    for typed, set_as in SYMBOLS.items():
        safe = re.sub(typed, set_as, safe)
    return Markup(safe)  # the text was escaped above


def _as_css_string(text: str) -> Markup:
    """A text as a string of a style sheet."""
    return Markup(document.css_string(_finalize(text)))  # only letters, digits and escapes


def _finalize(value: Any) -> Any:
    """Replace what no page may hold: control characters, direction overrides, half characters."""
    if isinstance(value, Markup) or not isinstance(value, str) or value.isprintable():
        return value
    return "".join(map(_visible, value))


def _visible(character: str) -> str:
    code = ord(character)
    control = (code < 32 and character not in "\n\t") or 0x7F <= code < 0xA0
    turning = 0x200E <= code <= 0x200F or 0x202A <= code <= 0x202E or 0x2066 <= code <= 0x2069
    half = 0xD800 <= code < 0xE000 or code in (0xFFFE, 0xFFFF)
    return "\ufffd" if control or turning or half else character


def _context(analysis: Analysis, brief: bool) -> dict[str, Any]:
    """Everything the template places."""
    summary, figures = analysis.summary, draw_figures(analysis, brief=brief)
    priors = {name: draws_of(analysis, "prior", name) for name in summary["parameters"]}
    return {
        **_front(analysis),
        **_contents(analysis, figures),
        **_checks(analysis),
        **_paperwork(summary),
        "figures": figures,
        "brief": brief,
        "n_dhr": summary["input"]["n_dhr"],
        "parameters": tables.parameter_rows(summary, priors),
        "correlation": tables.correlation_rows(summary),
        "residual_text": texts.residual_text(summary),
        "discrepancy_text": texts.statement(summary, "discrepancy"),
        "discrepancy": tables.discrepancy_rows(summary),
        "holdout": summary["holdout"],
        "holdout_rows": tables.holdout_rows(summary),
        "cases": tables.case_rows(summary),
        "loo_text": texts.statement(summary, "loo"),
        "readings": tables.reading_rows(summary),
        "widths_text": structure.widths_text(summary),
        "reciprocity_text": structure.reciprocity_text(summary),
        "reciprocity": structure.reciprocity_rows(summary),
        "reciprocity_caption": structure.reciprocity_caption(summary),
        "sensitivity": any("prior_sensitivity" in p for p in summary["parameters"].values()),
        "optima": _optima(analysis),
        "scans": tables.scan_rows(summary),
        "warnings": summary["input"]["warnings"],
        "data_facts": texts.data_facts(summary),
        "model_text": texts.model_text(summary),
        "effects_choice": summary.get("effects_choice"),
        "effect_rows": tables.effect_rows(summary),
        "sampling": texts.facts(summary["sampling"]),
        "accuracy": texts.facts(summary["accuracy"]),
        "timings": texts.timing_rows(summary),
        "provenance": texts.provenance(summary),
        "next": None if analysis.design is None else design_tables.next_section(analysis.design),
        "config_toml": analysis.config_toml.strip(),
    }


def _front(analysis: Analysis) -> dict[str, Any]:
    """First screen."""
    summary = analysis.summary
    return {
        "sample": summary["sample"],
        "short_sample": texts.shortened(summary["sample"]),
        "meta": texts.meta(summary),
        "model_name": summary["model"],
        "created": str(summary["created_utc"]).replace("T", " ")[:16] + " UTC",
        "verdict": summary["verdict"],
        "headline": summary["headline"],
        "applicability": texts.applicability(summary),
        "banner": texts.banner(summary),
        "reservation": texts.reservation(summary),
        "values_note": texts.values_note(summary),
    }


def _paperwork(summary: Mapping[str, Any]) -> dict[str, Any]:
    """What a laboratory states, limits and verdicts, and the statement of uncertainty."""
    found = summary.get("conformity")
    items = document.given(summary)
    return {
        "document": {key: items.get(key, "") for key in document.KEYS},
        "has_document": bool(items),
        "document_front": document.front_items(summary),
        "document_details": document.detail_items(summary),
        "not_given": document.not_given(summary),
        "signatures": document.signatures(summary),
        "uncertainty": document.uncertainty_text(summary),
        "identification": document.identification(summary),
        "conformity_word": found["verdict"] if found else "",
        "conformity_verdict": conformity.WORDS[found["verdict"]] if found else "",
        "conformity_look": conformity.LOOK_OF[found["verdict"]] if found else "",
        "conformity_text": conformity.conformity_text(summary),
        "conformity_rule": conformity.rule_text(found) if found else "",
        "agreed_rule": items.get("decision_rule", ""),
        "rule_notice": conformity.rule_notice(summary),
        "conformity_measurand": conformity.measurand_text(found) if found else "",
        "limit_rows": conformity.limit_rows(summary),
    }


def _contents(analysis: Analysis, figures: Figures) -> dict[str, Any]:
    """Sections of this run with their numbers and titles."""
    absent = {
        "measured": not figures.measured,
        "between": not figures.between,
        "dhr": not figures.dhr,
        "residuals": not figures.residuals,
        "leave_one_out": not analysis.summary.get("leave_one_out"),
        "holdout": not (analysis.summary["holdout"] or analysis.summary.get("holdouts")),
    }
    absent["document"] = not analysis.summary.get("document")
    absent["conformity"] = not analysis.summary.get("conformity")
    absent["next"] = analysis.design is None
    absent["structure"] = not {"reciprocity", "scan_widths"} & set(analysis.summary)
    sections = [name for name in TITLES if not absent.get(name, False)]
    numbers = {name: number for number, name in enumerate(sections, start=1)}
    first = next((n for n in ("measured", "between", "dhr") if n in sections), "")
    return {"sections": sections, "titles": TITLES, "numbers": numbers, "first_bands": first}


def _checks(analysis: Analysis) -> dict[str, Any]:
    data, diagnostics = tables.check_rows(analysis.summary)
    findings = tables.finding_rows(analysis.summary)
    return {
        "verdict_words": VERDICT_WORDS,
        "data_checks": [*findings, *data],
        "diagnostics": diagnostics,
        "attention": [*findings, *tables.attention([*diagnostics, *data])],
        "tally": tables.tally([*diagnostics, *findings, *data]),
    }


def _optima(analysis: Analysis) -> dict[str, Any]:
    symbols, rows = tables.optima_rows(analysis.summary)
    heads = ["No.", "log posterior", "Difference", "Starts", *symbols]
    return {
        "heads": heads,
        "rows": rows,
        "upright": list(zip(heads, *rows, strict=True)) if len(heads) > MOST_COLUMNS else [],
        "n_starts": count(analysis.summary["map"]["n_starts"]),
        "words": texts.optima_text(len(rows)),
    }
