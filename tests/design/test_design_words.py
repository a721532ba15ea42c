"""The recommendation in words for every case, from plain values made by hand."""

from __future__ import annotations

from typing import Any

from pbrdf_bayes.design.ranking import span_of_angles
from pbrdf_bayes.design.words import recommend
from pbrdf_bayes.verbs.design import best_table
from pbrdf_bayes.words import say

RUN = {
    "sample": "a", "wavelength_um": 3.39, "created_utc": "x", "verdict": "PASS", "seed": 1,
    "applicability": "applies",
}  # fmt: skip


def row(
    label: str, theta_i: float, eig: float, minutes: float = 18.0, **other: Any
) -> dict[str, Any]:
    quantity = "brdf" if "scan" in label else label[:3].lower()
    found = {
        "label": f"{label} at {theta_i:g}°", "quantity": quantity, "polarization": "p",
        "theta_i_deg": theta_i, "port_deg": None, "minutes": minutes, "eig_nats": eig,
        "eig_se": 0.01, "eig_low": eig - 0.01, "eig_high": eig + 0.01,
        "eig_per_minute": eig / minutes, "tied": False, "tied_per_minute": False, "repeat": False,
        "sd_ratio": {"n": {"ratio": 0.8, "se": 0.0}, "k": {"ratio": 0.63, "se": 0.0}},
    }  # fmt: skip
    return found | other


def design(*rows: dict[str, Any], **other: Any) -> dict[str, Any]:
    batch = {
        "members": [],
        "eig_nats": 0.0,
        "eig_se": 0.0,
        "eig_low": 0.0,
        "eig_high": 0.0,
        "minutes": 0.0,
        "budget_minutes": None,
    }
    found = {
        "run": RUN,
        "about": ["n", "k"],
        "candidates": list(rows),
        "batch": batch,
        "pairs": None,
    }
    return found | other


BEST = row("p scan", 55.0, 0.64, tied=True, tied_per_minute=True)


def test_one_that_is_far_ahead() -> None:
    said = recommend(design(BEST, row("p scan", 50.0, 0.31)))
    assert said[0] == (
        "Take the p scan at 55° next (18 min): +0.64 ± 0.01 nat about n and k. It is expected to "
        "bring the standard deviation of k to 63 % of what it is now."
    )
    assert "the next best, the p scan at 50°, gives 48 % of it" in said[1]
    assert "Nothing else comes close" in said[1]
    assert "also the best for each minute" in said[1]
    assert said[-1] == "1 nat is a factor of 2.7 in the volume of what is plausible."


def test_one_that_is_a_little_ahead_is_not_said_to_be_far() -> None:
    said = " ".join(recommend(design(BEST, row("p scan", 50.0, 0.58))))
    assert "gives 91 % of it" in said
    assert "comes close" not in said


def test_goals_are_told() -> None:
    ratios = BEST["sd_ratio"] | {"DHR_s(70°)": {"ratio": 0.4, "se": 0.0}}
    said = recommend(design(BEST | {"sd_ratio": ratios}))[0]
    assert "of k to 63 % and of DHR_s(70°) to 40 %" in said


def test_ties_are_told_as_ranges_of_neighbouring_angles() -> None:
    tied = [row("p scan", a, 0.63, tied=True) for a in (60.0, 65.0, 70.0, 85.0)]
    dhr = row("DHR_p", 75.0, 0.62, tied=True)
    others = [row("p scan", a, 0.1) for a in (75.0, 80.0)]
    said = " ".join(recommend(design(BEST, *tied, dhr, *others)))
    assert (
        "Not told apart from it by the calculation: p scan at 60 to 70° and 85°; DHR_p at 75°."
        in said
    )


def test_another_one_is_better_for_each_minute() -> None:
    best = BEST | {"tied_per_minute": False}
    cheap = row("DHR_p", 75.0, 0.45, minutes=3.0, tied_per_minute=True)
    said = " ".join(recommend(design(best, cheap)))
    assert (
        "For each minute the DHR_p at 75° is best: 70 % of that gain in 17 % of the time (3 min)."
        in said
    )


def test_only_the_best_for_each_minute_is_told_to_be_it() -> None:
    cheap = row("DHR_p", 75.0, 0.15, minutes=3.0, tied_per_minute=True)
    said = " ".join(recommend(design(BEST, cheap)))
    assert "For each minute it is not told apart from the best, the DHR_p at 75°." in said
    assert "also the best for each minute" not in said


def test_the_first_for_each_minute_is_not_said_to_be_best_alone() -> None:
    others = [row("p scan", a, 0.63, tied_per_minute=True) for a in (60.0, 65.0)]
    said = " ".join(recommend(design(BEST, *others)))
    assert "For each minute it is first, not told apart from: p scan at 60 and 65°." in said
    assert "also the best for each minute" not in said
    same = [one | {"tied": True} for one in others]
    said = " ".join(recommend(design(BEST, *same)))
    assert "it is first as well, not told apart from the same." in said
    assert said.count("p scan at 60 and 65°") == 1
    dhr = [row("DHR_p", a, 0.45, minutes=3.0, tied_per_minute=True) for a in (75.0, 80.0)]
    said = " ".join(recommend(design(BEST | {"tied_per_minute": False}, *dhr)))
    assert "in 17 % of the time (3 min); not told apart from it there: DHR_p at 80°." in said


