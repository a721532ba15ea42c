"""What a verdict is, on readings and on a fit, and a finding about the readings of a sample."""

from __future__ import annotations

from msgspec import Struct, field

from pbrdf_bayes.records.values import CheckJudged, Judged, Number, Whole


class Judgement(Struct, frozen=True, kw_only=True):
    """A value against its threshold, what it means and what to do.

    Attributes
    ----------
    title : str
    value, threshold : float
        NaN where there is none.
    unit : str
    verdict : {"PASS", "WARN", "FAIL", "SKIP"}
        ``SKIP`` where the measurement lacks what the check needs.
    statement, advice : str
        What was found, with its numbers; what to do (empty for PASS and SKIP).
    """

    title: str
    value: Number
    threshold: Number
    unit: str | None
    verdict: CheckJudged
    statement: str
    advice: str | None


class Check(Judgement, frozen=True, kw_only=True):
    """A judgement with its code.

    Attributes
    ----------
    name : str
        The code, which stays the same between versions; it keys the sentences of
        `pbrdf_bayes.words`.
    scans : tuple of str
        Labels of the scans that the verdict is about.
    lines : tuple of int
        Lines of the file that it is about.
    """

    name: str
    scans: tuple[str, ...] = ()
    lines: tuple[Whole, ...] = ()


class Finding(Struct, frozen=True):
    """A mistake of the bench or of the file, or something odd, that the readings show.

    Attributes
    ----------
    code, sample : str
        What it is, e.g. ``theta_r_sign``; or `Check.name` of the check that found it.
    verdict : {"PASS", "WARN", "FAIL"}
    scans : tuple of str
        Labels of the scans that show it.
    lines : tuple of int
        Lines of the file, where single readings show it.
    size : float or None
        How large it is; the unit stands in the statement.
    statement, remedy : str
    """

    code: str
    sample: str
    verdict: Judged
    scans: tuple[str, ...]
    lines: tuple[Whole, ...]
    size: float | None
    statement: str
    remedy: str


class Findings(Struct, frozen=True, kw_only=True):
    """All findings about a file, for ``check --json``."""

    findings: tuple[Finding, ...] = field(default_factory=tuple)
