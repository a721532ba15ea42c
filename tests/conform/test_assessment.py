"""``conform``, ``--limits``, ``--document`` and ``--pdf``: real runs, real files, a real browser."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from scipy.stats import norm

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import Analysis, load_analysis
from pbrdf_bayes.cli import main
from pbrdf_bayes.conform.assessment import assess_conformity, prior_shares
from pbrdf_bayes.conform.measurands import draw_measurands, sample_of
from pbrdf_bayes.document import Document, fill_in, refuse_shared_items, run_number
from pbrdf_bayes.errors import ConfigError
from pbrdf_bayes.io.document_toml import read_document
from pbrdf_bayes.io.limits_toml import read_limits, specification_from_table
from pbrdf_bayes.io.print_pdf import find_browser, print_pdf
from pbrdf_bayes.measurement import measurement_from_columns
from pbrdf_bayes.report import render_report
from pbrdf_bayes.report.document import css_string
from pbrdf_bayes.specification import DecisionRule, Limit, Specification
from pbrdf_bayes.verbs.conform import text_table
from pbrdf_bayes.workflow.fitting import fit_file

pytestmark = pytest.mark.usefixtures("signals_as_before")

LIMITS = """\
specification = "PS-114 <issue 3>"
[[limit]]
name = "index"
parameter = "n"
lower = 1.4
upper = 1.6
[[limit]]
name = "glare & co"
quantity = "brdf"
polarization = "s"
theta_i_deg = 45
theta_r_deg = "-60:60:20"
upper = 10.0
"""
DIFFERENCE = """\
[[difference]]
name = "shade"
quantity = "brdf"
polarization = "s"
theta_i_deg = 20
theta_r_deg = "-40:40:20"
tolerance = 0.2
[[difference]]
name = "dn"
parameter = "n"
tolerance = 0.002
"""
DHR = """\
[[limit]]
name = "DHR"
quantity = "dhr"
polarization = "u"
theta_i_deg = 10
upper = 0.5
"""
DOCUMENT = """\
title = "Test report"
report_number = "A-7 </style><script>alert(1)</script>"
laboratory = "Laboratory <b>one</b>"
item_description = "paint"
date_received = 2026-02-26
date_measured = "2026-03-02/2026-03-05"
date_issued = 2026-03-09
note = "first line\\nsecond line"
"""


def test_a_prediction_that_the_prior_makes_is_not_decided() -> None:
    """One DHR reading: it tells the DHR close by, and next to nothing of that of p at 65 deg."""
    m = measurement_from_columns(
        sample="one", wavelength_um=1.0, quantity=["dhr"], polarization=["s"], theta_i_deg=[10.0],
        theta_r_deg=[np.nan], value=pb.dhr(pb.GREEN_PAINT, [10.0], "s"), sigma=[0.002],
    )  # fmt: skip
    found = pb.fit(m, pb.RunConfig(accuracy="draft", holdout="none"), seed=1)
    assert not any(row["identified"] for row in found.summary["parameters"].values())
    places = {"at the reading": ("s", 10.0), "close by": ("p", 15.0), "far": ("p", 65.0)}
    limits = tuple(
        Limit(name=name, quantity="dhr", polarization=q, theta_i_deg=(angle,), upper=0.9)
        for name, (q, angle) in places.items()
    )
    shares = prior_shares(sample_of(found), limits)
    spread = {
        name: np.var(np.log(draw_dhr(found, q, angle))) for name, (q, angle) in places.items()
    }
    posterior = pb.build_posterior(m, pb.RunConfig(accuracy="draft"))
    prior = posterior.sample_prior(np.random.default_rng(1), 2000)
    for name, (q, angle) in places.items():
        before = np.var(np.log(dhr_of(prior, q, angle)))
        assert shares[name] == pytest.approx(spread[name] / before, rel=0.2)
    judged = assess_conformity(found, Specification(limits=limits))["limits"]
    assert [limit["verdict"] for limit in judged] == ["ACCEPT", "ACCEPT", "UNDECIDED"]
    assert judged[2]["reason"].endswith("sigma_n0, rho0: the prior would decide")


def draw_dhr(found: Analysis, q: str, angle: float) -> np.ndarray:
    """DHR of every fourth draw, one by one."""
    draws = found.draws["posterior"].dataset
    x = np.stack([draws[name].to_numpy().ravel()[::4] for name in ("n", "k", "sigma_n0", "rho0")])
    return dhr_of(x.T, q, angle)


def dhr_of(sets: np.ndarray, q: str, angle: float) -> np.ndarray:
    paints = [pb.Parameters(n=n, k=k, sigma_n0=a, rho0=r) for n, k, a, r in sets]
    return np.array([float(pb.dhr(paint, angle, q)) for paint in paints])


@pytest.fixture(scope="module")
def run(finished_run: Path) -> Analysis:
    return load_analysis(finished_run)


@pytest.fixture(scope="module")
def other(small_csv: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same readings with another seed: the same posterior, other draws."""
    folder = tmp_path_factory.mktemp("other") / "run"
    fit_file(small_csv, pb.RunConfig(accuracy="draft", holdout=False), out=folder, seed=2)
    return folder


