"""Every sentence of every verdict, once, by its code.

A verdict is computed where its numbers are (`pbrdf_bayes.verdicts`, `pbrdf_bayes.readings.checks`,
`pbrdf_bayes.conform`). Its text is written here, and pages, files and the command line repeat it.
`OF_READINGS` and `OF_FIT` hold title, unit, statement and advice of each code, `PHRASES` the
variants and parts. Fields in braces are the numbers of a verdict.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from pbrdf_bayes.records.checks import Check


class Words(NamedTuple):
    """Of one code; the advice is for WARN and FAIL, ``fail`` replaces it for FAIL."""

    title: str
    unit: str
    statement: str = ""
    advice: str = ""
    fail: str = ""


class Mistake(NamedTuple):
    """Of one mistake of the bench."""

    statement: str
    remedy: str


NOT_CONSTANTS = (
    "The parameters are fitted numbers, not material constants, and their uncertainties are not "
    "valid as such."
)
_LEFT_OUT = "They do not enter centre, limits, trend and spread."
LOCAL_NORMAL = "local normal approximation"
_LOOK_WHERE = "Look at the residuals for the angle at which the misfit starts."

OF_READINGS = {
    "repeatability": Words(
        "Repeated readings agree", "dex",
        "{n} repeated readings agree to {value:.3f} dex ({percent:.1f} %). Scan {label} deviates "
        "most, by {mean:+.3f} dex on average.",
        "Look for drift of the source and for another spot on the sample. Flag the scan that is "
        "off, or let each scan have its own scale (u_brdf_cal).",
    ),
    "symmetry": Words(
        "Forward and backward sides agree at normal incidence", "dex",
        "Both sides of {label} agree to {value:.3f} dex rms.",
        "Check the alignment of the sample and the stray light on either side.",
    ),
    "dhr_level": Words(
        "BRDF level is consistent with the DHR", "factor",
        "{compared} compared with a DHR reading. The farthest is {label}: its DHR is "
        "{dhr:.3g}, and the scan gives {low:.2g} to {high:.2g}.",
        "Check the units: DHR is a fraction; BRDF is per steradian, not multiplied by pi or "
        "cos(theta_r). Check the reference of both instruments. brdf_scale = 'relative' fits the "
        "shape of the scans alone.",
    ),
    "spikes": Words(
        "No isolated points", "points",
        "The BRDF spans {low:.3g} to {high:.3g} sr^-1 ({decades:.1f} decades). The scans have "
        "{points}{listed}.",
        "Look for a reflection in the set-up, the edge of an obscured region or a lost reading "
        "there. Flag the rows.",
    ),
    "coverage": Words(
        "Scans cover their specular direction", "scans",
        "{complete} of {counted} scans are complete.",
        "Extend these scans past theta_r = theta_i with at least {least} points, or expect wider "
        "intervals for rho0 and sigma_n0.",
    ),
    "s_equals_p": Words(
        "s and p agree at normal incidence", "dex",
        "log10 of {s} over {p} at theta_r = 0 is {ratio:+.3f} dex (standard error {error:.3f}), a "
        "factor of {factor:.3f}.",
        "Check the gain and the leakage of the polarisers. Check whether the sample was turned "
        "between the scans. A grain in the paint makes s and p differ too.",
    ),
    "noise": Words(
        "Noise from point to point", "%",
        "The median of the scans is {value:.2g} %. They range from {least:.2g} % to {most:.2g} % "
        "({label}). Slow variations along a scan do not count.",
    ),
}  # fmt: skip

OF_FIT = {
    "misfit": Words(
        "Model misfit", "dex",
        "The model leaves {value:.3f} dex rms ({percent:.0f} %) at its least-squares optimum. "
        "{repeats}",
        "The misfit is larger than the noise. Intervals that take the model as exact are too "
        f"narrow. {_LOOK_WHERE}",
        f"The model does not describe these readings. {NOT_CONSTANTS}",
    ),
    "residual_correlation": Words(
        "Residual correlation", "1",
        "Residuals of neighbouring angles correlate with {value:.2f}.",
        "Neighbouring readings are not independent. They hold the information of about "
        "{share:.2g} % of the rows. The intervals of this i.i.d. likelihood are too narrow, by a "
        "factor of the order of {factor:.1f}.",
    ),
    "rhat": Words(
        "Agreement of ensembles (nested R-hat)", "1",
        "The largest R-hat between {n} ensembles is {value:.4f}.",
        "The ensembles disagree. Give more steps (max_steps).",
    ),
    "ess": Words(
        "Effective sample size", "1",
        "The smallest bulk or tail effective sample size is {value:.0f}.",
        "Means and intervals are noisy. Give more steps (max_steps).",
    ),
    "k_hat": Words(
        "Importance weights (Pareto k-hat)", "1",
        "Pareto k-hat is {value:.2f}. Importance sampling is reliable here.",
    ),
    "chain_length": Words(
        "Chain length in autocorrelation times", "1",
        "The kept steps are {value:.0f} autocorrelation times of {time:.1f} steps.",
        "The autocorrelation estimate needs a longer chain (max_steps).",
    ),
    "modes": Words(
        "Separate optima", "nat",
        "{n_best} of {n_starts} starts end at the best optimum. {rivals}",
        "Several parameter sets explain the data. The weights between them are only as good as "
        "the sampler's jumps. Add a polarisation, an angle or a DHR reading.",
    ),
    "identifiability": Words(
        "Identifiability", "1",
        "The data explain at least {percent:g} % of the prior variance of every physical "
        "parameter{basis}.",
        "The prior decides these parameters. Add polarised scans, DHR readings or a narrower, "
        "defensible prior before you quote them.",
    ),
    "bounds": Words(
        "Parameters at a bound", "1",
        "No physical parameter is pressed against the bound of its prior{most}.",
        "The optimum lies outside the range of the prior. The model serves as a description only. "
        f"{NOT_CONSTANTS}",
    ),
    "prior_sensitivity": Words(
        "Sensitivity to the prior (power scaling)", "1",
        "No physical parameter is sensitive to the power of the prior. The largest sensitivity is "
        "{value:.3f} ({name}); to the power of the readings it is {readings:.2f}.",
    ),
    "discrepancy": Words(
        "Discrepancy of the model", "1",
        "The model is off by {dex:.3f} dex ({percent:.1f} %) along a scan, over lengths of "
        "{length:.0f} deg. The white noise is {noise:.1f} %. Standard deviations are {low:.2g} to "
        "{high:.2g} times those under independent readings.",
        f"The intervals allow for a misfit of each scan's own. {_LOOK_WHERE}",
        "The model does not apply: its misfit is as large as the features that it explains. Look "
        "for the missing effect. Where whole scans are off, give them a scale of their own "
        "(u_brdf_cal, or brdf_scale = 'relative').",
    ),
    "dhr_misfit": Words(
        "DHR misfit", "1",
        "DHR readings are {percent:.0f} % rms from the model beyond their stated noise.",
        "BRDF and DHR contradict each other, or the DHR noise is as large as that. Check the "
        "calibration of both. Fit each alone and compare.",
    ),
    "common_misfit": Words(
        "Misfit common to the scans", "1",
        "The misfits of {n} scans have a correlation of {value:.2f}. Independent misfits would be "
        "as alike with probability {p:.2g}.",
        "The intervals take the misfits of two scans as independent. A shared misfit makes them "
        "too narrow, those of sigma_n0 and rho0 most. Look for an error of the angle scale or the "
        "detector, or try another line shape.",
    ),
    "applicability": Words("Applicability of the model", "dex"),
    "coverage": Words(
        "Readings inside the 90 % predictive band", "1",
        "{percent:.1f} % of the {n} fitted readings lie inside the 90 % predictive band.",
        "The noise model does not describe the scatter of the readings.",
    ),
    "loo": Words(
        "Leave-one-out (Pareto k-hat)", "1",
        "All other readings predict each of {n} readings. The log densities sum to {elpd:.0f} ± "
        "{u_elpd:.0f}, with {p_loo:.1f} effective parameters. The largest Pareto k-hat is "
        "{value:.2f}, of {place}.{influential}",
        "Single readings decide the posterior: {places}. Measure them again, or flag them and "
        "compare the two fits.",
    ),
    "outliers": Words(
        "Readings at odds with all others", "sd",
        "The reading farthest from the prediction of all others is {place}, {z:+.1f} standard "
        "deviations.",
        "Look them up in the laboratory's records: a slip, stray light, the shadow of the "
        "detector. They widen the inferred noise and pull the parameters. Flag wrong readings and "
        "fit again.",
    ),
    "pit": Words(
        "Probability integral transform by scan (p-value)", "1",
        "The readings of each of {n} scans scatter about the prediction of all others as expected.",
    ),
    "holdout": Words(
        "Prediction of scans not fitted", "dex", "",
        "Curves at angles that were not measured are less certain than their bands.",
    ),
    "holdout_angles": Words(
        "Prediction of angles left out", "dex",
        "The other scans predict {n} angles of incidence. {worst}",
        "The bands are too narrow for {missed}. The model does not carry over between angles of "
        "incidence. Curves at angles that were not measured are less certain than their bands.",
    ),
    "holdout_polarization": Words(
        "Prediction of the other polarisation", "dex",
        "One polarisation predicts the other, in {n} cases. {worst}",
        "The bands are too narrow for {missed}. One set of n, k, σ_N0 and ρ_0 does not describe "
        "both polarisations. Check the polariser and the scale of either. Do not quote n and k.",
    ),
    "not_finite": Words(
        "Points the model rejects", "1",
        "The model gave no finite density at {value:.0f} points inside the prior. The first is "
        "{first}.",
        "They were left out as impossible. Near the posterior they cut it: narrow the prior, or "
        "report these points (summary.json has all parameters).",
    ),
}  # fmt: skip

MISTAKES = {
    "theta_r_sign": Mistake(
        "The lobe of {names} lies at negative theta_r, on the side of the source.",
        "Reverse the sign of theta_r_deg there: + is the forward side.",
    ),
    "sign_lost": Mistake(
        "The angles of {names} occur twice with different values, and no theta_r is negative.",
        "Restore the sign of theta_r_deg: + forward, - backward.",
    ),
    "swapped_polarization": Mistake(
        "p is brighter than s in {where}. Every surface reflects s at least as much.",
        "Exchange s and p in the column polarization there.",
    ),
    "cosine_factor.times": Mistake(
        "The backward side falls like cos(theta_r) to the power {size:.2f} towards grazing "
        "theta_r, in {n} scan ends. A BRDF levels out there.",
        "The values look like BRDF times cos(theta_r). Divide them by cos(theta_r).",
    ),
    "cosine_factor.over": Mistake(
        "The backward side rises like cos(theta_r) to the power {size:.2f} towards grazing "
        "theta_r, in {n} scan ends. A BRDF levels out there.",
        "The values look like BRDF over cos(theta_r). Multiply them by cos(theta_r).",
    ),
    "clipped": Mistake(
        "The highest {n} readings of scan {label} are one number, {size:.4g} sr^-1. The detector "
        "was at its limit.",
        "Flag these rows, or measure the peak again with less gain.",
    ),
    "shadow": Mistake(
        "Readings about theta_r = -theta_i of {names} lie {depth:.2g} dex below the curve on both "
        "sides. The detector stands in the beam.",
        "Give these rows the flag obscured.",
    ),
    "shuffled": Mistake(
        "Neighbouring readings of scan {label} differ as much as any two of it ({percent:.0f} % "
        "from point to point).",
        "Check whether the values of this scan still belong to their angles.",
    ),
    "scan_gain": Mistake(
        "Scan {label} lies a factor of {size:.3g} from the level of the other scans.",
        "Check the gain and the filter of this scan, or flag it.",
    ),
    "pi_factor.times": Mistake(
        "The scans integrate to {size:.2f} times the DHR, about pi.",
        "Divide the BRDF by pi if the values are reflectance factors, or check both scales.",
    ),
    "pi_factor.over": Mistake(
        "The scans integrate to {size:.2f} times the DHR, about 1/pi.",
        "Multiply the BRDF by pi if the values are BRDF over pi, or check both scales.",
    ),
    "zero_theta_r": Mistake(
        "At normal incidence the scans are symmetric about theta_r = {size:+.2f} deg.",
        "Correct theta_r_deg by {shift:+.2f} deg, or theta_i_deg, or align the goniometer.",
    ),
    "stated_sigma": Mistake(
        "Readings scatter {size:.3g} times as much from point to point as sigma states.",
        "Check the unit of sigma: it is the standard uncertainty of value in the same unit.",
    ),
}
"""Statement and remedy of mistakes of the bench."""

PHRASES = {
    # readings
    "repeatability.skip": "No geometry was measured more than once.",
    "symmetry.skip": "No scan at normal incidence has both sides.",
    "symmetry.zero": " They agree to {left:.3f} dex about theta_r = {centre:+.2f} deg.",
    "symmetry.shift": "Correct theta_r_deg by {shift:+.2f} deg, or realign the zero of the "
    "goniometer.",
    "dhr_level.skip": "No scan and DHR reading of one polarisation can be compared.",
    "spikes.skip": "No scan has {least} points or more.",
    "spikes.one": "{label}, theta_r {theta_r:.6g} deg ({size:+.2f} dex)",
    "spikes.line": "line {row}, {label}, theta_r {theta_r:.6g} deg ({size:+.2f} dex)",
    "coverage.skip": "No BRDF scan lies in the plane of incidence.",
    "coverage.out_of_plane": " {n} out of the plane of incidence do not count.",
    "coverage.missed": " The specular direction is missing in {labels}.",
    "coverage.few": " Fewer than {least} points are in {labels}.",
    "s_equals_p.skip": "No pair of s and p scans of one plane at normal incidence covers "
    "theta_r = 0.",
    "noise.skip": "No scan has {least} points or more.",
    # repeatability of a reading
    "repeats.stated": "stated by the column sigma",
    "repeats.inferred": "inferred from the scatter of neighbouring readings",
    "repeats.above_stated": "inferred from the scatter of neighbouring readings, more than is "
    "stated by the column sigma",
    "repeats.unknown": "not known",
    "misfit.repeats": "Readings repeat to {dex:.3f} dex ({source}).",
    "misfit.unknown": "The repeatability of the readings is not known.",
    # sampling
    "modes.none": "No rival is near.",
    "modes.rivals": "{n} other within {limit:g} nats. {share}",
    "modes.no_draw": "No draw is near it: the weight between them is not known.",
    "modes.share": "({percent:.1f} ± {error:.1f}) % of the draws are near it.",
    "identifiability.weak": "The data do not identify {listed} (variance explained by the "
    "data{basis}).",
    "identifiability.basis": ", the readings counted as {percent:.2g} % of their number for their "
    "correlation",
    "bounds.pressed": "The bound of the prior holds {listed}.",
    "bounds.share": "{name} ({percent:.0f} % of the draws in the last per cent of its prior)",
    "bounds.optimum": "{name} (an optimum is there, and {percent:.0f} % of the draws in the last "
    "per cent of its prior)",
    "bounds.most": " (at most {percent:.0f} % of the draws, of {name})",
    "bounds.dielectric": " k is at 0, a dielectric as far as the readings show; that is no bound.",
    "prior_sensitivity.found": "The power of the prior matters for {listed}.",
    "prior_sensitivity.one": "{name} ({prior:.2f}, and {readings:.2f} for that of the readings)",
    "prior_sensitivity.dominated": "{names}: the prior decides, not the readings. Quote with the "
    "prior, or add readings (both polarisations, DHR).",
    "prior_sensitivity.pulled": "{names}: prior and readings pull apart. Check the preset of "
    "priors against the material, and the readings against their scale.",
    "prior_sensitivity.shared": "{names}: prior and readings share the decision. Defend the prior, "
    "or fit with a wider one and compare.",
    # predictions
    "place": "{label} at {angle:g} deg",
    "place.line": "{label} at {angle:g} deg, line {row}",
    "loo.influential": " {readings} much influence (k-hat above {limit:.2f}), until scored by a "
    "sample without them.",
    "outliers.found": "{n} of {all} readings contradict the prediction of all others: {listed}.",
    "outliers.one": "{place}, {z:+.1f} sd",
    "pit.found": "The readings of {n} of {all} scans do not scatter about the prediction of all "
    "others as expected: {listed}.",
    "pit.one": "scan {label}, {departure}",
    "pit.shape": "tails or skewness of the residuals",
    "pit.biased": "residuals biased (mean {mean:+.1f} sd)",
    "pit.wide": "residuals too wide (sd {sd:.1f})",
    "pit.narrow": "residuals too narrow (sd {sd:.1f})",
    "pit.shape.advice": "Residuals are not normal. Look for outliers, and for angles where the "
    "model bends otherwise than the readings.",
    "pit.biased.advice": "A scan is biased: its scale, its alignment or the model is off. State "
    "the uncertainty of the scale (u_brdf_cal), or leave it free (brdf_scale = 'relative').",
    "pit.wide.advice": "Residuals are wider than the noise of their polarisation. Intervals and "
    "bands are too narrow for that scan.",
    "pit.narrow.advice": "Residuals are narrower than the noise of their polarisation. Another "
    "scan inflates that noise.",
    "pit.all_narrow.advice": "Residuals of every scan are narrower than the noise. The prior of "
    "the noise (s_rel) is too high, or the readings were smoothed.",
    "pit.stated.advice": "The column sigma states {stated:.3f} dex, and neighbouring readings "
    "scatter by {found:.3f} dex. The likelihood takes sigma as independent noise of each reading. "
    "Errors that the readings of a scan share (the gain of a run, the scale) are not independent. "
    "State the scatter of single readings in sigma, and the shared part in u_brdf_cal, or leave "
    "the scale free (brdf_scale = 'relative').",
    "holdout.recipe": "The model was fitted to DHR and the scan {label} alone. It predicts "
    "{shapes}{scans} within {rms:.3f} dex rms. The 90 % predictive band holds {percent:.0f} % of "
    "their readings and is {width:.3f} dex wide.",
    "holdout.case": "The model was fitted to {fitted}. It predicts {name} within {rms:.3f} dex "
    "rms. The 90 % predictive band holds {percent:.0f} % of the readings and is {width:.3f} dex "
    "wide.",
    "holdout.worst": "The worst case is {name}: {rms:.3f} dex rms, with {percent:.0f} % of its "
    "readings inside the 90 % predictive band of {width:.3f} dex.",
    # applicability
    "applicability.applies": "Nothing speaks against the model for this material.",
    "applicability.descriptive": f"The model is descriptive only: {{reasons}}. {NOT_CONSTANTS}",
    "applicability.fails": f"The model does not apply: {{reasons}}. {NOT_CONSTANTS}",
    "applicability.bound": "{name} is at the bound of its prior",
    "applicability.angle": "it predicts angles left out to {rms:.2f} dex only",
    "applicability.polarization": "it predicts the other polarisation to {rms:.2f} dex only",
    "applicability.loose": "its rms is {rms:.3f} dex, and readings repeat to {dex:.3f} dex "
    "({source})",
    "applicability.tested": "angles left out are predicted to {rms:.3f} dex",
    "applicability.untested": "not tested: prediction of angles left out{why}",
    "applicability.one_angle": ": that takes BRDF scans at two angles of incidence or more",
    "applicability.not_asked": '; fit with holdout = "all" or a higher accuracy',
    "applicability.try_effects": "Fit with --effects auto: other effects of the sample may explain "
    f"the rest. {_LOOK_WHERE}",
    "applicability.tried": f"No effect that was tried explains the rest. {_LOOK_WHERE}",
    "assumed.fixed": "{name} = {value:g} was assumed, not measured.",
    "assumed.prior": "{name} was assumed by its prior, {prior}, rather than measured.",
    "assumed.k_bounded": "k is 0 at the best fit. The readings give an upper limit of k, and no "
    "value.",
    # choice of effects
    "effects.best": "{model} predicts readings left out with errors {percent} % smaller than "
    "{base}.{held}",
    "effects.none": "Nothing beyond {base} predicts readings left out better.{held}",
    "effects.held": " n is held at {n}: it is not identified without s and p scans or DHR.",
    "effects.nothing_left_out": "{why}: nothing could be left out, and no effect is added.",
    "effects.no_statistics": "The choice has no statistics behind it: nothing could be left out.",
    "effects.few": "The choice has almost no statistics behind it: only {n} cases could be left "
    "out. Only an effect with about the same gain in each stands out from chance. Add scans at "
    "more angles of incidence.",
    # headline and pages of a run
    "headline.not_converged": "The sampler did not converge within its budget. These numbers are "
    "provisional.",
    "headline.fail": "Do not use these values as they stand: {statement}",
    "headline.warn": "Use with care: {statement}",
    "headline.readings": "Check the readings first: {statement}",
    "headline.dhr_alone": "The {model} describes the DHR readings. See which parameters they do "
    "not identify.",
    "headline.pass": "The {model} describes the readings to {rms:.3f} dex rms ({percent:.1f} %), "
    "and every check passes.",
    "page.not_converged.title": "NOT CONVERGED: the numbers on this page are not a result",
    "page.not_converged": "The sampler used up its budget before it met its thresholds. Values, "
    "intervals and bands are provisional. The failed diagnostics below give the remedy.",
    "page.failed.title": "FAIL: do not use these values as they stand",
    "page.failed": "At least one check failed. The intervals hold only if the model does. The "
    "checks below give the reason and the remedy.",
    "reservation.not_converged": "Provisional: the sampler did not converge.",
    "reservation.failed": "Intervals and bands are not valid as they stand: a check failed.",
    "batch.not_converged": "{folder}: not converged within max_steps. Results are kept and marked. "
    "Raise max_steps in the configuration, and go on with --resume",
    "batch.failed": f"{{samples}} the verdict Fail. {NOT_CONSTANTS} Crosses show them. {_LEFT_OUT}",
    "batch.unidentified": "The readings do not identify {listed}: the prior decides. Crosses show "
    f"these numbers. {_LEFT_OUT}",
    "parameter.assumed": "assumed, not measured",
    "parameter.identified": "identified by the data",
    "parameter.prior": "not identified: the prior decides",
    # design
    "design.not_converged": "The sampler did not converge: the draws behind this design are "
    "provisional. Resume the fit, or fit again with a higher --accuracy, and ask again.",
    "design.not_constants": "The model does not describe this sample (verdict of the fit: "
    f"{{verdict}}). {NOT_CONSTANTS} This design holds for these numbers only.",
    "design.fail": "The verdict of the fit is FAIL. Its report names the failed checks. This "
    "design holds for these draws only.",
    "design.ddr": "fit does not read DDR yet",
    # conformity
    "conform.accept": "The sample is accepted as conforming with {name}",
    "conform.reject": "The sample is rejected as not conforming with {name}",
    "conform.undecided": "Conformity with {name} is undecided",
    "conform.wrong": "more likely wrong than right: the {whose}'s risk of this decision is "
    "{percent:.0f} %, which the rule does not limit",
    "conform.reserved": "a limit that cannot be judged leaves the joint verdict open",
    "conform.none": "no limit can be judged",
    "conform.one_undecided": "a limit is undecided",
    "conform.risk": "accepting would take a risk of {accept:.2g} (at most {consumer:g}), rejecting "
    "one of {reject:.2g} (at most {producer:g})",
    "conform.all_guard": "the guard bands leave nothing of the tolerance interval",
    "conform.in_guard": "the estimate lies in a guard band",
    "conform.finer": "the Monte Carlo error leaves it open: fit with a higher --accuracy",
    "conform.finest": "the Monte Carlo error leaves it open; no --accuracy makes more draws",
    "conform.few_draws": "{n:.0f} effective draws cannot show a risk below {least:.2g}, and "
    "{allowed:g} is allowed: {remedy}",
    "conform.allow": "allow {risk:.2g} or more",
    "conform.reference_accuracy": "fit with --accuracy reference",
    "conform.not_converged": "the sampler did not converge",
    "conform.does_not_apply": "the model does not apply to this sample",
    "conform.no_parameter": "{name} is no parameter of this fit",
    "conform.fixed": "{name} was held fixed, not measured",
    "conform.not_identified": "the readings do not identify {name}: the prior would decide",
    "conform.no_properties": "the model is descriptive only: its parameters are no properties of "
    "the sample",
    "conform.misfit_unknown": "the model is descriptive only, and its misfit here is not known",
    "conform.failed": "the fit failed its checks (verdict FAIL)",
    "conform.reference": "reference: {reason}",
}


def say(key: str, **numbers: Any) -> str:
    """A phrase with its numbers.

    Examples
    --------
    >>> say("applicability.bound", name="n")
    'n is at the bound of its prior'
    """
    return PHRASES[key].format(**numbers)


def of_mistake(code: str, **numbers: Any) -> tuple[str, str]:
    """Statement and remedy of a mistake of the bench.

    Examples
    --------
    >>> of_mistake("scan_gain", label="s 20 deg", size=2.0)[0]
    'Scan s 20 deg lies a factor of 2 from the level of the other scans.'
    """
    statement, remedy = MISTAKES[code]
    return statement.format(**numbers), remedy.format(**numbers)


def counted(n: int, noun: str) -> str:
    """A number with its noun.

    Examples
    --------
    >>> counted(1, "scan"), counted(2, "other scan"), counted(0, "isolated point")
    ('1 scan', '2 other scans', 'no isolated points')
    """
    return f"{n or 'no'} {noun}{'s' * (n != 1)}"


def listed(words: Sequence[str]) -> str:
    """Words with commas and an ``and``.

    Examples
    --------
    >>> listed(["n", "k", "rho0"]), listed(["n"])
    ('n, k and rho0', 'n')
    """
    return f"{', '.join(words[:-1])} and {words[-1]}" if len(words) > 1 else words[0]


def judged(
    code: str, value: float, threshold: float, verdict: str, *, of: dict[str, Words] = OF_FIT,
    statement: str = "", more: str = "", advice: str = "", scans: Sequence[str] = (),
    lines: Sequence[int] = (), **numbers: Any,
) -> Check:  # fmt: skip
    """A verdict in words.

    Parameters
    ----------
    code : str
        Key of the table.
    value, threshold : float
    verdict : {"PASS", "WARN", "FAIL", "SKIP"}
    of : dict of str to Words
        `OF_FIT` or `OF_READINGS`.
    statement, advice : str
        In place of those of the table. No advice goes with PASS and SKIP.
    more : str
        Follows the statement.
    scans, lines : sequence
        The scans and the lines of the file that the verdict is about.
    **numbers
        Fields of the sentences, beside ``value`` and ``threshold``.

    Examples
    --------
    >>> judged("ess", 20.0, 1000.0, "FAIL").statement
    'The smallest bulk or tail effective sample size is 20.'
    """
    words = of[code]
    fields = {"value": value, "threshold": threshold, **numbers}
    remedy = words.fail if verdict == "FAIL" and words.fail else words.advice
    return Check(
        name=code, title=words.title, value=value, threshold=threshold, unit=words.unit,
        verdict=verdict, statement=(statement or words.statement.format(**fields)) + more,
        advice=(advice or remedy.format(**fields)) if verdict in ("WARN", "FAIL") else "",
        scans=tuple(scans), lines=tuple(lines),
    )  # fmt: skip


def skipped(code: str, **numbers: Any) -> Check:
    """A check of the readings that the measurement gives no occasion for."""
    nan, reason = float("nan"), say(f"{code}.skip", **numbers)
    return judged(code, nan, nan, "SKIP", of=OF_READINGS, statement=reason)