def test_an_error_is_told_as_it_is() -> None:
    for se, words in (
        (0.28, "+0.64 ± 0.28 nat"), (0.006, "+0.64 ± 0.01 nat"), (0.0043, "+0.640 ± 0.004 nat"),
        (0.00096, "+0.6400 ± 0.0010 nat"), (1e-7, "+0.6400 ± under 0.0001 nat"),
    ):  # fmt: skip
        assert words in " ".join(recommend(design(BEST | {"eig_se": se}))), se


def test_nothing_is_worth_measuring() -> None:
    weak = row("p scan", 55.0, 0.02)
    said = recommend(design(weak, row("p scan", 50.0, 0.01)))
    assert said == [
        (
            "No candidate tells much more about n and k: the largest gain is +0.02 ± 0.01 nat "
            "(p scan at 55°, 18 min)."
        )
    ]
    uncertain = row("p scan", 55.0, 0.3, eig_se=0.2)
    assert recommend(design(uncertain))[0].startswith("No candidate tells much more")


def test_a_fit_that_failed_is_told_first() -> None:
    failed = RUN | {"verdict": "FAIL"}
    said = recommend(design(BEST, run=failed | {"applicability": "does not apply"}))
    assert said[0] == say("design.not_constants", verdict="FAIL")
    said = recommend(design(BEST, run=failed | {"status": "not_converged"}))
    assert said[0] == say("design.not_converged")
    assert say("design.not_constants", verdict="FAIL") not in said
    said = recommend(design(BEST, run=failed | {"status": "done"}))
    assert said[0] == say("design.fail")
    assert recommend(design(BEST, run=RUN | {"status": "done"}))[0].startswith("Take the p scan")


def test_before_any_reading() -> None:
    said = recommend(design(BEST, run=None))
    assert said[0].startswith("Before any reading, from the priors alone: take the p scan at 55°")


def test_a_wide_bracket_is_told_instead_of_the_middle() -> None:
    best = row("p scan", 55.0, 5.0, eig_low=4.88, eig_high=5.12)
    said = recommend(design(best))[0]
    assert "between +4.88 and +5.12 nat about n and k; more draws would narrow that" in said
    best = row("p scan", 55.0, 5.0, eig_low=4.6, eig_high=5.4)  # of draws made for the readings
    assert "between +4.60 and +5.40 nat about n and k." in recommend(design(best))[0]
    said = " ".join(recommend(design(best, row("p scan", 50.0, 1.0))))
    assert "The next best, the p scan at 50°, gives less: +1.00 ± 0.01 nat." in said
    assert "comes close" not in said


def test_what_the_local_normal_law_tells_is_told_as_such() -> None:
    local = {"eig_method": "local", "sd_method": "local"}
    best = row("p scan", 60.0, 11.5, eig_low=8.5, eig_high=34.1, eig_se=0.3, tied=True, **local)
    best |= {"tied_per_minute": True, "sd_ratio": {n: {"ratio": 0.014, "se": 0.0} for n in "nk"}}
    other = row("s scan", 60.0, 11.4, eig_low=8.0, eig_high=20.0, tied=True, **local)
    batch = design()["batch"] | {
        "members": [best | {"method": "local"}, other | {"method": "local"}],
        "eig_nats": 12.5, "eig_se": 0.3, "eig_low": 9.5, "eig_high": 35.1, "minutes": 36.0,
    }  # fmt: skip
    said = " ".join(recommend(design(best, other, run=None, batch=batch)))
    assert "take the p scan at 60° next (18 min): +11.5 ± 0.30 nat (local normal approx" in said
    assert "of n to 1.4 % of what it is now (local normal approximation)" in said
    assert "Not told apart from it by the calculation: s scan at 60°." in said
    assert "together +12.5 ± 0.30 nat (local normal approximation) in 36 min" in said
    assert "What it adds from no. 2 on is by the local normal approximation." in said
    assert not [claim for claim in ("34.1", "comes close", "cannot be told") if claim in said]


def test_no_zero_has_a_sign_and_no_gain_is_below_it() -> None:
    for eig in (-0.002, -0.04, 0.0):
        weak = row("p scan", 55.0, eig, eig_low=eig - 0.01, eig_high=eig + 0.01)
        assert "the largest gain is 0.00 ± 0.01 nat" in recommend(design(weak))[0]
    shown = weak | {"eig_nats": -1e-5, "eig_per_minute": -1e-7, "p_best": 1.0}
    assert "-0.0" not in best_table(design(shown, sd_before={"n": 0.1}))