def write(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


# ---------------------------------------------------------------------------------- the measurands


def limit(**keys: object) -> Limit:
    return specification_from_table({"limit": [{"name": "x", "upper": 1.0, **keys}]}).limits[0]


def test_a_brdf_not_measured_has_the_discrepancy_in_it(run: Analysis) -> None:
    """ln BRDF has the variance of the model's curve and the mean of tau^2 together."""
    sample = sample_of(run)
    wanted = limit(quantity="brdf", polarization="s", theta_i_deg=45, theta_r_deg=[-30, 30])
    values = np.log(draw_measurands(sample, [wanted])["x"])
    tau = sample.x[:, sample.posterior.parameter_names.index("tau")]
    model = pb.predict_scene(run, pb.Scene(theta_i_deg=(45.0,), theta_r_deg=(-30.0, 30.0),
                                           polarizations=("s",), n_draws=4000)).brdf  # fmt: skip
    assert model is not None
    sd = (np.log(model[0, 0, :, 0, 2]) - np.log(model[0, 0, :, 0, 0])) / (2 * 1.645)
    assert values.std(axis=0) ** 2 == pytest.approx(sd**2 + np.mean(tau**2), rel=0.15)


def test_a_measured_brdf_is_better_known(run: Analysis) -> None:
    at = {"quantity": "brdf", "polarization": "s", "theta_r_deg": [0, 30]}
    sample = sample_of(run)
    measured = draw_measurands(sample, [limit(theta_i_deg=20, **at)])["x"]
    elsewhere = draw_measurands(sample, [limit(theta_i_deg=21, **at)])["x"]
    assert np.all(np.log(measured).std(axis=0) <= np.log(elsewhere).std(axis=0) * 1.05)


def test_limits_share_draws_and_paths(run: Analysis) -> None:
    """A ratio is that of the two BRDF of the same draw; an angle named twice is the same point."""
    at = {"theta_i_deg": 33, "theta_r_deg": [-20, 10]}
    rows = [{"name": q, "upper": 9.0, "quantity": "brdf", "polarization": q, **at} for q in "sp"]
    rows.append({"name": "r", "upper": 9.0, "quantity": "brdf_ratio", **at})
    found = draw_measurands(sample_of(run), specification_from_table({"limit": rows}).limits)
    assert np.array_equal(found["r"], found["s"] / found["p"])


def test_unpolarised_light_where_s_and_p_were_measured(run: Analysis) -> None:
    """Mean and covariance by dense algebra of the two scans, draw by draw of the parameters."""
    sample = sample_of(run)
    wanted = np.array([-40.0, 0.0, 20.0, 33.0])
    u = limit(quantity="brdf", polarization="u", theta_i_deg=20, theta_r_deg=wanted.tolist())
    found = draw_measurands(sample, [u])["x"]
    names, m = sample.posterior.parameter_names, sample.posterior.measurement

    def conditional(x: dict[str, float], q: str) -> tuple[np.ndarray, np.ndarray]:
        """Mean and covariance of the BRDF for one polarisation, from its readings alone."""
        paint = pb.Parameters(**{key: x[key] for key in ("n", "k", "sigma_n0", "rho0")})
        mine = (m.brdf.theta_i_deg == 20.0) & (m.brdf.polarization == q)
        read = m.brdf.theta_r_deg[mine]
        f_read, f = (pb.brdf(paint, 20.0, angles, q) for angles in (read, wanted))

        def k(a: np.ndarray, b: np.ndarray) -> np.ndarray:
            r = np.sqrt(3.0) * np.abs(a[:, None] - b) / x["ell_deg"]
            return np.asarray(x["tau"] ** 2 * (1.0 + r) * np.exp(-r))

        gain = pb.RunConfig().u_brdf_cal ** 2
        c = k(read, read) + gain + x[f"s_rel_{q}"] ** 2 * np.eye(read.size)
        gains = np.linalg.solve(c, k(read, wanted)).T
        mean = gains @ (np.log(m.brdf.value[mine]) - np.log(f_read))
        v = k(wanted, wanted) - gains @ k(read, wanted)
        e = f * np.exp(mean + 0.5 * np.diag(v))  # of a log-normal law
        return e, np.outer(e, e) * np.expm1(v)

    means, within = [], []
    for row in sample.x[::20]:
        x = dict(zip(names, row, strict=True))
        (s, var_s), (p, var_p) = conditional(x, "s"), conditional(x, "p")
        means.append(0.5 * (s + p))
        within.append(0.25 * (var_s + var_p))
    sd = np.sqrt(np.diag(np.mean(within, axis=0) + np.cov(np.array(means).T)))
    error = sd * (1 / len(means) + 1 / len(found)) ** 0.5
    assert np.all(np.abs(found.mean(axis=0) - np.mean(means, axis=0)) < 4.0 * error)
    assert found.std(axis=0) == pytest.approx(sd, rel=0.1)


@pytest.mark.parametrize("theta_i", [20, 45])
@pytest.mark.parametrize("quantity", ["brdf", "dhr"])
def test_unpolarised_light_is_half_s_and_half_p(
    run: Analysis, theta_i: float, quantity: str
) -> None:
    at: dict[str, object] = {"quantity": quantity, "theta_i_deg": theta_i, "upper": 0.9}
    at |= {} if quantity == "dhr" else {"theta_r_deg": [-20, 10]}
    rows = [{"name": q, "polarization": q, **at} for q in "usp"]
    found = draw_measurands(sample_of(run), specification_from_table({"limit": rows}).limits)
    assert found["u"] == pytest.approx(0.5 * (found["s"] + found["p"]), rel=1e-12)


def test_unpolarised_light_that_was_measured_has_its_own_readings(
    tmp_path: Path,
) -> None:
    """Readings 20 % high for unpolarised light alone: the limit on it follows them."""
    m = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=4, theta_i_deg=(30.0,), theta_r_deg=np.linspace(-60.0, 60.0, 21),
        polarizations=("s", "p", "u"),
    )  # fmt: skip
    high = m.brdf.polarization == "u"
    values = np.where(high, 1.2 * m.brdf.value, m.brdf.value)
    pb.write_tidy_csv(replace(m, brdf=replace(m.brdf, value=values)), tmp_path / "u.csv")
    config = pb.RunConfig(accuracy="draft", holdout=False)
    fit_file(tmp_path / "u.csv", config, out=tmp_path / "run", seed=1)
    analysis = load_analysis(tmp_path / "run")
    wanted = limit(quantity="brdf", polarization="u", theta_i_deg=30, theta_r_deg=[-24, 6])
    found = draw_measurands(sample_of(analysis), [wanted])["x"]
    seen = [values[high & (m.brdf.theta_r_deg == angle)][0] for angle in (-24.0, 6.0)]
    assert found.mean(axis=0) == pytest.approx(seen, rel=0.06)


