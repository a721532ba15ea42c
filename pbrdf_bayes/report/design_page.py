"""The page of a design: what to measure next in words, figures, a plan and how it was computed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pbrdf_bayes.report import design_tables
from pbrdf_bayes.report.figures.design import (
    KINDS,
    gain_pictures,
    goal_pictures,
    minutes_picture,
    shrinkage_picture,
)
from pbrdf_bayes.report.figures.looks import LOOKS
from pbrdf_bayes.report.numbers import THIN, count, fixed, number
from pbrdf_bayes.report.page import environment
from pbrdf_bayes.words import LOCAL_NORMAL, listed

_SHOWN = 10


def render_design(design: Mapping[str, Any]) -> str:
    """Write a design as one self-contained HTML page.

    Parameters
    ----------
    design : mapping
        The content of ``design.json``.

    Returns
    -------
    str
        The same design gives the same text.
    """
    run, rows = design["run"], design_tables.evaluated(design)
    kinds = [
        words for kind, (words, _) in KINDS.items() if any(r["quantity"] == kind for r in rows)
    ]
    first, *others = design["recommendation"].split("\n")
    return environment().get_template("design.html.j2").render(
        title=run["sample"] if run else "Before any reading",
        meta=_meta(design), headline=first, paragraphs=others,
        gains=gain_pictures(rows, per_minute=False),
        by_minute=gain_pictures(rows, per_minute=True),
        minutes=minutes_picture(rows),
        shrinkage=shrinkage_picture(rows[:_SHOWN], design["sd_before"]),
        looks={q: {"word": v.word, "dash": " ".join(map(str, v.dash))} for q, v in LOOKS.items()},
        kinds=kinds, rows=design_tables.candidate_rows(rows[:_SHOWN]),
        names=list(design["sd_before"]), about=listed(design["about"]),
        plan=design_tables.plan_rows(design["batch"]), pairs=_pairs(design),
        goals=design_tables.goal_tables(design),
        facts=_facts(design), instrument=_instrument(design),
        repeats=any(r["repeat"] for r in rows),
        goal_pictures=goal_pictures(design.get("goals", ())),
        any_local=any(r.get("eig_method") == design_tables.LOCAL for r in rows),
        sd_local=any(r.get("sd_method") == design_tables.LOCAL for r in rows[:_SHOWN]),
        plan_local=any(r.get("method") == design_tables.LOCAL for r in design["batch"]["members"]),
        readings=count(design.get("p_best_readings", design["choices"]["n_outer"])),
        n_more=design["n_evaluated"] - min(_SHOWN, len(rows)),
        n_screened=count(design["n_candidates"] - design["n_evaluated"]),
        screened=design["n_candidates"] > design["n_evaluated"],
    )  # fmt: skip


def _meta(design: Mapping[str, Any]) -> str:
    run, n = design["run"], count(design["n_candidates"])
    considered = f"{n} candidate{'s' * (design['n_candidates'] != 1)} considered"
    if run is None:
        return f"from the priors alone · {considered}"
    return (
        f"{number(run['wavelength_um'])} µm · verdict of the fit: {run['verdict']} · {considered}"
    )


def _pairs(design: Mapping[str, Any]) -> str:
    """How far taking the best one at a time is from the best pair."""
    pairs = design["pairs"]
    if not pairs:
        return ""
    best, greedy = (
        " and ".join(row["label"] for row in pairs[key]["members"]) for key in ("best", "greedy")
    )
    local = f" ({LOCAL_NORMAL})" if pairs.get("method") == design_tables.LOCAL else ""
    if pairs["gap_nats"] <= 0.0:
        return (
            f"Of {count(pairs['n_compared'])} pairs of the most promising candidates none beats "
            f"{greedy}, which are best one after the other{local}."
        )
    return (
        f"Of {count(pairs['n_compared'])} pairs of the most promising candidates the best is "
        f"{best}, {design_tables.with_se(pairs['gap_nats'], pairs['gap_se'])} nat beyond {greedy}, "
        f"which are best one after the other{local}."
    )


def _instrument(design: Mapping[str, Any]) -> dict[str, str]:
    """What the readings are simulated with, and what is assumed of the scale of a scan."""
    known = design.get("instrument", {})
    words = {
        "noise": "with noise, with the discrepancy of the model along a scan and with the gains of "
        "the instrument",
        "repeats": "What is measured at the same geometry already, or within 1° of incidence of "
        "it, is taken into account, so that a repeat tells little where noise does not limit: that "
        "close the discrepancy is the same.",
        "priors": "", "scale": "",
    }  # fmt: skip
    if known.get("noise") == "iid":
        words["noise"] = "with independent noise and with the gains of the instrument"
        words["repeats"] = (
            "Scans share nothing but the sample here: noise = iid has no discrepancy."
        )
    if known.get("scans_of_prior") and design["run"] is not None:
        words["priors"] = (
            "No scan was fitted: noise of scans is drawn from its prior."
            if known["noise"] == "iid"
            else "No scan was fitted: noise and discrepancy of scans are drawn from their priors."
        )
    perfect = known.get("brdf_scale") == "absolute" and known.get("u_brdf_cal") == 0.0
    if perfect and any(row["quantity"] == "brdf" for row in design["candidates"]):
        u = known["u_dhr_cal"]
        other = f", while a DHR has a gain of {number(100.0 * u)}{THIN}% (u_dhr_cal)" if u else ""
        words["scale"] = (
            "Scans have a perfect absolute scale here, as the configuration says (u_brdf_cal = 0)"
            f"{other}."
        )
    return words


def _facts(design: Mapping[str, Any]) -> list[tuple[str, str]]:
    choices, rows = design["choices"], design_tables.evaluated(design)
    best = rows[0]
    widest = max(rows, key=lambda row: row["eig_high"] - row["eig_low"])
    few = sum(row.get("sd_method") == design_tables.LOCAL for row in rows)
    budget = choices["minutes"]
    facts = [
        ("simulated paints", count(choices["n_outer"])),
        ("draws compared with each", count(choices["n_inner"])),
        ("draws of the nuisance for each", count(choices["n_nuisance"])),
        ("bracket of the best", _bracket(best)),
        ("widest bracket", f"{_bracket(widest)} ({widest['label']})"),
        ("effective draws of the best", number(best["ess"])),
        ("linear estimate of the best",
         f"{design_tables.with_se(best['linear_nats'], best['linear_se'])} nat"),
        ("chance to be best rests on",
         f"{count(design.get('p_best_readings', choices['n_outer']))} simulated readings"),
        ("candidates only screened by the linear estimate",
         count(design["n_candidates"] - design["n_evaluated"])),
        ("budget", "none" if budget is None else f"{number(budget)} min"),
        ("measurements together at most", count(choices["batch"])),
        ("seed", str(design["seed"])),
        ("version", f"pbrdf_bayes {design['version']}"),
    ]  # fmt: skip
    if few:
        facts.insert(5, (f"candidates by the {LOCAL_NORMAL}", count(few)))
    return facts


def _bracket(row: Mapping[str, Any]) -> str:
    return f"{fixed(row['eig_low'], 3)} to {fixed(row['eig_high'], 3)} nat"