def goal_row(label: str, reduction: float, minutes: float = 18.0, **other: Any) -> dict[str, Any]:
    return {
        "label": label, "quantity": "brdf" if "scan" in label else label[:3].lower(),
        "minutes": minutes, "reduction": reduction, "reduction_se": 0.01,
        "reduction_per_minute": reduction / minutes, "sd_ratio": (1.0 - reduction) ** 0.5,
        "tied": False, "tied_per_minute": False,
    } | other  # fmt: skip


def test_the_best_for_each_goal_is_named() -> None:
    scan = goal_row("p scan at 60°", 0.84, tied=True)
    near = goal_row("p scan at 65°", 0.83, tied=True)
    dhr = goal_row("DHR_p at 70°", 0.5, minutes=3.0, tied_per_minute=True)
    goals = [
        {"name": "DHR_p(70°)", "candidates": [scan, near, dhr]},
        {"name": "f_s(60°, 10°)", "candidates": [goal_row("p scan at 60°", 0.01)]},
    ]
    said = recommend(design(BEST, goals=goals))
    assert (
        "Best for what you need: for DHR_p(70°) the p scan at 60° (standard deviation to 40 %, 1 "
        "more not told apart) and for each minute the DHR_p at 70°; nothing sharpens "
        "f_s(60°, 10°)."
    ) in said


def test_a_ddr_is_recommended_with_what_fit_does_of_it() -> None:
    words = f"Note: {say('design.ddr')}."
    assert words in recommend(design(row("DDR_p", 55.0, 0.64)))
    assert words not in recommend(design(BEST, row("DDR_p", 55.0, 0.1)))
    goals = [{"name": "DHR_p(70°)", "candidates": [goal_row("DDR_p at 70°", 0.5)]}]
    assert words in recommend(design(BEST, goals=goals))


def test_a_step_that_is_a_ddr_says_that_fit_does_not_read_it() -> None:
    batch = {
        "members": [BEST, row("DDR_p", 75.0, 0.3)], "eig_nats": 0.91, "eig_se": 0.02,
        "eig_low": 0.9, "eig_high": 0.92, "minutes": 36.0, "budget_minutes": 60.0,
    }  # fmt: skip
    said = " ".join(recommend(design(BEST, batch=batch)))
    assert "p scan at 55°, then DDR_p at 75° (fit does not read DDR yet): together" in said


def test_candidates_of_other_ranges_are_no_neighbours() -> None:
    """Labels that say the range of the scan are grouped by it."""
    tied = [
        row("p scan", a, 0.63, tied=True) | {"label": f"p scan at {a:g}°, 0 to 60° in 7 readings"}
        for a in (60.0, 65.0)
    ]
    said = " ".join(recommend(design(BEST, *tied)))
    assert "calculation: p scan at 60 and 65°, 0 to 60° in 7 readings." in said


def test_a_repeat_is_told() -> None:
    assert "repeats a geometry" in recommend(design(BEST | {"repeat": True}))[0]


def test_the_batch_is_told_with_its_budget() -> None:
    batch = {
        "members": [BEST, row("p scan", 50.0, 0.3)], "eig_nats": 0.91, "eig_se": 0.02, "eig_low": 0.9, "eig_high": 0.92,
        "minutes": 36.0, "budget_minutes": 60.0,
    }  # fmt: skip
    said = recommend(design(BEST, batch=batch))
    assert (
        "With 60 min: p scan at 55°, then p scan at 50°: together +0.91 ± 0.02 nat in 36 min."
        in said
    )
    short = batch | {
        "members": [row("DHR_p", 75.0, 0.1, 3.0)],
        "budget_minutes": 5.0,
        "minutes": 3.0,
    }
    said = " ".join(recommend(design(BEST, batch=short)))
    assert "With 5 min: DHR_p at 75°: +0.91 ± 0.02 nat in 3 min." in said
    assert "The p scan at 55° takes longer than that." in said


def test_a_pair_that_beats_the_greedy_one_is_told() -> None:
    members = {"members": [BEST, row("DHR_p", 75.0, 0.3)]}
    pairs = {"best": members, "greedy": members, "gap_nats": 0.2, "gap_se": 0.02, "n_compared": 150}
    said = " ".join(recommend(design(BEST, pairs=pairs)))
    assert "Of 150 pairs compared p scan at 55° with DHR_p at 75° tells most: 0.20 nat" in said
    assert "pairs" not in " ".join(recommend(design(BEST, pairs=pairs | {"gap_nats": 0.03})))


def test_the_only_candidate() -> None:
    assert "It is the only candidate." in " ".join(recommend(design(BEST)))


def test_candidates_that_were_only_screened_do_not_count() -> None:
    screened = {"label": "p scan at 10°", "eig_nats": None}
    assert "only candidate" in " ".join(recommend(design(BEST, screened)))


def test_angles_that_are_no_neighbours_are_no_range() -> None:
    assert span_of_angles([0.0, 85.0], range(0, 90, 5)) == "0° and 85°"