def test_unpolarised_light_alone_has_a_discrepancy_of_its_own(tmp_path: Path) -> None:
    """Its tau is that of unpolarised scans: half of it for s and half for p would be too little."""
    m = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=4, theta_i_deg=(20.0, 60.0), theta_r_deg=np.linspace(-60.0, 60.0, 21),
        polarizations=("u",), relative_noise=0.1,
    )  # fmt: skip
    pb.write_tidy_csv(m, tmp_path / "u.csv")
    config = pb.RunConfig(accuracy="draft", holdout=False)
    fit_file(tmp_path / "u.csv", config, out=tmp_path / "run", seed=1)
    sample = sample_of(load_analysis(tmp_path / "run"))
    wanted = limit(quantity="brdf", polarization="u", theta_i_deg=40, theta_r_deg=[-20, 20])
    found = np.log(draw_measurands(sample, [wanted])["x"])
    names = ("n", "k", "sigma_n0", "rho0")
    assert sample.posterior.parameter_names[:4] == names
    paints = [pb.Parameters(**dict(zip(names, row, strict=False))) for row in sample.x[::8]]
    curves = np.log([pb.brdf(paint, 40.0, [-20.0, 20.0], "u") for paint in paints])
    tau = sample.x[::8, sample.posterior.parameter_names.index("tau")]
    standard = (found[::8] - curves) / tau[:, None]
    assert standard.std(axis=0) == pytest.approx(1.0, abs=4.0 / (2.0 * len(tau)) ** 0.5)


def test_dhr_and_parameter_are_those_of_the_draws(run: Analysis) -> None:
    sample = sample_of(run)
    dhr = limit(quantity="dhr", polarization="p", theta_i_deg=[0, 50])
    n = limit(parameter="n")
    found = draw_measurands(sample, [dhr])["x"]
    names = sample.posterior.parameter_names
    for row in (0, 1234):
        x = dict(zip(names, sample.x[row], strict=True))
        paint = pb.Parameters(**{key: x[key] for key in ("n", "k", "sigma_n0", "rho0")})
        assert found[row] == pytest.approx(pb.dhr(paint, [0, 50], "p"), rel=1e-9)
    assert np.array_equal(draw_measurands(sample, [n])["x"][:, 0], sample.x[:, 0])


