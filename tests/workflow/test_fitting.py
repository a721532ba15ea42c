"""From a measurement to a run and back: what is stored is what was computed."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from arviz_stats import ess, rhat
from arviz_stats import summary as arviz_summary

import pbrdf_bayes as pb
from pbrdf_bayes.analysis import Analysis, load_analysis
from pbrdf_bayes.errors import RunFolderError
from pbrdf_bayes.inference.posterior import Posterior
from pbrdf_bayes.inference.prediction.bands import Targets
from pbrdf_bayes.io.run_folder import save_analysis, validate_summary
from pbrdf_bayes.measurement import select_scans
from pbrdf_bayes.records.values import plain
from pbrdf_bayes.results import QUANTILES
from pbrdf_bayes.words import say
from pbrdf_bayes.workflow.curves import angles_between
from pbrdf_bayes.workflow.fitting import (
    Observer,
    fit_file,
)
from pbrdf_bayes.workflow.paperwork import Paperwork, amend_folder
from pbrdf_bayes.workflow.prediction import predict_from_analysis

NAMES = ["n", "k", "sigma_n0", "rho0", "s_rel_s", "s_rel_p", "tau", "ell_deg", "u_dhr"]
DRAFT = pb.RunConfig(accuracy="draft")


@pytest.fixture(scope="module")
def measurement(small_csv: Path) -> pb.Measurement:
    return pb.read_measurement(small_csv)


@pytest.fixture(scope="module")
def stages() -> list[str]:
    """Stages that the fit of `analysis` told."""
    return []


@pytest.fixture(scope="module")
def analysis(measurement: pb.Measurement, stages: list[str]) -> Analysis:
    """The fit in memory that `finished_run` has on disk, made with an observer."""
    return pb.fit(measurement, DRAFT, seed=1, observer=Observer(stage=stages.append))


@pytest.fixture(scope="module")
def loaded(finished_run: Path) -> Analysis:
    return load_analysis(finished_run)


@pytest.fixture(scope="module")
def sampled(measurement: pb.Measurement) -> Analysis:
    """With chains: accuracy standard."""
    return pb.fit(measurement, pb.RunConfig(holdout=False), seed=2)


@pytest.fixture(scope="module")
def provisional(measurement: pb.Measurement) -> Analysis:
    """A budget that is far too small for a tenfold target."""
    config = pb.RunConfig(accuracy="reference", holdout=False, max_steps=100)
    return pb.fit(measurement, config, seed=1)


# ------------------------------------------------------------------------- the same from disk


@pytest.mark.slow
@pytest.mark.parametrize("name", ["sampled", "provisional"])
def test_a_report_from_memory_is_the_one_from_disk(
    name: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    from_memory = pb.render_report(request.getfixturevalue(name))
    save_analysis(request.getfixturevalue(name), tmp_path, report=from_memory, log="")
    assert pb.render_report(load_analysis(tmp_path)) == from_memory


def test_a_report_from_disk_is_the_one_made_from_memory(finished_run: Path, tmp_path: Path) -> None:
    folder = Path(shutil.copytree(finished_run, tmp_path / "run"))
    before = (folder / "report.html").read_bytes()
    (folder / "report.html").unlink()
    assert amend_folder(folder, Paperwork()) == folder / "report.html"
    assert (folder / "report.html").read_bytes() == before


def test_draws_in_memory_and_on_disk_are_the_same(
    analysis: Analysis, loaded: Analysis, stages: list[str]
) -> None:
    """And they do not depend on who watches the fit."""
    assert stages[:3] == ["check", "optimise", "sample"]
    for name in analysis.draws.children:
        xr.testing.assert_identical(
            loaded.draws[name].to_dataset(), analysis.draws[name].to_dataset()
        )


def test_a_stored_run_has_the_posterior_that_was_fitted(
    analysis: Analysis, loaded: Analysis, measurement: pb.Measurement
) -> None:
    x = np.stack([analysis.draws["posterior"][name].values[0, :50] for name in NAMES], axis=1)
    again, fitted = loaded.posterior(), analysis.posterior()
    assert again.log_prob(x).tobytes() == fitted.log_prob(x).tobytes()
    lp = again.log_prob_coordinates(again.to_coordinates(x))
    np.testing.assert_allclose(lp, analysis.draws["sample_stats"]["lp"].values[0, :50], rtol=1e-9)
    assert (loaded.measurement.scans, loaded.measurement.sha256) == (
        measurement.scans, measurement.sha256,
    )  # fmt: skip


def test_the_summary_validates_and_matches_the_draws(analysis: Analysis) -> None:
    summary = plain(analysis.summary)
    validate_summary(summary, where="memory")
    assert json.loads(json.dumps(summary, allow_nan=False)) == summary
    assert list(summary["parameters"]) == NAMES
    group = analysis.draws["posterior"]
    for name, row in summary["parameters"].items():
        values = group[name].values.ravel()
        assert row["mean"] == pytest.approx(values.mean(), rel=1e-12)
        assert row["sd"] == pytest.approx(values.std(ddof=1), rel=1e-12)
        wanted = np.quantile(values, [0.025, 0.05, 0.5, 0.95, 0.975])
        found = [row[key] for key in ("q025", "q05", "median", "q95", "q975")]
        np.testing.assert_allclose(found, wanted, rtol=1e-12)
        assert {"map", "ess_bulk", "ess_tail", "rhat", "mcse_mean"} <= set(row)
    matrix = np.array(summary["correlation"]["matrix"])
    flat = np.stack([group[name].values.ravel() for name in NAMES])
    np.testing.assert_allclose(matrix, np.corrcoef(flat), atol=1e-12)


def test_the_summary_says_where_it_comes_from(
    analysis: Analysis, measurement: pb.Measurement
) -> None:
    summary = analysis.summary
    assert summary["input"]["sha256"] == measurement.sha256
    assert summary["input"]["file"] == "small_simulated.csv"
    assert summary["input"]["n_brdf"] == 132
    assert summary["input"]["n_dhr"] == 16
    assert summary["seed"] == 1
    assert summary["config"]["accuracy"] == "draft"
    assert summary["versions"]["pbrdf-bayes"] == pb.__version__
    assert {"numpy", "scipy", "numba", "emcee", "nlopt"} <= set(summary["versions"])
    assert summary["effects"] == []
    assert summary["line_shape"] == "lorentzian"


def test_a_well_specified_fit_passes(analysis: Analysis) -> None:
    """2 % noise is 0.0087 dex: 132 rows with 4 parameters give it within 20 %."""
    summary = analysis.summary
    assert summary["status"] == "done"
    assert summary["verdict"] == "PASS", summary["headline"]
    assert summary["fit"]["rms_dex_best"]["overall"] == pytest.approx(0.0087, rel=0.2)
    assert summary["fit"]["rms_dex"]["overall"] >= summary["fit"]["rms_dex_best"]["overall"]
    assert set(summary["fit"]["rms_dex"]["scans"]) == {
        "s 20 deg",
        "p 20 deg",
        "s 60 deg",
        "p 60 deg",
    }
    truth = dict(zip(NAMES, pb.GREEN_PAINT.as_array(), strict=False))
    for name, value in truth.items():
        row = summary["parameters"][name]
        assert abs(row["mean"] - value) < 5.0 * row["sd"], name
        assert row["identified"]


def test_residuals_are_those_of_the_public_model(
    analysis: Analysis, measurement: pb.Measurement
) -> None:
    best = analysis.summary["fit"]["rms_dex_best"]
    parameters = pb.Parameters(**best["parameters"])
    squares = 0.0
    for scan in measurement.scans:
        model = pb.brdf(
            parameters, scan.theta_i_deg, measurement.brdf.theta_r_deg[scan.rows], scan.polarization
        )
        squares += float(np.sum(np.log10(measurement.brdf.value[scan.rows] / model) ** 2))
    # draft quadrature: 1e-4 relative is 4e-5 dex
    assert best["overall"] == pytest.approx(np.sqrt(squares / len(measurement.brdf)), abs=5e-5)


# ------------------------------------------------------------------------ files others can read


def test_posterior_nc_is_an_arviz_tree(finished_run: Path) -> None:
    with xr.open_datatree(finished_run / "posterior.nc") as tree:
        groups = set(tree.children)
        assert {
            "posterior", "sample_stats", "posterior_predictive", "observed_data", "constant_data"
        } <= groups  # fmt: skip
        posterior = tree["posterior"]
        assert list(posterior.data_vars) == NAMES
        assert posterior["n"].dims == ("chain", "draw")
        n_obs = tree["observed_data"]["brdf"].size
        assert tree["posterior_predictive"]["brdf"].dims == ("chain", "draw", "brdf_obs")
        assert tree["posterior_predictive"].sizes["brdf_obs"] == n_obs == 132
        assert tree["constant_data"]["brdf_theta_r_deg"].size == n_obs
        assert tree["sample_stats"]["lp"].dims == ("chain", "draw")


@pytest.mark.slow
def test_arviz_works_on_the_stored_tree(sampled: Analysis, tmp_path: Path) -> None:
    """summary, ess and rhat of another package on the file, equal to ours where they are the same."""
    path = tmp_path / "posterior.nc"
    sampled.draws.to_netcdf(path, engine="h5netcdf")
    with xr.open_datatree(path) as tree:
        tree.load()
    table = arviz_summary(tree, round_to="none")
    assert list(table.index) == NAMES
    for name in NAMES:
        row = sampled.summary["parameters"][name]
        assert float(table.loc[name, "mean"]) == pytest.approx(row["mean"], rel=1e-9)
        # divided by n there, by n - 1 here
        assert float(table.loc[name, "sd"]) == pytest.approx(row["sd"], rel=1e-4)
    sizes, agreement = ess(tree), rhat(tree)
    for name in NAMES:
        # chains are walkers, thinned: fewer draws than our estimate saw, of the same order
        assert 0.2 < float(sizes[name]) / sampled.summary["parameters"][name]["ess_bulk"] < 5.0
        assert float(agreement[name]) < 1.05


@pytest.mark.slow
def test_chains_are_walkers_of_ensembles(sampled: Analysis) -> None:
    posterior = sampled.draws["posterior"]
    assert posterior.attrs["sampling"] == "emcee"
    assert posterior.sizes["chain"] == 4 * 32
    assert np.bincount(posterior["ensemble"].values).tolist() == [32] * 4
    sampling = sampled.summary["sampling"]
    assert sampling["n_ensembles"] == 4
    assert sampling["n_walkers"] == 32
    for row in sampled.summary["parameters"].values():
        assert row["rhat"] < 1.01
        assert min(row["ess_bulk"], row["ess_tail"]) >= 1000


@pytest.mark.slow
def test_psis_and_the_sampler_agree(analysis: Analysis, sampled: Analysis) -> None:
    """Two methods, two seeds, two quadratures: means within five joint standard errors."""
    for name in NAMES:
        a, b = (run.summary["parameters"][name] for run in (analysis, sampled))
        error = np.hypot(a["mcse_mean"], b["mcse_mean"])
        assert abs(a["mean"] - b["mean"]) < 5.0 * error, name
        ratio = a["sd"] / b["sd"]
        n = min(a["ess_bulk"], b["ess_bulk"])
        assert abs(ratio - 1.0) < 5.0 * np.sqrt(2.0 / n), name


def test_curves_cover_measured_and_other_angles(analysis: Analysis) -> None:
    curves = analysis.draws["curves"]
    np.testing.assert_array_equal(curves["quantile"].values, QUANTILES)
    keys = set(
        zip(
            curves["curve_polarization"].values.tolist(), curves["curve_theta_i_deg"].values.tolist(),
            curves["curve_measured"].values.tolist(), strict=True,
        )
    )  # fmt: skip
    assert {("s", 20.0, True), ("p", 20.0, True), ("s", 60.0, True), ("p", 60.0, True)} <= keys
    assert sum(not measured for *_, measured in keys) >= 2
    bands = curves["model_band"].values
    assert np.all(np.diff(bands, axis=-1) >= 0.0)
    # a stored curve is the public model at the MAP
    best = {name: analysis.summary["parameters"][name]["map"] for name in NAMES[:4]}
    i = next(k for k in range(curves.sizes["curve"]) if curves["curve_theta_i_deg"][k] == 60.0)
    wanted = pb.brdf(
        pb.Parameters(**best), 60.0, curves["theta_r_deg"].values,
        str(curves["curve_polarization"].values[i]),
    )  # fmt: skip
    np.testing.assert_allclose(curves["map"].values[i], wanted, rtol=1e-4)  # draft: 10 rtol


def test_most_replicated_readings_look_like_the_data(
    analysis: Analysis, measurement: pb.Measurement
) -> None:
    """Posterior predictive: each reading is a 2 % matter, the stored ones are single precision."""
    replicated = analysis.draws["posterior_predictive"]["brdf"].values[0]
    ratio = np.log(replicated / measurement.brdf.value)
    assert 0.015 < ratio.std() < 0.05
    assert abs(ratio.mean()) < 0.01


# ------------------------------------------------------------------------------- other outcomes


@pytest.mark.slow
def test_a_run_that_does_not_converge_is_kept_and_marked(
    provisional: Analysis, tmp_path: Path
) -> None:
    summary = provisional.summary
    assert summary["status"] == "not_converged"
    assert summary["verdict"] == "FAIL"
    assert summary["headline"] == say("headline.not_converged")
    assert summary["diagnostics"]["ess"]["verdict"] == "FAIL"
    report = pb.render_report(provisional)
    assert "did not converge" in report
    save_analysis(provisional, tmp_path, report=report, log="")
    assert load_analysis(tmp_path).summary["status"] == "not_converged"


def test_dhr_alone(measurement: pb.Measurement) -> None:
    alone = select_scans(measurement, np.zeros(4, bool), dhr=True)
    found = pb.fit(alone, DRAFT, seed=1)
    assert found.summary["status"] == "done"
    assert found.summary["fit"]["rms_dex_best"]["overall"] is None or np.isnan(
        found.summary["fit"]["rms_dex_best"]["overall"]
    )
    assert not found.summary["parameters"]["rho0"]["identified"]
    assert found.summary["holdout"] is None
    assert "rho0" in found.summary["diagnostics"]["identifiability"]["statement"]
    pb.render_report(found)


def test_a_fixed_parameter_is_assumed_and_not_identified(measurement: pb.Measurement) -> None:
    config = replace(DRAFT, priors={"n": {"kind": "fixed", "value": 1.526}}, holdout=False)
    summary = pb.fit(measurement, config, seed=1).summary
    n = summary["parameters"]["n"]
    assert (n["kind"], n["identified"], n["sd"]) == ("fixed", False, 0.0)
    assert n["contraction"] is None
    assert summary["parameters"]["k"]["identified"]
    found = summary["applicability"]
    assert found["verdict"] == "applies"
    assert found["caveats"] == [
        f"Not {say('applicability.untested', why=say('applicability.not_asked'))[4:]}.",
        say("assumed.fixed", name="n", value=1.526),
    ]


def test_one_unpolarised_scan_alone() -> None:
    """Priors of n and k that a laboratory might bring; the data add nothing to them."""
    m = pb.simulate_measurement(
        pb.GREEN_PAINT, seed=4, theta_i_deg=(30.0,), theta_r_deg=np.linspace(-60, 60, 25),
        polarizations=("u",), dhr_theta_i_deg=(),
    )  # fmt: skip
    priors = {
        "n": {"kind": "normal", "mean": 1.5, "sd": 0.01},
        "k": {"kind": "normal", "mean": 0.2, "sd": 0.01},
    }
    found = pb.fit(m, replace(DRAFT, priors=priors), seed=1)
    assert found.summary["status"] == "done"
    assert not found.summary["parameters"]["n"]["identified"]
    assert found.summary["diagnostics"]["identifiability"]["verdict"] == "WARN"
    assert found.summary["holdout"] is None
    words = set(found.draws["curves"]["curve_polarization"].values.tolist())
    assert words == {"s", "p", "u"}
    pb.render_report(found)


@pytest.mark.parametrize(
    "config",
    [
        {"prior": "dielectric", "brdf_floor": 1e-6, "u_brdf_cal": 0.05},
        {"prior": "metal", "brdf_scale": "relative", "predict_theta_i_deg": (5.0, 75.0),
         "priors": {"n": {"kind": "normal", "mean": 1.5, "sd": 0.05}}},
    ],
    ids=lambda config: ",".join(config),
)  # fmt: skip
def test_choices_of_a_run_are_fitted_and_recorded(measurement: pb.Measurement, config: Any) -> None:
    found = pb.fit(measurement, pb.RunConfig(accuracy="draft", holdout=False, **config), seed=1)
    assert found.summary["status"] == "done"
    for key, value in config.items():
        stored = found.summary["config"][key]
        assert stored == (list(value) if isinstance(value, tuple) else value)
    if "predict_theta_i_deg" in config:
        angles = set(found.draws["curves"]["curve_theta_i_deg"].values.tolist())
        assert {5.0, 75.0} <= angles
    if config.get("brdf_scale") == "relative":
        wide, narrow = (found.summary["parameters"][n]["sd"] for n in ("rho0", "u_dhr"))
        assert wide > 0.0 < narrow


@pytest.mark.parametrize(
    ("measured", "wanted"),
    [
        ([], (20.0, 45.0, 70.0)), ([20.0, 60.0], (10.0, 40.0, 70.0)),
        ([0.0, 20.0, 40.0, 60.0, 80.0], (10.0, 30.0, 50.0)), ([0.0, 2.0, 80.0], (41.0,)),
    ],
)  # fmt: skip
def test_angles_between_are_the_middles_of_the_widest_gaps(
    measured: list[float], wanted: tuple[float, ...]
) -> None:
    assert angles_between(measured) == wanted


def test_points_where_the_model_gives_nan_are_rejected_counted_and_told(
    measurement: pb.Measurement, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In summary, log, verdicts and report, with their parameters; no draw lies there."""
    log_likelihood = Posterior.log_likelihood

    def with_a_hole(self: Posterior, x: Any) -> Any:
        values = log_likelihood(self, x)
        values[np.asarray(x)[:, 0] > 1.53] = np.nan
        return values

    monkeypatch.setattr(Posterior, "log_likelihood", with_a_hole)
    csv = tmp_path / "small.csv"
    pb.write_tidy_csv(measurement, csv)
    run = fit_file(csv, replace(DRAFT, holdout=False), out=tmp_path / "run", seed=1)
    found = load_analysis(run.folder)
    rejected = found.summary["rejected"]
    assert rejected["n"] > 100
    assert len(rejected["examples"]) == 5
    assert all(list(point) == NAMES and point["n"] > 1.53 for point in rejected["examples"])
    assert float(found.draws["posterior"]["n"].max()) <= 1.53
    row = found.summary["diagnostics"]["not_finite"]
    assert (row["value"], row["verdict"]) == (rejected["n"], "WARN")
    first = f"n = {rejected['examples'][0]['n']:.6g}, k = "
    assert first in row["statement"]
    assert first in (run.folder / "report.html").read_text(encoding="utf-8")
    log = (run.folder / "log.txt").read_text(encoding="utf-8")
    assert f"{rejected['n']} points rejected: the model gave no finite density" in log
    assert str(rejected["examples"][0]) in log


