"""What to measure next of a sample: from a run, or from the priors alone, to a recommendation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from pbrdf_bayes.analysis import Analysis
from pbrdf_bayes.config import AUTO, RunConfig
from pbrdf_bayes.design.beliefs import Beliefs, beliefs_of_prior, beliefs_of_run
from pbrdf_bayes.design.candidates import Candidate, Costs
from pbrdf_bayes.design.goals import Goal, parse_goal
from pbrdf_bayes.design.run import DesignChoices, design_measurements
from pbrdf_bayes.design.summary import summarise_design
from pbrdf_bayes.design.words import minutes as in_minutes
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.results import draws_of_run
from pbrdf_bayes.workflow.candidates_csv import Wanted, list_wanted

Told = Callable[[str, int, int], None]

INNER_PER_OUTER = 2
FEWEST_DRAWS, MOST_DRAWS = 25, 50_000
"""Simulated paints, as many as `DesignChoices` allows with so many draws compared with each."""
_N_PRIOR_DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Question:
    """All that a design is computed from, checked.

    Attributes
    ----------
    analysis : Analysis or None
    beliefs : Beliefs
    candidates : tuple of Candidate
    goals : tuple of Goal
    choices : DesignChoices
    """

    analysis: Analysis | None
    beliefs: Beliefs
    candidates: tuple[Candidate, ...]
    goals: tuple[Goal, ...]
    choices: DesignChoices


def ask(
    source: Analysis | RunConfig, wanted: Wanted | Sequence[Candidate], *,
    goals: Sequence[str] = (), about: Sequence[str] = (), choices: DesignChoices | None = None,
) -> Question:  # fmt: skip
    """Check what is asked for and prepare it; nothing is simulated yet.

    Parameters
    ----------
    source : Analysis or RunConfig
        A finished run, or the priors before any reading.
    wanted : Wanted or sequence of Candidate
    goals : sequence of str
        See `pbrdf_bayes.design.goals.parse_goal`.
    about : sequence of str
        Parameters that the information is about; the physical ones by default.
    choices : DesignChoices, optional

    Returns
    -------
    Question

    Raises
    ------
    ConfigError, DataError
    """
    chosen = choices or DesignChoices()
    aims = tuple(dict.fromkeys(parse_goal(text) for text in goals))
    analysis = source if isinstance(source, Analysis) else None
    measurement = None if analysis is None else analysis.measurement
    candidates = list_wanted(wanted, measurement) if isinstance(wanted, Wanted) else tuple(wanted)
    _check_candidates(candidates, chosen.minutes)
    if isinstance(source, Analysis):
        beliefs = _beliefs_of(source, about)
    else:
        beliefs = _beliefs_before(source, candidates, chosen, about)
    return Question(analysis, beliefs, candidates, aims, chosen)


def answer(question: Question, told: Told = lambda *_: None) -> dict[str, Any]:
    """Compute a design.

    Parameters
    ----------
    question : Question
    told : callable
        Told the stage, and how many of how many candidates are done.

    Returns
    -------
    dict
        See `pbrdf_bayes.design.summary.summarise_design`.

    Raises
    ------
    ConfigError
        The run has too few draws.
    """
    result = design_measurements(
        question.beliefs, question.candidates, choices=question.choices, goals=question.goals,
        told=told,
    )  # fmt: skip
    analysis = question.analysis
    return summarise_design(result, None if analysis is None else analysis.summary)


def design_next(
    source: Analysis | RunConfig, *, candidates: Sequence[Candidate] = (),
    costs: Costs | None = None, goals: Sequence[str] = (), about: Sequence[str] = (),
    minutes: float = float("inf"), batch: int | None = None, draws: int = 400, seed: int = 1,
) -> dict[str, Any]:  # fmt: skip
    """Which measurement would tell most about a sample, for each and for each minute.

    Every candidate is simulated many times from what is believed now, draws of the posterior and
    not a best fit, and the information that its readings would give is averaged. Nuisance (noise,
    discrepancy of the model, gains of the instrument) is accounted for, and a repeat of what is
    known well gains little.

    Parameters
    ----------
    source : Analysis or RunConfig
        A finished run; or its choices alone, for a design from their priors before any reading.
    candidates : sequence of Candidate
        What could be measured. By default scans, DHR and DDR for s, p and unpolarised light every
        5 degrees of incidence to 85, scans as the sample has been scanned so far, and every
        geometry that was measured.
    costs : Costs, optional
        Minutes at the bench, of the default candidates.
    goals : sequence of str
        Predictions whose sharpening is wanted too: ``dhr:s:70``, ``brdf:p:60:-30``,
        ``scan:p:60``, ``ratio:60:40`` (polarisation, theta_i, theta_r [deg]). A scan counts by its
        mean variance at theta_r -80 to 80 by 8 degrees.
    about : sequence of str
        Parameters that the information is about: n, k, sigma_n0 and rho0 by default.
    minutes : float
        Budget of the measurements taken together [min].
    batch : int, optional
        Measurements taken together at most: by default 4, and 20 under a budget of minutes.
    draws : int
        Simulated paints; each is compared with twice as many other draws.
    seed : int
        The result is a function of it.

    Returns
    -------
    dict
        ``candidates``: those of the largest expected gain first, each with ``eig_nats`` and its
        standard error ``eig_se`` [nat], ``eig_per_minute``, ``p_best``, and the expected
        ``sd_ratio`` of parameters and goals, after over before [1]; ``batch``: the best ones
        together; ``recommendation``: text. The content of ``design.json``, see
        `pbrdf_bayes.records.design.Design`.

    Raises
    ------
    ConfigError
        When a choice is not allowed, nothing fits the budget, or the run has too few draws.

    Notes
    -----
    Nested Monte Carlo between a lower and an upper estimate: Ryan, J. Comput. Graph. Stat. 12, 585
    (2003), doi:10.1198/1061860032012; Foster et al., AISTATS 2020, arXiv:1911.00294.
    """
    choices = choices_of(minutes=minutes, batch=batch, draws=draws, seed=seed)
    wanted = tuple(candidates) or Wanted(costs=costs or Costs())
    return answer(ask(source, wanted, goals=goals, about=about, choices=choices))


def choices_of(*, minutes: float, batch: int | None, draws: int, seed: int) -> DesignChoices:
    """Choices from what a user gives.

    Raises
    ------
    ConfigError
    """
    low, high = FEWEST_DRAWS, MOST_DRAWS
    if not (isinstance(draws, int) and low <= draws <= high):
        msg = f"draws = {draws!r} (--draws) is not allowed: give a whole number in [{low}, {high}]"
        raise ConfigError(msg)
    return DesignChoices(
        n_outer=draws, n_inner=INNER_PER_OUTER * draws, minutes=minutes, batch=batch, seed=seed
    )


def _beliefs_of(analysis: Analysis, about: Sequence[str]) -> Beliefs:
    posterior = analysis.posterior()
    draws = draws_of_run(analysis, posterior.parameter_names)
    return beliefs_of_run(posterior, draws.reshape(-1, posterior.n_par), about=about)


def _beliefs_before(
    config: RunConfig, candidates: Sequence[Candidate], choices: DesignChoices,
    about: Sequence[str],
) -> Beliefs:  # fmt: skip
    if config.effects == AUTO:
        msg = "effects: auto needs readings to choose from. Name the effects, or leave them out"
        raise ConfigError(msg)
    n_draws = max(_N_PRIOR_DRAWS, choices.n_outer + choices.n_inner)
    return beliefs_of_prior(config, candidates, n_draws=n_draws, seed=choices.seed, about=about)


def _check_candidates(candidates: Sequence[Candidate], minutes: float) -> None:
    if not candidates:
        msg = "there is no candidate: give at least one angle of incidence, or a CSV of candidates"
        raise ConfigError(msg)
    cheapest = min(candidates, key=lambda c: c.minutes)
    if cheapest.minutes > minutes:
        msg = (
            f"minutes = {minutes:g} is not enough for any candidate: the cheapest, the "
            f"{cheapest.label}, takes {in_minutes(cheapest.minutes)}. Raise the budget, or give "
            "the costs of your bench"
        )
        raise ConfigError(msg)