def test_a_difference_of_two_runs(run: Analysis, other: Path, tmp_path: Path) -> None:
    """Normal posteriors: P(|dn| <= d) from the means and standard uncertainties of the two."""
    specification = read_limits(write(tmp_path / "l.toml", DIFFERENCE))
    reference = load_analysis(other)
    found = assess_conformity(run, specification, reference)
    dn = next(one for one in found["limits"] if one["name"] == "dn")
    a, b = (r.summary["parameters"]["n"] for r in (run, reference))
    mean, sd = a["mean"] - b["mean"], float(np.hypot(a["sd"], b["sd"]))
    exact = norm.cdf((0.002 - mean) / sd) - norm.cdf((-0.002 - mean) / sd)
    assert dn["u"][0] == pytest.approx(sd, rel=0.05)
    assert dn["probability"]["value"] == pytest.approx(exact, abs=0.03)
    shade = next(one for one in found["limits"] if one["name"] == "shade")
    assert np.all(np.abs(shade["mean"]) < 3 * np.array(shade["u"]))
    assert (shade["unit"], shade["lower"], shade["upper"]) == ("dex", -0.2, 0.2)
    exceeds, p = dn["probability_exceeds"], dn["probability"]
    assert exceeds["value"] == pytest.approx(1.0 - exact, abs=0.03)
    assert (exceeds["low"], exceeds["high"], exceeds["u"]) == (1 - p["high"], 1 - p["low"], p["u"])
    assert f"tolerance is exceeded: {exceeds['value']:.4f} +- " in text_table(found)
    page = render_report(Analysis({**run.summary, "conformity": found}, run.draws, ""))
    assert page.count("exceeds the tolerance: ") == 2
    assert f"exceeds the tolerance: {100.0 * exceeds['value']:.1f} ± " in page
    assert assess_conformity(run, Specification(limits=(limit(parameter="n"),)))["limits"][0][
        "probability_exceeds"
    ] is None  # fmt: skip


@pytest.mark.parametrize(
    ("change", "quantity", "reason"),
    [
        ({"status": "not_converged"}, "dhr", "did not converge"),
        ({"verdict": "FAIL"}, "brdf", "failed its checks"),
        ("does not apply", "brdf", "does not apply"),
        ("descriptive only", "parameter", "descriptive only"),
        ("descriptive only", "dhr", "not known"),
        ("descriptive only", "brdf", ""),
    ],
)
def test_no_verdict_where_the_model_does_not_hold(
    run: Analysis, change: object, quantity: str, reason: str
) -> None:
    summary = dict(run.summary)
    if isinstance(change, dict):
        summary |= change
    else:
        summary["applicability"] = {**summary["applicability"], "verdict": change}
    upper = 1.0 if quantity == "dhr" else 99.0
    keys = {
        "parameter": {"parameter": "n"},
        "dhr": {"polarization": "s", "theta_i_deg": 10},
        "brdf": {"polarization": "s", "theta_i_deg": 20, "theta_r_deg": 0},
    }[quantity]
    wanted = Specification(limits=(limit(quantity=quantity, upper=upper, **keys),))
    found = assess_conformity(Analysis(summary, run.draws, run.config_toml), wanted)
    assert reason in found["limits"][0]["reason"]
    assert found["verdict"] == ("UNDECIDED" if reason else "ACCEPT")


def test_a_parameter_the_fit_has_not_is_undecided(run: Analysis) -> None:
    found = assess_conformity(run, Specification(limits=(limit(parameter="lambert"),)))
    assert found["verdict"] == "UNDECIDED"
    assert found["limits"][0]["mean"] == [None]
    summary = {**run.summary, "conformity": found}
    assert "no parameter of this fit" in render_report(Analysis(summary, run.draws, ""))


def test_more_draws_are_taken_where_there_are_more_that_count(run: Analysis) -> None:
    """A run with 20 000 independent draws shows a risk of 3.69 / 20 000, not of 3.69 / 4000."""
    posterior = run.draws["posterior"].to_dataset()
    many = posterior.isel(draw=np.tile(np.arange(posterior.sizes["draw"]), 5))
    many = many.assign_coords(draw=np.arange(many.sizes["draw"]))
    names = run.summary["parameters"]
    rows = {name: {**row, "ess_bulk": 2e4, "ess_tail": 2e4} for name, row in names.items()}
    config = {**run.summary["config"], "accuracy": "reference"}
    fine = Analysis({**run.summary, "parameters": rows, "config": config},
                    run.draws.copy(), run.config_toml)  # fmt: skip
    fine.draws["posterior"] = xr.DataTree(many)
    rule = DecisionRule(max_consumer_risk=2e-4)
    wanted = Specification(limits=(limit(parameter="n", upper=2.9),), decision=rule)
    found = assess_conformity(fine, wanted)
    assert (found["verdict"], found["n_draws"]) == ("ACCEPT", 20_000)
    assert 1.0 - found["probability"]["low"] == pytest.approx(1.0 - 0.025 ** (1 / 2e4))
    assert len(sample_of(fine, n_points=5000).x) == 4000
    assert "reference, and allow 0.00037" in assess_conformity(run, wanted)["reason"]


# ------------------------------------------------------------------------------- the command line