# ------------------------------------------------------------------------------------- prediction


def targets(theta_i: float, theta_r: list[float], q: str = "s") -> Targets:
    n = len(theta_r)
    return Targets(np.full(n, q), np.full(n, theta_i), np.array(theta_r), np.zeros(n))


def test_prediction_at_a_stored_angle_is_the_stored_curve(loaded: Analysis) -> None:
    """Other draws are picked: the median agrees within the width of the model band."""
    curves = loaded.draws["curves"]
    angles = curves["theta_r_deg"].values.tolist()
    i = next(
        k for k in range(curves.sizes["curve"])
        if curves["curve_theta_i_deg"][k] == 20.0 and curves["curve_polarization"][k] == "s"
    )  # fmt: skip
    bands = predict_from_analysis(loaded, targets(20.0, angles))
    stored = curves["model_band"].values[i]
    np.testing.assert_allclose(bands.at_map, curves["map"].values[i], rtol=1e-12)
    width = stored[:, -1] - stored[:, 0]
    assert np.all(np.abs(bands.model[:, 2] - stored[:, 2]) < 0.3 * width)


def test_prediction_of_dhr(loaded: Analysis) -> None:
    bands = predict_from_analysis(loaded, targets(45.0, [np.nan], "p"))
    wanted = float(pb.dhr(pb.GREEN_PAINT, 45.0, "p"))
    assert bands.predictive[0, 0] < wanted < bands.predictive[0, -1]