def test_conform_writes_json_and_report(
    finished_run: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(finished_run, here / "run")
    before = (here / "run" / "summary.json").read_bytes()
    write(here / "l.toml", LIMITS)
    assert main(["conform", "run", "--limits", "l.toml", "--json", "c.json", "--strict"]) == 0
    assert (here / "run" / "summary.json").read_bytes() == before
    said = capsys.readouterr().out
    assert "ACCEPT: PS-114" in said
    found = json.loads((here / "c.json").read_text())
    assert [one["verdict"] for one in found["limits"]] == ["ACCEPT", "ACCEPT"]
    assert main(["conform", "run", "--limits", "l.toml", "--save"]) == 0
    assert load_analysis(here / "run").summary["conformity"] == found
    page = (here / "run" / "report.html").read_text(encoding="utf-8")
    assert page == render_report(load_analysis(here / "run"))
    assert "PS-114 &lt;issue 3&gt;" in page
    assert "glare &amp; co" in page
    write(here / "l.toml", LIMITS.replace("1.6", "1.41"))
    assert main(["conform", "run", "--limits", "l.toml", "--strict"]) == 4


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no [[limit]]"),
        ('rule = "rsik"\n' + LIMITS, "Did you mean 'risk'?"),
        ("max_consumer_risk = 2\n" + LIMITS, r"[0.0001, 0.5]"),
        (LIMITS.replace("upper = 1.6", "uper = 1.6"), "Did you mean 'upper'?"),
        (LIMITS.replace("upper = 1.6", "upper = 1.3"), "is not below"),
        (LIMITS.replace('"n"', '"rho_0"'), "Did you mean 'rho0'?"),
        (LIMITS.replace('"brdf"', '"bdrf"'), "Did you mean 'brdf'?"),
        (LIMITS.replace("= 45", "= 95"), "[0, 89.95]"),
        (LIMITS.replace('"-60:60:20"', '"60:-60:20"'), "LO:HI:STEP"),
        (LIMITS.replace('"-60:60:20"', '"-60:60:0.01"'), "allowed are 5000"),
        (LIMITS.replace("glare & co", "index"), "given twice"),
        (LIMITS.replace('theta_r_deg = "-60:60:20"\n', ""), "theta_r_deg is missing"),
        (LIMITS.replace("upper = 10.0", 'upper = "10"'), "finite number"),
        (LIMITS.replace("10.0", "-1.0"), "upper = -1 is not allowed: a BRDF is above 0"),
        (DHR.replace("0.5", "50"), "upper = 50 is not allowed: a DHR is a share in [0, 1]: 50 %"),
        (DHR.replace("upper = 0.5", "lower = -0.2"), "lower = -0.2 is not allowed"),
        (DHR + "phi_r_deg = 90\n", "phi_r_deg does not go with quantity = 'dhr'"),
        (LIMITS.replace("upper = 10.0", "upper = 1" + "0" * 400), "limit[2].upper = 1000"),
        (LIMITS.replace("upper = 10.0", "upper = 0x" + "f" * 9000), "up to 64 bits"),
        ("max_consumer_risk = 1" + "0" * 400 + "\n" + LIMITS, "l.toml: max_consumer_risk = 1000"),
        *(
            (LIMITS.replace("= 45", f"= {value}"), f"theta_i_deg{said} is not allowed")
            for value, said in (
                ("[[1]]", ": [1] in its list"),
                ("[20, '30']", ": '30' in its list"),
                ("{a = 1}", " = {'a': 1}"),
                ("2020-01-01", " = datetime.date(2020, 1, 1)"),
                ("[[1, 2], [3]]", ": [1, 2] in its list"),
                ("true", " = True"),
                ("nan", " = nan"),
                ("[20, true]", ": True in its list"),
                ("[20, inf]", ": inf in its list"),
            )
        ),
        (LIMITS + "guard = 0.2\n", "guard of limit 'glare & co' belongs to rule = \"guard\""),
        (DIFFERENCE + "guard = 0.2\n", "guard of limit 'dn' belongs to rule = \"guard\""),
        ("max_consumer_risk = 0.05\nrule = 'simple'\n" + LIMITS, 'belongs to rule = "risk"'),
        ("max_producer_risk = 0.1\nrule = 'guard'\n" + LIMITS, 'does nothing under rule = "guard"'),
        ("guard_factor = 2\nrule = 'simple'\n" + LIMITS, 'belongs to rule = "guard"'),
        (DIFFERENCE, "--reference"),
        (DIFFERENCE.replace("0.002", "-1"), "tolerance = -1.0"),
    ],
)
def test_limits_that_are_wrong_are_refused(
    finished_run: Path, here: Path, capsys: pytest.CaptureFixture[str], text: str, said: str
) -> None:
    write(here / "l.toml", text)
    assert main(["conform", str(finished_run), "--limits", "l.toml", "--json", "c.json"]) == 2
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1
    assert not (here / "c.json").exists()


@pytest.mark.parametrize("name", ["run/summary.json", "run/../run/report.html", "l.toml"])
def test_no_file_that_is_read_is_replaced(
    finished_run: Path, here: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    shutil.copytree(finished_run, here / "run")
    write(here / "l.toml", LIMITS)
    before = (here / name).read_bytes()
    assert main(["conform", "run", "--limits", "l.toml", "--json", name]) == 2
    assert "would replace a file" in capsys.readouterr().err
    assert (here / name).read_bytes() == before
    assert main(["conform", "run", "--limits", "l.toml", "--json", "run/conformity.json"]) == 0


def test_reservations_go_with_their_rule_and_no_other() -> None:
    with pytest.raises(ConfigError, match=r'guard_factor belongs to rule = "guard"'):
        DecisionRule(guard_factor=2.0)
    with pytest.raises(ConfigError, match=r'max_producer_risk belongs to rule = "risk"'):
        DecisionRule(rule="simple", max_producer_risk=0.1)
    with pytest.raises(ConfigError, match=r"guard of limit 'index' belongs"):
        Specification(limits=(Limit(name="index", quantity="parameter", parameter="n", upper=2.0,
                                    guard=0.1),))  # fmt: skip
    row = {"name": "index", "parameter": "n", "upper": 2.0, "guard": 0.1}
    found = specification_from_table({"rule": "guard", "guard_factor": 2, "limit": [row]})
    assert (found.decision.guard_factor, found.limits[0].guard) == (2.0, 0.1)


@pytest.mark.parametrize("angle", [10**400, float("nan"), "20", True, (1.0,)])
def test_angles_of_a_limit_are_finite_numbers(angle: object) -> None:
    with pytest.raises(ConfigError, match=r"theta_i_deg: .* is not a finite number"):
        Limit(name="a", quantity="dhr", polarization="s", theta_i_deg=(angle,), upper=1.0)  # type: ignore[arg-type]


def test_a_run_is_no_reference_of_itself(finished_run: Path, here: Path, capsys) -> None:
    write(here / "l.toml", DIFFERENCE)
    run = str(finished_run)
    assert main(["conform", run, "--limits", "l.toml", "--reference", run]) == 2
    assert "the run itself" in capsys.readouterr().err


def test_fit_refuses_before_it_starts(
    small_csv: Path, here: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    write(here / "l.toml", DIFFERENCE)
    assert main(["fit", str(small_csv), "--out", "r", "--limits", "l.toml"]) == 2
    write(here / "d.toml", 'laboratroy = "x"\n')
    assert main(["fit", str(small_csv), "--out", "r", "--document", "d.toml"]) == 2
    assert "Did you mean 'laboratory'?" in capsys.readouterr().err
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr("pbrdf_bayes.io.print_pdf._ELSEWHERE", ())
    assert main(["fit", str(small_csv), "--out", "r", "--pdf"]) == 2
    assert "apt install chromium" in capsys.readouterr().err
    assert not (here / "r").exists()


def test_fit_judges_at_once_and_a_finished_run_too(small_csv: Path, here: Path) -> None:
    write(here / "l.toml", LIMITS)
    write(here / "d.toml", DOCUMENT)
    fit = ["fit", str(small_csv), "--accuracy", "draft", "--quiet", "--out", "r", "--limits"]
    assert main([*fit, "l.toml"]) == 0
    first = load_analysis(here / "r").summary
    assert first["conformity"]["verdict"] == "ACCEPT"
    assert "document" not in first
    assert main([*fit, "l.toml", "--resume", "--document", "d.toml"]) == 0
    second = load_analysis(here / "r").summary
    assert second["document"]["title"] == "Test report"
    assert second["conformity"] == first["conformity"]
    page = (here / "r" / "report.html").read_text(encoding="utf-8")
    assert main(["report", "r"]) == 0
    assert (here / "r" / "report.html").read_text(encoding="utf-8") == page


# ------------------------------------------------------------------------------------ the document


class Scripts(HTMLParser):
    """Counts what must not be made from the user's text."""

    def __init__(self) -> None:
        super().__init__()
        self.bad: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "script":
            self.bad.append(tag)


@pytest.fixture(scope="module")
def documented(run: Analysis, tmp_path_factory: pytest.TempPathFactory) -> str:
    from dataclasses import asdict

    path = write(tmp_path_factory.mktemp("doc") / "d.toml", DOCUMENT)
    wanted = read_limits(write(path.with_name("l.toml"), LIMITS))
    added = {"document": asdict(read_document(path)), "conformity": assess_conformity(run, wanted)}
    return render_report(Analysis({**run.summary, **added}, run.draws, run.config_toml))


def test_the_page_shows_what_was_given_and_names_what_was_not(documented: str) -> None:
    parser = Scripts()
    parser.feed(documented)
    assert parser.bad == []
    assert documented.count("</style>") == 1
    assert "Laboratory &lt;b&gt;one&lt;/b&gt;" in documented
    assert "2026-03-02 to 2026-03-05" in documented
    missing = re.search(r"Not given: ([^.]*)\.", documented)
    assert missing is not None
    assert {"sampling", "operator", "metrological traceability"} <= set(missing[1].split(", "))
    assert "End of report A-7" in documented
    assert "relate only to the item tested" in documented


def judged_page(run: Analysis, limits: str, path: Path, **items: str) -> tuple[dict, str]:
    found = assess_conformity(run, read_limits(write(path / "l.toml", limits)))
    added = {"conformity": found, **({"document": items} if items else {})}
    return found, render_report(Analysis({**run.summary, **added}, run.draws, run.config_toml))


@pytest.mark.parametrize(
    ("limits", "verdict", "look"),
    [(LIMITS, "ACCEPT", "PASS"), (LIMITS.replace("1.6", "1.41"), "REJECT", "FAIL")],
)
def test_the_verdict_on_limits_leads(
    run: Analysis, tmp_path: Path, limits: str, verdict: str, look: str
) -> None:
    found, page = judged_page(run, limits, tmp_path)
    fit = run.summary["verdict"]
    assert found["verdict"] == verdict
    assert f"<title>{verdict} · " in page
    stamps = re.findall(r'<div class="stamp ([^"]*)">.*?<span>(\w+)</span><small>(\w+)', page)
    assert stamps == [(look, verdict, "limits"), (f"{fit} second", fit, "fit")]
    assert page.index('<p class="conforms') < page.index('<p class="headline')
    alone = render_report(run)
    assert f"<title>{fit} · " in alone
    assert re.findall(r'<div class="stamp ([^"]*)">', alone) == [fit]


@pytest.mark.parametrize(
    ("agreed", "rule", "said"),
    [
        ("simple acceptance per contract", "risk", "simple acceptance; the verdict here follows"),
        ("simple acceptance per contract", "simple", ""),
        ("Shared risk", "simple", ""),
        ("shared risk, without any guard band", "risk", "speaks of simple acceptance;"),
        ("Guard band of 2 u, simple acceptance without guard band for n", "risk",
         "speaks of simple acceptance and guard bands"),
        ("acceptance without guard band", "guard", "speaks of simple acceptance;"),
        ("guarded acceptance, risk of 2.5 %", "risk", ""),
        ("wie vereinbart", "guard", ""),
    ],
)  # fmt: skip
def test_the_rule_agreed_upon_and_the_one_applied(
    run: Analysis, tmp_path: Path, agreed: str, rule: str, said: str
) -> None:
    _, page = judged_page(run, f'rule = "{rule}"\n{LIMITS}', tmp_path, decision_rule=agreed)
    applied = {"risk": "largest specific risk", "simple": "simple acceptance (clause 8.2)",
               "guard": "guard bands (clause 8.3)"}[rule]  # fmt: skip
    section = page[page.index('<section id="conformity"') : page.index('<section id="parameters"')]
    assert f"<dt>Decision rule agreed upon</dt><dd>{agreed}</dd>" in section
    assert re.search(r"<dt>Decision rule applied</dt><dd>[^<]*" + re.escape(applied), section)
    assert page.count("The decision rule agreed upon speaks of") == 2 * bool(said)
    assert said in section


def test_curves_that_are_not_drawn_are_counted(run: Analysis, tmp_path: Path) -> None:
    many = LIMITS.replace("theta_i_deg = 45", 'theta_i_deg = "5:65:5"')
    found, page = judged_page(run, many, tmp_path)
    assert len(set(found["limits"][1]["theta_i_deg"])) == 13
    assert "The first 12 of 13 curves are drawn" in page
    assert "curves are drawn" not in judged_page(run, LIMITS, tmp_path)[1]


def test_a_report_without_a_number_has_that_of_its_run(run: Analysis) -> None:
    page = render_report(run)
    number = run_number(run.summary)
    assert re.fullmatch("[0-9a-f]{10}", number)
    assert f"End of report of run {number}" in page
    assert css_string(f"Report of run {number}") in page
    for key, value in (("sample", "x"), ("seed", 9), ("created_utc", "2026-01-01T00:00:00Z")):
        assert run_number({**run.summary, key: value}) != number


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({}, "no item is given"),
        ({"title": "x" * 201}, "allowed are 200"),
        ({"note": "x" * 2001}, "allowed are 2000"),
        ({"title": "a\nb"}, "line break"),
        ({"note": "a\x1bb"}, "cannot be printed"),
        ({"note": "a\u202eb"}, "cannot be printed"),
        ({"note": "a\u2028b"}, "cannot be printed"),
        ({"note": "a\u200bb"}, "cannot be printed"),
        ({"note": "a\ud800b"}, "cannot be printed"),
        ({"report_number": "A-{smaple}"}, "{smaple} is not known. Did you mean '{sample}'?"),
        ({"item_id": "{run} {run}"}, "{run} is there twice"),
        ({"date_issued": "5 March"}, "2026-03-02"),
        ({"date_measured": "2026-03-05/2026-03-02"}, "from/to"),
        ({"date_received": "2026-03-05", "date_issued": "2026-03-04"}, "is before"),
        ({"date_measured": "2026-03-01/2026-03-05", "date_issued": "2026-03-04"}, "is before"),
    ],
)
def test_items_that_are_wrong_are_refused(keys: dict[str, str], said: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(said)):
        Document(**keys)