@pytest.mark.parametrize(
    ("theta_i", "theta_r"),
    [(90.0, 0.0), (-1.0, 0.0), (np.nan, 0.0), (20.0, 90.5), (20.0, -120.0), (20.0, np.inf)],
)
def test_prediction_outside_the_domain_is_refused(
    theta_i: float, theta_r: float, loaded: Analysis
) -> None:
    name = "theta_r_deg" if 0.0 <= theta_i < 89.95 else "theta_i_deg"
    with pytest.raises(pb.PbrdfError, match=name):
        predict_from_analysis(loaded, targets(theta_i, [0.0, theta_r]))


# ------------------------------------------------------------------------------------------ resume


def test_an_existing_run_is_refused_without_resume(finished_run: Path, small_csv: Path) -> None:
    before = {p.name: p.stat().st_mtime_ns for p in finished_run.iterdir()}
    with pytest.raises(RunFolderError, match=r"not empty \(config\.toml.*Add --resume, or give"):
        fit_file(small_csv, DRAFT, out=finished_run)
    assert {p.name: p.stat().st_mtime_ns for p in finished_run.iterdir()} == before


def test_resume_of_a_finished_run_keeps_it(finished_run: Path, small_csv: Path) -> None:
    before = {p.name: p.stat().st_mtime_ns for p in finished_run.iterdir()}
    run = fit_file(small_csv, DRAFT, out=finished_run, resume=True)
    assert (run.folder, run.status, run.verdict) == (finished_run, "done", "PASS")
    assert {p.name: p.stat().st_mtime_ns for p in finished_run.iterdir()} == before


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ("seed", r"seed: 1 there, 2 now"),
        ("config", r"accuracy: 'draft' there, 'standard' now"),
        ("priors", r"priors: \{\} there"),
        ("data", r"data: '[0-9a-f]+' there, '[0-9a-f]+' now"),
        ("sample", r"sample: 'small_simulated' there, 'other_simulated' now"),
    ],
)
def test_resume_of_another_run_is_refused_with_a_diff(
    change: str, message: str, finished_run: Path, small_csv: Path, tmp_path: Path
) -> None:
    csv, config, seed = small_csv, DRAFT, 1
    text = small_csv.read_text(encoding="utf-8")
    if change == "seed":
        seed = 2
    elif change == "config":
        config = pb.RunConfig()
    elif change == "priors":
        config = replace(DRAFT, priors={"n": {"kind": "uniform"}})
    else:
        old, new = ("small_simulated", "other_simulated") if change == "sample" else ("0.1", "0.2")
        csv = tmp_path / "other.csv"
        csv.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(RunFolderError, match=message) as caught:
        fit_file(csv, config, out=finished_run, seed=seed, resume=True)
    assert "Give another --out" in str(caught.value)


def test_a_file_in_place_of_the_folder_is_refused(small_csv: Path, tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_text("mine", encoding="utf-8")
    with pytest.raises(RunFolderError, match=r"is a file; --out is the folder of the run"):
        fit_file(small_csv, DRAFT, out=path)
    assert path.read_text(encoding="utf-8") == "mine"


def raising(error: BaseException) -> Callable[[str], None]:
    def stage(name: str) -> None:
        if name == "optimise":
            raise error

    return stage


def test_the_default_folder_is_below_reports(
    small_csv: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MemoryError):
        fit_file(small_csv, DRAFT, observer=Observer(stage=raising(MemoryError())))
    (folder,) = (tmp_path / "reports" / "small_simulated").iterdir()
    assert [p.name for p in folder.iterdir()] == [".lock"]


@pytest.mark.parametrize("error", [KeyboardInterrupt(), MemoryError()])
def test_a_fit_that_breaks_leaves_no_run(
    error: BaseException, small_csv: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "run"
    for _ in range(2):  # the lock went with the fit that broke
        with pytest.raises(type(error)):
            fit_file(small_csv, DRAFT, out=folder, observer=Observer(stage=raising(error)))
        assert [p.name for p in folder.iterdir()] == [".lock"]