def test_items_that_are_another_in_every_report(run: Analysis) -> None:
    wanted = Document(title="{sample}", report_number="A-{sample}-{run}", item_id="{sample}",
                      note="{sample}")  # fmt: skip
    found = fill_in(wanted, {**run.summary, "sample": "{run}"})
    number = run_number({**run.summary, "sample": "{run}"})
    assert (found["title"], found["report_number"]) == ("{run}", f"A-{{run}}-{number}")
    assert (found["item_id"], found["note"]) == ("{run}", "{sample}")


@pytest.mark.parametrize(
    ("items", "samples", "said"),
    [
        ({"report_number": "A-7"}, ["a"], ""),
        ({"report_number": "A-7"}, ["a", "b"], "would stand on 2 reports: of 'a', 'b'. Put {sample"),
        ({"report_number": "A-{sample}"}, ["a", "b"], ""),
        ({"report_number": "A-{sample}"}, ["a", "b", "a"], "of 'a', 'a'. Put {run} in it"),
        ({"report_number": "A-{run}"}, ["a", "b", "a"], ""),
        ({"item_id": "7"}, ["a", "a"], ""),
        ({"item_id": "7"}, ["a", "b"], "item_id = '7' would stand on 2 reports"),
        ({"title": "paint"}, ["a", "b"], ""),
    ],
)  # fmt: skip
def test_reports_of_a_batch_have_numbers_of_their_own(
    items: dict[str, str], samples: list[str], said: str
) -> None:
    if not said:
        refuse_shared_items(Document(**items), samples)
        return
    with pytest.raises(ConfigError, match=re.escape(said)):
        refuse_shared_items(Document(**items), samples)


def test_a_batch_refuses_one_number_for_two_reports(
    small_csv: Path, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = small_csv.read_text(encoding="utf-8")
    name = text.splitlines()[1].split(",")[0]
    rows = text.replace(f"\n{name},", "\nother,").split("\n", 1)[1]
    write(here / "two.csv", text + rows.replace("0.0", "0.1", 1))
    write(here / "d.toml", 'report_number = "A-7"\n')
    assert main(["batch", "two.csv", "--out", "b", "--document", "d.toml"]) == 2
    assert "report_number = 'A-7' would stand on 2 reports" in capsys.readouterr().err
    assert not (here / "b").exists()


def test_a_file_of_items(tmp_path: Path) -> None:
    path = write(tmp_path / "d.toml", "[document]\n" + DOCUMENT)
    assert read_document(path).date_issued == "2026-03-09"
    write(
        path, 'environment = "(23\u202f±\u00a02) °C,\u2003dry\u3000air"\nnote = """a\u2009b\nc"""\n'
    )
    assert read_document(path).environment == "(23\u00a0±\u00a02) °C, dry air"
    assert read_document(path).note == "a b\nc"
    write(path, "note = 3\n")
    with pytest.raises(ConfigError, match=r"d\.toml: note = 3 is not allowed: give text in quotes"):
        read_document(path)


# ------------------------------------------------------------------------------------------ the PDF


@pytest.mark.browser
def test_every_page_says_its_number_and_the_report(documented: str) -> None:
    pypdf = pytest.importorskip("pypdf")
    try:
        find_browser()
    except ConfigError as error:
        pytest.skip(str(error))
    pages = pypdf.PdfReader(BytesIO(print_pdf(documented))).pages
    for number, page in enumerate(pages, start=1):
        width, height = (float(x) for x in page.mediabox[2:])
        assert (width, height) == pytest.approx((595.3, 841.9), abs=1.0)
        text = page.extract_text()
        assert f"{number} / {len(pages)}" in text
        assert "Report A-7 </style>" in text.replace("\n", " ")
        assert len(text) > 150, f"page {number} is blank"
    assert "End of report" in pages[-1].extract_text()


@pytest.mark.browser
def test_a_browser_that_fails_is_told(
    finished_run: Path, here: Path, capsys: pytest.CaptureFixture[str], monkeypatch,
    make_executable: Callable[[str, str], Path],
) -> None:  # fmt: skip
    """The run stays complete and an earlier PDF does not outlive its report."""
    shutil.copytree(finished_run, here / "run")
    write(here / "run" / "report.pdf", "old")
    folder = make_executable("chromium", "echo 'cannot start' >&2; exit 1")
    monkeypatch.setenv("PATH", str(folder))
    assert main(["report", "run", "--pdf"]) == 2
    error = capsys.readouterr().err
    assert "cannot start" in error
    assert "pbrdf-bayes report run --pdf" in error
    assert not (here / "run" / "report.pdf").exists()
    assert (here / "run" / "report.html").is_file()


@pytest.fixture
def make_executable(tmp_path: Path) -> Callable[[str, str], Path]:
    def make(name: str, script: str) -> Path:
        folder = tmp_path / "bin"
        folder.mkdir()
        path = write(folder / name, f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        return folder

    return make
